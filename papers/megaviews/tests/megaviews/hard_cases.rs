//! What makes a traversal go wrong.

use std::sync::Arc;

use argus_gpu::{Gpu, GpuOptions};
use argus_megaviews::hierarchy::{HierarchyError, OctreeBuilder, RootCube, Triangle, stream};
use argus_megaviews::many_views::{ManyViews, Settings, ViewList, ViewPoint};
use glam::{DVec3, Vec3};

use crate::common::{Frame, octree_of, room, scattered, wide};
use crate::device::gpu;

/// No texel is negative, infinite or NaN.
fn all_finite(frame: &Frame) {
    for value in frame.maps.iter().flatten() {
        let range = f32::from_bits(value[0]);
        assert!(range.is_finite() && range >= 0.0, "{range}");
    }
}

#[test]
fn the_same_views_give_the_same_bytes_again() {
    let octree = octree_of(&room(), 6);
    let views = scattered(500, 21);
    for sharing in [true, false] {
        let [one, other] = [0, 1].map(|_| Frame::new(&octree, wide(6, 16, sharing), &views));
        assert_eq!(one.maps, other.maps);
        assert_eq!(one.stats.steps, other.stats.steps);
        all_finite(&one);
    }
}

#[test]
fn queues_that_overflow_are_split_and_no_byte_and_no_count_changes() {
    let octree = octree_of(&room(), 6);
    let views = scattered(700, 22);
    for sharing in [true, false] {
        let settings = wide(6, 16, sharing);
        let whole = Frame::new(&octree, settings, &views);
        assert_eq!(whole.stats.multipass_level, 0);
        let peak = whole.stats.peak_queued() as u32;
        for (share, level) in [(2, 1), (10, 2)] {
            let mut split =
                Frame::new(&octree, Settings { queue_pairs: Some(peak / share), ..settings }, &views);
            assert!(split.stats.multipass_level >= level, "{:?}", split.stats);
            assert!(split.stats.reruns >= split.stats.multipass_level);
            assert_eq!(split.maps, whole.maps, "sharing {sharing}, queues of {}", peak / share);
            assert_eq!(split.stats.steps, whole.stats.steps);
            // The next frame begins where this one ended.
            let list = ViewList::new(&gpu(), &octree.root, &views).unwrap();
            assert_eq!(split.many.render(&list).unwrap().reruns, 0);
        }
    }
}

#[test]
fn a_queue_that_no_split_makes_fit_is_an_error_that_says_so() {
    let octree = octree_of(&room(), 6);
    let settings = Settings { queue_pairs: Some(64), ..wide(6, 64, false) };
    let mut many = ManyViews::new(&gpu(), octree.clone(), settings).unwrap();
    let list = ViewList::new(&gpu(), &octree.root, &scattered(4, 1)).unwrap();
    let error = many.render(&list).unwrap_err();
    assert!(matches!(error, HierarchyError::TooLarge { .. }), "{error}");
}

#[test]
fn more_pairs_than_a_binding_or_a_dispatch_holds_are_all_met() {
    let octree = octree_of(&room(), 2);
    // Outside, so that leaves cover few texels each.
    let view = ViewPoint::everywhere(DVec3::new(4.0, 4.2, 13.5));
    let settings = Settings { side: 8, sharing: false, ..Settings::default() };
    let count = 330_000;
    let one = Frame::new(&octree, settings, &[view]);
    let mut many = ManyViews::new(&gpu(), octree.clone(), settings).unwrap();
    let list = ViewList::new(&gpu(), &octree.root, &vec![view; count]).unwrap();
    let stats = many.render(&list).unwrap();
    assert!(stats.peak_untested() > 17_000_000, "{stats:?}");
    for (all, single) in stats.steps.iter().zip(&one.stats.steps) {
        let n = count as u64;
        assert_eq!(
            [all.tested, all.rendered, all.queued],
            [single.tested * n, single.rendered * n, single.queued * n]
        );
    }
    let set = many.maps();
    let last = count as u64 - 1;
    let (array, at) = (last >> set.shift, last & ((1 << set.shift) - 1));
    let mut commands = gpu().commands("last map");
    let pending = commands.read_buffer(&set.arrays[array as usize], at * 512..(at + 1) * 512);
    let bytes = commands.submit().wait().unwrap().take(pending);
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes[..]);
    let expected: Vec<u32> = one.of(0).iter().map(|value| value[0]).collect();
    assert_eq!(words, expected);
}

#[test]
fn a_million_views_at_one_point_are_one_view() {
    let octree = octree_of(&room(), 6);
    let view = ViewPoint { position: DVec3::new(3.0, 2.0, 5.0), direction: DVec3::Y, half_fov: 1.5 };
    let one = Frame::new(&octree, wide(6, 16, true), &[view]);
    let all = Frame::new(&octree, wide(6, 16, true), &vec![view; 1_000_000]);
    assert_eq!(all.stats.maps, 1);
    assert_eq!(all.stats.processed(), one.stats.processed());
    assert_eq!(all.maps, one.maps);
    assert_eq!(all.stats.views_per_node(), 1e6);
}

#[test]
fn views_on_the_borders_of_cells_and_on_one_plane_lose_nothing() {
    let octree = octree_of(&room(), 5);
    let cell = octree.root.edge / 32.0;
    let on = |x: f64, y: f64| ViewPoint::everywhere(octree.root.origin + DVec3::new(x, y, 16.0) * cell);
    let views: Vec<ViewPoint> =
        (0..400).map(|i| on(f64::from(i % 20) + 6.0, f64::from(i / 20) + 6.0)).collect();
    let shared = Frame::new(&octree, wide(5, 16, true), &views);
    assert_eq!(shared.stats.view_leaves, 400, "each view is in one cell");
    all_finite(&shared);
    let alone = Frame::new(&octree, wide(5, 16, false), &views);
    let holes =
        |frame: &Frame| (0..400).map(|v| frame.of(v).iter().filter(|t| t[0] == 0).count()).sum::<usize>();
    // A closed room: texels without anything are those outside the rims alone, and a few between discs.
    let (shared, alone) = (holes(&shared), holes(&alone));
    assert!(shared <= alone + alone / 50, "{shared} {alone}");
}

#[test]
fn views_outside_the_scene_are_in_an_octree_of_their_own() {
    let octree = octree_of(&room(), 5);
    let mut views = scattered(60, 31);
    views.extend((0..20).map(|i| ViewPoint::everywhere(DVec3::new(40.0 + f64::from(i), -30.0, 7.0))));
    for sharing in [true, false] {
        let frame = Frame::new(&octree, wide(5, 16, sharing), &views);
        all_finite(&frame);
        assert!(frame.of(70).iter().any(|value| value[0] != 0), "the room is seen from afar");
    }
}

#[test]
fn a_scene_of_one_triangle_is_seen() {
    let color = Vec3::ONE;
    let corners = [DVec3::new(2.0, 0.0, 0.0), DVec3::new(2.0, 1.0, 0.0), DVec3::new(2.0, 0.0, 1.0)];
    let octree = octree_of(&[Triangle { corners, color }], 8);
    let views =
        [ViewPoint::everywhere(DVec3::new(1.0, 0.3, 0.3)), ViewPoint::everywhere(DVec3::new(2.0, 0.2, 0.2))];
    for sharing in [true, false] {
        let frame = Frame::new(&octree, wide(8, 32, sharing), &views);
        all_finite(&frame);
        let texel = argus_scene::paraboloid::texel_of(DVec3::X, 32) as usize;
        let range = 1.0 / f32::from_bits(frame.of(0)[texel][0]);
        assert!((range - 1.0).abs() < 0.05, "{range}");
    }
}

#[test]
fn a_scene_and_its_views_a_million_metres_away_give_the_same_bytes() {
    // A distance that f64 adds without rounding, so that bytes can be compared.
    let far = DVec3::new(f64::from(1 << 20), f64::from(-(1 << 21)), f64::from(3 << 20));
    let quantised = |p: DVec3| (p * 1024.0).round() / 1024.0;
    let near: Vec<Triangle> =
        room().iter().map(|t| Triangle { corners: t.corners.map(quantised), ..*t }).collect();
    let moved: Vec<Triangle> =
        near.iter().map(|t| Triangle { corners: t.corners.map(|c| c + far), ..*t }).collect();
    let views: Vec<ViewPoint> =
        scattered(200, 41).iter().map(|v| ViewPoint { position: quantised(v.position), ..*v }).collect();
    let there: Vec<ViewPoint> =
        views.iter().map(|v| ViewPoint { position: v.position + far, ..*v }).collect();
    let (here, away) = (octree_of(&near, 6), octree_of(&moved, 6));
    assert_eq!(here.levels, away.levels);
    for sharing in [true, false] {
        let settings = wide(6, 16, sharing);
        let (a, b) = (Frame::new(&here, settings, &views), Frame::new(&away, settings, &there));
        let differing = a.maps.iter().flatten().zip(b.maps.iter().flatten()).filter(|(a, b)| a != b).count();
        assert_eq!(differing, 0, "of {} texels", a.maps.len() * 512);
    }
}

#[test]
fn views_that_are_nowhere_or_look_nowhere_are_refused_by_field() {
    let octree = octree_of(&room(), 2);
    let good = ViewPoint { position: DVec3::ONE, direction: DVec3::X, half_fov: 1.0 };
    let refused = |view: ViewPoint| ViewList::new(&gpu(), &octree.root, &[good, view]).unwrap_err().field;
    assert_eq!(refused(ViewPoint { position: DVec3::NAN, ..good }), "view.position");
    assert_eq!(refused(ViewPoint { half_fov: f64::NAN, ..good }), "view.half_fov");
    assert_eq!(refused(ViewPoint { half_fov: 0.0, ..good }), "view.half_fov");
    assert_eq!(refused(ViewPoint { direction: DVec3::ZERO, ..good }), "view.direction");
    assert!(ViewList::new(&gpu(), &octree.root, &[]).is_err());
    let all = ViewPoint { direction: DVec3::ZERO, half_fov: 4.0, ..good };
    ViewList::new(&gpu(), &octree.root, &[all]).unwrap();
}

#[test]
fn a_frame_waits_for_the_device_once_however_many_levels_its_views_have() {
    let gpu = Gpu::new(&GpuOptions::default()).unwrap();
    let triangles = room();
    let root = RootCube::around(&stream::bounds(triangles.iter().copied()));
    let octree = Arc::new(OctreeBuilder::new(&gpu).build(root, 5, triangles).unwrap());
    let list = ViewList::new(&gpu, &root, &scattered(300, 5)).unwrap();
    for depth in [1, 5, 9] {
        let mut many = ManyViews::new(&gpu, Arc::clone(&octree), wide(depth, 16, true)).unwrap();
        many.render(&list).unwrap();
        let before = gpu.waits();
        let stats = many.render(&list).unwrap();
        assert_eq!((stats.view_depth, stats.reruns), (depth, 0));
        assert_eq!(gpu.waits() - before, 1, "{depth} levels");
    }
}
