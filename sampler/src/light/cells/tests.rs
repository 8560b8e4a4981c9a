//! Cells of scenes in which things move: what is kept is what filling in the new pose would give.

use std::sync::Arc;

use argus_scene::animation::{Animation, Channel, Interpolation, Node, Parts as NodeParts, Rest, Track};
use argus_scene::light_sampling::r2;
use argus_scene::{
    CellSettings, Instance, Light, LightEffects, LightLevel, Lighting, Material, Mesh, PathSettings, RigKind,
    Scene, SceneHash, Sky,
};
use glam::{DAffine3, DVec3, IVec3, Vec3};

use super::super::lattice::{CellKey, PageKey};
use super::super::path_light::PathLight;
use super::super::sky::SkyIrradiance;
use super::super::tracing::{LightTracing, emitters_at};
use super::store::Kept;
use super::*;
use crate::light_rays::{CullMode, LightRays};
use crate::packets::PacketTracer;
use crate::{LightSettings, resident};

/// Seconds from one place of the mover to the next.
const STEP: f64 = 1.0;

/// A box of half size `half`, which is seen from the inside, or from the outside if that is negative. Each side is divided into 2·n²
/// triangles.
fn cube(half: f32, n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for (side, x, y) in [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::NEG_X, Vec3::Z, Vec3::Y),
        (Vec3::Y, Vec3::Z, Vec3::X),
        (Vec3::NEG_Y, Vec3::X, Vec3::Z),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::NEG_Z, Vec3::Y, Vec3::X),
    ] {
        let first = mesh.positions.len() as u32;
        for i in 0..(n + 1) * (n + 1) {
            let at = [i % (n + 1), i / (n + 1)].map(|i| 2.0 * i as f32 / n as f32 - 1.0);
            mesh.positions.push((side - x * at[0] - y * at[1]) * half.abs());
            mesh.normals.push(-side * half.signum());
        }
        for i in 0..n * n {
            let a = first + i / n * (n + 1) + i % n;
            let (b, c, d) = (a + 1, a + n + 1, a + n + 2);
            mesh.indices.extend(if half > 0.0 { [a, d, b, a, c, d] } else { [a, b, d, a, d, c] });
        }
    }
    mesh
}

/// Two closed rooms of four metres, two metres apart, each with a lamp and a crate; and a box of half size `half` that is at `places` one
/// after the other, with a lamp of its own above it.
fn scene(half: f32, places: &[Vec3]) -> Arc<Scene> {
    // The crate has so many triangles that coarse cells thin them out.
    let meshes = vec![cube(2.0, 4), cube(-0.5, 12), cube(-half, 2)];
    let at = |mesh: u32, node: Option<u32>, place: DVec3| Instance {
        mesh,
        node,
        world_from_mesh: DAffine3::from_translation(place),
    };
    let rooms = [-3.0, 3.0].map(|x| DVec3::new(x, 0.0, 0.0));
    let mut instances = Vec::new();
    for room in rooms {
        instances.push(at(0, None, room));
        // Two crates in the same place, each of which a ray may hit: which one must not depend on what it misses.
        instances.extend([at(1, None, room - DVec3::Y * 1.5), at(1, Some(2), DVec3::X * (room.x + 3.0))]);
    }
    instances.push(at(2, Some(0), DVec3::ZERO));
    let lamp =
        |position: DVec3| Light::Point { position, intensity: Vec3::splat(4.0), range: None, radius: 0.0 };
    let mut lights: Vec<Light> = rooms.map(|room| lamp(room + DVec3::new(0.3, 1.5, 0.2))).to_vec();
    lights.push(lamp(DVec3::ZERO));
    let rest = |translation| Rest::Parts(NodeParts { translation, ..NodeParts::default() });
    let node =
        |parent, translation, lights| Node { name: String::new(), parent, rest: rest(translation), lights };
    // The last place is held for a step, since what is animated begins again at the end.
    let channel = |node: u32, places: Vec<Vec3>| Channel {
        node,
        times_secs: (0..=places.len()).map(|i| (i as f64 * STEP) as f32).collect(),
        track: Track::Translation(places.iter().chain(places.last()).copied().collect()),
        interpolation: Interpolation::Step,
    };
    // The second crates are animated, but do not move: so they are objects of their own to rays.
    let stays = channel(2, vec![Vec3::new(-3.0, -1.5, 0.0); places.len()]);
    let channels = vec![channel(0, places.to_vec()), stays];
    let scene = Scene {
        name: String::new(),
        hash: SceneHash([0; 32]),
        meshes,
        instances,
        materials: vec![Material { base_color: glam::Vec4::new(0.7, 0.6, 0.5, 1.0), ..Material::default() }],
        textures: Vec::new(),
        nodes: vec![
            node(None, DVec3::ZERO, vec![]),
            node(Some(0), DVec3::Y * (f64::from(half) + 0.2), vec![2]),
            node(None, DVec3::ZERO, vec![]),
        ],
        animations: vec![Animation { name: "moves".to_owned(), channels }],
        lighting: Lighting { lights, sky: Sky::BLACK, exposure: 1.0 },
        cameras: Vec::new(),
        rig: RigKind::Cell,
        ..Scene::default()
    };
    let pose = scene.at(0.0);
    Arc::new(Scene { instances: pose.instances, lighting: pose.lighting, ..scene })
}

/// A scene at a pose, and its cells.
struct Posed {
    scene: Arc<Scene>,
    tracer: PacketTracer,
    tracing: Arc<LightTracing>,
    light: PathLight,
}

impl Posed {
    fn new(scene: &Arc<Scene>) -> Self {
        let placements = resident::placed(scene, &scene.at(0.0).instances);
        let tracer = PacketTracer::new(scene, &placements, 1e-3);
        let effects = LightEffects { shadows: true, ..LightEffects::NONE };
        let tracing = Arc::new(LightTracing {
            effects,
            settings: LightSettings::default(),
            rays: LightRays::new(&tracer, CullMode::None).unwrap(),
            emitters: emitters_at(scene, &[], effects, 0.0),
            emission: Vec::new(),
            sky: SkyIrradiance::new(&scene.lighting.sky),
            lighting: scene.lighting.clone(),
        });
        let paths = PathSettings { level: 5, ..PathSettings::default() };
        let settings = CellSettings { paths, ..CellSettings::default() };
        let light = PathLight::new(scene, &placements, paths, Some(settings));
        let mut posed = Self { scene: scene.clone(), tracer, tracing, light };
        posed.make_ready();
        posed
    }

    /// A fresh one that never was at another pose than at first.
    fn at(scene: &Arc<Scene>, step: usize) -> Self {
        let mut posed = Self::new(scene);
        posed.go(step);
        posed
    }

    fn go(&mut self, step: usize) {
        let pose = self.scene.at(step as f64 * STEP);
        let placements = resident::placed(&self.scene, &pose.instances);
        self.tracer.pose(&self.scene, &placements);
        let tracing = Arc::make_mut(&mut self.tracing);
        tracing.rays.pose(&self.tracer).unwrap();
        tracing.lighting = pose.lighting;
        self.light.place(&self.scene, &placements);
        self.make_ready();
    }

    fn make_ready(&mut self) {
        self.light.ready(&self.tracing, LightLevel::Full, false).unwrap();
        self.fill(&[], 0);
    }

    fn cells(&self) -> (&LightCells, CellInputs) {
        self.light.for_tests()
    }

    /// Fills corners, after it took the pose over.
    fn fill(&self, corners: &[CellKey], tier: usize) {
        let (cells, inputs) = self.cells();
        let about = &self.tracing.rays.about(inputs.leaves.center());
        let surfaces = self.light.surfaces();
        let scene = cells.scene(Parts { inputs: &inputs, surfaces, about });
        let mut state = cells.state();
        state.relight(&inputs, || sharing::content_of(&scene));
        state.fill_corners(&scene, corners, tier);
    }

    fn kept(&self) -> Kept {
        self.cells().0.state().kept
    }

    /// All pages, packed.
    fn packed(&self) -> Vec<(PageKey, Vec<u8>)> {
        let state = self.cells().0.state();
        let mut keys: Vec<PageKey> = state.store.page_keys().collect();
        keys.sort_unstable_by_key(|key| key.number());
        keys.into_iter().filter_map(|key| Some((key, state.store.packed(key)?))).collect()
    }

    /// Corners at points of the surfaces of instances, of levels 4 to 7.
    fn corners(&self, instances: std::ops::Range<u32>, count: u32, seed: u32) -> Vec<CellKey> {
        let (_, inputs) = self.cells();
        let lattice = inputs.leaves.lattice();
        let of_all: Vec<[Vec3; 3]> = inputs
            .leaves
            .instances()
            .filter(|(instance, _)| instances.contains(instance))
            .flat_map(|(_, triangles)| triangles.to_vec())
            .collect();
        let corner = |i: u32| {
            let [a, b, c] = of_all[(i * 7919 + seed * 31) as usize % of_all.len()];
            let square = r2(i + seed * 1000).as_vec2();
            let at = a + (b - a) * square.x * (1.0 - square.y) + (c - a) * square.y;
            let level = 4 + i % 4;
            let (cell, _) = lattice.about(at.as_dvec3())[level as usize]?;
            CellKey::new(level, cell - IVec3::splat((i / 4 % 2) as i32))
        };
        (0..count).filter_map(corner).collect()
    }
}

/// The instances of a room, the crates in it included.
const ROOMS: [std::ops::Range<u32>; 2] = [0..3, 3..6];

/// Every page of one equals that of the other.
fn assert_pages_are(kept: &Posed, fresh: &Posed, what: &str) {
    let (kept, fresh) = (kept.packed(), fresh.packed());
    for (key, packed) in &kept {
        let wanted = fresh.iter().find(|(other, _)| other == key).map(|(_, packed)| packed);
        assert!(wanted == Some(packed), "{what}: page {key:?} is not what filling gives");
    }
}

#[test]
fn what_is_kept_is_what_filling_in_the_new_pose_gives_whatever_moves_where() {
    // Within a room, through a wall, between the rooms, out of the bounds and far away, and back.
    let random = |i: u32| {
        let [a, b] = [r2(i), r2(i * 3 + 1)].map(|point| point.as_vec2() - 0.5);
        Vec3::new(a.x * 10.0, a.y * 4.0, b.x * 4.0)
    };
    let mut places = vec![Vec3::new(3.5, -0.5, 0.5), Vec3::new(3.6, -0.5, 0.5), Vec3::new(40.0, 9.0, -3.0)];
    places.extend((1..7).map(random));
    places.extend([Vec3::new(3.0, 300.0, 0.0), Vec3::new(3.0, 310.0, 0.0), Vec3::new(4.0, 0.5, -1.0)]);
    let scene = scene(0.3, &places);
    let mut moved = Posed::new(&scene);
    let mut corners = Vec::new();
    for step in 0..places.len() {
        if step > 0 {
            moved.go(step);
        }
        let before = moved.packed().len();
        // At every second step what is not kept is filled again, with more, in another order.
        if step % 2 == 0 {
            corners.extend(moved.corners(0..7, 60, step as u32));
            let mut order = corners.clone();
            order.rotate_left(step * 13 % corners.len());
            moved.fill(&order, 0);
        }
        let fresh = Posed::at(&scene, step);
        fresh.fill(&corners, 0);
        assert_pages_are(&moved, &fresh, &format!("step {step}, {before} kept"));
    }
    let Kept { kept, touched } = moved.kept();
    println!("{kept} pages kept, {touched} touched");
    assert!(kept > 50 && touched > 50, "{kept} pages kept, {touched} touched");
}

#[test]
fn a_far_mover_touches_few_pages_and_one_that_goes_through_everything_touches_all() {
    let places = [Vec3::new(3.5, -0.5, 0.5), Vec3::new(3.2, 0.6, -0.4)];
    let mut far = Posed::new(&scene(0.3, &places));
    far.fill(&far.corners(ROOMS[0].clone(), 400, 1), 0);
    far.go(1);
    let Kept { kept, touched } = far.kept();
    println!("in the other room: {kept} pages kept, {touched} touched");
    assert!(kept > 9 * touched && kept > 50, "{kept} pages kept, {touched} touched");

    let mut near = Posed::new(&scene(0.3, &places));
    near.fill(&near.corners(ROOMS[1].clone(), 400, 1), 0);
    near.go(1);
    let Kept { kept, touched } = near.kept();
    println!("in the same room: {kept} pages kept, {touched} touched");
    assert!(touched > kept && kept > 0, "{kept} pages kept, {touched} touched");

    let mut through = Posed::new(&scene(6.0, &[Vec3::new(0.0, 0.0, 0.0), Vec3::new(0.5, 0.2, 0.1)]));
    through.fill(&through.corners(0..6, 400, 1), 0);
    through.go(1);
    let Kept { kept, touched } = through.kept();
    assert!(kept == 0 && touched > 50, "{kept} pages kept, {touched} touched");
}

#[test]
fn pages_of_another_sampler_are_kept_like_own_ones_once_things_move() {
    let places = [Vec3::new(3.5, -0.5, 0.5), Vec3::new(3.2, 0.6, -0.4), Vec3::new(3.9, 0.2, -0.4)];
    let scene = scene(0.3, &places);
    let (mut filler, mut taker) = (Posed::new(&scene), Posed::at(&scene, 1));
    filler.fill(&filler.corners(ROOMS[0].clone(), 200, 5), 0);
    filler.go(1);
    let all = filler.packed();
    let numbers: Vec<u64> = all.iter().map(|(key, _)| key.number()).collect();
    let (from, to) = (filler.cells().0.pages(), taker.cells().0.pages());
    let content = to.content().unwrap();
    assert_eq!(from.content(), Some(content));
    for (page, packed) in from.packed(content, &numbers) {
        to.add(content, page, &packed).unwrap();
    }
    assert!(!all.is_empty() && taker.packed() == all);
    filler.go(2);
    taker.go(2);
    let kept = taker.packed();
    assert!(kept == filler.packed() && kept.len() * 10 > all.len() * 9, "{} of {}", kept.len(), all.len());
    assert_ne!(to.content(), Some(content));
}

#[test]
fn a_scene_in_which_nothing_moves_records_nothing() {
    let still = scene(0.3, &[Vec3::new(3.5, -0.5, 0.5)]);
    let posed = Posed::new(&Arc::new(Scene { animations: Vec::new(), ..(*still).clone() }));
    posed.fill(&posed.corners(0..6, 50, 1), 0);
    assert!(posed.packed().iter().all(|(_, packed)| packed.ends_with(&[0])));
    let moving = Posed::new(&scene(0.3, &[Vec3::ZERO, Vec3::X]));
    moving.fill(&moving.corners(0..6, 50, 1), 0);
    let bytes = |posed: &Posed| posed.cells().0.state().store.bytes();
    println!("{} bytes with a record, {} without", bytes(&moving), bytes(&posed));
    assert!(bytes(&posed) < bytes(&moving));
}
