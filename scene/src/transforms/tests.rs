//! Moving nodes by request.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::*;
use crate::animation::{Animation, Channel, Interpolation, Node, Parts, Track};
use crate::{Instance, Light, Mesh, Revisions, Transforms};

fn node(name: &str, parent: Option<u32>, x: f64) -> Node {
    let rest = Rest::Parts(Parts { translation: DVec3::X * x, ..Parts::default() });
    Node { name: name.to_owned(), parent, rest, lights: Vec::new() }
}

/// An arm at x = 1 with a hand at x = 3, which holds a lamp, and a stone at x = 10.
fn arm() -> Arc<Scene> {
    let mut nodes = vec![node("arm", None, 1.0), node("hand", Some(0), 2.0), node("stone", None, 10.0)];
    nodes[1].lights = vec![0];
    let at = |node: u32, x: f64| Instance {
        mesh: 0,
        node: Some(node),
        world_from_mesh: DAffine3::from_translation(DVec3::X * x),
    };
    let mut scene = Scene {
        meshes: vec![Mesh::default()],
        instances: vec![at(0, 1.0), at(1, 3.0), at(2, 10.0)],
        nodes,
        ..Scene::default()
    };
    scene.lighting.lights =
        vec![Light::Point { position: DVec3::X * 3.0, intensity: glam::Vec3::ONE, range: None, radius: 0.0 }];
    Arc::new(scene)
}

fn to(x: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::X * x)
}

fn known(scene: &Arc<Scene>, revision: u64, nodes: &[(u32, DAffine3)]) {
    let parent_from_node = nodes.iter().copied().collect();
    scene.revisions.add(Arc::new(Transforms { revision, parent_from_node }));
}

fn xs(scene: &Scene, time_secs: f64) -> Vec<f64> {
    scene.at(time_secs).instances.iter().map(|placed| placed.world_from_mesh.translation.x).collect()
}

#[test]
fn children_and_lights_hang_from_a_moved_node() {
    let scene = arm();
    known(&scene, 1, &[(0, to(5.0))]);
    let moved = scene.with_transforms(1, &BTreeSet::new()).unwrap();
    assert_eq!(xs(&moved, 0.0), [5.0, 7.0, 10.0]);
    let Light::Point { position, .. } = moved.at(0.0).lighting.lights[0] else { panic!("a lamp") };
    assert_eq!(position.x, 7.0);
    assert_eq!(scene.lighting_at(0.0, 1).lights, moved.at(0.0).lighting.lights);
    assert_eq!(scene.lighting_at(0.0, 0).lights, scene.lighting.lights);
}

#[test]
fn a_later_revision_says_all_that_differs_from_the_file() {
    let scene = arm();
    known(&scene, 1, &[(0, to(5.0))]);
    known(&scene, 2, &[(2, to(-1.0))]);
    let first = scene.with_transforms(1, &BTreeSet::new()).unwrap();
    let second = first.with_transforms(2, &BTreeSet::from([0])).unwrap();
    assert_eq!(xs(&second, 0.0), [1.0, 3.0, -1.0], "the arm is as in the file again");
    assert_eq!(second.by_request.as_ref().unwrap().movers, BTreeSet::from([0, 2]));
    let file = second.with_transforms(0, &BTreeSet::new()).unwrap();
    assert!(Arc::ptr_eq(&file, &scene), "revision 0 is the file, and is not copied");
    assert!(scene.with_transforms(3, &BTreeSet::new()).is_none());
}

#[test]
fn no_animation_moves_a_mover_and_none_begins_to_play() {
    let mut scene = Scene::clone(&arm());
    let moves = |node: u32, x: f32| Channel {
        node,
        times_secs: vec![0.0, 1.0],
        track: Track::Translation(vec![glam::Vec3::ZERO, glam::Vec3::X * x]),
        interpolation: Interpolation::Linear,
    };
    let walk = Animation { name: "walk".to_owned(), channels: vec![moves(0, 100.0)] };
    // It does not play, since it moves the arm, too.
    let run = Animation { name: "run".to_owned(), channels: vec![moves(0, 9.0), moves(2, 50.0)] };
    scene.animations = vec![walk, run];
    let scene = Arc::new(scene);
    known(&scene, 1, &[(0, to(5.0))]);
    let moved = scene.with_transforms(1, &BTreeSet::new()).unwrap();
    assert_eq!(xs(&moved, 0.5), [5.0, 7.0, 10.0]);
    let world = |node, set: &[(u32, DAffine3)]| scene.world_from_parent(node, &set.iter().copied().collect());
    assert_eq!(world(1, &[]), None, "the arm is moved by its animation");
    assert_eq!(world(1, &[(0, to(5.0))]), Some(to(5.0)));
    assert_eq!(world(2, &[]), Some(DAffine3::IDENTITY));
}

#[test]
fn a_bad_matrix_is_refused_with_the_node_and_the_reason() {
    let said = |transform: DAffine3| {
        check_transform("nodes.matrix", "3 \"arm\"", &transform).unwrap_err().to_string()
    };
    let nan = said(DAffine3::from_translation(DVec3::new(0.0, f64::NAN, 0.0)));
    assert!(nan.contains("nodes.matrix: node 3 \"arm\": row 1, column 3") && nan.contains("NaN"), "{nan}");
    for singular in [
        DMat3::ZERO,
        DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0)),
        DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Y),
    ] {
        assert!(said(DAffine3::from_mat3(singular)).contains("singular"));
    }
    assert!(said(to(1e300)).contains("at most 1e15"));
    for good in
        [to(4.0), DAffine3::from_scale(DVec3::splat(1e-6)), DAffine3::from_scale(DVec3::new(-1.0, 1e4, 1e-4))]
    {
        check_transform("nodes.matrix", "0", &good).unwrap();
    }
}

#[test]
fn kept_revisions_are_bounded_by_number_and_by_size() {
    let all = Revisions::default();
    (1..=1000).for_each(|revision| all.add(Arc::new(Transforms { revision, ..Transforms::default() })));
    assert_eq!(
        (all.all().len(), all.get(1000 - 63).is_some(), all.get(1000 - 64).is_some()),
        (64, true, false)
    );
    assert_eq!(all.get(0).unwrap().revision, 0);
    let many: BTreeMap<u32, DAffine3> = (0..100_000).map(|node| (node, DAffine3::IDENTITY)).collect();
    for revision in 2000..2010 {
        all.add(Arc::new(Transforms { revision, parent_from_node: many.clone() }));
    }
    assert_eq!(all.all().iter().map(|kept| kept.revision).collect::<Vec<_>>(), [2008, 2009]);
}
