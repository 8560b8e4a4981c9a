//! Light cells: pure, tight, and as right as the rays that they replace.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_sampler::{CellSettings, GpuSampler, Indirect, PathSettings, SamplerSettings};
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer};
use argus_scene::{
    Camera, Frame, LightEffects, Lighting, Material, Output, Plan, ProbeSource, Sampler as _, Scene, Sky,
    SurfaceLight, ViewJob,
};
use glam::{DAffine3, DVec3, Vec3};

use crate::against_reference::real_scene;
use crate::common::*;
use crate::reflecting::{chrome, probes_from, probes_of};
use crate::rooms::*;

/// Leaves of six centimetres in a room of four metres.
pub(crate) fn settings() -> CellSettings {
    let paths = PathSettings { level: 6, ..PathSettings::default() };
    // Fewer rays than by default, because tests wait for them.
    CellSettings { paths, rays: 64, ..CellSettings::default() }
}

fn lit(scene: &Arc<Scene>, indirect: Indirect) -> GpuSampler {
    let effects = indirect.effects_with(LightEffects::NONE);
    sampler_with(scene, SamplerSettings { sub_samples: 1, effects, indirect, ..SamplerSettings::default() })
}

fn with_cells(scene: &Arc<Scene>) -> GpuSampler {
    lit(scene, Indirect::Cells(settings()))
}

pub(crate) fn cells(rays: u32) -> Option<SurfaceLight> {
    Some(SurfaceLight::Cells { rays, reflected: true })
}

/// A view lit in a way that its plan names, or by what there is.
pub(crate) fn job(camera: Camera, size: [u32; 2], light: Option<SurfaceLight>) -> ViewJob {
    let job = view_job(camera, size, 1);
    ViewJob { plan: Plan::direct(1).with_light(light), ..job }
}

/// Fills all that views lacked, and refines it.
pub(crate) fn fill(sampler: &mut GpuSampler) {
    let begin = Instant::now();
    while sampler.fill_light(Duration::from_millis(20), true) {
        assert!(begin.elapsed() < Duration::from_secs(60), "filling ends: {:?}", sampler.light_cells());
    }
}

pub(crate) fn color(sampler: &mut GpuSampler, job: &ViewJob) -> Vec<u8> {
    direct(sampler, job).images[Output::Color].clone().expect("the job asks for colour").to_vec()
}

fn mean_of(bytes: &[u8]) -> f64 {
    bytes.iter().map(|&b| f64::from(b)).sum::<f64>() / bytes.len() as f64
}

#[test]
fn equal_plans_give_equal_bytes_whatever_was_looked_up_before() {
    let scene = box_of_cornell(DVec3::ZERO);
    let size = [64, 48];
    let views = [16, 64].map(|rays| job(view_of_room(DVec3::ZERO), size, cells(rays)));
    let mut fresh = with_cells(&scene);
    let wanted = views.each_ref().map(|view| color(&mut fresh, view));
    assert!(wanted[0] != wanted[1]);
    // Other views fill some of the cells first, in other orders, of other tiers and sizes.
    for turn in 0..3 {
        let mut sampler = with_cells(&scene);
        for i in 0..4 {
            let angle = f64::from(i * (turn + 1)) * 1.7;
            let eye = DVec3::new(angle.sin(), 0.3 * f64::from(turn), angle.cos());
            let camera = Camera { fov_deg: 80.0, ..Camera::look_at(eye, DVec3::new(0.1, -0.4, 0.0)) };
            let light = [cells(16), None, cells(64)][(i + turn) as usize % 3];
            direct(&mut sampler, &job(camera, [40 + 8 * turn as u32, 30], light));
            if turn == 1 {
                sampler.fill_light(Duration::from_millis(5), true);
            }
        }
        if turn == 2 {
            fill(&mut sampler);
        }
        for (view, wanted) in views.iter().zip(&wanted) {
            assert!(color(&mut sampler, view) == *wanted, "turn {turn}");
        }
    }
}

#[test]
fn an_open_view_waits_for_nothing_and_says_what_lit_it() {
    let scene = box_of_cornell(DVec3::ZERO);
    let mut sampler = with_cells(&scene);
    let open = job(view_of_room(DVec3::ZERO), [320, 240], None);
    let light = |sampler: &mut GpuSampler| direct(sampler, &open).provenance.plan.light();
    assert_eq!(light(&mut sampler), Some(SurfaceLight::Rays));
    assert!(sampler.light_cells().unwrap().waiting > 0);
    // A view may find cells missing between the pixels that were looked at first: it rises step by step.
    let rises = (0..8).any(|_| {
        fill(&mut sampler);
        light(&mut sampler) == cells(64)
    });
    assert!(rises, "{:?}", sampler.light_cells());
    // A pin names the light, and gets it anywhere.
    let frame = direct(&mut sampler, &open);
    let pin = ViewJob { plan: frame.provenance.plan.clone(), ..open.clone() };
    let mut other = with_cells(&scene);
    assert!(direct(&mut other, &pin).images[Output::Color] == frame.images[Output::Color]);
    let rays = job(view_of_room(DVec3::ZERO), [320, 240], Some(SurfaceLight::Rays));
    assert_eq!(direct(&mut sampler, &rays).provenance.plan.light(), Some(SurfaceLight::Rays));
    // Sets without cells have no such light.
    let mut paths = lit(&scene, Indirect::Paths(settings().paths));
    assert_eq!(direct(&mut paths, &open).provenance.plan.light(), None);
    let refused = paths.render_views(&[pin], &argus_scene::Cancel::new()).remove(0);
    assert!(refused.is_err());
}

/// A room with a lamp one centimetre below its ceiling, which shines up, too.
fn room_with_a_lamp_at_the_ceiling() -> Arc<Scene> {
    let mut scene = empty_scene();
    let lamp = Material { emissive: Vec3::splat(8.0), double_sided: true, ..grey(0.7) };
    scene.materials = vec![grey(0.7), lamp];
    add_room(&mut scene, DVec3::ZERO, [0; 6]);
    let at = DAffine3::from_translation(DVec3::new(0.0, 1.99, 0.0));
    place(&mut scene, quad(Vec3::ZERO, Vec3::X * 0.3, Vec3::Z * 0.3, 1.0, 1), at);
    scene.lighting = lit_by(Vec::new());
    Arc::new(scene)
}

#[test]
fn a_lamp_close_to_a_ceiling_leaves_no_bright_spots_on_walls() {
    const SIZE: [u32; 2] = [96, 72];
    /// Pixels to the sides that a pixel is compared with: cells are narrower.
    const ASIDE: usize = 10;
    let scene = room_with_a_lamp_at_the_ceiling();
    let wall =
        Camera { fov_deg: 60.0, ..Camera::look_at(DVec3::new(0.0, -0.5, 0.5), DVec3::new(0.0, -0.6, -2.0)) };
    let image = color(&mut with_cells(&scene), &job(wall, SIZE, cells(64)));
    let most = image.chunks_exact(SIZE[0] as usize * 3).flat_map(|row| {
        let green: Vec<f64> = row.chunks_exact(3).map(|rgb| f64::from(rgb[1])).collect();
        let excess = |x: usize| green[x] - green[x - ASIDE].max(green[x + ASIDE]);
        (ASIDE..green.len() - ASIDE).map(excess).collect::<Vec<f64>>()
    });
    let most = most.fold(0.0, f64::max);
    eprintln!("{most} of 255 above both sides; mean {}", mean_of(&image));
    assert!(mean_of(&image) > 20.0 && most < 6.0, "{most}");
}

#[test]
fn a_room_looks_like_the_path_traced_one_wherever_it_stands() {
    for (offset, name) in [(DVec3::ZERO, "near"), (DVec3::new(1e6, -2e6, 3e6), "far")] {
        let scene = box_of_cornell(offset);
        let (camera, size) = (view_of_room(offset), [96, 96]);
        let effects = Indirect::Cells(settings()).effects_with(LightEffects::NONE);
        let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 16 });
        let paths = Some(Paths { paths: 256, bounces: settings().paths.bounces });
        let truth = tracer.render_with(&camera, size, 1, paths, |_| {}).display(1.0);
        let mut sampler = with_cells(&scene);
        let mut by = |light| {
            let image = image_of(&direct(&mut sampler, &job(camera, size, light)));
            flip(&format!("cells-{name}"), &image, &truth)
        };
        let (rays, first, best) = (by(Some(SurfaceLight::Rays)), by(cells(16)), by(cells(64)));
        println!("{name}: FLIP {rays:.4} by rays, {first:.4} and {best:.4} by cells");
        assert!(best < 0.06 && best < 1.1 * rays, "{name}: FLIP {best}, by rays {rays}");
    }
}

/// A box of half size two with walls of two centimetres, under an open sky.
pub(crate) fn closed_box(center: DVec3) -> Arc<Scene> {
    let mut scene = empty_scene();
    scene.materials = vec![grey(0.7)];
    add_room(&mut scene, center, [0; 6]);
    let mut outside = empty_scene();
    add_room(&mut outside, DVec3::ZERO, [0; 6]);
    let outer = DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(1.01));
    for mut mesh in outside.meshes {
        mesh.indices.as_chunks_mut::<3>().0.iter_mut().for_each(|corners| corners.swap(1, 2));
        mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
        place(&mut scene, mesh, outer);
    }
    // A floor that goes on outside, so that it is one plane on both sides of the walls.
    let ground = quad(Vec3::NEG_Y * 1.99, Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 1.0, 0);
    place(&mut scene, ground, DAffine3::from_translation(center));
    let one = Vec3::ONE;
    let sky = Sky { zenith: one, horizon: one, ground: one, map: None, reach: None };
    scene.lighting = Lighting { lights: Vec::new(), sky, exposure: 1.0 };
    Arc::new(scene)
}

#[test]
fn no_sky_comes_through_a_wall_of_two_centimetres() {
    for offset in [DVec3::ZERO, DVec3::new(1e6, 0.0, -1e6)] {
        let scene = closed_box(offset);
        // Fine leaves, so that little leaks through leaf sides of the octree, by which both are lit.
        let paths = PathSettings { level: 8, ..PathSettings::default() };
        let mut sampler = lit(&scene, Indirect::Cells(CellSettings { paths, ..CellSettings::default() }));
        let inside = |at: DVec3, target: DVec3| Camera {
            fov_deg: 90.0,
            ..Camera::look_at(offset + at, offset + target)
        };
        let corner = DVec3::new(-2.0, -2.0, -2.0);
        for camera in [inside(DVec3::ZERO, corner), inside(corner * 0.8, corner)] {
            for size in [[200, 150], [32, 24]] {
                // So many that noise of the few cells of the small image is no leak.
                let dark = mean_of(&color(&mut sampler, &job(camera, size, cells(64))));
                let by_rays = mean_of(&color(&mut sampler, &job(camera, size, Some(SurfaceLight::Rays))));
                println!("{size:?}: {dark:.3} of 255 by cells, {by_rays:.3} by rays");
                // What is left leaks through leaf sides, and cells spread it: those of the small image, half a metre wide, by a
                // hundredth of what the open sky would bring.
                let spread = if size[0] < 100 { 3.0 } else { 1.0 };
                assert!(dark < by_rays + spread, "{dark} of 255, {by_rays} by rays");
            }
        }
    }
}

#[test]
fn both_faces_of_a_thin_sheet_have_their_own_light() {
    let mut scene = empty_scene();
    scene.materials = vec![argus_scene::Material { double_sided: true, ..grey(0.8) }];
    place(&mut scene, quad(Vec3::ZERO, Vec3::X, Vec3::NEG_Z, 1.0, 0), DAffine3::IDENTITY);
    let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, ground: Vec3::ZERO, map: None, reach: None };
    scene.lighting = Lighting { lights: Vec::new(), sky, exposure: 1.0 };
    let mut sampler = with_cells(&Arc::new(scene));
    let mut seen = |height: f64, light| {
        let camera = Camera { up: DVec3::Z, ..Camera::look_at(DVec3::Y * height, DVec3::ZERO) };
        let view = job(Camera { fov_deg: 20.0, ..camera }, [64, 64], light);
        mean_of(&color(&mut sampler, &view))
    };
    let (above, below) = (seen(2.0, cells(16)), seen(-2.0, cells(16)));
    let (open, dim) = (seen(2.0, Some(SurfaceLight::Rays)), seen(-2.0, Some(SurfaceLight::Rays)));
    let off = (above - open).abs().max((below - dim).abs());
    assert!(off < 2.0 && above > 4.0 * below, "{above} and {below} by cells, {open} and {dim} by rays");
}

#[test]
fn scenes_without_surfaces_and_triangles_without_area_are_lit() {
    let here = Camera::look_at(DVec3::new(0.0, 1.0, 5.0), DVec3::ZERO);
    let mut nothing = with_cells(&Arc::new(empty_scene()));
    assert!(mean_of(&color(&mut nothing, &job(here, [32, 24], cells(16)))) > 0.0);
    assert!(!nothing.fill_light(Duration::from_millis(1), true));
    let mut scene = empty_scene();
    place(&mut scene, quad(Vec3::ZERO, Vec3::X, Vec3::NEG_Z, 1.0, 0), DAffine3::IDENTITY);
    let plain = color(&mut with_cells(&Arc::new(scene.clone())), &job(here, [32, 24], cells(16)));
    let mut flat = quad(Vec3::ZERO, Vec3::X, Vec3::NEG_Z, 1.0, 0);
    flat.positions = vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::ZERO];
    place(&mut scene, flat, DAffine3::IDENTITY);
    let with_flat = color(&mut with_cells(&Arc::new(scene)), &job(here, [32, 24], cells(16)));
    let off = plain.iter().zip(&with_flat).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off <= Some(3), "{off:?}");
}

#[test]
fn memory_is_bounded_and_evicted_cells_come_back_the_same() {
    let scene = box_of_cornell(DVec3::ZERO);
    let mut sampler = with_cells(&scene);
    let view = job(view_of_room(DVec3::ZERO), [64, 48], cells(16));
    let wanted = color(&mut sampler, &view);
    let report = sampler.light_cells().unwrap();
    assert!(report.cells > 0 && report.bytes > 0 && report.filled >= report.cells as u64, "{report:?}");
    // Other light forgets the cells of this one.
    let off = Lighting { lights: Vec::new(), ..scene.lighting.clone() };
    let sampled = job_around_origin(&scene, 16);
    let info = argus_scene::SampleSetInfo { lighting: off, ..(*sampled.info).clone() };
    let dark = argus_scene::SampleJob { info: Arc::new(info), ..sampled };
    assert_eq!(mean_radiance(&mut sampler, &dark), Vec3::ZERO);
    assert!(color(&mut sampler, &view) == wanted);
}

/// A room with a mirror in front of a wall, a view that the mirror fills, and the view from behind it, to which the mirror's back
/// and the wall's are open.
fn room_with_a_mirror() -> (Arc<Scene>, [Camera; 2]) {
    let mut scene = (*box_of_cornell(DVec3::ZERO)).clone();
    scene.materials.push(Material { base_color: glam::Vec4::ONE, ..chrome(0.0) });
    scene.materials.iter_mut().for_each(|material| material.double_sided = false);
    let mirror = scene.materials.len() as u32 - 1;
    let wall = quad(Vec3::NEG_Z * 1.9, Vec3::X * 1.5, Vec3::Y * 1.5, 1.0, mirror);
    place(&mut scene, wall, DAffine3::IDENTITY);
    let camera = |z: f64| {
        let eye = DVec3::new(0.1, 0.2, z);
        Camera { fov_deg: 40.0, ..Camera::look_at(eye, eye.with_z(-1.9)) }
    };
    (Arc::new(scene), [camera(1.5), camera(-5.3)])
}

fn mirrored(scene: &Scene, job: ViewJob) -> ViewJob {
    ViewJob { reflections: probes_from(scene, ProbeSource::Rays), ..job }
}

#[test]
fn a_mirror_shows_the_light_of_the_direct_view() {
    let (scene, [front, behind]) = room_with_a_mirror();
    let size = [96, 96];
    let mut sampler = with_cells(&scene);
    let mut off = |light| {
        let seen = color(&mut sampler, &mirrored(&scene, job(front, size, light)));
        let wanted = color(&mut sampler, &job(behind, size, light));
        let flipped = wanted.chunks(3 * size[0] as usize).flat_map(|row| row.rchunks(3)).flatten();
        let mut off: Vec<u8> = seen.iter().zip(flipped).map(|(a, b)| a.abs_diff(*b)).collect();
        // The mirror also shows the lamp, a glint of a few pixels.
        off.sort_unstable();
        off[..off.len() / 20 * 19].iter().map(|&off| f64::from(off)).sum::<f64>() / off.len() as f64
    };
    let (by_cells, by_rays) = (off(cells(16)), off(Some(SurfaceLight::Rays)));
    println!("off by {by_cells:.3} of 255 by cells, {by_rays:.3} by rays");
    // A view joins cells of 16 rays with what is around them, and what its reflections show has nothing around it.
    assert!(by_cells < 1.0 && by_cells < 1.5 * by_rays, "{by_cells} of 255, {by_rays} by rays");
}

#[test]
fn bytes_of_reflections_depend_on_no_order_of_filling() {
    let (scene, [front, behind]) = room_with_a_mirror();
    let view = mirrored(&scene, job(front, [64, 64], cells(16)));
    let probes = probes_of(&scene, probes_from(&scene, ProbeSource::Rays));
    let planes = |sampler: &mut GpuSampler| {
        let sample = sample(sampler, &probes);
        sample.planes.iter().map(|plane| host_bytes(&sample, plane.kind)).collect::<Vec<_>>()
    };
    let (mut one, mut other) = (with_cells(&scene), with_cells(&scene));
    let wanted = (color(&mut one, &view), planes(&mut one));
    direct(&mut other, &mirrored(&scene, job(behind, [40, 30], None)));
    fill(&mut other);
    let first = planes(&mut other);
    assert!((color(&mut other, &view), first) == wanted);
}

#[test]
fn an_open_view_does_not_wait_for_cells_of_its_reflections() {
    let (scene, [front, behind]) = room_with_a_mirror();
    // The mirror is all that the view shows: its own cells are few, those of what it reflects many.
    let open = mirrored(&scene, job(front, [320, 320], None));
    let mut sampler = with_cells(&scene);
    let pinned = color(&mut sampler, &mirrored(&scene, job(front, [320, 320], Some(SurfaceLight::Rays))));
    assert!(direct(&mut sampler, &open).images[Output::Color].as_deref() == Some(&pinned[..]));
    let light = |sampler: &mut GpuSampler| direct(sampler, &open).provenance.plan.light();
    let rises = (0..8).any(|_| {
        fill(&mut sampler);
        light(&mut sampler) == cells(64)
    });
    assert!(rises, "{:?}", sampler.light_cells());
    let half = Some(SurfaceLight::Cells { rays: 16, reflected: false });
    let half = mirrored(&scene, job(front, [320, 320], half));
    let frame = direct(&mut sampler, &half);
    assert_eq!(frame.provenance.plan.light(), half.plan.light());
    let mut other = with_cells(&scene);
    direct(&mut other, &job(behind, [320, 320], None));
    assert!(direct(&mut other, &half).images[Output::Color] == frame.images[Output::Color]);
}

#[test]
fn cells_of_another_sampler_are_as_good_as_own_ones_and_much_cheaper() {
    let scene = box_of_cornell(DVec3::ZERO);
    let view = |light| job(view_of_room(DVec3::ZERO), [320, 240], light);
    let (mut one, mut other) = (with_cells(&scene), with_cells(&scene));
    let wanted = color(&mut one, &view(cells(64)));
    direct(&mut other, &view(None));
    let (from, to) = (one.cell_pages().unwrap(), other.cell_pages().unwrap());
    let content = to.content().expect("cells of a still scene have a name");
    assert_eq!(from.content(), Some(content));
    let pages = to.wanted(usize::MAX);
    assert!(!pages.is_empty() && to.wanted(usize::MAX).is_empty(), "a page is asked for once");
    // What is awaited is not filled.
    assert!(other.fill_light(Duration::from_millis(5), false));
    assert_eq!(other.light_cells().unwrap().filled, 0);
    let begin = Instant::now();
    let packed = from.packed(content, &pages);
    packed.iter().for_each(|(page, packed)| to.add(content, *page, packed).unwrap());
    let took_ms = begin.elapsed().as_secs_f64() * 1e3;
    to.give_up(&pages);
    assert!(color(&mut other, &view(cells(64))) == wanted);
    let (filler, taker) = (one.light_cells().unwrap(), other.light_cells().unwrap());
    let bytes: usize = packed.iter().map(|(_, packed)| packed.len()).sum();
    println!(
        "{} pages, {bytes} bytes: taken in {took_ms:.1} ms, filled in {:.1} ms",
        packed.len(),
        filler.fill_ms
    );
    assert_eq!(taker.pages_taken, packed.len() as u64);
    // Rays are nowhere cheaper than in a box of so few triangles.
    assert!(taker.filled < filler.filled / 10 && 4.0 * took_ms < filler.fill_ms, "{filler:?} {taker:?}");
    // Cells of another content, and bytes that are no page, change nothing.
    let off = Lighting { lights: Vec::new(), ..scene.lighting.clone() };
    let mut dark = with_cells(&Arc::new(Scene { lighting: off, ..(*scene).clone() }));
    color(&mut dark, &view(cells(16)));
    let dark = dark.cell_pages().unwrap();
    assert!(dark.content() != Some(content) && dark.packed(content, &pages).is_empty());
    let (page, packed) = &packed[0];
    assert!(to.add(content, *page, &packed[1..]).is_err() && to.add(content, u64::MAX, packed).is_err());
    to.add(dark.content().unwrap(), *page, packed).unwrap();
    assert_eq!(other.light_cells().unwrap(), taker);
}

/// Milliseconds of a frame's stages of these names.
fn ms_of(frame: &Frame, names: &[&str]) -> f64 {
    frame.stages.iter().filter(|stage| names.contains(&stage.name.as_str())).map(|stage| stage.ms).sum()
}

#[test]
fn filled_cells_light_nearly_all_of_a_large_scene_for_much_less_than_rays() {
    let Some(scene) = real_scene("sponza/sponza.glb") else { return };
    let mut sampler = lit(&scene, Indirect::Cells(CellSettings::default()));
    let camera = Camera::look_at(DVec3::new(-9.0, 2.0, -0.5), DVec3::new(0.0, 3.0, 0.0));
    for size in [[640, 480], [320, 240]] {
        let view = job(camera, size, None);
        for _ in 0..3 {
            direct(&mut sampler, &view);
            while sampler.light_cells().unwrap().waiting > 0 {
                sampler.fill_light(Duration::from_millis(20), false);
            }
        }
        let before = sampler.light_cells().unwrap();
        let by_cells = direct(&mut sampler, &view);
        assert_eq!(by_cells.provenance.plan.light(), cells(16), "{size:?}");
        let after = sampler.light_cells().unwrap();
        let lit = (after.pixels_lit - before.pixels_lit) as f64 / (after.pixels - before.pixels) as f64;
        // The least of three in turn: other work on the machine only adds to times.
        let [mut cells, mut rays] = [f64::INFINITY; 2];
        for _ in 0..3 {
            let by_cells = direct(&mut sampler, &view);
            let by_rays = direct(&mut sampler, &job(camera, size, Some(SurfaceLight::Rays)));
            cells = cells.min(ms_of(&by_cells, &["look up light cells"]));
            rays = rays.min(ms_of(&by_rays, &["trace sky", "gather paths"]));
        }
        println!(
            "{size:?}: {cells:.0} ms by cells, {rays:.0} by rays, {lit:.3} of pixels by cells, {after:?}"
        );
        assert!(lit > 0.85 && cells < 0.7 * rays, "{size:?}: {cells} and {rays} ms, {lit} of pixels");
    }
}
