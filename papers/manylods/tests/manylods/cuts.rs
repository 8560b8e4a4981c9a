//! Cuts of many views: the same however they are found, and the maps drawn from them.

use argus_manylods::{CutMethod, CutSettings, CutStats, CutTree, ImperfectViews, ManyLods};
use argus_manylods::{SphereBuilder, SphereHierarchy};
use argus_megaviews::hierarchy::{HierarchyError, RootCube, Triangle, stream};
use argus_megaviews::many_views::{RasterViews, Settings, Texel, ViewList, ViewPoint};
use argus_scene::paraboloid::is_inside;
use glam::{DQuat, DVec3};

use crate::common::{Frame, octree_of, room, scattered, wide};
use crate::device::{gpu, read};

fn balls(depth: u32) -> SphereHierarchy {
    let triangles = room();
    let root = RootCube::around(&stream::bounds(triangles.iter().copied()));
    SphereBuilder::new(&gpu()).build(root, depth, &triangles).unwrap()
}

/// A cut tree of each kind over the room.
fn trees() -> [CutTree; 2] {
    let octree = octree_of(&room(), 5);
    [CutTree::of_octree(&gpu(), &octree).unwrap(), CutTree::of_spheres(&balls(12))]
}

fn many(tree: &CutTree, method: CutMethod) -> ManyLods {
    ManyLods::new(&gpu(), tree.clone(), CutSettings { method, ..CutSettings::default() }).unwrap()
}

fn list(tree: &CutTree, views: &[ViewPoint]) -> ViewList {
    ViewList::new(&gpu(), tree.root(), views).unwrap()
}

/// The views a step further: each moves by about `step` metres in a direction of its own that changes slowly, and turns.
fn moved(views: &[ViewPoint], time: u32, step: f64) -> Vec<ViewPoint> {
    let along = |i: usize| {
        let (a, b) = (i as f64 * 2.4, f64::from(time) * 0.1 + i as f64);
        DVec3::new(a.cos() * b.cos(), b.sin(), a.sin() * b.cos()) * step
    };
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), step * 0.05);
    let moved = views.iter().enumerate().map(|(i, view)| ViewPoint {
        position: view.position + along(i),
        direction: turn * view.direction,
        ..*view
    });
    moved.collect()
}

#[test]
fn a_cut_is_where_nodes_first_appear_small_or_are_not_seen() {
    for tree in trees() {
        let views = scattered(21, 3);
        let mut cuts = many(&tree, CutMethod::Basic);
        cuts.select(&list(&tree, &views)).unwrap();
        let found = cuts.cuts().unwrap();
        let count = (tree.nodes().size() / 16) as usize;
        let (nodes, spheres): (Vec<[u32; 4]>, Vec<[f32; 4]>) =
            (read(tree.nodes(), count), read(tree.spheres(), count));
        // In f64 and by angles.
        let is_right = |node: usize, view: &ViewPoint| {
            let [x, y, z, radius] = spheres[node].map(f64::from);
            let to = DVec3::new(x, y, z) - tree.root().unit_from_world(view.position);
            let (range, sine) = (to.length(), radius / to.length());
            let small =
                range > radius && 16.0 * sine / (to.x.abs() / range + (1.0 - sine * sine).sqrt()) < 1.0;
            let angle = to.angle_between(view.direction);
            let off = (angle - view.half_fov).clamp(0.0, std::f64::consts::FRAC_PI_2);
            small || (view.half_fov < std::f64::consts::PI && range * off.sin() > radius)
        };
        let (mut expected, mut open) = (Vec::new(), Vec::new());
        for (index, view) in (0u32..).zip(&views) {
            open.push(tree.root_node() as usize);
            while let Some(node) = open.pop() {
                let links = nodes[node][3];
                if links & 255 == 0 || is_right(node, view) {
                    expected.push([node as u32, index]);
                } else {
                    let first = (links >> 8) as usize;
                    open.extend(first..first + (links & 255).count_ones() as usize);
                }
            }
        }
        let expected: std::collections::BTreeSet<[u32; 2]> = expected.into_iter().collect();
        let found: std::collections::BTreeSet<[u32; 2]> = found.into_iter().collect();
        let differing = expected.symmetric_difference(&found).count();
        assert!(found.len() > 1000 && differing * 2000 <= found.len(), "{differing} of {}", found.len());
    }
}

/// Fails where two lists of cuts differ, and says by how much.
fn assert_same(a: &ManyLods, b: &ManyLods, what: &str) {
    let (a, b) = (a.cuts().unwrap(), b.cuts().unwrap());
    let first = a.iter().zip(&b).find(|(a, b)| a != b);
    assert!(a == b, "{what}: {} and {} nodes, the first to differ {first:?}", a.len(), b.len());
}

/// The stats of an incremental and of a basic frame for each of so many steps; their cuts are the same.
fn follow(tree: &CutTree, views: &[ViewPoint], steps: &[f64]) -> Vec<(CutStats, CutStats)> {
    let (mut kept, mut anew) = (many(tree, CutMethod::Incremental), many(tree, CutMethod::Basic));
    let mut views = views.to_vec();
    let mut all = Vec::new();
    for (time, step) in (0..).zip(steps) {
        views = moved(&views, time, *step);
        let list = list(tree, &views);
        all.push((kept.select(&list).unwrap(), anew.select(&list).unwrap()));
        assert_same(&kept, &anew, &format!("step {time}, {step} m"));
    }
    all
}

#[test]
fn incremental_cuts_are_those_of_the_basic_method_after_any_path() {
    for tree in trees() {
        let steps = [0.0, 0.001, 0.004, 0.004, 0.02, 0.0, 0.05, 0.3, 0.01, 4.0, 0.01, 0.001, 1e-7, 0.003];
        follow(&tree, &scattered(140, 31), &steps);
        let everywhere: Vec<ViewPoint> =
            scattered(60, 32).into_iter().map(|view| ViewPoint::everywhere(view.position)).collect();
        follow(&tree, &everywhere, &[0.02; 40]);
    }
}

#[test]
fn views_that_go_straight_on_turn_back_and_go_their_own_ways_have_the_same_cuts_either_way() {
    for tree in trees() {
        let (mut kept, mut anew) = (many(&tree, CutMethod::Incremental), many(&tree, CutMethod::Basic));
        let (mut visits, mut turned) = (Vec::new(), Vec::new());
        let mut views = scattered(42, 37);
        for time in 0..60u32 {
            for (i, view) in (0u32..).zip(&mut views) {
                // Straight on for twelve frames, then back, aside, in a circle, and each as it likes.
                let angle = match time / 12 {
                    0 => 0.3,
                    1 => 0.3 + std::f64::consts::PI,
                    2 => 1.9,
                    3 => 0.1 * f64::from(time),
                    _ => 1.7 * f64::from(time) * f64::from(i % 7),
                };
                view.position += DVec3::new(angle.cos(), 0.2, angle.sin()) * 0.016;
            }
            let list = list(&tree, &views);
            let frame = kept.select(&list).unwrap();
            anew.select(&list).unwrap();
            assert_same(&kept, &anew, &format!("frame {time}"));
            if time % 12 == 0 {
                turned.push(frame.visits);
            } else if (4..12).contains(&time) {
                visits.push(frame.visits);
            }
        }
        // Who goes straight on is seen coming; who turns is looked at.
        assert!(visits.iter().max() < turned[1..3].iter().min(), "{visits:?} {turned:?}");
    }
}

#[test]
fn views_far_outside_on_borders_and_at_one_point_have_the_same_cuts_either_way() {
    for tree in trees() {
        let cell = tree.root().edge / 32.0;
        let on =
            |i: u32| tree.root().origin + DVec3::new(f64::from(i % 5), f64::from(i / 5), 16.0) * cell * 4.0;
        let mut views: Vec<ViewPoint> = (0..25).map(|i| ViewPoint::everywhere(on(i))).collect();
        views.extend((0..5).map(|i| ViewPoint::everywhere(DVec3::new(40.0 + f64::from(i), -30.0, 7.0))));
        views.extend([ViewPoint { position: DVec3::splat(3.0), direction: DVec3::Y, half_fov: 1.0 }; 40]);
        follow(&tree, &views, &[0.0, cell, 0.0, cell, 0.01, 0.01]);
    }
}

#[test]
fn nodes_far_from_changing_are_not_looked_at() {
    for tree in trees() {
        let views = scattered(70, 33);
        // Two thousandths of the scene a frame.
        let stats = follow(&tree, &views, &[0.016; 24]);
        let sum = |of: &dyn Fn(&(CutStats, CutStats)) -> u64| stats[8..].iter().map(of).sum::<u64>() as f64;
        let visits = sum(&|s| s.1.visits) / sum(&|s| s.0.visits);
        let operations = sum(&|s| s.1.operations()) / sum(&|s| s.0.operations());
        assert!(visits > 8.0 && operations > 10.0, "visits {visits}, operations {operations}");
        // Nothing moves, nothing is looked at.
        let still = follow(&tree, &views, &[0.016, 0.0, 0.0]);
        assert_eq!((still[1].0.visits, still[2].0.visits), (0, 0), "{:?}", still[1].0);
    }
}

#[test]
fn lazy_cuts_come_to_be_the_basic_ones_when_motion_stops() {
    for tree in trees() {
        for edges in [1, 3] {
            let (mut lazy, mut anew) =
                (many(&tree, CutMethod::Lazy { edges }), many(&tree, CutMethod::Basic));
            let mut views = scattered(105, 35);
            let mut lagged = 0;
            for time in 0..20 {
                views = moved(&views, time, 0.02);
                let list = list(&tree, &views);
                lazy.select(&list).unwrap();
                anew.select(&list).unwrap();
                lagged += usize::from(lazy.cuts().unwrap() != anew.cuts().unwrap());
            }
            assert!(lagged > 10, "cuts lag behind while views move: {lagged}");
            let list = list(&tree, &views);
            let mut frames = 0;
            while lazy.select(&list).unwrap().operations() > 0 {
                frames += 1;
                assert!(frames < 20);
            }
            assert_same(&lazy, &anew, &format!("{edges} edges"));
            assert_eq!(lazy.select(&list).unwrap().visits, 0, "nothing is left to be done");
        }
    }
}

/// The room, its blocks bent by so much.
fn bent(amount: f64) -> Vec<Triangle> {
    let bend = |p: DVec3| {
        p + DVec3::new((p.y * 0.8).sin(), 0.0, (p.y * 0.5).cos()) * amount * p.y * (8.0 - p.y) / 16.0
    };
    room().into_iter().map(|t| Triangle { corners: t.corners.map(bend), ..t }).collect()
}

#[test]
fn cuts_follow_a_scene_that_moves_and_one_that_is_put_in_order_anew() {
    let builder = SphereBuilder::new(&gpu());
    let mut hierarchy = balls(11);
    let tree = CutTree::of_spheres(&hierarchy);
    let views = list(&tree, &scattered(77, 41));
    let (mut kept, mut anew) = (many(&tree, CutMethod::Incremental), many(&tree, CutMethod::Basic));
    let mut lazy = many(&tree, CutMethod::Lazy { edges: 1 });
    for frame in 0..16 {
        let bent = bent(f64::from(frame).sin() * [0.0, 0.002, 0.02, 0.2][frame as usize % 4]);
        if frame % 7 == 5 {
            builder.rebuild(&mut hierarchy, &bent).unwrap();
        } else {
            builder.update(&mut hierarchy, &bent).unwrap();
        }
        kept.select(&views).unwrap();
        anew.select(&views).unwrap();
        lazy.select(&views).unwrap();
        assert_same(&kept, &anew, &format!("frame {frame}"));
    }
    for _ in 0..20 {
        lazy.select(&views).unwrap();
    }
    assert_same(&lazy, &anew, "at the end");
}

#[test]
fn cuts_that_do_not_fit_are_found_again_and_end_in_an_error_that_says_so() {
    let [tree, _] = trees();
    let views = list(&tree, &scattered(30, 51));
    for method in [CutMethod::Basic, CutMethod::Incremental] {
        let settings = CutSettings { method, ..CutSettings::default() };
        let with = |entries, settings| CutSettings { entries, ..settings };
        let mut free = ManyLods::new(&gpu(), tree.clone(), settings).unwrap();
        free.select(&views).unwrap();
        let nodes = free.cuts().unwrap();
        let mut exact =
            ManyLods::new(&gpu(), tree.clone(), with(Some(nodes.len() as u32), settings)).unwrap();
        exact.select(&views).unwrap();
        assert_same(&exact, &free, "what just fits");
        let mut small =
            ManyLods::new(&gpu(), tree.clone(), with(Some(nodes.len() as u32 / 2), settings)).unwrap();
        let error = small.select(&views).unwrap_err();
        assert!(matches!(error, HierarchyError::TooLarge { .. }), "{error}");
    }
}

#[test]
fn a_view_may_start_over_more_often_than_its_entries_can_be_told_apart() {
    let [_, tree] = trees();
    let (mut kept, mut anew) = (many(&tree, CutMethod::Incremental), many(&tree, CutMethod::Basic));
    let mut views = scattered(3, 61);
    for time in 0..300 {
        views[1].position.x = if time % 2 == 0 { 1.0 } else { 7.0 };
        kept.select(&list(&tree, &views)).unwrap();
    }
    anew.select(&list(&tree, &views)).unwrap();
    assert_same(&kept, &anew, "at the end");
}

#[test]
fn maps_of_octree_cuts_are_those_of_the_double_traversal_without_sharing() {
    let octree = octree_of(&room(), 5);
    let tree = CutTree::of_octree(&gpu(), &octree).unwrap();
    let views = scattered(84, 71);
    for side in [16, 32] {
        let settings = wide(5, side, false);
        let frame = Frame::new(&octree, settings, &views);
        for method in [CutMethod::Basic, CutMethod::Incremental] {
            let texel = Texel::RangeAndNode;
            let told = CutSettings { method, side, texel, disc: settings.disc, ..CutSettings::default() };
            let mut cuts = ManyLods::new(&gpu(), tree.clone(), told).unwrap();
            let stats = cuts.render(&list(&tree, &views)).unwrap();
            assert_eq!(stats.nodes, cuts.cuts().unwrap().len() as u64);
            let maps = cuts.maps().unwrap();
            let (mut wrong, mut texels) = (0, 0);
            for view in 0..views.len() {
                let own = maps.read(&gpu(), view as u32).unwrap();
                let inside = |texel: &usize| is_inside(*texel as u32, side);
                for texel in (0..own.len()).filter(inside) {
                    texels += 1;
                    wrong += usize::from(own[texel] != frame.of(view)[texel]);
                }
            }
            assert!(wrong * 1000 <= texels, "{wrong} of {texels} texels, {}", method.name());
        }
    }
}

#[test]
fn maps_of_sphere_cuts_are_close_to_what_rays_meet() {
    let tree = CutTree::of_spheres(&balls(15));
    let views: Vec<ViewPoint> =
        scattered(20, 73).into_iter().map(|v| ViewPoint::everywhere(v.position)).collect();
    let mut cuts = many(&tree, CutMethod::Basic);
    cuts.render(&list(&tree, &views)).unwrap();
    let mut exact = RasterViews::new(&gpu(), *tree.root(), room(), Settings::default()).unwrap();
    exact.render(&list(&tree, &views)).unwrap();
    let mut off: Vec<f32> = Vec::new();
    for view in 0..views.len() as u32 {
        let pairs = cuts.maps().unwrap().read(&gpu(), view).unwrap();
        let truth = exact.maps().read(&gpu(), view).unwrap();
        for texel in (0..512).filter(|texel| is_inside(*texel as u32, 16)) {
            let [a, b] = [&pairs, &truth].map(|map| f32::from_bits(map[texel][0]));
            assert!(a.is_finite() && a >= 0.0);
            off.push(if a == 0.0 { 1.0 } else { (a / b - 1.0).abs() });
        }
    }
    off.sort_by(f32::total_cmp);
    let at = |share: f64| off[(off.len() as f64 * share) as usize];
    assert!(at(0.5) < 0.03 && at(0.8) < 0.15, "median {}, 80% {}", at(0.5), at(0.8));
}

#[test]
fn imperfect_maps_come_closer_to_what_rays_meet_with_more_points() {
    let points = balls(14);
    let views: Vec<ViewPoint> =
        scattered(12, 75).into_iter().map(|v| ViewPoint::everywhere(v.position)).collect();
    let views = ViewList::new(&gpu(), &points.root, &views).unwrap();
    let mut exact = RasterViews::new(&gpu(), points.root, room(), Settings::default()).unwrap();
    exact.render(&views).unwrap();
    let mut imperfect = ImperfectViews::new(&gpu(), &points, Settings::default()).unwrap();
    let mut median_off = |points: u32| {
        imperfect.render(&views, points).unwrap();
        let mut off = Vec::new();
        for view in 0..12 {
            let maps = [imperfect.maps(), exact.maps()].map(|maps| maps.read(&gpu(), view).unwrap());
            for texel in (0..512).filter(|texel| is_inside(*texel as u32, 16)) {
                let [a, b] = [&maps[0], &maps[1]].map(|map| f32::from_bits(map[texel][0]));
                assert!(a.is_finite() && a > 0.0, "{points} points leave no gap");
                off.push((a / b - 1.0).abs());
            }
        }
        off.sort_by(f32::total_cmp);
        off[off.len() / 2]
    };
    let few = median_off(64);
    let many = median_off(8192);
    assert!(many < 0.1 && few > 2.0 * many, "{few} {many}");
    assert!(ImperfectViews::new(&gpu(), &points, Settings { side: 24, ..Settings::default() }).is_err());
}

#[test]
fn the_same_frames_give_the_same_bytes_again() {
    let [_, tree] = trees();
    let run = || {
        let mut cuts = many(&tree, CutMethod::Incremental);
        let mut views = scattered(50, 81);
        for time in 0..5 {
            views = moved(&views, time, 0.02);
            cuts.render(&list(&tree, &views)).unwrap();
        }
        let stats = cuts.render(&list(&tree, &moved(&views, 9, 0.02))).unwrap();
        let maps = cuts.maps().unwrap();
        let maps: Vec<_> = (0..50).map(|map| maps.read(&gpu(), map).unwrap()).collect();
        (maps, [stats.visits, stats.splits, stats.merges, stats.nodes], cuts.cuts().unwrap())
    };
    assert!(run() == run(), "another run, other bytes");
}

#[test]
fn settings_out_of_range_are_refused_by_field() {
    let [tree, _] = trees();
    let good = CutSettings::default();
    let refused = |settings: CutSettings| match ManyLods::new(&gpu(), tree.clone(), settings).unwrap_err() {
        HierarchyError::OutOfRange { field, .. } => field,
        other => panic!("{other}"),
    };
    assert_eq!(refused(CutSettings { side: 4, ..good }), "resolution");
    assert_eq!(refused(CutSettings { threshold: f32::NAN, ..good }), "threshold");
    assert_eq!(refused(CutSettings { threshold: 5.0, ..good }), "threshold");
    assert_eq!(refused(CutSettings { method: CutMethod::Lazy { edges: 0 }, ..good }), "edges");
    assert_eq!(refused(CutSettings { jump: f64::NAN, ..good }), "jump");
    assert_eq!(refused(CutSettings { lag: -0.1, ..good }), "lag");
    assert_eq!(refused(CutSettings { entries: Some(0), ..good }), "entries");
}
