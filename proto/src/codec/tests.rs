use std::time::Instant;

use proptest::prelude::*;

use super::*;

const LAYOUTS: [Layout; 9] = [
    Layout::R8,
    Layout::Rgb8,
    Layout::Rgba8,
    Layout::Rg16,
    Layout::Rgba16,
    Layout::R32,
    Layout::Rg32,
    Layout::Rgb32,
    Layout::Rgb9e5,
];

fn round_trip(layout: Layout, raw: &[u8]) {
    if let Some(packed) = pack(layout, raw).unwrap() {
        assert!(packed.len() < raw.len());
        assert_eq!(unpack(layout, &packed, raw.len()).unwrap(), raw, "{layout:?}");
    }
}

/// Bytes that pack: a ramp with steps, as images have.
fn ramp(layout: Layout, texels: usize) -> Vec<u8> {
    (0..texels * layout.texel_bytes()).map(|i| (i / 97 + i % layout.texel_bytes() * 31) as u8).collect()
}

proptest! {
    #[test]
    fn noise_survives_also_where_it_cannot_shrink(
        which in 0usize..LAYOUTS.len(),
        texels in 0usize..600,
        seed in proptest::collection::vec(any::<u8>(), 7200),
    ) {
        let layout = LAYOUTS[which];
        let raw = &seed[..texels * layout.texel_bytes()];
        round_trip(layout, raw);
        // Whether zstd saves bytes or not, the split is its own inverse.
        let joined = match layout {
            Layout::R8 => join::<1, 1>(&split::<1, 1>(raw)),
            Layout::Rgb8 => join::<3, 1>(&split::<3, 1>(raw)),
            Layout::Rgba8 => join::<4, 1>(&split::<4, 1>(raw)),
            Layout::Rg16 => join::<2, 2>(&split::<2, 2>(raw)),
            Layout::Rgba16 => join::<4, 2>(&split::<4, 2>(raw)),
            Layout::R32 => join::<1, 4>(&split::<1, 4>(raw)),
            Layout::Rg32 => join::<2, 4>(&split::<2, 4>(raw)),
            Layout::Rgb32 => join::<3, 4>(&split::<3, 4>(raw)),
            Layout::Rgb9e5 => join_rgb9e5(&split_rgb9e5(raw)),
        };
        prop_assert_eq!(&joined[..], raw);
    }

    #[test]
    fn damage_is_an_error_and_never_a_panic(
        which in 0usize..LAYOUTS.len(),
        at in any::<prop::sample::Index>(),
        flip in 1u8..=255,
        keep in any::<prop::sample::Index>(),
    ) {
        let layout = LAYOUTS[which];
        let raw = ramp(layout, 1000);
        let packed = pack(layout, &raw).unwrap().expect("a ramp packs");
        let mut damaged = packed.to_vec();
        let at = at.index(damaged.len());
        damaged[at] ^= flip;
        // Some bits of zstd's own header mean nothing; all others break the checksum.
        if let Ok(unpacked) = unpack(layout, &damaged, raw.len()) {
            prop_assert_eq!(&unpacked[..], &raw[..]);
        }
        prop_assert!(unpack(layout, &packed[..keep.index(packed.len())], raw.len()).is_err());
    }
}

#[test]
fn every_layout_survives_ramps_of_odd_sizes_and_a_single_texel() {
    for layout in LAYOUTS {
        for texels in [1, 2, 3, 17, 31 * 7, 640 * 3 + 1] {
            round_trip(layout, &ramp(layout, texels));
        }
        assert!(pack(layout, &[]).unwrap().is_none());
    }
}

#[test]
fn a_false_size_is_refused_before_memory_is_allocated() {
    let raw = ramp(Layout::R32, 5000);
    let packed = pack(Layout::R32, &raw).unwrap().unwrap();
    for claimed in [0, 4, raw.len() - 4, raw.len() + 4, raw.len() + 1] {
        assert!(unpack(Layout::R32, &packed, claimed).is_err(), "{claimed}");
    }
    // A bomb: 64 MiB of zeros in a few kilobytes, announced as four.
    let zeros = vec![0; 64 << 20];
    let bomb = pack(Layout::R8, &zeros).unwrap().unwrap();
    assert!(bomb.len() < 16 << 10);
    assert!(unpack(Layout::R8, &bomb, 4096).is_err());
    assert!(unpack(Layout::R8, b"not zstd at all", 15).is_err());
    assert!(pack(Layout::R32, &[1, 2, 3]).is_err());
}

/// A surface over a plane seen at an angle, with silhouettes, like a sample's range and radiance.
fn picture(width: usize, height: usize) -> (Vec<u8>, Vec<u8>, Vec<u8>) {
    let (mut range, mut radiance, mut color) = (Vec::new(), Vec::new(), Vec::new());
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
            let ground = 0.02 + 0.05 * v + 0.002 * (40.0 * u).sin() * (30.0 * v).cos();
            let tree = (9.0 * u).fract() < 0.3 && (7.0 * v).fract() < 0.4;
            let inverse = if tree { ground * 1.7 } else { ground };
            // Twelve of 23 bits of mantissa, as samplers round them.
            range.extend_from_slice(&(inverse.to_bits() & !0x7ff).to_le_bytes());
            let grain = ((x * 7919 + y * 104_729) % 13) as f32 * 0.004;
            let shade = if tree { 0.2 } else { 0.5 } + 0.2 * (12.0 * u * v).sin() + grain;
            let channel = |k: f32| ((shade * k * 400.0) as u32).min(511);
            let bits = channel(1.0) | channel(0.8) << 9 | channel(0.6) << 18 | 16 << 27;
            radiance.extend_from_slice(&bits.to_le_bytes());
            color.extend([1.0, 0.8, 0.6].map(|k| (shade * k * 200.0) as u8));
        }
    }
    (range, radiance, color)
}

#[test]
fn speed_and_ratio_are_printed() {
    for (width, height) in [(200, 150), (1280, 720)] {
        let (range, radiance, color) = picture(width, height);
        let images = [("range R32Float", Layout::R32, range), ("radiance Rgb9e5", Layout::Rgb9e5, radiance)];
        for (name, layout, raw) in images.into_iter().chain([("colour Rgb8", Layout::Rgb8, color)]) {
            let packed = pack(layout, &raw).unwrap().expect("an image packs");
            let median = |run: &dyn Fn()| {
                let mut ms: Vec<f64> = (0..15)
                    .map(|_| {
                        let begin = Instant::now();
                        run();
                        begin.elapsed().as_secs_f64() * 1e3
                    })
                    .collect();
                ms.sort_by(f64::total_cmp);
                ms[7]
            };
            let packing = median(&|| drop(pack(layout, &raw).unwrap()));
            let unpacking = median(&|| drop(unpack(layout, &packed, raw.len()).unwrap()));
            let ratio = raw.len() as f64 / packed.len() as f64;
            println!("{name} {width}×{height}: {ratio:.1}:1, pack {packing:.2} ms, unpack {unpacking:.2} ms");
            assert!(ratio > 1.5, "{name}");
        }
    }
}
