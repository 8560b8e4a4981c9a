//! Hard cases of frames as samples, with the renderers in this process: no distance at all, viewers behind and inside of
//! geometry, the far end of the coordinates, and nothing but sky.

use std::sync::Arc;

use argus_compositor::GpuCompositor;
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::GpuSampler;
use argus_scene::reference::Tracer;
use argus_scene::sample::{SampleSet, SampleSetInfo};
use argus_scene::{
    Camera, Cancel, Compositor as _, Frame, FrameSource, Output, Outputs, Plan, Rig, RigSettings, SampleId,
    Sampler as _, Scene, SceneState, Version, ViewJob, Visibility, Warp,
};
use glam::DVec3;

const SIZE: [u32; 2] = [96, 72];

/// A floor of 8 m and a cube of 2 m on it, at an offset in metres.
fn scene(offset: f64) -> Arc<Scene> {
    let corner = |x: f64, y: f64, z: f64| format!("v {} {} {}\n", offset + x, y, offset + z);
    let mut obj = String::new();
    for (x, z) in [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)] {
        obj += &corner(x, 0.0, z);
    }
    for y in [0.0, 2.0] {
        for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            obj += &corner(x, y, z);
        }
    }
    obj += "f 4 3 2 1\nf 9 12 11 10\nf 5 6 10 9\nf 6 7 11 10\nf 7 8 12 11\nf 8 5 9 12\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cube.obj");
    std::fs::write(&path, obj).unwrap();
    let mut scene = argus_scene::open(path.to_str().unwrap()).unwrap();
    // The sky of a view is exposed as its frames were.
    scene.lighting.exposure = 0.6;
    Arc::new(scene)
}

/// The renderers of a scene.
struct Stage {
    scene: Arc<Scene>,
    sampler: GpuSampler,
    compositor: GpuCompositor,
    info: Arc<SampleSetInfo>,
}

impl Stage {
    fn new(scene: Arc<Scene>) -> Self {
        let gpu = Gpu::new(&GpuOptions::default()).unwrap();
        let info = Arc::new(SampleSetInfo {
            version: Version::of_epoch(SampleId::FRAMES, 0),
            ..SampleSetInfo::of_scene(&scene, Rig::for_scene(&scene, &RigSettings::default()).unwrap())
        });
        let sampler = GpuSampler::new(Arc::clone(&gpu), Arc::clone(&scene)).unwrap();
        let compositor = GpuCompositor::new(gpu).unwrap();
        Self { scene, sampler, compositor, info }
    }

    fn job(&self, camera: Camera, plan: Plan) -> ViewJob {
        ViewJob {
            camera,
            width: SIZE[0],
            height: SIZE[1],
            outputs: Outputs::COLOR.with(Output::Range).with(Output::Mask),
            band_rows: 0,
            plan,
            state: SceneState::default(),
            time_secs: 0.0,
            visibility: Visibility::default(),
            reflections: None,
            history: None,
            rays: None,
        }
    }

    fn direct(&mut self, camera: Camera) -> Frame {
        let outputs = Outputs::COLOR.with(Output::Range);
        let job = ViewJob { outputs, ..self.job(camera, Plan::direct(1)) };
        self.sampler.render_views(&[job], &Cancel::new()).remove(0).unwrap()
    }

    /// The view of `to`, warped from the direct frame of `from`.
    fn warped(&mut self, from: Camera, to: Camera) -> Frame {
        let frame = self.direct(from);
        let source = FrameSource {
            camera: from,
            width: SIZE[0],
            height: SIZE[1],
            samples_per_pixel: 1,
            band_rows: 0,
            light: None,
        };
        let sample = Arc::new(source.sample(&frame).unwrap());
        let id = sample.id;
        self.compositor.hold(&SampleSet { info: Arc::clone(&self.info), samples: vec![sample] }).unwrap();
        let plan = Plan::Warp(Warp { samples: vec![id], frames: vec![source], ..Warp::default() });
        self.compositor.compose(&[self.job(to, plan)], &Cancel::new()).remove(0).unwrap()
    }
}

fn ranges(frame: &Frame) -> Vec<f32> {
    let bytes = frame.images[Output::Range].as_ref().unwrap();
    bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

/// Share of pixels that no frame saw.
fn unseen(frame: &Frame) -> f64 {
    let mask = frame.images[Output::Mask].as_ref().unwrap();
    mask.iter().filter(|value| **value == 255).count() as f64 / mask.len() as f64
}

fn at(offset: f64, eye: [f64; 3], target: [f64; 3]) -> Camera {
    let origin = DVec3::new(offset, 0.0, offset);
    Camera::look_at(origin + DVec3::from(eye), origin + DVec3::from(target))
}

#[test]
fn a_frame_warped_to_its_own_camera_is_itself_to_within_rounding() {
    for offset in [0.0, 1e6] {
        let mut stage = Stage::new(scene(offset));
        let camera = at(offset, [5.0, 3.0, 4.0], [0.0, 0.5, 0.0]);
        let direct = stage.direct(camera);
        let warped = stage.warped(camera, camera);
        assert_eq!(unseen(&warped), 0.0, "offset {offset}");
        assert!(ranges(&direct).contains(&f32::INFINITY), "some pixels show the sky");
        let pairs = direct.images[Output::Color]
            .as_ref()
            .unwrap()
            .iter()
            .zip(warped.images[Output::Color].as_ref().unwrap().iter());
        let most = pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(most <= 1, "offset {offset}: {most} steps of 255");
        for (is, was) in ranges(&warped).iter().zip(ranges(&direct)) {
            assert!(*is == was || (is - was).abs() < 1e-3 * was, "offset {offset}: {is} m, not {was} m");
        }
    }
}

#[test]
fn ranges_from_a_frame_beside_equal_those_of_the_reference_at_any_offset() {
    for offset in [0.0, 1e6] {
        let mut stage = Stage::new(scene(offset));
        let from = at(offset, [5.0, 3.0, 4.0], [0.0, 0.5, 0.0]);
        let to = at(offset, [5.1, 3.0, 3.8], [0.1, 0.5, -0.2]);
        let warped = stage.warped(from, to);
        assert!(unseen(&warped) < 0.1, "offset {offset}: {}", unseen(&warped));
        let truth = Tracer::new(Arc::clone(&stage.scene)).render(&to, SIZE[0], SIZE[1], 1, |_| ());
        let mask = warped.images[Output::Mask].clone().unwrap();
        let mut far_off = 0;
        for (pixel, is) in ranges(&warped).iter().enumerate().filter(|(pixel, _)| mask[*pixel] == 0) {
            assert!(!is.is_nan());
            let was = truth.range[pixel];
            let near = f64::from(*is) == f64::from(was)
                || (f64::from(*is) - f64::from(was)).abs() < 0.01 * f64::from(was);
            far_off += usize::from(!near);
        }
        // Pixels at silhouettes may fall to either side.
        assert!(far_off < mask.len() / 50, "offset {offset}: {far_off} pixels");
    }
}

#[test]
fn a_viewer_behind_the_frames_back_sees_nothing_of_it() {
    let mut stage = Stage::new(scene(0.0));
    let from = at(0.0, [3.0, 1.0, 3.0], [0.0, 0.5, 0.0]);
    let behind = at(0.0, [-3.0, 1.0, -3.0], [0.0, 0.5, 0.0]);
    let away = Camera { target: from.eye * 2.0 - from.target, ..from };
    assert_eq!(unseen(&stage.warped(from, away)), 1.0);
    assert!(unseen(&stage.warped(from, behind)) > 0.5);
}

#[test]
fn a_viewer_inside_of_geometry_gets_no_invalid_pixel() {
    let mut stage = Stage::new(scene(0.0));
    let inside = at(0.0, [0.0, 1.0, 0.0], [1.0, 1.0, 0.3]);
    let outside = at(0.0, [3.0, 1.0, 1.0], [0.0, 1.0, 0.0]);
    let touching = at(0.0, [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]);
    for (from, to) in [(inside, outside), (outside, inside), (touching, outside), (outside, touching)] {
        let warped = stage.warped(from, to);
        assert!(ranges(&warped).iter().all(|range| *range > 0.0), "a range is a distance or infinite");
    }
}

#[test]
fn a_frame_of_sky_alone_shows_no_surface_and_no_other_sky() {
    let mut stage = Stage::new(scene(0.0));
    let up = at(0.0, [3.0, 1.0, 3.0], [3.5, 9.0, 3.0]);
    let moved = at(0.0, [2.0, 1.5, 2.0], [2.5, 9.5, 2.0]);
    let (direct, warped) = (stage.direct(moved), stage.warped(up, moved));
    let colors = |frame: &Frame| frame.images[Output::Color].as_ref().unwrap().as_chunks::<3>().0.to_vec();
    let mask = warped.images[Output::Mask].clone().unwrap();
    for (pixel, (was, is)) in colors(&direct).iter().zip(&colors(&warped)).enumerate() {
        // Beside the bounds of the scene a sample without surfaces proves nothing, so its pixels are traced.
        let is_seen = mask[pixel] == 0;
        assert!(!is_seen || was.iter().zip(is).all(|(a, b)| a.abs_diff(*b) <= 2), "{was:?}, not {is:?}");
    }
    assert!(ranges(&warped).iter().all(|range| *range == f32::INFINITY));
}
