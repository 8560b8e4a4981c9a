//! What no view sees is culled, and nothing else.

use argus_megaviews::many_views::{Bounding, Occlusion, Settings, ViewList, ViewPoint};
use glam::DVec3;

use crate::common::{Frame, octree_of, room, scattered, wide};
use crate::device::gpu;
use crate::maps_oracle::Nodes;

/// Every texel that holds a node of which any view of the map sees a part is the same as without culling.
fn nothing_seen_is_lost(views: &[ViewPoint], settings: Settings) {
    let octree = octree_of(&room(), 5);
    let nodes = Nodes::of(&octree);
    let with = Frame::new(&octree, settings, views);
    let without = Frame::new(&octree, Settings { culling: false, ..settings }, views);
    assert_eq!(without.stats.steps.iter().map(|s| s.culled).sum::<u64>(), 0);
    assert_eq!(with.map_of_view, without.map_of_view);
    let (mut seen, mut unseen) = (0, 0);
    for (view, point) in views.iter().enumerate() {
        for (texel, value) in without.of(view).iter().enumerate() {
            if value[0] != 0 && nodes.is_seen(value[1] as usize, point) {
                assert_eq!(with.of(view)[texel], *value, "view {view} ({point:?}), texel {texel}");
                seen += 1;
            } else if with.of(view)[texel] != *value {
                unseen += 1;
            }
        }
    }
    assert!(seen > 1000, "{seen} texels seen");
    let culled: u64 = with.stats.steps.iter().map(|s| s.culled).sum();
    assert!(culled > 0 && unseen > 0, "something was culled: {culled} pairs, {unseen} texels");
}

#[test]
fn no_pair_that_a_view_sees_is_culled_view_by_view() {
    nothing_seen_is_lost(&scattered(140, 1), wide(5, 16, false));
}

#[test]
fn no_pair_that_any_of_a_nodes_views_sees_is_culled() {
    for bounding in [Bounding::Cell, Bounding::Tight] {
        for view_depth in [2, 5] {
            let settings = Settings { bounding, view_depth: Some(view_depth), ..wide(5, 16, true) };
            nothing_seen_is_lost(&scattered(300, 2), settings);
        }
    }
}

#[test]
fn views_of_opposite_directions_in_one_cell_see_everything_together() {
    let at = DVec3::new(3.3, 1.2, 2.9);
    // Cones of directions whose half angle and field of view add up to more than π, and views that do not.
    let view = |direction, half_fov| ViewPoint { position: at, direction, half_fov };
    let mut views =
        vec![view(DVec3::X, 2.0), view(DVec3::NEG_X, 2.0), view(DVec3::Y, 1e-3), view(DVec3::NEG_Y, 3.1)];
    let up = views[2];
    views.extend((0..20).map(|i| ViewPoint { position: at + DVec3::X * f64::from(i) * 0.2, ..up }));
    nothing_seen_is_lost(&views, wide(5, 16, true));
    nothing_seen_is_lost(&views, wide(5, 16, false));
}

#[test]
fn what_is_left_out_behind_nearer_surfaces_changes_no_byte() {
    let octree = octree_of(&room(), 6);
    for (sharing, count) in [(false, 120), (true, 500)] {
        for side in [16, 32] {
            let views = scattered(count, 4);
            let settings = wide(6, side, sharing);
            let all = Frame::new(&octree, settings, &views);
            let few = Frame::new(&octree, Settings { occlusion: Occlusion::Shells, ..settings }, &views);
            assert_eq!(few.map_of_view, all.map_of_view);
            assert!(few.maps == all.maps, "sharing {sharing}, {side}: other bytes");
            let [fewer, more] = [few.stats.rendered(), all.stats.rendered()];
            assert!(fewer < more, "{fewer} pairs of {more}");
            // What could be left out by who knew the maps beforehand.
            let mut known = Frame::new(&octree, Settings { occlusion: Occlusion::Known, ..settings }, &views);
            let list = ViewList::new(&gpu(), &octree.root, &views).unwrap();
            assert!(known.many.render(&list).unwrap().rendered() < fewer);
            let maps = (0..known.stats.maps).map(|map| known.many.maps().read(&gpu(), map).unwrap());
            assert!(
                maps.eq(all.maps.iter().cloned()),
                "sharing {sharing}, {side}: other bytes from known maps"
            );
        }
    }
}
