use glam::{DAffine3, Vec3};

use super::*;
use crate::{Camera, Mesh, Rig, RigSettings, scene::NamedCamera};

/// A scene of meshes, each of triangles.
fn scene(meshes: &[Vec<[DVec3; 3]>]) -> Scene {
    let mesh = |triangles: &Vec<[DVec3; 3]>| Mesh {
        positions: triangles.iter().flatten().map(|p| p.as_vec3()).collect(),
        normals: vec![Vec3::Y; 3 * triangles.len()],
        indices: (0..3 * triangles.len() as u32).collect(),
        ..Mesh::default()
    };
    Scene {
        meshes: meshes.iter().map(mesh).collect(),
        instances: (0..meshes.len() as u32)
            .map(|mesh| Instance { mesh, node: None, world_from_mesh: DAffine3::IDENTITY })
            .collect(),
        ..Scene::default()
    }
}

/// A level square with `cells` × `cells` quads, its middle at a point.
fn ground(size: f64, cells: u32, middle: DVec3) -> Vec<[DVec3; 3]> {
    let at = |x: u32, z: u32| {
        middle + DVec3::new(f64::from(x), 0.0, f64::from(z)) * (size / f64::from(cells))
            - DVec3::new(0.5, 0.0, 0.5) * size
    };
    let quad = |i: u32| {
        let (x, z) = (i % cells, i / cells);
        let [a, b, c, d] = [at(x, z), at(x + 1, z), at(x + 1, z + 1), at(x, z + 1)];
        [[a, b, c], [a, c, d]]
    };
    (0..cells * cells).flat_map(quad).collect()
}

/// A box of twelve triangles between two corners.
fn block(min: DVec3, max: DVec3) -> Vec<[DVec3; 3]> {
    let corner = |i: usize| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { max[axis] } else { min[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    };
    let quads = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6]];
    let halves = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]];
    quads.into_iter().flat_map(halves).map(|three| three.map(corner)).collect()
}

/// A sphere of `2 · rings · around` triangles about the origin.
fn sphere(radius: f64, rings: u32, around: u32) -> Vec<[DVec3; 3]> {
    let at = |ring: u32, step: u32| {
        let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
        let turn = std::f64::consts::TAU * f64::from(step) / f64::from(around);
        radius * DVec3::new(polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin())
    };
    let quad = |i: u32| {
        let (ring, step) = (i / around, i % around);
        let [a, b, c, d] = [at(ring, step), at(ring + 1, step), at(ring + 1, step + 1), at(ring, step + 1)];
        [[a, b, c], [a, c, d]]
    };
    (0..rings * around).flat_map(quad).collect()
}

/// A triangle of 1 cm.
fn speck(at: DVec3) -> Vec<[DVec3; 3]> {
    vec![[at, at + DVec3::X * 0.01, at + DVec3::Y * 0.01]]
}

/// A box of 2 m on a ground of 8 m, with a thin wall.
fn set_piece() -> Vec<Vec<[DVec3; 3]>> {
    let thing = block(DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 1.0));
    let wall = block(DVec3::new(-3.0, 0.0, -2.0), DVec3::new(-2.0, 2.0, -2.0));
    vec![ground(8.0, 1, DVec3::ZERO), thing, wall]
}

/// Forty blocks of 1 to 3 m on 20 m.
fn town(middle: DVec3) -> Vec<[DVec3; 3]> {
    let house = |i: u32| {
        let share = (f64::from(i) * DVec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5)).fract();
        let at = middle + (share - 0.5) * DVec3::new(20.0, 0.0, 20.0);
        block(at, at + DVec3::new(1.0, 1.0 + 2.0 * share.y, 1.0))
    };
    (1..=40).flat_map(house).collect()
}

fn with<const N: usize>(
    mut meshes: Vec<Vec<[DVec3; 3]>>,
    more: [Vec<[DVec3; 3]>; N],
) -> Vec<Vec<[DVec3; 3]>> {
    meshes.extend(more);
    meshes
}

/// The triangles of all meshes as one.
fn merged(meshes: Vec<Vec<[DVec3; 3]>>) -> Vec<Vec<[DVec3; 3]>> {
    vec![meshes.concat()]
}

#[test]
fn scenes_of_one_scale_have_their_bounds_as_extent() {
    let hill = |[a, b, c]: [DVec3; 3]| {
        [a, b, c].map(|p| p + DVec3::Y * (3.0 * (p.x * 0.1).sin() + 2.0 * (p.z * 0.07).cos()))
    };
    let statue: Vec<_> = sphere(0.4, 64, 64);
    let room = block(DVec3::new(-6.0, -1.0, -4.0), DVec3::new(6.0, 3.0, 4.0));
    let cases: [(&str, Vec<Vec<[DVec3; 3]>>); 11] = [
        ("a terrain", vec![ground(1000.0, 60, DVec3::ZERO).into_iter().map(hill).collect()]),
        ("a quad", vec![ground(3.0, 1, DVec3::ONE)]),
        ("a triangle", vec![vec![[DVec3::ZERO, DVec3::X, DVec3::Z]]]),
        ("equal triangles", vec![vec![[DVec3::ZERO, DVec3::X, DVec3::Z]; 9]]),
        ("a box on a ground", set_piece()),
        ("the same as one mesh", merged(set_piece())),
        ("a town", vec![ground(30.0, 1, DVec3::ZERO), town(DVec3::ZERO)]),
        ("a room", vec![room.clone()]),
        ("a statue in a room", vec![room.clone(), statue.clone()]),
        (
            "a bird above a town",
            vec![merged(vec![ground(30.0, 1, DVec3::ZERO), town(DVec3::ZERO)]).concat(), speck(DVec3::Y)],
        ),
        ("a room as one mesh with its statue", merged(vec![room, statue])),
    ];
    for (name, meshes) in cases {
        let scene = scene(&meshes);
        assert_eq!(scene.extent(), scene.bounds(), "{name}");
    }
}

#[test]
fn a_stray_triangle_or_a_sky_dome_changes_no_extent() {
    let about: [(&str, Vec<Vec<[DVec3; 3]>>); 3] = [
        ("a box on a ground", set_piece()),
        ("a town", vec![ground(30.0, 1, DVec3::ZERO), town(DVec3::ZERO)]),
        ("a room", vec![block(DVec3::new(-6.0, -1.0, -4.0), DVec3::new(6.0, 3.0, 4.0))]),
    ];
    for (name, meshes) in about {
        let extent = scene(&meshes).extent();
        for far in [100.0, 1e3, 1e4, 2e5] {
            let stray = with(meshes.clone(), [speck(DVec3::Z * far)]);
            assert_eq!(scene(&stray).extent(), extent, "{name}, {far} m");
            assert_eq!(scene(&stray).default_camera(), scene(&meshes).default_camera(), "{name}, {far} m");
            let rig = |meshes: &[_]| Rig::for_scene(&scene(meshes), &RigSettings::default()).unwrap();
            assert_eq!(rig(&stray), rig(&meshes), "{name}, {far} m");
            assert_eq!(scene(&merged(stray)).extent(), extent, "{name}, {far} m, one mesh");
        }
        for radius in [1e3, 1e4] {
            let dome = with(meshes.clone(), [sphere(radius, 32, 64)]);
            assert_eq!(scene(&dome).extent(), extent, "{name}, dome of {radius} m");
        }
    }
}

#[test]
fn a_ground_far_larger_than_what_stands_on_it_is_cut_off_around_that() {
    let things = || set_piece().split_off(1);
    for size in [100.0, 1e3, 1e5] {
        // Of two triangles, of a slab, and of many triangles.
        let slab = block(DVec3::new(-size, -0.1, -size), DVec3::new(size, 0.0, size));
        let mut grounds = vec![ground(size, 1, DVec3::ZERO), slab];
        grounds.extend((size > 500.0).then(|| ground(size, 40, DVec3::ZERO)));
        for (i, ground) in grounds.into_iter().enumerate() {
            let scene = scene(&with(things(), [ground, sphere(0.5, 8, 16)]));
            let (extent, of_things) =
                (scene.extent(), Bounds { min: DVec3::new(-3.0, 0.0, -2.0), max: DVec3::new(1.0, 2.0, 1.0) });
            assert!(
                extent.contains(of_things.min) && extent.contains(of_things.max),
                "{size} {i}: {extent:?}"
            );
            assert!(extent.size().max_element() < 30.0, "{size} {i}: {extent:?}");
        }
    }
}

#[test]
fn the_extent_scales_and_moves_with_the_scene() {
    let meshes = with(set_piece(), [speck(DVec3::Z * 1e3)]);
    let extent = scene(&meshes).extent();
    for scale in [1e-3, 1.0, 1e3] {
        let offset = DVec3::new(20.0, -3.0, 7.0) * scale;
        let mut moved = scene(&meshes);
        for instance in &mut moved.instances {
            instance.world_from_mesh =
                DAffine3::from_scale_rotation_translation(DVec3::splat(scale), glam::DQuat::IDENTITY, offset);
        }
        let expected = Bounds { min: extent.min * scale + offset, max: extent.max * scale + offset };
        let found = moved.extent();
        assert!((found.min - expected.min).abs().max_element() < 1e-9 * scale, "{scale}");
        assert!((found.max - expected.max).abs().max_element() < 1e-9 * scale, "{scale}");
    }
}

#[test]
fn two_places_of_equal_weight_are_both_within_the_extent() {
    let far = DVec3::X * 800.0;
    let scene = scene(&[town(DVec3::ZERO), town(far)]);
    assert_eq!(scene.extent(), scene.bounds());
}

#[test]
fn cameras_within_the_bounds_extend_the_extent() {
    let mut there = scene(&with(set_piece(), [speck(DVec3::Z * 1e3)]));
    let extent = there.extent();
    let eye = DVec3::new(1.0, 1.0, 40.0);
    for (eye, within) in [(eye, true), (DVec3::splat(5e3), false), (DVec3::ZERO, true)] {
        there.cameras =
            vec![NamedCamera { name: String::new(), camera: Camera::look_at(eye, eye + DVec3::X) }];
        let expected = if within { extent.union(&Bounds { min: eye, max: eye }) } else { extent };
        assert_eq!(there.extent(), expected, "{eye}");
    }
}

#[test]
fn scenes_without_finite_triangles_have_an_empty_extent() {
    assert!(scene(&[]).extent().is_empty());
    assert!(scene(&[vec![]]).extent().is_empty());
    let mut broken = scene(&set_piece());
    for instance in &mut broken.instances {
        instance.world_from_mesh = DAffine3::from_scale(DVec3::INFINITY);
    }
    assert!(broken.extent().is_empty());
    // A point has an extent without size.
    let point = scene(&[vec![[DVec3::ONE; 3]]]);
    assert_eq!(point.extent(), point.bounds());
}
