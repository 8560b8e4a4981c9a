//! Texels of fewer bits hold what those of all bits hold, but for what was left away.

use argus_megaviews::hierarchy::Octree;
use argus_megaviews::many_views::{Occlusion, RasterViews, Settings, Texel, TexelCode, ViewList, ViewPoint};
use glam::DVec3;

use crate::common::{Frame, octree_of, room, scattered, wide};
use crate::device::gpu;

/// Texels of few bits.
const COARSE: [Texel; 2] = [Texel::RangeAndNode32, Texel::Range16];

fn code_of(texel: Texel, octree: &Octree) -> TexelCode {
    TexelCode::new(texel, octree.node_count(), octree.root.edge).unwrap()
}

/// Texels of two frames with the same maps, side by side.
fn texels<'a>(a: &'a Frame, b: &'a Frame) -> impl Iterator<Item = ([u32; 2], [u32; 2])> + 'a {
    assert_eq!(a.map_of_view, b.map_of_view);
    assert_eq!(a.maps.len(), b.maps.len());
    a.maps.iter().flatten().copied().zip(b.maps.iter().flatten().copied())
}

#[test]
fn every_texel_holds_the_code_of_the_nearest_range() {
    let octree = octree_of(&room(), 6);
    let views = scattered(400, 51);
    for sharing in [true, false] {
        // Without fusion, each texel is the nearest of the pairs rendered to it, which are the same for all formats.
        let of =
            |texel| Frame::new(&octree, Settings { texel, fusion: false, ..wide(6, 16, sharing) }, &views);
        let whole = of(Texel::RangeAndNode);
        let alone = of(Texel::Range);
        assert!(texels(&alone, &whole).all(|(alone, whole)| alone == [whole[0], 0]));
        for texel in COARSE {
            let code = code_of(texel, &octree);
            let coarse = of(texel);
            assert_eq!(coarse.stats.map_bytes * 64, whole.stats.map_bytes * u64::from(texel.bits()));
            let (mut seen, mut ties) = (0u32, 0u32);
            for (coarse, whole) in texels(&coarse, &whole) {
                let range = f32::from_bits(whole[0]);
                assert_eq!(coarse[0], code.decode(code.encode(range)).to_bits(), "{texel:?} {range}");
                seen += u32::from(range > 0.0);
                if texel.names_nodes() && coarse[1] != whole[1] {
                    // Ranges of the same code: then the greater number stays.
                    assert!(coarse[1] > whole[1], "{coarse:?} {whole:?}");
                    ties += 1;
                }
            }
            // A scene of some ten thousand nodes leaves 18 bits.
            assert!(seen > 50_000 && ties * 500 < seen, "{texel:?}: {ties} ties of {seen}");
        }
    }
}

#[test]
fn fused_ranges_stay_within_a_step_a_level() {
    let octree = octree_of(&room(), 6);
    let views = scattered(600, 52);
    for texel in COARSE {
        let of = |texel| Frame::new(&octree, Settings { texel, ..wide(6, 16, true) }, &views);
        let (coarse, exact) = (of(texel), of(texel.exact()));
        let step = code_of(texel, &octree).step();
        // Ranges that are found anew from nodes do not drift; others may be cut at each of the maps on the way, and near
        // the eye, what is cut moves the point by more of its range than before.
        let allowed = if texel.names_nodes() { step } else { 6.0 * 2.0 * step };
        let (mut seen, mut beyond) = (0u32, 0u32);
        for (coarse, exact) in texels(&coarse, &exact) {
            let [a, b] = [coarse[0], exact[0]].map(|bits| f64::from(f32::from_bits(bits)));
            assert!(a.is_finite() && a >= 0.0);
            assert_eq!(a == 0.0, b == 0.0, "the sky stays where it is");
            if b > 0.0 {
                seen += 1;
                beyond += u32::from((a / b - 1.0).abs() > allowed + 1e-6);
            }
        }
        assert!(seen > 100_000 && beyond * 1000 < seen, "{texel:?}: {beyond} of {seen} beyond {allowed}");
    }
}

#[test]
fn fused_maps_of_few_bits_hold_what_queries_find() {
    let octree = octree_of(&room(), 5);
    let views = scattered(400, 53);
    for texel in COARSE {
        let settings = Settings { texel, ..wide(5, 16, true) };
        let fused = Frame::new(&octree, settings, &views);
        let sparse = Frame::new(&octree, Settings { fusion: false, ..settings }, &views);
        let asked = sparse.map_of_view.iter().step_by(9);
        let queries: Vec<[u32; 2]> = asked.flat_map(|&map| (0..512).map(move |texel| [map, texel])).collect();
        let answers = sparse.many.query(&queries).unwrap();
        for ([map, at], answer) in queries.iter().zip(&answers) {
            assert_eq!(fused.maps[*map as usize][*at as usize], *answer, "{texel:?}: map {map}, texel {at}");
        }
    }
}

#[test]
fn texels_of_few_bits_are_the_same_again_and_behind_nearer_surfaces() {
    let octree = octree_of(&room(), 6);
    let mut views = scattered(300, 54);
    // Beyond the ranges that codes tell apart, with the room in sixteen texels.
    views.push(ViewPoint::everywhere(DVec3::new(76.0, 4.0, 4.0)));
    for texel in COARSE {
        for sharing in [true, false] {
            let settings = Settings { texel, ..wide(6, 64, sharing) };
            let [one, again] = [0, 1].map(|_| Frame::new(&octree, settings, &views));
            assert!(one.maps == again.maps, "{texel:?}: other bytes");
            let few = Frame::new(&octree, Settings { occlusion: Occlusion::Shells, ..settings }, &views);
            assert!(few.maps == one.maps, "{texel:?}: other bytes with occlusion");
            assert!(few.stats.rendered() < one.stats.rendered());
            let far = one.of(300).iter().map(|value| f32::from_bits(value[0]));
            assert!(far.clone().all(f32::is_finite) && far.fold(0.0, f32::max) > 0.0, "{texel:?}");
        }
    }
}

#[test]
fn triangles_and_splits_know_texels_of_few_bits_too() {
    let octree = octree_of(&room(), 6);
    let views = scattered(300, 55);
    for texel in COARSE {
        let settings = Settings { texel, ..wide(6, 16, true) };
        let whole = Frame::new(&octree, settings, &views);
        let pairs = Some(whole.stats.peak_queued() as u32 / 3);
        let split = Frame::new(&octree, Settings { queue_pairs: pairs, ..settings }, &views);
        assert!(split.stats.multipass_level > 0 && split.maps == whole.maps, "{texel:?}");

        let list = ViewList::new(&gpu(), &octree.root, &views[..4]).unwrap();
        let read = |texel| {
            let mut raster =
                RasterViews::new(&gpu(), octree.root, room(), Settings { texel, ..settings }).unwrap();
            raster.render(&list).unwrap();
            (raster.maps().code, raster.maps().read(&gpu(), 3).unwrap())
        };
        let ((code, coarse), (_, exact)) = (read(texel), read(texel.exact()));
        for (coarse, exact) in coarse.iter().zip(&exact) {
            assert_eq!(coarse[0], code.decode(code.encode(f32::from_bits(exact[0]))).to_bits());
        }
    }
}
