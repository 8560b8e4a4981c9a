//! Scattered rays on a device against those of the CPU and the f64 reference, and where rounding could leak light.

use argus_gpu::GpuOptions;
use argus_scene::reference::Tracer;
use argus_scene::{Mesh, Scene};
use argus_shaders::layout::sampler::{ScatteredHit, ScatteredRay, ray_flags};
use glam::{DAffine3, DMat3, DQuat};

use super::super::tests::{lump, number, odd_scene, scene, sheet, traced, vector};
use super::super::{CullMode, LightRays, RayHit};
use super::*;
use crate::mixed::mixed;
use crate::passes::{ScatteredRays, Sought, Tracing};
use crate::resident;

/// A ray: origin relative to the eye, direction, length.
type Ray = (Vec3, Vec3, f32);

/// A scene for both tracers.
struct Both {
    gpu: Arc<Gpu>,
    tracer: PacketTracer,
    on_cpu: LightRays,
    trees: DeviceTrees,
    faces: CullMode,
}

impl Both {
    fn new(scene: &Arc<Scene>, faces: CullMode) -> Self {
        let gpu = Gpu::new(&GpuOptions::default()).unwrap();
        let tracer = traced(scene);
        let on_cpu = LightRays::new(&tracer, faces).unwrap();
        let trees = DeviceTrees::new(&gpu, &tracer).unwrap();
        Self { gpu, tracer, on_cpu, trees, faces }
    }

    fn of_mesh(mesh: Mesh, place: DAffine3) -> Self {
        Self::new(&Arc::new(scene(vec![mesh], vec![(0, place)], vec![Default::default()])), CullMode::None)
    }

    /// Nearest hits, and shares of light that pass, on the device.
    fn trace(&self, eye: DVec3, rays: &[Ray]) -> (Vec<Option<RayHit>>, Vec<f32>) {
        let flags = if self.faces == CullMode::Back { ray_flags::OF_SIGHT } else { 0 };
        let ray = |&(origin, direction, most): &Ray| ScatteredRay {
            origin: origin.to_array(),
            most,
            direction: direction.to_array(),
            flags,
        };
        let data: Vec<ScatteredRay> = rays.iter().map(ray).collect();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let (gpu, count) = (&self.gpu, rays.len() as u64);
        let placed = self.trees.about(gpu, eye).unwrap();
        let pass = ScatteredRays::new(gpu);
        let data = gpu.upload("rays", &data, usage);
        let hits = gpu.buffer("hits", count * size_of::<ScatteredHit>() as u64, usage);
        let passed = gpu.buffer("passed", count * 4, usage);
        let mut commands = gpu.commands("scattered rays");
        pass.clear_unfinished(&mut commands);
        let tracing = Tracing { rays: &pass, trees: &self.trees, placed: &placed };
        for sought in [Sought::Nearest(&hits), Sought::Passed(&passed)] {
            tracing.record_as("trace", &mut commands, gpu, &data, count as u32, sought);
        }
        let read = [
            commands.read_buffer(&hits, 0..hits.size()),
            commands.read_buffer(&passed, 0..count * 4),
            pass.read_unfinished(&mut commands),
        ];
        let mut finished = commands.submit().wait().unwrap();
        let [hits, passed, unfinished] = read.map(|pending| finished.take(pending));
        assert!(unfinished.iter().all(|&byte| byte == 0), "a walk was cut off");
        let hits = hits.chunks_exact(size_of::<ScatteredHit>()).take(rays.len());
        let hits = hits.map(|bytes| RayHit::of_device(bytemuck::pod_read_unaligned(bytes)));
        (hits.collect(), passed.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect())
    }

    /// Compares rays with those of the CPU. Returns the number of hits. Hits are within [`is_near`] of one another, of either of
    /// two triangles that share an edge. Rays may differ where they graze an edge of the nearer hit: at most one in ten
    /// thousand, and three in small sets.
    fn agree(&self, eye: DVec3, rays: &[Ray], name: &str) -> usize {
        let (found, passed) = self.trace(eye, rays);
        let about = self.on_cpu.about(eye);
        let (mut hits, mut apart) = (0, 0);
        for (i, &(origin, direction, most)) in rays.iter().enumerate() {
            let theirs = about.nearest(origin, direction, most);
            let agrees = match (found[i], theirs) {
                (None, None) => true,
                (Some(a), Some(b)) if (a.instance, a.primitive) == (b.instance, b.primitive) => {
                    hits += 1;
                    is_near(&a, &b, origin, direction) && a.front == b.front && weights_agree(&a, &b)
                }
                (Some(a), Some(b)) => {
                    hits += 1;
                    is_near(&a, &b, origin, direction)
                }
                _ => false,
            };
            let light = about.passed(origin, direction, most);
            let is_same_light = (light - passed[i]).abs() < 1e-3;
            if !agrees || !is_same_light {
                apart += 1;
                let nearer = [found[i], theirs].into_iter().flatten().min_by(|a, b| a.t.total_cmp(&b.t));
                println!(
                    "{name}: ray {i} {origin} {direction} {most}: {:?} {theirs:?} {} {light}",
                    found[i], passed[i]
                );
                assert!(agrees || nearer.is_some_and(|hit| grazes(&hit)), "{name}: ray {i}");
            }
        }
        assert!(apart <= 3.max(rays.len() / 10_000), "{name}: {apart} of {} rays differ", rays.len());
        hits
    }
}

/// Whether two hits are a ten-thousandth of their distance from one another, or some units in the last place of
/// coordinates, which grazing rays magnify.
fn is_near(a: &RayHit, b: &RayHit, origin: Vec3, direction: Vec3) -> bool {
    let far = a.t.max(b.t) * direction.length();
    (a.t - b.t).abs() * direction.length() <= 1e-4 * far + 8e-6 * (origin.length() + far)
}

fn weights_agree(a: &RayHit, b: &RayHit) -> bool {
    (0..2).all(|k| (a.weights[k] - b.weights[k]).abs() < 0.02)
}

/// Whether a hit is within a thousandth of an edge of its triangle.
fn grazes(hit: &RayHit) -> bool {
    let [beta, gamma] = hit.weights;
    beta.min(gamma).min(1.0 - beta - gamma) < 1e-3
}

/// Rays from around an eye in all directions, some short, of lengths that differ by six orders.
fn around(reach: f64, count: u64) -> Vec<Ray> {
    let ray = |i: u64| {
        let origin = (vector(i, 0) * reach).as_vec3();
        let direction = (vector(i, 3) * 10f64.powf(3.0 * number(i, 6))).as_vec3();
        let most = if i.is_multiple_of(2) {
            f32::MAX
        } else {
            (number(i, 7).abs() * reach) as f32 / direction.length()
        };
        (origin, direction, most)
    };
    (0..count).map(ray).collect()
}

/// Rays that leave the surfaces which others hit.
fn leaving(both: &Both, eye: DVec3, rays: &[Ray]) -> Vec<Ray> {
    let about = both.on_cpu.about(eye);
    let bounce = |(i, &(origin, direction, most)): (u64, &Ray)| {
        let hit = about.nearest(origin, direction, most)?;
        let point = origin + direction * hit.t;
        let away = -direction.normalize() * about.offset(point, hit.t * direction.length()) * 4.0;
        Some((point + away, vector(i, 9).as_vec3(), f32::MAX))
    };
    (0u64..).zip(rays).filter_map(bounce).collect()
}

fn sees_as_the_cpu(spec: &str, faces: CullMode) {
    let scene = Arc::new(argus_scene::open(spec).unwrap());
    let both = Both::new(&scene, faces);
    let bounds = scene.bounds();
    let (eye, reach) = (bounds.center(), bounds.size().max_element() * 0.5);
    let rays = around(reach, 20_000);
    let hits = both.agree(eye, &rays, spec);
    let hits_leaving = both.agree(eye, &leaving(&both, eye, &rays), spec);
    assert!(hits > 500 && hits_leaving > 100, "{spec}: {hits} {hits_leaving}");
}

#[test]
fn the_device_hits_what_the_cpu_hits_in_built_in_scenes() {
    for spec in ["terrain:20000", "mirrors:12", "rooms", "rooms+balls:20"] {
        sees_as_the_cpu(spec, CullMode::None);
    }
    sees_as_the_cpu("mirrors:12", CullMode::Back);
}

#[test]
fn the_device_hits_what_the_cpu_hits_in_files() {
    let Some(folder) = std::env::var_os("ARGUS_SCENES").map(std::path::PathBuf::from) else {
        return println!("SKIPPED: ARGUS_SCENES is not set");
    };
    for file in ["sponza/sponza.glb", "salle_de_bain/salle_de_bain.glb", "pine/pine.glb"] {
        match folder.join(file) {
            path if path.is_file() => sees_as_the_cpu(&path.display().to_string(), CullMode::None),
            path => println!("SKIPPED: there is no {}", path.display()),
        }
    }
}

#[test]
fn the_device_hits_what_the_reference_hits() {
    for spec in ["terrain:5000", "rooms", "mirrors:12"] {
        let scene = Arc::new(argus_scene::open(spec).unwrap());
        let both = Both::new(&scene, CullMode::Back);
        let reference = Tracer::new(Arc::clone(&scene));
        let bounds = scene.bounds();
        let (eye, reach) = (bounds.center(), bounds.size().max_element() * 0.5);
        let mut rays = around(reach, 10_000);
        rays.iter_mut().for_each(|ray| ray.2 = f32::MAX);
        let (found, _) = both.trace(eye, &rays);
        let mut apart = 0;
        for (&(origin, direction, _), found) in rays.iter().zip(found) {
            let theirs = reference.trace(eye + origin.as_dvec3(), direction.as_dvec3());
            apart += usize::from(match (found, theirs) {
                (None, None) => false,
                (Some(a), Some(b)) => {
                    let range = f64::from(a.t) * direction.as_dvec3().length();
                    (range - b.range).abs() > 1e-4 * b.range.max(reach * 1e-2)
                }
                _ => true,
            });
        }
        assert!(apart <= 10, "{spec}: {apart} of {} rays differ", rays.len());
    }
}

#[test]
fn cut_outs_mirrored_transforms_a_million_metres_and_millimetres_make_no_difference_on_the_device() {
    for moving in [false, true] {
        for at in [DVec3::ZERO, DVec3::new(1e6, -2e6, 1e6)] {
            for scale in [1.0, 1e-3] {
                for faces in [CullMode::None, CullMode::Back] {
                    let both = Both::new(&Arc::new(odd_scene(at, scale, moving)), faces);
                    let name = format!("at {at}, scale {scale}, moving {moving}, {faces:?}");
                    let eye = at + DVec3::splat(scale);
                    assert!(both.agree(eye, &around(5.0 * scale, 4000), &name) > 500, "{name}");
                }
            }
        }
    }
}

#[test]
fn no_ray_leaves_a_closed_surface_between_its_triangles_on_the_device() {
    for at in [DVec3::ZERO, DVec3::splat(1e6)] {
        for scale in [1.0, 1e-3, 1e3] {
            let mesh = lump(24);
            let turn = DQuat::from_rotation_y(0.3);
            let place = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, at);
            let corners: Vec<DVec3> = mesh.positions.iter().map(|p| place.matrix3 * p.as_dvec3()).collect();
            let indices = mesh.indices.clone();
            let both = Both::of_mesh(mesh, place);
            let ray = |i: u64| {
                let origin = (vector(i, 0) * 0.4 * scale).as_vec3();
                let first = mixed(i << 8 | 3) * (indices.len() / 3) as f64;
                let [a, b] = [0, 1].map(|k| corners[indices[first as usize * 3 + k] as usize]);
                // At a corner, and along an edge.
                let target = if i.is_multiple_of(2) { a } else { a.lerp(b, mixed(i << 8 | 4)) };
                (origin, target.as_vec3() - origin, f32::MAX)
            };
            let rays: Vec<Ray> = (0..20_000).map(ray).collect();
            let (hits, passed) = both.trace(at, &rays);
            assert!(passed.iter().all(|&share| share == 0.0), "at {at}, scale {scale}");
            assert!(hits.iter().all(|hit| hit.is_some_and(|hit| (hit.t - 1.0).abs() < 1e-3)));
        }
    }
}

#[test]
fn rays_along_axes_and_in_the_planes_of_boxes_hit_what_is_there_on_the_device() {
    let both = Both::of_mesh(sheet(16, 0), DAffine3::IDENTITY);
    let (mut down, mut aside) = (Vec::new(), Vec::new());
    for x in -16i8..=16 {
        for y in -16i8..=16 {
            // On edges, on corners, and between them.
            let origin = Vec3::new(f32::from(x) / 16.0, f32::from(y) / 16.0, 2.0);
            for direction in [Vec3::NEG_Z, Vec3::new(-0.0, 0.0, -4.0), Vec3::new(0.0, -0.0, -1e-3)] {
                down.push((origin, direction, f32::MAX));
                aside.push((origin, -direction, f32::MAX));
            }
            for direction in [Vec3::X, Vec3::NEG_Y, Vec3::new(1.0, -1.0, 0.0)] {
                aside.push((origin.with_z(0.0) - direction * 3.0, direction, f32::MAX));
            }
        }
    }
    let (hits, passed) = both.trace(DVec3::ZERO, &down);
    for ((&(_, direction, _), hit), passed) in down.iter().zip(hits).zip(passed) {
        let hit = hit.unwrap();
        assert!((hit.t * -direction.z - 2.0).abs() < 1e-6 && hit.front && passed == 0.0, "{hit:?}");
    }
    let (hits, passed) = both.trace(DVec3::ZERO, &aside);
    assert!(hits.iter().all(Option::is_none) && passed.iter().all(|&share| share == 1.0));
}

#[test]
fn a_ray_on_the_device_hits_nothing_at_or_beyond_its_length_or_at_its_origin() {
    let both = Both::of_mesh(sheet(1, 0), DAffine3::IDENTITY);
    let (origin, down) = (Vec3::new(0.25, 0.5, 0.0), Vec3::NEG_Z);
    let lengths = [0.5, 1.0, 1.0 + 1e-5, f32::INFINITY, f32::MAX];
    let mut rays: Vec<Ray> = lengths.iter().map(|&most| (origin, down, most)).collect();
    rays.extend([(origin + down, down, f32::MAX), (origin + down, -down, 9.0)]);
    let (hits, _) = both.trace(DVec3::new(0.0, 0.0, 1.0), &rays);
    let is_hit: Vec<bool> = hits.iter().map(Option::is_some).collect();
    assert_eq!(is_hit, [false, false, true, true, true, false, false]);
}

#[test]
fn nonsense_hits_nothing_and_ends_on_the_device() {
    let both = Both::of_mesh(lump(8), DAffine3::IDENTITY);
    let mut rays = Vec::new();
    for nonsense in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::new(f32::NAN, 1.0, 0.0)] {
        rays.push((Vec3::ZERO, nonsense, 1.0));
        let from = if nonsense == Vec3::ZERO { Vec3::MAX } else { nonsense };
        rays.push((from, Vec3::X, f32::INFINITY));
    }
    rays.extend([0.0, -1.0, f32::NAN, f32::NEG_INFINITY].map(|most| (Vec3::ZERO, Vec3::X, most)));
    for extreme in [1e-44, f32::MIN_POSITIVE, 1e-30, 1e30, f32::MAX] {
        rays.push((Vec3::X * 5.0, Vec3::new(extreme, extreme * 0.5, -extreme), f32::MAX));
    }
    let (hits, passed) = both.trace(DVec3::ZERO, &rays);
    assert!(hits.iter().all(Option::is_none), "{hits:?}");
    assert!(passed.iter().all(|&share| share == 1.0), "{passed:?}");
    let inside: Vec<Ray> = [1e-30, 1.0, 1e30].map(|x| (Vec3::ZERO, Vec3::X * x, f32::INFINITY)).to_vec();
    assert!(both.trace(DVec3::ZERO, &inside).0.iter().all(Option::is_some));
}

#[test]
fn triangles_without_an_area_are_never_hit_and_an_empty_scene_is_empty_on_the_device() {
    let mut flat = lump(8);
    flat.positions = vec![Vec3::X; flat.positions.len()];
    for mesh in [Mesh::default(), flat] {
        let both = Both::of_mesh(mesh, DAffine3::IDENTITY);
        let (hits, _) = both.trace(DVec3::Z, &around(3.0, 500));
        assert!(hits.iter().all(Option::is_none));
    }
}

#[test]
fn rays_follow_the_pose_on_the_device() {
    let scene = Arc::new(argus_scene::open("mirrors:12").unwrap());
    let mut both = Both::new(&scene, CullMode::Back);
    let eye = scene.bounds().center();
    let reach = scene.bounds().size().max_element() * 0.5;
    for time in [0.7, 2.9] {
        both.tracer.pose(&scene, &resident::placed(&scene, &scene.at(time).instances));
        both.on_cpu.pose(&both.tracer).unwrap();
        both.trees.pose(&both.gpu, &both.tracer).unwrap();
        both.agree(eye, &around(reach, 4000), &format!("at {time} s"));
    }
    let mut hidden = odd_scene(DVec3::ZERO, 1.0, true);
    for instance in hidden.instances.iter_mut().filter(|instance| instance.mesh == 2) {
        instance.world_from_mesh.matrix3 = DMat3::ZERO;
    }
    assert!(
        Both::new(&Arc::new(hidden), CullMode::Back).agree(DVec3::ZERO, &around(5.0, 2000), "hidden") > 100
    );
}

#[test]
fn transparent_surfaces_let_the_same_light_pass_on_the_device() {
    use argus_scene::{AlphaMode, Material};
    let faded = |alpha: f32, mode| Material {
        alpha: mode,
        base_color: glam::Vec4::new(1.0, 1.0, 1.0, alpha),
        ..Material::default()
    };
    let place = |z: f64| DAffine3::from_translation(DVec3::Z * z);
    let places = (0..4).map(|i| (i, place(-1.0 - f64::from(i)))).collect();
    let meshes = (0..4).map(|i| sheet(2, i)).collect();
    let materials = vec![
        faded(0.25, AlphaMode::Blend),
        faded(0.5, AlphaMode::Mask(0.5)),
        faded(0.5, AlphaMode::Blend),
        faded(0.4, AlphaMode::Mask(0.5)),
    ];
    let both = Both::new(&Arc::new(scene(meshes, places, materials)), CullMode::None);
    let about = both.on_cpu.about(DVec3::ZERO);
    let ray = |i: u64| {
        let at = vector(i, 0).as_vec3() * 0.9;
        (at.with_z(-0.5 - (i % 5) as f32), if i.is_multiple_of(2) { Vec3::NEG_Z } else { Vec3::Z }, f32::MAX)
    };
    let rays: Vec<Ray> = (0..4000).map(ray).collect();
    let (hits, passed) = both.trace(DVec3::ZERO, &rays);
    let (mut first, mut theirs) = (0, 0);
    for (i, &(origin, direction, most)) in rays.iter().enumerate() {
        assert!((passed[i] - about.passed(origin, direction, most)).abs() < 1e-6, "ray {i}");
        // Which hits count is random, by the place.
        first += usize::from(hits[i].is_some_and(|hit| hit.instance == 0));
        theirs += usize::from(about.nearest(origin, direction, most).is_some_and(|hit| hit.instance == 0));
    }
    assert!(first > 50 && first.abs_diff(theirs) < 100, "{first} {theirs}");
}
