//! Scattered rays against f64 single rays, and where rounding could leak light.

use std::sync::Arc;

use argus_scene::material::{Filter, Wrap};
use argus_scene::{
    AlphaMode, Instance, Lighting, Material, Mesh, RigKind, Scene, SceneHash, Sky, Texture, TextureRef,
};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, Vec4};

use super::*;
use crate::mixed::mixed;
use crate::packets::PacketTracer;
use crate::packets::lanes::Plain;
use crate::resident;

pub(super) fn scene(meshes: Vec<Mesh>, places: Vec<(u32, DAffine3)>, materials: Vec<Material>) -> Scene {
    let instance = |(mesh, world_from_mesh)| Instance { mesh, node: None, world_from_mesh };
    Scene {
        name: String::new(),
        hash: SceneHash([0; 32]),
        meshes,
        instances: places.into_iter().map(instance).collect(),
        materials,
        textures: Vec::new(),
        nodes: Vec::new(),
        animations: Vec::new(),
        lighting: Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: 1.0 },
        cameras: Vec::new(),
        rig: RigKind::Cell,
        ..Scene::default()
    }
}

pub(super) fn traced(scene: &Arc<Scene>) -> PacketTracer {
    PacketTracer::new(scene, &resident::placed(scene, &scene.instances), 1e-3)
}

/// A scene of one mesh at one place, hit on both faces.
fn both(mesh: Mesh, place: DAffine3) -> LightRays {
    let scene = Arc::new(scene(vec![mesh], vec![(0, place)], vec![Material::default()]));
    LightRays::new(&traced(&scene), CullMode::None).unwrap()
}

/// From -1 to 1.
pub(super) fn number(index: u64, k: u64) -> f64 {
    mixed(index << 8 | k) * 2.0 - 1.0
}

pub(super) fn vector(index: u64, k: u64) -> DVec3 {
    DVec3::new(number(index, k), number(index, k + 1), number(index, k + 2))
}

/// A flat grid of side two in the plane z = 0, of triangles that share corners, facing +z.
pub(super) fn sheet(cells: u32, material: u32) -> Mesh {
    let mut mesh = Mesh { material, ..Mesh::default() };
    for i in 0..(cells + 1) * (cells + 1) {
        let (x, y) = ((i % (cells + 1)) as f32 / cells as f32, (i / (cells + 1)) as f32 / cells as f32);
        mesh.positions.push(Vec3::new(x * 2.0 - 1.0, y * 2.0 - 1.0, 0.0));
        mesh.normals.push(Vec3::Z);
        mesh.uvs.push(glam::Vec2::new(x, y));
    }
    for i in 0..cells * cells {
        let a = i / cells * (cells + 1) + i % cells;
        let (b, c, d) = (a + 1, a + cells + 1, a + cells + 2);
        mesh.indices.extend([a, b, d, a, d, c]);
    }
    mesh
}

/// A closed, wavy surface around zero, of triangles that share corners. Within 0.7 of zero, all of it is visible.
pub(super) fn lump(rings: u32) -> Mesh {
    let around = rings * 2;
    let mut mesh = Mesh::default();
    let mut point = |polar: f32, turn: f32| {
        let (ring, height) = polar.sin_cos();
        let radius = 1.0 + 0.05 * (3.0 * turn).sin() * ring * ring;
        mesh.positions.push(Vec3::new(ring * turn.cos(), height, ring * turn.sin()) * radius);
    };
    point(0.0, 0.0);
    for i in 0..(rings - 1) * around {
        let (polar, turn) = ((i / around + 1) as f32 / rings as f32, (i % around) as f32 / around as f32);
        point(polar * std::f32::consts::PI, turn * std::f32::consts::TAU);
    }
    point(std::f32::consts::PI, 0.0);
    let last = mesh.positions.len() as u32 - 1;
    let at = |ring: u32, turn: u32| match ring {
        0 => 0,
        ring if ring == rings => last,
        ring => 1 + (ring - 1) * around + turn % around,
    };
    for ring in 0..rings {
        for turn in 0..around {
            let [a, b] = [at(ring, turn), at(ring, turn + 1)];
            let [c, d] = [at(ring + 1, turn), at(ring + 1, turn + 1)];
            if ring > 0 {
                mesh.indices.extend([a, b, d]);
            }
            if ring + 1 < rings {
                mesh.indices.extend([a, d, c]);
            }
        }
    }
    mesh.normals = mesh.positions.clone();
    mesh
}

/// Sheets with holes, mirrored and scaled, single-sided and double-sided. `moving`: an animation moves them, so that each
/// is an object of its own.
pub(super) fn odd_scene(at: DVec3, scale: f64, moving: bool) -> Scene {
    let side = 64u32;
    let holes = (0..side * side).flat_map(|i| {
        let (x, y) = (i % side, i / side);
        [200, 120, 40, if (x / 8 + y / 8) % 2 == 0 { 255 } else { 20 }]
    });
    let cutout = Material {
        alpha: AlphaMode::Mask(0.5),
        base_color_texture: Some(TextureRef::new(0)),
        double_sided: true,
        ..Material::default()
    };
    let places = (0..60u32).map(|i| {
        let turn = DQuat::from_rotation_y(f64::from(i) * 0.37) * DQuat::from_rotation_x(f64::from(i % 5));
        let mirror = DVec3::new(if i % 3 == 0 { -1.0 } else { 1.0 }, 1.0, 1.0);
        let size = mirror * (0.5 + 0.1 * f64::from(i % 7)) * scale;
        let place = at + vector(u64::from(i), 40) * 4.0 * scale;
        (i % 3, DAffine3::from_scale_rotation_translation(size, turn, place))
    });
    let meshes = vec![sheet(3, 0), sheet(2, 1), Mesh { material: 0, ..lump(6) }];
    let single = Material { double_sided: false, ..Material::default() };
    let mut scene = scene(meshes, places.collect(), vec![single, cutout]);
    scene.textures.push(Texture {
        name: String::new(),
        width: side,
        height: side,
        rgba: holes.collect::<Vec<u8>>().into(),
        srgb: true,
        wrap: [Wrap::Repeat; 2],
        filter: Filter::Linear,
    });
    if moving {
        animate(&mut scene);
    }
    scene
}

/// Gives each instance a node that an animation claims to move.
fn animate(scene: &mut Scene) {
    use argus_scene::animation::{Animation, Channel, Interpolation, Node, Rest, Track};
    let mut channels = Vec::new();
    for (node, instance) in (0u32..).zip(&mut scene.instances) {
        instance.node = Some(node);
        let rest = Rest::Matrix(instance.world_from_mesh);
        scene.nodes.push(Node { name: String::new(), parent: None, rest, lights: Vec::new() });
        let track = Track::Translation(vec![Vec3::ZERO]);
        channels.push(Channel { node, times_secs: vec![0.0], track, interpolation: Interpolation::Linear });
    }
    scene.animations.push(Animation { name: String::new(), channels });
}

/// Compares rays from around `eye` with f64 single rays, which stay in `reach` of it. Returns the number of hits.
fn agree(tracer: &PacketTracer, rays: &LightRays, eye: DVec3, reach: f64, name: &str) -> usize {
    let about = rays.about(eye);
    let (mut hits, mut apart) = (0, 0);
    let count = 4000;
    for i in 0..count {
        let origin = (vector(i, 0) * reach).as_vec3();
        let direction = (vector(i, 3) * 10f64.powf(3.0 * number(i, 6))).as_vec3();
        let most =
            if i % 2 == 0 { f32::MAX } else { (number(i, 7).abs() * reach) as f32 / direction.length() };
        let ours = about.nearest(origin, direction, most);
        let theirs = tracer.nearest(eye + origin.as_dvec3(), direction.as_dvec3(), f64::from(most));
        assert_eq!(about.is_blocked(origin, direction, most), ours.is_some(), "{name}: ray {i}");
        assert_eq!(about.nearest_by::<Plain>(origin, direction, most), ours, "{name}: ray {i}");
        assert_eq!(about.is_blocked_by::<Plain>(origin, direction, most), ours.is_some());
        match (ours, theirs) {
            (None, None) => (),
            (Some(ours), Some(theirs))
                if (ours.instance, ours.primitive) == (theirs.instance, theirs.primitive) =>
            {
                hits += 1;
                let off = (f64::from(ours.t) - theirs.t).abs() * f64::from(direction.length());
                // Grazing rays magnify the rounding of coordinates.
                apart += u64::from(off > 1e-4 * reach);
                let [beta, gamma] = [0, 1].map(|k| (f64::from(ours.weights[k]) - theirs.weights[k]).abs());
                apart += u64::from(beta.max(gamma) > 0.05);
                assert_eq!(ours.front, theirs.front, "{name}: ray {i}");
            }
            _ => apart += 1,
        }
    }
    assert!(apart * 400 <= count, "{name}: {apart} of {count} rays differ");
    hits
}

#[test]
fn scattered_rays_hit_what_f64_rays_hit() {
    for spec in ["terrain:20000", "mirrors:12"] {
        let scene = Arc::new(argus_scene::open(spec).unwrap());
        let tracer = traced(&scene);
        let rays = LightRays::new(&tracer, CullMode::Back).unwrap();
        let bounds = scene.bounds();
        let reach = bounds.size().max_element() * 0.5;
        assert!(agree(&tracer, &rays, bounds.center(), reach, spec) > 200, "{spec}");
    }
}

#[test]
fn cut_outs_mirrored_transforms_a_million_metres_and_millimetres_make_no_difference() {
    for moving in [false, true] {
        for at in [DVec3::ZERO, DVec3::new(1e6, -2e6, 1e6)] {
            for scale in [1.0, 1e-3] {
                let scene = Arc::new(odd_scene(at, scale, moving));
                let tracer = traced(&scene);
                let name = format!("at {at}, scale {scale}, moving {moving}");
                let objects = tracer.hierarchy().placed.len();
                assert_eq!(objects, if moving { 60 } else { 1 }, "{name}");
                let rays = LightRays::new(&tracer, CullMode::Back).unwrap();
                // At a million metres, f64 coordinates of a scene of millimetres are coarse.
                assert!(agree(&tracer, &rays, at + DVec3::splat(scale), 5.0 * scale, &name) > 500, "{name}");
            }
        }
    }
}

#[test]
fn rays_follow_the_pose_and_find_what_a_scale_of_zero_hid() {
    let scene = Arc::new(argus_scene::open("mirrors:12").unwrap());
    let mut tracer = traced(&scene);
    let mut rays = LightRays::new(&tracer, CullMode::Back).unwrap();
    let eye = scene.bounds().center();
    let reach = scene.bounds().size().max_element() * 0.5;
    for time in [0.7, 2.9] {
        tracer.pose(&scene, &resident::placed(&scene, &scene.at(time).instances));
        rays.pose(&tracer).unwrap();
        agree(&tracer, &rays, eye, reach, &format!("at {time} s"));
    }
    let mut hidden = odd_scene(DVec3::ZERO, 1.0, true);
    let shown = hidden.instances.clone();
    for instance in hidden.instances.iter_mut().filter(|instance| instance.mesh == 2) {
        instance.world_from_mesh.matrix3 = DMat3::ZERO;
    }
    let hidden = Arc::new(hidden);
    let mut tracer = traced(&hidden);
    let mut rays = LightRays::new(&tracer, CullMode::Back).unwrap();
    let before = agree(&tracer, &rays, DVec3::ZERO, 5.0, "hidden");
    tracer.pose(&hidden, &resident::placed(&hidden, &shown));
    rays.pose(&tracer).unwrap();
    assert!(agree(&tracer, &rays, DVec3::ZERO, 5.0, "shown") > before);
}

#[test]
fn no_ray_leaves_a_closed_surface_between_its_triangles() {
    for at in [DVec3::ZERO, DVec3::splat(1e6)] {
        for scale in [1.0, 1e-3, 1e3] {
            let mesh = lump(24);
            let turn = DQuat::from_rotation_y(0.3);
            let place = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, at);
            let corners: Vec<DVec3> = mesh.positions.iter().map(|p| place.matrix3 * p.as_dvec3()).collect();
            let indices = mesh.indices.clone();
            let rays = both(mesh, place);
            let about = rays.about(at);
            for i in 0..40_000u64 {
                let origin = (vector(i, 0) * 0.4 * scale).as_vec3();
                let first = mixed(i << 8 | 3) * (indices.len() / 3) as f64;
                let [a, b] = [0, 1].map(|k| corners[indices[first as usize * 3 + k] as usize]);
                // At a corner, and along an edge.
                let target = if i % 2 == 0 { a } else { a.lerp(b, mixed(i << 8 | 4)) };
                let direction = target.as_vec3() - origin;
                assert!(about.is_blocked(origin, direction, f32::MAX), "{origin} {direction} at {at}");
                let hit = about.nearest(origin, direction, f32::MAX).unwrap();
                assert!((hit.t - 1.0).abs() < 1e-3, "{hit:?}");
            }
        }
    }
}

#[test]
fn rays_along_axes_and_in_the_planes_of_boxes_hit_what_is_there() {
    let rays = both(sheet(16, 0), DAffine3::IDENTITY);
    let about = rays.about(DVec3::ZERO);
    for x in -16i8..=16 {
        for y in -16i8..=16 {
            // On edges, on corners, and between them.
            let origin = Vec3::new(f32::from(x) / 16.0, f32::from(y) / 16.0, 2.0);
            for direction in [Vec3::NEG_Z, Vec3::new(-0.0, 0.0, -4.0), Vec3::new(0.0, -0.0, -1e-3)] {
                let hit = about.nearest(origin, direction, f32::MAX).unwrap();
                assert_eq!(hit.t * -direction.z, 2.0);
                assert!(hit.front && about.is_blocked(origin, direction, f32::MAX));
                assert_eq!(about.nearest(origin, -direction, f32::MAX), None);
            }
            // In the sheet's plane, which no ray hits from its side.
            for direction in [Vec3::X, Vec3::NEG_Y, Vec3::new(1.0, -1.0, 0.0)] {
                assert!(!about.is_blocked(origin.with_z(0.0) - direction * 3.0, direction, f32::MAX));
            }
        }
    }
    let behind = about.nearest(Vec3::new(0.3, 0.2, -2.0), Vec3::Z, f32::MAX).unwrap();
    assert!(!behind.front && behind.t == 2.0, "{behind:?}");
}

#[test]
fn a_ray_hits_nothing_at_or_beyond_its_length_or_at_its_origin() {
    let rays = both(sheet(1, 0), DAffine3::IDENTITY);
    let about = rays.about(DVec3::new(0.0, 0.0, 1.0));
    let (origin, down) = (Vec3::new(0.25, 0.5, 0.0), Vec3::NEG_Z);
    for (most, is_hit) in [(0.5, false), (1.0, false), (1.0f32.next_up(), true), (f32::INFINITY, true)] {
        assert_eq!(about.is_blocked(origin, down, most), is_hit, "{most}");
        assert_eq!(about.nearest(origin, down, most).is_some(), is_hit, "{most}");
    }
    assert!(!about.is_blocked(origin + down, down, f32::MAX) && !about.is_blocked(origin + down, -down, 9.0));
    let offset = Vec3::Z * about.offset(origin + down, 0.0);
    assert!(about.is_blocked(origin + down + offset, down, f32::MAX));
}

#[test]
fn nonsense_hits_nothing_and_ends() {
    let rays = both(lump(8), DAffine3::IDENTITY);
    let about = rays.about(DVec3::ZERO);
    for nonsense in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::new(f32::NAN, 1.0, 0.0)] {
        assert!(!about.is_blocked(Vec3::ZERO, nonsense, 1.0), "{nonsense}");
        assert_eq!(about.nearest(Vec3::ZERO, nonsense, f32::INFINITY), None, "{nonsense}");
        let from = if nonsense == Vec3::ZERO { Vec3::MAX } else { nonsense };
        assert_eq!(about.nearest(from, Vec3::X, f32::INFINITY), None, "{from}");
    }
    for most in [0.0, -1.0, f32::NAN, f32::NEG_INFINITY] {
        assert!(!about.is_blocked(Vec3::ZERO, Vec3::X, most), "{most}");
        assert_eq!(about.nearest(Vec3::ZERO, Vec3::X, most), None, "{most}");
    }
    for extreme in [1e-44, f32::MIN_POSITIVE, 1e-30, 1e30, f32::MAX] {
        let direction = Vec3::new(extreme, extreme * 0.5, -extreme);
        let _ = about.nearest(Vec3::ZERO, direction, f32::MAX);
        assert_eq!(about.nearest(Vec3::X * 5.0, direction, f32::MAX), None);
    }
}

#[test]
fn triangles_without_an_area_are_never_hit_and_an_empty_scene_is_empty() {
    let mut flat = lump(8);
    let last = flat.positions.len() as u32;
    flat.positions = vec![Vec3::X; flat.positions.len()];
    flat.positions.extend([Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::NAN]);
    flat.indices.extend([last, last + 1, last + 2, last, last, last + 1, last, last + 1, last + 3]);
    flat.normals = vec![Vec3::Y; flat.positions.len()];
    for mesh in [Mesh::default(), flat] {
        let rays = both(mesh, DAffine3::IDENTITY);
        let about = rays.about(DVec3::Z);
        for i in 0..2000 {
            let (origin, target) = (vector(i, 0).as_vec3(), Vec3::X * mixed(i << 8 | 5) as f32 - Vec3::Z);
            // Some go along the triangles themselves.
            let direction = if i % 4 == 0 { Vec3::X } else { target - origin };
            let origin = if i % 4 == 0 { -Vec3::Z - Vec3::X } else { origin };
            assert_eq!(about.nearest(origin, direction, f32::MAX), None, "ray {i}");
            assert!(!about.is_blocked(origin, direction, f32::MAX), "ray {i}");
        }
    }
}

#[test]
fn a_sliver_is_hit_between_its_corners_or_not_at_all() {
    let sliver = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-30, 0.0)],
        normals: vec![Vec3::Z; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    let rays = both(sliver, DAffine3::IDENTITY);
    let about = rays.about(DVec3::Z);
    for i in 0..2000 {
        let origin = vector(i, 0).as_vec3();
        let direction = Vec3::X * mixed(i << 8 | 5) as f32 - Vec3::Z - origin;
        let hit = about.nearest(origin, direction, f32::MAX);
        assert_eq!(about.is_blocked(origin, direction, f32::MAX), hit.is_some());
        if let Some(hit) = hit {
            assert!(hit.t > 0.0 && hit.weights.iter().all(|w| (-1e-6..=1.000_001).contains(w)), "{hit:?}");
        }
    }
}

#[test]
fn light_passes_where_alpha_is_below_the_cutoff() {
    let faded = |alpha| Material {
        alpha: AlphaMode::Mask(0.5),
        base_color: Vec4::new(1.0, 1.0, 1.0, alpha),
        ..Material::default()
    };
    let place = |z: f64| DAffine3::from_translation(DVec3::Z * z);
    let places = vec![(0, place(-1.0)), (1, place(-2.0)), (2, place(-3.0))];
    let meshes = vec![sheet(2, 0), sheet(2, 1), sheet(2, 2)];
    let materials = vec![faded(0.2), faded(0.8), Material::default()];
    let scene = Arc::new(scene(meshes, places, materials));
    let rays = LightRays::new(&traced(&scene), CullMode::None).unwrap();
    let about = rays.about(DVec3::ZERO);
    let (origin, down) = (Vec3::new(0.3, 0.1, 0.0), Vec3::NEG_Z);
    assert!(!about.is_blocked(origin, down, 1.5) && about.is_blocked(origin, down, 2.5));
    assert_eq!(about.nearest(origin, down, f32::MAX).map(|hit| (hit.instance, hit.t)), Some((1, 2.0)));
    // From below, single-sided triangles block light.
    assert!(about.is_blocked(Vec3::new(0.3, 0.1, -2.5), Vec3::Z, 1.0));
    assert!(about.is_blocked(Vec3::new(0.3, 0.1, -3.5), Vec3::Z, 1.0));
}
