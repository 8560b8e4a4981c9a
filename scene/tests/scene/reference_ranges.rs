//! The reference tracer's hits, against geometry that is known exactly.
use crate::common;

use argus_scene::reference::Tracer;
use argus_scene::{Instance, Scene};
use common::{furnace, patch, scene, sphere, tracer, white};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use proptest::prelude::*;

fn placed(mesh: argus_scene::Mesh, world_from_mesh: DAffine3) -> Scene {
    let mut scene = scene(vec![mesh], vec![white()], furnace());
    scene.instances = vec![Instance { mesh: 0, node: None, world_from_mesh }];
    scene
}

/// The nearest hit by a test of every triangle, without a hierarchy.
fn brute_force(scene: &Scene, origin: DVec3, direction: DVec3) -> Option<f64> {
    let mut nearest = f64::INFINITY;
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        for corners in mesh.indices.chunks_exact(3) {
            let place = |i: u32| {
                let p = mesh.origin + mesh.positions[i as usize].as_dvec3();
                instance.world_from_mesh.transform_point3(p)
            };
            let [a, b, c] = [0, 1, 2].map(|k| place(corners[k]));
            let (p, s) = (direction.cross(c - a), origin - a);
            let q = s.cross(b - a);
            let determinant = (b - a).dot(p);
            let (u, v) = (s.dot(p) / determinant, direction.dot(q) / determinant);
            let t = (c - a).dot(q) / determinant;
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 {
                nearest = nearest.min(t);
            }
        }
    }
    nearest.is_finite().then_some(nearest)
}

#[test]
fn a_plane_has_its_exact_range_from_any_side_and_distance() {
    let tracer = tracer(placed(patch(7), DAffine3::IDENTITY));
    for origin in [DVec3::new(0.1, 0.2, 3.0), DVec3::new(-4.0, 1.0, -0.01), DVec3::new(2e5, -1e5, 3e5)] {
        for target in [DVec3::new(0.3, -0.4, 0.0), DVec3::new(-0.99, 0.99, 0.0)] {
            let hit = tracer.trace(origin, target - origin).expect("the patch is there");
            let distance = origin.distance(target);
            assert!((hit.range - distance).abs() <= 1e-14 * distance.max(1.0), "{origin} {target}");
            assert!(hit.position.distance(target) <= 1e-10);
            assert_eq!(hit.front, origin.z > 0.0);
        }
        assert!(tracer.trace(origin, DVec3::new(1.01, 0.0, 0.0) - origin).is_none());
    }
}

#[test]
fn a_tessellated_sphere_is_as_round_as_its_triangles() {
    let rings = 64;
    let tracer = tracer(placed(sphere(rings), DAffine3::IDENTITY));
    // The sagitta of a chord that spans one ring.
    let flat = 1.0 - (std::f64::consts::PI / f64::from(rings)).cos();
    for i in 0..500 {
        let angle = f64::from(i) * 2.399_963;
        let y = 1.0 - f64::from(i) / 250.0;
        let radius = (1.0 - y * y).max(0.0).sqrt();
        let outward = DVec3::new(radius * angle.cos(), y, radius * angle.sin());
        let outside = tracer.trace(outward * 5.0, -outward).expect("hit from outside");
        assert!(outside.range >= 4.0 - 1e-7 && outside.range <= 4.0 + flat, "{outside:?}");
        assert!(outside.front);
        let inside = tracer.trace(DVec3::ZERO, outward).expect("hit from inside");
        assert!(inside.range >= 1.0 - flat && inside.range <= 1.0 + 1e-7, "{inside:?}");
        assert!(!inside.front);
    }
}

#[test]
fn instances_are_placed_by_any_invertible_transform_and_fronts_survive_mirrors() {
    let turned = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.5, -0.9, 2.1));
    for linear in [
        DMat3::IDENTITY,
        turned,
        turned * DMat3::from_diagonal(DVec3::new(0.02, 5.0, 0.7)),
        DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
        turned * DMat3::from_diagonal(DVec3::new(1.0, -3.0, 0.5)) * turned,
    ] {
        let world_from_mesh = DAffine3 { matrix3: linear, translation: DVec3::new(3.0, -2.0, 9.0) };
        let scene = placed(patch(3), world_from_mesh);
        let tracer = Tracer::new(scene.into());
        let target = world_from_mesh.transform_point3(DVec3::new(0.3, -0.1, 0.0));
        for side in [1.0, -1.0] {
            let eye = world_from_mesh.transform_point3(DVec3::new(0.8, 0.5, 2.0 * side));
            let hit = tracer.trace(eye, target - eye).expect("the patch is there");
            assert!((hit.range - eye.distance(target)).abs() < 1e-13 * hit.range.max(1.0), "{linear}");
            assert_eq!(hit.front, side > 0.0, "{linear}");
        }
    }
}

#[test]
fn a_scene_a_million_metres_away_is_traced_as_precisely() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    let here = tracer(placed(sphere(32), DAffine3::IDENTITY));
    let by_instance = tracer(placed(sphere(32), DAffine3::from_translation(far)));
    let by_origin = tracer(placed(argus_scene::Mesh { origin: far, ..sphere(32) }, DAffine3::IDENTITY));
    for i in 0..400 {
        let eye = DVec3::new(f64::from(i).sin() * 9.0, f64::from(i % 7) - 3.0, f64::from(i).cos() * 9.0);
        let aim = DVec3::new(0.0, f64::from(i % 11) / 6.0 - 0.9, 0.0) - eye;
        let expected = here.trace(eye, aim).map(|hit| hit.range);
        for tracer in [&by_instance, &by_origin] {
            match (tracer.trace(far + eye, aim).map(|hit| hit.range), expected) {
                (Some(range), Some(expected)) => assert!((range / expected - 1.0).abs() < 1e-9),
                (None, None) => {}
                // A ray at the silhouette may fall to either side; its range must then be a grazing one.
                (range, expected) => panic!("ray {i}: {range:?}, here {expected:?}"),
            }
        }
    }
}

#[test]
fn an_eye_a_million_metres_away_still_sees_a_small_object() {
    let tracer = tracer(placed(patch(40), DAffine3::IDENTITY));
    let eye = DVec3::new(1e6, 2e6, 3e6);
    for i in 0..1000 {
        let target = DVec3::new(f64::from(i).sin() * 0.999, f64::from(i * 7).cos() * 0.999, 0.0);
        let hit = tracer.trace(eye, target - eye).expect("nothing may be culled");
        assert!((hit.range / eye.distance(target) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn no_ray_slips_through_edges_or_corners_of_a_tessellation() {
    let cells = 16;
    // Turned, so that edges are not aligned with any axis and every vertex is rounded.
    let turn = DAffine3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, -0.2));
    for world_from_mesh in [DAffine3::IDENTITY, turn] {
        let scene = placed(patch(cells), world_from_mesh);
        let tracer = Tracer::new(scene.clone().into());
        let mesh = &scene.meshes[0];
        let eye = world_from_mesh.transform_point3(DVec3::new(0.137, -0.271, 1.7));
        for triangle in mesh.indices.chunks_exact(3) {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let [a, b] = [a, b].map(|k| mesh.positions[triangle[k] as usize].as_dvec3());
                for step in 0..=8 {
                    let p = a.lerp(b, f64::from(step) / 8.0);
                    if p.abs().max_element() > 0.999 {
                        continue; // the patch's own border has nothing behind it
                    }
                    let target = world_from_mesh.transform_point3(p);
                    assert!(tracer.trace(eye, target - eye).is_some(), "a crack at {p}");
                }
            }
        }
    }
}

#[test]
fn degenerate_triangles_and_transforms_are_not_seen_and_hide_nothing() {
    let mut mesh = patch(2);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::NAN, Vec3::INFINITY, Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.1, 0.1, 1.0)]);
    mesh.normals.extend([Vec3::Z; 4]);
    let (nan, infinite, a, b) = (first, first + 1, first + 2, first + 3);
    mesh.indices.extend([nan, a, b, a, infinite, b, a, a, b, a, b, a, b, b, b, 0, a, 9999]);
    let mut scene = placed(mesh, DAffine3::IDENTITY);
    for singular in [DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0)), DMat3::IDENTITY * f64::NAN]
    {
        let translation = DVec3::new(0.0, 0.0, 1.0);
        let world_from_mesh = DAffine3 { matrix3: singular, translation };
        scene.instances.push(Instance { mesh: 0, node: None, world_from_mesh });
    }
    scene.instances.push(Instance { mesh: 0, node: None, world_from_mesh: DAffine3::NAN });
    let tracer = Tracer::new(scene.into());
    let hit = tracer.trace(DVec3::new(0.05, 0.05, 3.0), DVec3::NEG_Z).expect("the patch behind");
    assert!(hit.instance == 0 && hit.triangle < 8, "{hit:?}");
    assert!((hit.range - 3.0).abs() < 1e-14);
}

#[test]
fn extreme_sizes_are_traced_or_left_out_and_hide_nothing() {
    let ray = (DVec3::new(0.1, 0.2, 3.0), DVec3::NEG_Z);
    let mut scene = placed(patch(3), DAffine3::IDENTITY);
    for translation in [1e30, -1e149, 1e200, f64::MAX] {
        let world_from_mesh = DAffine3::from_translation(DVec3::X * translation);
        scene.instances.push(Instance { mesh: 0, node: None, world_from_mesh });
    }
    let hit = Tracer::new(scene.into()).trace(ray.0, ray.1).expect("the patch beside the far ones");
    assert!(hit.instance == 0 && (hit.range - 3.0).abs() < 1e-12, "{hit:?}");
    for scale in [1e-90_f64, 1e-30, 1e30, 1e90] {
        let tracer = Tracer::new(placed(patch(3), DAffine3::from_scale(DVec3::splat(scale))).into());
        let hit = tracer.trace(ray.0 * scale, ray.1).unwrap_or_else(|| panic!("scaled by {scale}"));
        assert!((hit.range / scale - 3.0).abs() < 1e-12, "{scale}: {hit:?}");
    }
    let mut huge = patch(3);
    huge.positions.iter_mut().for_each(|p| *p *= f32::MAX);
    let hit = tracer(placed(huge, DAffine3::IDENTITY)).trace(ray.0, ray.1).expect("the huge patch");
    assert!((hit.range - 3.0).abs() < 1e-12);
}

#[test]
fn rays_without_a_direction_or_not_finite_meet_nothing() {
    let tracer = tracer(placed(patch(2), DAffine3::IDENTITY));
    let origin = DVec3::new(0.1, 0.2, 3.0);
    for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(tracer.trace(DVec3::new(0.0, odd, 1.0), DVec3::NEG_Z), None);
        assert_eq!(tracer.trace(origin, DVec3::new(0.0, odd, -1.0)), None);
        assert!(tracer.radiance_along(origin, DVec3::splat(odd), DVec3::ZERO, DVec3::ZERO).is_finite());
    }
    assert_eq!(tracer.trace(origin, DVec3::ZERO), None);
    // A direction of extreme length is still a direction.
    for scale in [1e-300, 1e300, f64::MAX, 5e-324] {
        assert_eq!(tracer.trace(origin, DVec3::NEG_Z * scale).map(|hit| hit.range), Some(3.0), "{scale}");
    }
    let empty = common::tracer(scene(Vec::new(), vec![white()], furnace()));
    assert_eq!(empty.trace(origin, DVec3::NEG_Z), None);
}

#[test]
fn of_two_surfaces_in_one_place_the_first_is_seen_from_every_side() {
    let mut scene = placed(patch(5), DAffine3::IDENTITY);
    scene.instances = vec![scene.instances[0]; 4];
    let mesh = &mut scene.meshes[0];
    let again = mesh.indices.clone();
    mesh.indices.extend(again);
    let tracer = Tracer::new(scene.into());
    for i in 0..100 {
        let target = DVec3::new(f64::from(i).sin(), f64::from(i).cos(), 0.0) * 0.9;
        let hit = tracer.trace(DVec3::new(0.3, 0.1, 2.0), target - DVec3::new(0.3, 0.1, 2.0)).unwrap();
        assert!(hit.instance == 0 && hit.triangle < 50, "{hit:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Triangles of all sizes, some overlapping, in two instances: the hierarchies lose none of them.
    #[test]
    fn the_hierarchies_find_the_same_hits_as_a_test_of_every_triangle(
        corners in proptest::collection::vec(-1.0f32..1.0, 9 * 40),
        sizes in proptest::collection::vec(1e-4f32..2.0, 40),
        eye in proptest::array::uniform3(-3.0f64..3.0),
        offset in prop_oneof![Just(0.0), Just(1e6)],
    ) {
        let triangle = |i: usize| {
            let at = Vec3::from_slice(&corners[9 * i..]);
            let edge = |k: usize| at + Vec3::from_slice(&corners[9 * i + 3 * k..]) * sizes[i];
            [at, edge(1), edge(2)]
        };
        let positions: Vec<Vec3> = (0..40).flat_map(triangle).collect();
        let mesh = argus_scene::Mesh { normals: vec![Vec3::Y; 120], positions, indices: (0..120).collect(), ..Default::default() };
        let mut scene = placed(mesh, DAffine3::from_translation(DVec3::splat(offset)));
        let linear = DMat3::from_rotation_y(1.0) * DMat3::from_diagonal(DVec3::new(0.5, -1.5, 0.8));
        scene.instances.push(Instance {
            mesh: 0,
            node: None,
            world_from_mesh: DAffine3 { matrix3: linear, translation: DVec3::splat(offset) + DVec3::X },
        });
        let tracer = Tracer::new(scene.clone().into());
        let eye = DVec3::from(eye) + DVec3::splat(offset);
        for i in 0..64 {
            let target = DVec3::new(f64::from(i).sin(), f64::from(i * 3).cos(), f64::from(i * 5).sin());
            let direction = (target + DVec3::splat(offset) - eye).normalize();
            let (found, expected) = (tracer.trace(eye, direction).map(|h| h.range), brute_force(&scene, eye, direction));
            match (found, expected) {
                (Some(found), Some(expected)) => prop_assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}"),
                (found, expected) => prop_assert_eq!(found.is_some(), expected.is_some()),
            }
        }
    }
}
