//! Visibility of a view's surfaces from the cameras of a lattice.

use crate::common;

use std::sync::Arc;

use argus_scene::procedural::mirrors;
use argus_scene::reference::{SceneSight, Tracer};
use argus_scene::rig::{CandidateCameras, Target, VisibilityQuery as _};
use argus_scene::{Camera, Material, Rig, Scene};
use common::{furnace, patch, scene, white};
use glam::{DAffine3, DMat3, DVec2, DVec3};

/// Walls of 20 m that face +z, at these heights above the plane z = 0.
fn walls(at: &[f64], double_sided: bool) -> Scene {
    let material = Material { double_sided, ..white() };
    let mut scene = scene(at.iter().map(|_| patch(1)).collect(), vec![material], furnace());
    for (instance, z) in scene.instances.iter_mut().zip(at) {
        let matrix3 = DMat3::from_diagonal(DVec3::splat(10.0));
        instance.world_from_mesh = DAffine3 { matrix3, translation: DVec3::Z * *z };
    }
    scene
}

fn sight(scene: Scene) -> SceneSight {
    SceneSight::new(&Arc::new(scene))
}

/// A viewer a metre in front of the plane z = 0, looking at it.
fn viewer() -> Camera {
    Camera::look_at(DVec3::new(0.1, 0.2, 1.0), DVec3::new(0.1, 0.2, 0.0))
}

#[test]
fn a_camera_behind_a_wall_is_not_chosen_for_a_viewer_before_it() {
    let candidates = [(1, DVec3::new(0.1, 0.2, -0.2)), (2, DVec3::new(1.0, 1.0, 1.4))];
    for double_sided in [false, true] {
        // From behind, a single-sided wall is invisible, and so such a camera shows nothing of it.
        let sight = sight(walls(&[0.0], double_sided));
        assert_eq!(sight.best(&viewer(), &candidates, 1), [2], "double-sided: {double_sided}");
        assert!(!sight.sees(candidates[0].1, viewer().eye));
        assert!(sight.sees(candidates[1].1, viewer().eye));
    }
}

#[test]
fn a_second_camera_is_chosen_for_targets_that_the_first_does_not_show() {
    // A ledge hides the left of the view from both nearer cameras.
    let mut scene = walls(&[0.0, 0.5], true);
    scene.instances[1].world_from_mesh.matrix3 = DMat3::from_diagonal(DVec3::new(0.2, 10.0, 1.0));
    scene.instances[1].world_from_mesh.translation = DVec3::new(0.5, 0.0, 0.3);
    let right = [(1, DVec3::new(1.0, 0.2, 0.9)), (2, DVec3::new(1.0, 0.3, 0.9))];
    let left = (3, DVec3::new(-1.2, 0.2, 0.9));
    let chosen = sight(scene).best(&viewer(), &[right[0], right[1], left], 2);
    assert!(chosen.contains(&3), "{chosen:?}");
}

#[test]
fn of_cameras_with_equal_visibility_the_first_is_best() {
    let away = Camera { target: DVec3::new(0.1, 0.2, 9.0), ..viewer() };
    let candidates: Vec<(u64, DVec3)> =
        (0..5).map(|i| (9 - i, DVec3::new(0.0, 0.0, 1.0 + i as f64))).collect();
    let sight = sight(walls(&[0.0], false));
    assert_eq!(sight.best(&away, &candidates, 3), [9, 8, 7], "all see the sky");
    assert_eq!(sight.best(&away, &candidates, 9), [9, 8, 7, 6, 5], "there are no more");
    assert_eq!(sight.best(&away, &candidates, 0), [0; 0]);
    assert_eq!(sight.best(&away, &[], 4), [0; 0]);
}

#[test]
fn a_camera_at_the_eye_is_the_best_and_one_on_a_surface_is_harmless() {
    let candidates = [(1, DVec3::new(0.1, 0.2, 0.0)), (2, viewer().eye), (3, DVec3::splat(f64::NAN))];
    assert_eq!(sight(walls(&[0.0], false)).best(&viewer(), &candidates, 1), [2]);
    let on_the_wall = Camera { eye: DVec3::new(0.1, 0.2, 0.0), target: DVec3::ZERO, ..viewer() };
    assert_eq!(sight(walls(&[0.0], false)).best(&on_the_wall, &candidates, 3).len(), 3);
}

#[test]
fn a_rig_chooses_cameras_that_see_the_view() {
    let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 2.0, face: 8 };
    // Between the wall and the lattice's planes at z = 0 and z = 2.
    let viewer = Camera::look_at(DVec3::new(0.1, 0.2, 0.45), DVec3::new(0.1, 0.2, 0.2));
    let sight = sight(walls(&[0.2], true));
    let z = |index| rig.camera(index).unwrap().center().z;
    let four = |sight| rig.nearest_among(&viewer, 4, CandidateCameras { refined: &[], sight });
    assert!(four(None).iter().any(|&index| z(index) == 0.0));
    assert!(four(Some(&sight)).iter().all(|&index| z(index) > 0.0));
    assert_eq!(four(None), rig.nearest(&viewer, 4));
    let all = rig.nearest_among(&viewer, usize::MAX, CandidateCameras { refined: &[], sight: Some(&sight) });
    assert_eq!(all.len(), 64, "there are no more around");
    assert_eq!(
        rig.nearest_among(&viewer, 8, CandidateCameras { refined: &[], sight: Some(&sight) })[..4],
        four(Some(&sight))
    );
    assert_eq!(z(rig.refinement(&viewer, 1, None).unwrap()), 0.0);
    assert_eq!(z(rig.refinement(&viewer, 1, Some(&sight)).unwrap()), 1.0);
}

#[test]
fn cameras_are_as_close_together_as_what_a_viewer_sees_is_near() {
    let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 100.0, face: 8 };
    let sight = sight(walls(&[0.0], true));
    let levels =
        [(2e5, -6), (5000.0, -1), (4700.0, 0), (160.0, 0), (80.0, 1), (9.0, 5), (0.5, 9), (1e-6, 10)];
    for (range, level) in levels {
        let viewer = Camera::look_at(DVec3::new(0.1, 0.2, range), DVec3::new(0.1, 0.2, 0.0));
        // A wall as wide as the view.
        let viewer = Camera { fov_deg: if range > 5.0 { 1e-3 } else { 50.0 }, ..viewer };
        assert_eq!(rig.own_level(&viewer, Some(&sight)), level, "{range} m");
        assert_eq!(rig.own_level(&viewer, None), 0);
        let four = rig.nearest_among(&viewer, 4, CandidateCameras { refined: &[], sight: Some(&sight) });
        let spacing = 100.0 * 0.5_f64.powi(level);
        for index in four {
            assert!(rig.level(index).unwrap() <= level.max(0) as u32);
            let apart = rig.camera(index).unwrap().center() - viewer.eye;
            assert!(apart.abs().max_element() <= 2.0 * spacing, "{range} m: {apart}");
        }
        let finer = level.max(0) as u32 + 1;
        assert!(rig.level(rig.refinement(&viewer, finer, Some(&sight)).unwrap()).unwrap() <= finer);
    }
    let away = Camera::look_at(DVec3::Z, DVec3::Z * 9.0);
    assert_eq!(rig.own_level(&away, Some(&sight)), 0, "only the sky is in sight");
}

#[test]
fn the_choice_is_the_same_far_from_the_origin() {
    let far = DVec3::splat(1e6);
    let mut moved = walls(&[0.2], true);
    moved.instances[0].world_from_mesh.translation += far;
    let candidates = |at: DVec3| [0.0, 1.0, 2.0].map(|z| (z as u64, at + DVec3::new(0.0, 0.0, z)));
    let view = |at: DVec3| Camera::look_at(at + DVec3::new(0.1, 0.2, 0.45), at + DVec3::new(0.3, 0.4, 0.2));
    let here = sight(walls(&[0.2], true)).best(&view(DVec3::ZERO), &candidates(DVec3::ZERO), 3);
    assert_eq!(sight(moved).best(&view(far), &candidates(far), 3), here);
}

#[test]
fn in_a_moving_scene_targets_are_at_their_positions_of_the_time() {
    let scene = Arc::new(mirrors(5));
    let sight = SceneSight::new(&scene);
    let camera = scene.default_camera();
    let directions: Vec<DVec3> = (0..64)
        .map(|i| camera.direction(DVec2::new(f64::from(i % 8), f64::from(i / 8)) + 0.5, 8, 8))
        .collect();
    let at = |secs| sight.targets(camera.eye, &directions, secs);
    assert_eq!(at(0.0), at(0.0));
    assert_ne!(at(0.0), at(1.3), "the balls have moved");
    let reference = Tracer::new(scene.clone()).at(1.3);
    for (target, direction) in at(1.3).iter().zip(&directions) {
        let Target::Surface(point) = target else { continue };
        let hit = reference.trace(camera.eye, *direction).expect("a surface");
        assert!(hit.position.distance(*point) < 1e-9);
    }
}
