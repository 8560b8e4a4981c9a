//! Flux of VPLs against what is known exactly, single rays and maps against the reference.

use argus_scene::reference::Tracer;
use argus_scene::{Instance, Light, Lighting, Material, Mesh, RigKind, Scene, SceneHash, Sky, paraboloid};
use glam::{DAffine3, Vec4};

use super::*;
use argus_sampler::plug::{PacketTracer, mixed, placed};

/// What VPLs are made from.
struct World {
    scene: Arc<Scene>,
    tracer: PacketTracer,
    surfaces: Surfaces,
}

impl World {
    fn new(meshes: Vec<(Mesh, DAffine3)>, material: Material, lights: Vec<Light>) -> Self {
        let (meshes, places): (Vec<Mesh>, Vec<DAffine3>) = meshes.into_iter().unzip();
        let instance = |(mesh, world_from_mesh)| Instance { mesh, node: None, world_from_mesh };
        let scene = Arc::new(Scene {
            name: String::new(),
            hash: SceneHash([0; 32]),
            meshes,
            instances: (0..).zip(places).map(instance).collect(),
            materials: vec![material],
            textures: Vec::new(),
            nodes: Vec::new(),
            animations: Vec::new(),
            lighting: Lighting { lights, sky: Sky::BLACK, exposure: 1.0 },
            cameras: Vec::new(),
            rig: RigKind::Cell,
            ..Scene::default()
        });
        let placements = placed(&scene, &scene.instances);
        let tracer = PacketTracer::new(&scene, &placements, 1e-3);
        let surfaces = Surfaces::new(&scene, &placements);
        Self { scene, tracer, surfaces }
    }

    fn vpls(&self, settings: VplSettings) -> Vec<Vpl> {
        let bounds = self.scene.bounds();
        let emitters = Emitters::new(&self.scene.lighting, &self.surfaces, bounds);
        paths::trace(&self.tracer, &self.surfaces, &emitters, &settings, bounds)
    }
}

fn settings(vpls: u32, bounces: u32) -> VplSettings {
    VplSettings { vpls, bounces, ..VplSettings::default() }
}

fn grey(albedo: f32) -> Material {
    Material { base_color: Vec4::new(albedo, albedo, albedo, 1.0), ..Material::default() }
}

/// A cube of side two, seen from within.
fn room() -> Mesh {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0;
    let faces = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
    let mut mesh = Mesh::default();
    for face in faces {
        let first = mesh.positions.len() as u32;
        let [a, b, c] = [face[0], face[1], face[2]].map(corner);
        mesh.positions.extend(face.map(corner));
        mesh.normals.extend([(b - a).cross(c - a).normalize(); 4]);
        mesh.indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
    }
    mesh
}

fn floor(half: f32) -> Mesh {
    let at = |x: f32, z: f32| Vec3::new(x, 0.0, z) * half;
    Mesh {
        positions: vec![at(-1.0, 1.0), at(1.0, 1.0), at(1.0, -1.0), at(-1.0, -1.0)],
        normals: vec![Vec3::Y; 4],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..Mesh::default()
    }
}

fn bulb(position: DVec3) -> Light {
    Light::Point { position, intensity: Vec3::new(1.0, 2.0, 0.5), range: None, radius: 0.0 }
}

fn assert_near(found: Vec3, wanted: Vec3, share: f32) {
    let off = (found - wanted).abs() / wanted.max(Vec3::splat(1e-6));
    assert!(off.max_element() <= share, "{found} is not {wanted}");
}

#[test]
fn a_closed_room_reflects_its_albedo_of_the_flux_at_each_bounce_wherever_it_stands() {
    for offset in [DVec3::ZERO, DVec3::new(1e6, -3e6, 2e6)] {
        let place = DAffine3::from_translation(offset);
        let world =
            World::new(vec![(room(), place)], grey(0.5), vec![bulb(offset + DVec3::new(0.3, 0.2, -0.4))]);
        let flux = Vec3::new(1.0, 2.0, 0.5) * 4.0 * std::f32::consts::PI;
        let once = world.vpls(settings(1000, 1));
        assert_eq!(once.len(), 1000);
        assert_near(paths::total_flux(&once), flux * 0.5, 1e-4);
        let often = world.vpls(settings(20_000, 4));
        assert_near(paths::total_flux(&often), flux * (0.5 + 0.25 + 0.125 + 0.0625), 0.02);
        for vpl in &often {
            assert!((1..=4).contains(&vpl.bounces));
            let inside = (vpl.position - offset).abs().max_element();
            assert!(inside < 1.0 && inside > 0.999, "{inside}");
            assert!(vpl.normal.as_dvec3().dot(offset - vpl.position) > 0.0, "normals look inward");
        }
    }
}

#[test]
fn parallel_light_brings_a_floor_its_irradiance_by_the_cosine() {
    let direction = DVec3::new(0.6, -0.8, 0.0);
    let sun = Light::Directional { direction, irradiance: Vec3::splat(3.0), angular_radius: 0.0 };
    let world = World::new(vec![(floor(2.0), DAffine3::IDENTITY)], grey(0.25), vec![sun]);
    let wanted = Vec3::splat(3.0 * 16.0 * 0.8 * 0.25);
    assert_near(paths::total_flux(&world.vpls(settings(8000, 1))), wanted, 0.01);
}

#[test]
fn a_spot_brings_what_its_ramp_integrates_to() {
    let (inner, outer) = (0.3f64, 0.6f64);
    let spot = Light::Spot {
        position: DVec3::Y * 2.0,
        direction: DVec3::NEG_Y,
        intensity: Vec3::ONE,
        range: None,
        inner_cone: inner,
        outer_cone: outer,
        radius: 0.0,
    };
    let world = World::new(vec![(floor(4.0), DAffine3::IDENTITY)], grey(0.5), vec![spot]);
    let solid = std::f64::consts::TAU * ((1.0 - inner.cos()) + (inner.cos() - outer.cos()) / 3.0);
    assert_near(paths::total_flux(&world.vpls(settings(8000, 1))), Vec3::splat(0.5 * solid as f32), 0.01);
}

#[test]
fn a_range_cuts_the_flux_off_as_shading_does() {
    let lit = |range| {
        let light = Light::Point { position: DVec3::Y, intensity: Vec3::ONE, range, radius: 0.0 };
        let world = World::new(vec![(floor(50.0), DAffine3::IDENTITY)], grey(0.5), vec![light]);
        paths::total_flux(&world.vpls(settings(4000, 1))).x
    };
    // ∫ (1 − (d/r)⁴) I cosθ / d² over the floor, d = 1 / cosθ: 2π ∫ (1 − 1 / (r·z)⁴) dz from 1/r to 1.
    let r = 3.0f64;
    let wanted = std::f64::consts::TAU * ((1.0 - 1.0 / r) - (r.powi(3) - 1.0) / 3.0 / r.powi(4));
    assert!((f64::from(lit(Some(r))) / (0.5 * wanted) - 1.0).abs() < 0.03, "{} {wanted}", lit(Some(r)));
    assert_eq!(lit(Some(0.9)), 0.0);
    assert!(lit(None) > lit(Some(r)));
}

#[test]
fn surfaces_that_emit_are_vpls_themselves_on_both_sides_if_they_have_two() {
    for (double_sided, sides) in [(true, 2.0), (false, 1.0)] {
        let material = Material { emissive: Vec3::new(2.0, 1.0, 0.0), double_sided, ..grey(0.0) };
        let world = World::new(vec![(floor(1.0), DAffine3::from_scale(DVec3::splat(3.0)))], material, vec![]);
        let vpls = world.vpls(settings(4000, 1));
        let wanted = Vec3::new(2.0, 1.0, 0.0) * (std::f32::consts::PI * 36.0 * sides);
        assert_near(paths::total_flux(&vpls).truncate().extend(0.0), wanted, 1e-3);
        let up = vpls.iter().filter(|vpl| vpl.normal.y > 0.0).count();
        assert_eq!(up < vpls.len(), double_sided);
        assert!(vpls.iter().all(|vpl| vpl.bounces == 0));
    }
}

#[test]
fn light_that_meets_nothing_leaves_no_vpl_and_ends() {
    let away = Light::Spot {
        position: DVec3::Y,
        direction: DVec3::Y,
        intensity: Vec3::ONE,
        range: None,
        inner_cone: 0.1,
        outer_cone: 0.2,
        radius: 0.0,
    };
    let floor_of = |lights| World::new(vec![(floor(1.0), DAffine3::IDENTITY)], grey(0.5), lights);
    assert!(floor_of(vec![away]).vpls(settings(100, 4)).is_empty());
    assert!(floor_of(Vec::new()).vpls(settings(100, 4)).is_empty());
    let dark = Light::Point { position: DVec3::Y, intensity: Vec3::ZERO, range: None, radius: 0.0 };
    assert!(floor_of(vec![dark]).vpls(settings(100, 4)).is_empty());
    let nowhere = Light::Point { position: DVec3::NAN, intensity: Vec3::ONE, range: None, radius: 0.0 };
    assert!(floor_of(vec![nowhere]).vpls(settings(100, 4)).is_empty());
    let nothing = World::new(Vec::new(), grey(0.5), vec![bulb(DVec3::ZERO)]);
    assert!(nothing.vpls(settings(100, 4)).is_empty());
}

#[test]
fn a_seed_decides_every_vpl() {
    let world = World::new(vec![(room(), DAffine3::IDENTITY)], grey(0.5), vec![bulb(DVec3::ZERO)]);
    let of = |seed| world.vpls(VplSettings { seed, ..settings(500, 3) });
    assert_eq!(of(1), of(1));
    assert_ne!(of(1), of(2));
}

/// A room with a tilted, mirrored and shrunken copy of itself in it, and a floor that is seen from above alone.
fn furnished() -> World {
    let turned = DAffine3::from_translation(DVec3::new(0.2, -0.3, 0.1))
        * DAffine3::from_axis_angle(DVec3::ONE.normalize(), 0.7)
        * DAffine3::from_scale(DVec3::new(-0.3, 0.2, 0.25));
    let meshes = vec![
        (room(), DAffine3::IDENTITY),
        (room(), turned),
        (floor(0.8), DAffine3::from_translation(DVec3::NEG_Y * 0.8)),
    ];
    World::new(meshes, Material { double_sided: false, ..grey(0.5) }, vec![bulb(DVec3::ZERO)])
}

fn number(index: u64, k: u64) -> f64 {
    mixed(index << 8 | k) * 2.0 - 1.0
}

#[test]
fn single_rays_meet_what_the_reference_meets() {
    let world = furnished();
    let reference = Tracer::new(Arc::clone(&world.scene));
    let mut hit = 0;
    for i in 0..4000 {
        let origin = DVec3::new(number(i, 0), number(i, 1), number(i, 2)) * 1.2;
        let direction = DVec3::new(number(i, 3), number(i, 4), number(i, 5)).normalize();
        let (ours, theirs) =
            (world.tracer.nearest(origin, direction, f64::INFINITY), reference.trace(origin, direction));
        let ids = |instance, triangle, front| (instance, triangle, front);
        assert_eq!(
            ours.map(|m| ids(m.instance, m.primitive, m.front)),
            theirs.map(|h| ids(h.instance, h.triangle, h.front)),
            "ray {i}"
        );
        if let (Some(ours), Some(theirs)) = (ours, theirs) {
            hit += 1;
            assert!((ours.t - theirs.range).abs() < 1e-6, "{} {}", ours.t, theirs.range);
            let off = ours.weights[0] - theirs.barycentric.x;
            assert!(off.abs() < 1e-5, "{off}");
        }
    }
    assert!(hit > 2000);
    for nonsense in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
        assert_eq!(world.tracer.nearest(DVec3::ZERO, nonsense, f64::INFINITY), None);
        assert_eq!(world.tracer.nearest(nonsense * f64::NAN, DVec3::X, f64::INFINITY), None);
    }
}

#[test]
fn exact_maps_say_what_the_reference_sees_through_the_middle_of_each_texel() {
    let world = furnished();
    let vpls = world.vpls(settings(40, 2));
    let reference = Tracer::new(Arc::clone(&world.scene));
    let side = 8;
    let maps = maps::exact(&world.tracer, &vpls, side);
    for (vpl, map) in vpls.iter().zip(maps.chunks_exact(128)) {
        for texel in 0..128 {
            let direction = paraboloid::center_of(texel, side);
            let shines = direction.dot(vpl.normal.as_dvec3()) > 0.0 && paraboloid::is_inside(texel, side);
            let seen = reference.trace(vpl.position, direction).filter(|_| shines);
            let wanted = seen.map_or(f32::MAX, |hit| hit.range as f32);
            let found = f32::from_bits(map[texel as usize]);
            assert!((found - wanted).abs() <= 1e-5 * wanted, "{found} {wanted}");
        }
    }
}

#[test]
fn surface_points_are_spread_by_area() {
    let world = furnished();
    let points = maps::surface_points(&world.surfaces, world.scene.bounds(), 4000, 3);
    let on = |test: &dyn Fn(Vec3) -> bool| {
        points.iter().filter(|p| test(Vec3::new(p[0], p[1], p[2]))).count() as f32 / 4000.0
    };
    let ceiling = on(&|p| (p.y - 1.0).abs() < 1e-5);
    let small = 2.0 * 4.0 * (0.3 * 0.2 + 0.2 * 0.25 + 0.3 * 0.25);
    let wanted = 4.0 / (24.0 + small + 2.56);
    assert!((ceiling - wanted).abs() < 0.01, "{ceiling} {wanted}");
    let nothing = World::new(Vec::new(), grey(0.5), Vec::new());
    assert!(maps::surface_points(&nothing.surfaces, nothing.scene.bounds(), 10, 3).is_empty());
}
