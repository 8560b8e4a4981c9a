use super::*;
use crate::tone::srgb_from_linear;

fn texture(width: u32, height: u32, srgb: bool, texel: impl Fn(u32, u32) -> [u8; 4]) -> Texture {
    let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let rgba: Vec<u8> = texels.flat_map(|(x, y)| texel(x, y)).collect();
    Texture {
        name: String::new(),
        width,
        height,
        rgba: rgba.into(),
        srgb,
        wrap: [Wrap::Repeat; 2],
        filter: Filter::Linear,
    }
}

fn noise(x: u32, y: u32) -> [u8; 4] {
    let mix = (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0xc2b2_ae35);
    (mix ^ (mix >> 15)).to_le_bytes()
}

fn chain(texture: &Texture) -> MipChain {
    MipChain::new(texture, AlphaUse::Ignored)
}

#[test]
fn levels_have_the_sizes_that_graphics_interfaces_expect() {
    let sizes: Vec<_> =
        chain(&texture(13, 5, true, noise)).levels.iter().map(|l| [l.width, l.height]).collect();
    assert_eq!(sizes, [[13, 5], [6, 2], [3, 1], [1, 1]]);
    assert_eq!(level_count([1, 1]), 1);
    assert_eq!(level_count([256, 3]), 9);
    assert_eq!(level_size([256, 3], 8), [1, 1]);
    assert_eq!(level_size([256, 3], 40), [1, 1]);
}

#[test]
fn a_checkerboards_mean_is_taken_in_linear_light() {
    let checker =
        |srgb| texture(4, 4, srgb, |x, y| if (x + y).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] });
    let byte = |srgb| chain(&checker(srgb)).levels[2].rgba[0];
    assert_eq!(byte(false), 128);
    assert_eq!(byte(true), 188, "linear 0.5 is byte 188 in sRGB");
}

#[test]
fn odd_sides_keep_the_mean() {
    for [width, height] in [[3, 1], [5, 7], [13, 31], [1, 9], [64, 48]] {
        let texture = texture(width, height, false, noise);
        let mean = |level: &Level, channel: usize| {
            let texels = level.rgba.chunks_exact(4);
            let n = texels.len() as f64;
            texels.map(|t| f64::from(t[channel])).sum::<f64>() / n
        };
        let chain = chain(&texture);
        for channel in 0..4 {
            let (first, last) =
                (mean(&chain.levels[0], channel), mean(&chain.levels[chain.levels.len() - 1], channel));
            assert!((first - last).abs() <= 0.5 + 1e-3, "{width}×{height}: {first} {last}");
        }
    }
}

#[test]
fn cutouts_have_no_dark_fringe_at_any_level() {
    let leaf = |x: u32, y: u32| if (x / 3 + y / 2).is_multiple_of(2) { [40, 200, 60, 255] } else { [0; 4] };
    let chain = MipChain::new(&texture(37, 21, true, leaf), AlphaUse::Cutout);
    for (l, level) in chain.levels.iter().enumerate() {
        for texel in level.rgba.chunks_exact(4) {
            assert_eq!(texel[..3], [40, 200, 60], "level {l}");
        }
    }
    // The same texture without the weighting shows the fringe, so the test can fail.
    let plain = MipChain::new(&texture(37, 21, true, leaf), AlphaUse::Ignored);
    assert!(plain.levels[2].rgba[1] < 190);
    assert_eq!(chain.levels[3].rgba[3], plain.levels[3].rgba[3], "coverage is not touched");
}

#[test]
fn a_fully_transparent_cutout_stays_as_it_is() {
    let chain = MipChain::new(&texture(5, 5, true, |_, _| [9, 8, 7, 0]), AlphaUse::Cutout);
    assert!(chain.levels.iter().all(|l| l.rgba.chunks_exact(4).all(|t| t == [9, 8, 7, 0])));
}

#[test]
fn texel_centres_return_the_texel_and_midpoints_their_mean_in_linear_light() {
    let texture = texture(4, 2, true, noise);
    let chain = chain(&texture);
    let linear = |x: u32, y: u32| linear_from_srgb(f32::from(noise(x, y)[0]) / 255.0);
    let at = |x: f32, y: f32| chain.sample(Vec2::new(x / 4.0, y / 2.0), 0.0).x;
    assert!((at(2.5, 1.5) - linear(2, 1)).abs() < 1e-6);
    assert!((at(2.0, 0.5) - 0.5 * (linear(1, 0) + linear(2, 0))).abs() < 1e-6);
}

#[test]
fn every_wrap_mode_continues_the_texture_across_its_border() {
    let ramp = texture(4, 1, false, |x, _| [x as u8 * 60, 0, 0, 255]);
    let read = |wrap, u: f32| {
        let chain = MipChain::new(&Texture { wrap: [wrap; 2], ..ramp.clone() }, AlphaUse::Ignored);
        (chain.sample(Vec2::new(u, 0.5), 0.0).x * 255.0).round()
    };
    // Across the border between texel 3 and its neighbour.
    assert_eq!([Wrap::Repeat, Wrap::Clamp, Wrap::Mirror].map(|w| read(w, 1.0)), [90.0, 180.0, 180.0]);
    assert_eq!([Wrap::Repeat, Wrap::Clamp, Wrap::Mirror].map(|w| read(w, 1.125)), [0.0, 180.0, 180.0]);
    assert_eq!([Wrap::Repeat, Wrap::Clamp, Wrap::Mirror].map(|w| read(w, -0.375)), [120.0, 0.0, 60.0]);
    assert_eq!(read(Wrap::Mirror, 2.125), 0.0);
}

#[test]
fn a_nearest_texture_shows_whole_texels_up_close_and_their_mean_from_afar() {
    let linear = texture(4, 1, false, |x, _| [x as u8 * 60, 0, 0, x as u8 * 60]);
    for wrap in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror] {
        let chain = chain(&Texture { wrap: [wrap; 2], filter: Filter::Nearest, ..linear.clone() });
        let texel = |u: f32| (chain.sample(Vec2::new(u, 0.5), 0.0).x * 255.0).round() as u32 / 60;
        assert_eq!([0.0, 0.24, 0.26, 0.49, 0.5, 0.99].map(texel), [0, 0, 1, 1, 2, 3], "{wrap:?}");
        let beyond = match wrap {
            Wrap::Repeat => [3, 0, 1],
            Wrap::Clamp => [0, 3, 3],
            Wrap::Mirror => [0, 3, 2],
        };
        assert_eq!([-0.01, 1.01, 1.26].map(texel), beyond, "{wrap:?}");
        for u in [0.1, 0.24, 0.26, 0.9] {
            let uv = Vec2::new(u, 0.5);
            let [red, alpha] = [chain.red(uv), chain.alpha(uv)].map(|x| (x * 255.0).round() as u32 / 60);
            assert_eq!([red, alpha], [texel(u); 2]);
        }
        assert_eq!(chain.sample(Vec2::splat(0.3), 2.0), self::chain(&linear).sample(Vec2::splat(0.3), 2.0));
    }
}

#[test]
fn non_finite_coordinates_and_levels_read_a_defined_texel() {
    for wrap in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror] {
        let chain =
            MipChain::new(&Texture { wrap: [wrap; 2], ..texture(8, 8, true, noise) }, AlphaUse::Ignored);
        let origin = chain.sample(Vec2::ZERO, 0.0);
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(chain.sample(Vec2::splat(odd), 0.0), origin);
            assert!(chain.sample(Vec2::new(0.3, odd), odd).is_finite());
            assert!((0.0..=1.0).contains(&chain.alpha(Vec2::splat(odd))));
        }
        for huge in [1e30, -1e30, f32::MAX, f32::MIN, 1e-40, -1e-40] {
            assert!(chain.sample(Vec2::splat(huge), 1.5).is_finite(), "{huge}");
        }
        assert_eq!(chain.level(Vec2::NAN, Vec2::NAN), 0.0);
        assert_eq!(chain.level(Vec2::NAN, Vec2::splat(0.25)), chain.level(Vec2::ZERO, Vec2::splat(0.25)));
        assert_eq!(chain.level(Vec2::INFINITY, Vec2::ZERO), 3.0);
    }
}

#[test]
fn the_level_is_the_logarithm_of_the_longer_footprint_in_texels() {
    let chain = chain(&texture(64, 16, true, noise));
    assert_eq!(chain.level(Vec2::new(4.0 / 64.0, 0.0), Vec2::new(0.0, 1.0 / 16.0)), 2.0);
    assert_eq!(chain.level(Vec2::ZERO, Vec2::new(0.0, 8.0 / 16.0)), 3.0);
    assert_eq!(chain.level(Vec2::ZERO, Vec2::ZERO), 0.0);
    assert_eq!(chain.level(Vec2::X * 1e9, Vec2::ZERO), 6.0);
}

#[test]
fn colour_is_continuous_in_the_level() {
    let chain = chain(&texture(64, 64, true, noise));
    let uv = Vec2::new(0.31, 0.77);
    let mut before = chain.sample(uv, -1.0);
    for i in 0..=700 {
        let now = chain.sample(uv, i as f32 / 100.0);
        assert!((now - before).abs().max_element() < 0.02, "at level {}", i as f32 / 100.0);
        before = now;
    }
    assert_eq!(before, chain.sample(uv, 6.0));
}

#[test]
fn the_transform_gives_the_quadrant_of_the_extensions_own_example() {
    // KHR_texture_transform's example: "the lower left quadrant of the source image, rotated clockwise 90°".
    let half_turn = std::f32::consts::FRAC_PI_2;
    let example = TextureRef {
        offset: Vec2::new(0.0, 1.0),
        scale: Vec2::splat(0.5),
        rotation: half_turn,
        ..TextureRef::new(0)
    };
    for (uv, expected) in [(Vec2::ZERO, [0.0, 1.0]), (Vec2::ONE, [0.5, 0.5]), (Vec2::X, [0.0, 0.5])] {
        assert!((transform_uv(&example, uv) - Vec2::from(expected)).length() < 1e-6, "{uv}");
    }
    let duv = Vec2::new(0.1, -0.2);
    let difference = transform_uv(&example, Vec2::ONE + duv) - transform_uv(&example, Vec2::ONE);
    assert!((difference - transform_duv(&example, duv)).length() < 1e-6);
}

#[test]
fn textures_with_a_wrong_size_become_a_white_texel() {
    let good = texture(2, 2, true, noise);
    for broken in [
        Texture { width: 0, ..good.clone() },
        Texture { height: 3, ..good.clone() },
        Texture { width: u32::MAX, height: u32::MAX, ..good.clone() },
    ] {
        assert_eq!(chain(&broken).sample(Vec2::splat(0.5), 0.0), Vec4::ONE);
    }
}

#[test]
fn the_encoding_table_agrees_with_the_formula() {
    for i in 0..=100_000 {
        let x = i as f32 / 100_000.0;
        let formula = srgb_from_linear(x) * 255.0 + 0.5;
        let byte = f32::from(SRGB.encode(x));
        // Within rounding of the decision threshold either neighbour is right.
        assert!(byte <= formula + 1e-3 && formula - 1e-3 < byte + 1.0, "{x}: {byte} {formula}");
    }
}
