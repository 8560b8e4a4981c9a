//! Hard places: planar mirrors, cut-outs, degenerate triangles, far origins, and eyes within reflectors.

use std::sync::Arc;

use argus_scene::procedural::{rooms, with_balls};
use argus_scene::{Instance, Lighting, Scene};
use glam::{DAffine3, DVec3, Vec3};

use super::facets::{Facet, Openings};
use super::tests::{by_brute_force, eye_of, reflectors_of};
use argus_sampler::plug::ReflectionRays;

use super::*;

/// A scene of one mesh about a unit ball at the origin, moved.
fn around_a_ball(corners: &[[Vec3; 3]], moved: DVec3, mirrored: bool) -> Scene {
    let mut scene = with_balls(rooms(20), 1).unwrap();
    let ball = scene.instances.pop().unwrap();
    let positions: Vec<Vec3> = corners.iter().flatten().copied().collect();
    let mesh = argus_scene::Mesh {
        normals: vec![Vec3::Y; positions.len()],
        indices: (0..positions.len() as u32).collect(),
        positions,
        ..argus_scene::Mesh::default()
    };
    let flip = if mirrored { DVec3::new(-1.0, 1.0, 1.0) } else { DVec3::ONE };
    let place = DAffine3::from_translation(moved) * DAffine3::from_scale(flip);
    scene.meshes.push(mesh);
    scene.materials[0].double_sided = false;
    let mesh = scene.meshes.len() as u32 - 1;
    scene.instances = vec![
        Instance { mesh, node: None, world_from_mesh: place },
        Instance {
            node: None,
            world_from_mesh: DAffine3::from_translation(moved) * DAffine3::from_scale(DVec3::splat(0.5)),
            ..ball
        },
    ];
    Scene { nodes: Vec::new(), animations: Vec::new(), lighting: Lighting::default(), ..scene }
}

/// Twelve triangles of a box that is seen from within.
fn inside_of_a_box() -> Vec<[Vec3; 3]> {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 6.0 - 3.0;
    let quads = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
    quads
        .iter()
        .flat_map(|q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
        .map(|t| t.map(corner))
        .collect()
}

#[test]
fn hard_places_have_no_holes_and_no_nan() {
    let flip =
        |triangles: Vec<[Vec3; 3]>| triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect::<Vec<_>>();
    let side_seen = |triangles: &[[Vec3; 3]]| {
        let scene = around_a_ball(triangles, DVec3::ZERO, false);
        Facet::all(&scene, &scene.instances)[0].side_towards(DVec3::ZERO) == Some(Side::Front)
    };
    let mut inside = inside_of_a_box();
    if !side_seen(&inside) {
        inside = flip(inside);
    }
    let mut odd = inside.clone();
    // Without area, through the middle of the map, edge-on, and with a corner on a corner of faces.
    odd.push([Vec3::ONE, Vec3::ONE, Vec3::X]);
    odd.push([Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)]);
    odd.push([Vec3::ONE, Vec3::ONE * 2.0, Vec3::new(1.0, 1.0, 1.001)]);
    for moved in [DVec3::ZERO, DVec3::new(1e6, -1e6, 1e6)] {
        for mirrored in [false, true] {
            let scene = Arc::new(around_a_ball(&odd, moved, mirrored));
            let points = PointScene::new(&scene, 0.0);
            let device =
                (mirrored && moved != DVec3::ZERO).then(|| PointDevice::new(&compute_tests::gpu(), &points));
            // Outside, in the box, within the reflector, and at its middle.
            for from in
                [DVec3::new(0.0, 0.0, 2.5), DVec3::new(0.2, 0.1, 0.0), DVec3::ZERO, DVec3::splat(50.0)]
            {
                let eye = Eye {
                    position: moved + from,
                    half_size: DVec3::ZERO,
                    pixels: 200.0,
                    height: 240,
                    near: 1e-3,
                };
                let reflectors = reflectors_of(&scene, &eye);
                assert_eq!(reflectors.len(), 1);
                let settings = EyePointSettings::default();
                let mut found = vec![points.points(&eye, &reflectors, &settings)];
                let on_device = |device| points.points_on(device, &eye, &reflectors, &settings).unwrap();
                found.extend(device.as_ref().map(on_device));
                let cut_there = |device| {
                    let filled = points.fill_on(device, &eye, &reflectors, &settings).unwrap();
                    points.read_points(device, filled, &reflectors).unwrap()
                };
                found.extend(device.as_ref().map(cut_there));
                for found in found {
                    let texels = (0..found.maps.texels()).map(|texel| found.maps.get(texel));
                    let ranges: Vec<f64> =
                        texels.map(|texel| texel.map_or(f64::NAN, |(_, range)| range)).collect();
                    let holes = ranges.iter().filter(|range| !range.is_finite()).count();
                    assert_eq!(holes, 0, "from {from}, moved {moved}, mirrored {mirrored}");
                    assert!(ranges.iter().all(|range| *range < 5.3));
                }
            }
        }
    }
}

/// A mirror of two triangles, 2 m × 2 m, at z = −1, seen from +z; its instance comes last.
fn with_a_planar_mirror(mut scene: Scene) -> Scene {
    let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    let mesh = argus_scene::Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        normals: vec![Vec3::Z; 4],
        indices: vec![0, 1, 2, 0, 2, 3],
        material: scene.meshes[scene.instances.last().unwrap().mesh as usize].material,
        ..argus_scene::Mesh::default()
    };
    scene.meshes.push(mesh);
    *scene.instances.last_mut().unwrap() = Instance {
        mesh: scene.meshes.len() as u32 - 1,
        node: None,
        world_from_mesh: DAffine3::from_translation(DVec3::new(0.0, 0.0, -1.0)),
    };
    scene
}

/// An eye in front of [`with_a_planar_mirror`].
fn before_the_mirror() -> Eye {
    let position = DVec3::new(0.4, 0.3, 1.5);
    Eye { position, half_size: DVec3::ZERO, pixels: 300.0, height: 240, near: 1e-3 }
}

#[test]
fn a_mirrored_camera_shows_a_planar_mirror_without_parallax() {
    let mut walls = inside_of_a_box();
    // Behind the mirror, and nearer to the eye's mirror image than all that the mirror shows.
    walls.push([Vec3::new(-2.0, -2.0, -1.5), Vec3::new(2.0, -2.0, -1.5), Vec3::new(0.0, 2.5, -1.5)]);
    let mut scene = with_a_planar_mirror(around_a_ball(&walls, DVec3::ZERO, false));
    scene.materials.iter_mut().for_each(|material| material.double_sided = true);
    let scene = Arc::new(scene);
    let eye = before_the_mirror();
    let mirror = planar_reflector(&scene, 1, &scene.instances[1], &eye).unwrap();
    assert_eq!((mirror.center, mirror.side), (DVec3::new(0.4, 0.3, -3.5), 608));
    let points = PointScene::new(&scene, 0.0);
    let found = points.points(&eye, &[mirror], &EyePointSettings::default());
    let mut others = 0;
    for i in 0..900 {
        let place = DVec3::new(f64::from(i % 30) / 15.0 - 0.97, f64::from(i / 30) / 15.0 - 0.97, -1.0);
        let to_place = place - eye.position;
        let reflected = (to_place * DVec3::new(1.0, 1.0, -1.0)).normalize();
        let from_mirror = MappedReflector { center: place, front: None, ..mirror };
        let (facet, range) = by_brute_force(points.facets(), &from_mirror, reflected).unwrap();
        let texel = lookup(&found.maps, 0, place - mirror.center, reflected, STEPS);
        let (id, seen) = found.maps.get(texel).unwrap();
        // The range is from the eye's image.
        let expected = range + to_place.length();
        assert!((seen / expected - 1.0).abs() < 0.01, "{place}: {seen} {expected}");
        others += usize::from(found.pieces.all[found.point(id).piece() as usize].facet as usize != facet);
    }
    assert!(others < 10, "{others}");
    let whole = points.rasterise(&[mirror]);
    assert!((0..whole.texels()).all(|t| whole.get(t).is_some() == found.maps.get(t).is_some()));
    let (traced, _) = ReflectionRays::new(&scene, 0.0).unwrap().maps(&[mirror]);
    let off = (0..whole.texels()).filter(|&t| whole.get(t).is_some() != traced.get(t).is_some()).count();
    assert!(off * 500 < whole.texels(), "{off}");
}

#[test]
fn a_curved_reflector_and_an_eye_in_the_mirrors_plane_have_no_mirrored_camera() {
    let ball = with_balls(rooms(20), 1).unwrap();
    let index = ball.instances.len() as u32 - 1;
    let eye = before_the_mirror();
    assert_eq!(planar_reflector(&ball, index, ball.instances.last().unwrap(), &eye), None);
    let scene = with_a_planar_mirror(around_a_ball(&inside_of_a_box(), DVec3::ZERO, false));
    let at = |z: f64| {
        let eye = Eye { position: DVec3::new(0.4, 0.3, z), ..eye };
        planar_reflector(&scene, 1, &scene.instances[1], &eye).map(|found| found.center.z)
    };
    assert_eq!([at(1.5), at(-1.0), at(-2.0)], [Some(-3.5), None, Some(0.0)]);
}

/// Squares of a metre, every second of which is open.
struct Checkers;

impl Openings for Checkers {
    fn is_open(&self, _: &Facet, point: DVec3) -> bool {
        (point.x.floor() + point.y.floor()).rem_euclid(2.0) == 0.0
    }
}

#[test]
fn cut_outs_are_open_for_each_texels_ray_by_itself() {
    let mut walls = inside_of_a_box();
    walls.push([Vec3::new(-2.0, -2.0, -2.0), Vec3::new(2.0, -2.0, -2.0), Vec3::new(0.0, 2.5, -2.0)]);
    let mut scene = around_a_ball(&walls, DVec3::ZERO, false);
    scene.materials.iter_mut().for_each(|material| material.double_sided = true);
    let eye =
        Eye { position: DVec3::Z * 2.0, half_size: DVec3::ZERO, pixels: 100.0, height: 240, near: 1e-3 };
    let reflectors = reflectors_of(&scene, &eye);
    let mut facets = Facet::all(&scene, &scene.instances);
    let screen = facets.iter().position(|facet| facet.instance == 0 && facet.primitive == 12).unwrap();
    facets[screen].cutout = true;
    // One cell covers many squares.
    let density = Density { reduction: 0.1, ..Density::default() };
    let pieces = facets::Cutter { eye: &eye, reflectors: &reflectors, density, culling: false }.cut(&facets);
    let mut first = vec![0u32];
    for piece in &pieces.all {
        first.push(first.last().unwrap() + piece.rows().cells() as u32);
    }
    let maps = IndexMaps::new(&reflectors);
    let splats = Splats {
        facets: &facets,
        pieces: &pieces,
        points: &[],
        stored: &vec![0; first.len()],
        first: &first,
        reflectors: &reflectors,
        cut: &Checkers,
    };
    splats.splat_to(&maps, 0);
    let closed: Vec<Facet> = facets.iter().copied().filter(|facet| !facet.cutout).collect();
    let mut counts = [0; 2];
    for texel in 0..maps.texels() {
        let (map, direction) = maps.direction_of(texel);
        let direction = direction.normalize();
        let (facet, range) = by_brute_force(&facets, &reflectors[map], direction).unwrap();
        let open = facet == screen && Checkers.is_open(&facets[screen], direction * range);
        let expected =
            if open { by_brute_force(&closed, &reflectors[map], direction).unwrap().1 } else { range };
        assert!((maps.get(texel).unwrap().1 / expected - 1.0).abs() < 1e-5);
        counts[usize::from(open)] += usize::from(facet == screen);
    }
    assert!(counts[0] > 50 && counts[1] > 50, "{counts:?}");
}

#[test]
fn a_line_of_sight_through_a_reflectors_sphere_only_adds_density() {
    // The triangle's line to the eye cuts the sphere: the paper's closest point on the line is then within it.
    let scene = around_a_ball(&inside_of_a_box(), DVec3::ZERO, false);
    let triangle = [DVec3::new(-0.5, 0.0, -3.0), DVec3::new(0.5, 0.0, -3.0), DVec3::new(0.0, 0.5, -3.0)];
    let density = |x: f64| {
        let eye = Eye {
            position: DVec3::new(x, 0.0, 2.5),
            half_size: DVec3::ZERO,
            pixels: 200.0,
            height: 2000,
            near: 1e-3,
        };
        density_for(&eye, &reflectors_of(&scene, &eye)[0], triangle, &Density::default())
    };
    let (through, beside) = (density(0.0), density(2.0));
    assert!(through.is_finite() && through >= beside, "{through} {beside}");
}

#[test]
fn sixty_five_reflectors_have_two_words_of_bits_and_maps_without_holes() {
    let scene = Arc::new(with_balls(rooms(20), 65).unwrap());
    let eye = eye_of(&scene, [64, 48]);
    let reflectors = reflectors_of(&scene, &eye);
    assert_eq!(reflectors.len(), 65);
    let points = PointScene::new(&scene, 0.0);
    let found = points.points(&eye, &reflectors, &EyePointSettings::default());
    assert_eq!(found.pieces.words, 2);
    let last = found.maps.index(64, 0, 0, 0)..found.maps.texels();
    let whole = points.rasterise(&reflectors);
    assert!(last.clone().any(|texel| whole.get(texel).is_some()));
    assert!(last.into_iter().all(|texel| whole.get(texel).is_some() == found.maps.get(texel).is_some()));
}
