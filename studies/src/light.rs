//! Light: the cost and the error of each method of indirect light, against the path-traced reference.
//!
//! One view, with all effects of direct light, is rendered by each method. A row has the seconds before the first view
//! (leaf sides, VPLs or octrees), those of a view, and the error against the reference. Views have one ray a pixel, so
//! that only light differs; the noise of the reference is part of every row.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{GpuSampler, Indirect, PathKnobs, PointKnobs, SamplerKnobs, VplKnobs};
use argus_scene::metrics::compare;
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer};
use argus_scene::tone::linear_from_srgb;
use argus_scene::{
    Camera, Cancel, LightEffects, Outputs, Plan, Sampler as _, SceneState, ViewJob, Visibility,
};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::json;

use crate::median::median;
use crate::{Effort, Machine, Report, report};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// Scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// Camera of the view; `None`: the scene's first camera.
    pub camera: Option<Camera>,
    /// View size in pixels.
    pub size: [u32; 2],
    /// Most reflections between light and visible surface, of the reference and of paths.
    pub bounces: u32,
    /// Paths a pixel of the reference.
    pub paths: u32,
    /// Measured views of each row; each time is their median.
    pub rounds: usize,
    /// Methods, with their knobs.
    pub methods: Vec<Indirect>,
    /// Folder for the images of all rows.
    pub images: Option<PathBuf>,
}

impl Default for Options {
    fn default() -> Self {
        let paths = PathKnobs::default();
        let vpl = VplKnobs::default();
        Self {
            scene: "terrain:50000".to_owned(),
            camera: None,
            size: [200, 150],
            bounces: paths.bounces,
            paths: 256,
            rounds: 3,
            methods: vec![
                Indirect::Off,
                Indirect::Paths(paths),
                Indirect::Paths(PathKnobs { level: 8, ..paths }),
                Indirect::Paths(PathKnobs { gather: 16, ..paths }),
                Indirect::Paths(PathKnobs { rays: 16, gather: 64, ..paths }),
                Indirect::Vpl(vpl),
                Indirect::Vpl(VplKnobs { bounces: 4, ..vpl }),
                Indirect::Points(PointKnobs::default()),
                Indirect::Points(PointKnobs { bounces: 4, ..PointKnobs::default() }),
            ],
            images: None,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self {
            scene: "terrain:2000".to_owned(),
            size: [32, 24],
            paths: 4,
            rounds: 1,
            methods: vec![
                Indirect::Off,
                Indirect::Paths(PathKnobs { level: 5, ..PathKnobs::default() }),
                Indirect::Vpl(VplKnobs { vpls: 256, ..VplKnobs::default() }),
                Indirect::Points(PointKnobs { levels: 5, ..PointKnobs::default() }),
            ],
            ..Self::default()
        }
    }
}

/// Runs the study; `progress` counts rows.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length(options.methods.len() as u64);
    let scene = Arc::new(argus_scene::open(&options.scene)?);
    let camera = options.camera.unwrap_or_else(|| scene.default_camera());
    let exposure = scene.lighting.exposure;
    progress.set_message("tracing the reference");
    let effects = LightEffects::ALL;
    let tracer = Tracer::new(Arc::clone(&scene)).with_direct_light(DirectLight { effects, rays: 16 });
    let indirect = Paths { paths: options.paths, bounces: options.bounces };
    let truth = tracer.render_with(&camera, options.size, 1, Some(indirect), |_| {}).display(exposure);
    let unlit = tracer.render_with(&camera, options.size, 1, None, |_| {}).display(exposure);
    let save = |image: &RgbImage, name: String| -> Result<()> {
        let Some(folder) = &options.images else { return Ok(()) };
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        Ok(image.save(folder.join(name))?)
    };
    save(&truth, "reference.png".to_owned())?;
    // What surfaces reflect onto one another.
    let (whole, direct) = (linear(&truth), linear(&unlit));
    let reflected = (whole.iter().sum::<f64>() - direct.iter().sum::<f64>()).max(1e-9);
    let mut rows = Vec::new();
    for (number, &method) in options.methods.iter().enumerate() {
        progress.set_message(method.to_string());
        let effects = method.effects_with(LightEffects::ALL);
        let knobs = SamplerKnobs { effects, indirect: method, ..SamplerKnobs::default() };
        let mut sampler = GpuSampler::with_knobs(Arc::clone(&gpu), Arc::clone(&scene), knobs)?;
        let job = job(camera, options.size);
        let begin = Instant::now();
        let image = view(&mut sampler, &job)?;
        let first = begin.elapsed().as_secs_f64();
        let mut times = Vec::new();
        for _ in 0..options.rounds.max(1) {
            let begin = Instant::now();
            view(&mut sampler, &job)?;
            times.push(begin.elapsed().as_secs_f64());
        }
        save(&image, format!("{number:02}.png"))?;
        let found = linear(&image);
        let off: f64 = found.iter().zip(&whole).map(|(found, truth)| (found - truth).abs()).sum();
        let leaves = sampler.paths().unwrap_or_default();
        rows.push(report::row(json!({
            "method": method.to_string(),
            "before_s": (first - median(&times)).max(0.0),
            "view_s": median(&times),
            "relative_error": off / reflected,
            "energy": (found.iter().sum::<f64>() - direct.iter().sum::<f64>()) / reflected,
            "flip": compare(&truth, &image)?.flip_mean,
            "leaf_sides": (leaves.sides > 0).then_some(leaves.sides),
            "build_ms": (leaves.sides > 0).then_some(leaves.build_ms),
            "links_ms": (leaves.sides > 0).then_some(leaves.links_ms),
            "direct_ms": (leaves.sides > 0).then_some(leaves.direct_ms),
            "bounces_ms": (leaves.sides > 0).then_some(leaves.gather_ms),
        })));
        progress.inc(1);
    }
    let mut report = Report::new(options.scene.clone(), Machine::here(gpu.kind()), rows);
    report.notes.push(format!(
        "relative_error: the sum of differences from the reference ({} paths a pixel, {} bounces), noise of direct light \
        included, by the sum of its indirect light. energy: the share of indirect light that was found. Both are of \
        displayed values made linear, so that values beyond white count as white.",
        options.paths, options.bounces
    ));
    report.notes.push(
        "before_s: the first view, compilation of programs included, less a later one. VPLs and points do not reflect the \
        sky's light, which paths and the reference do."
            .to_owned(),
    );
    report.note_longest_pass(&gpu);
    Ok(report)
}

fn job(camera: Camera, [width, height]: [u32; 2]) -> ViewJob {
    ViewJob {
        camera,
        width,
        height,
        outputs: Outputs::COLOR,
        plan: Plan::Direct { samples_per_pixel: 1 },
        state: SceneState::default(),
        time_secs: 0.0,
        visibility: Visibility::default(),
        reflections: None,
        history: None,
    }
}

fn view(sampler: &mut GpuSampler, job: &ViewJob) -> Result<RgbImage> {
    let frame = sampler.render_views(std::slice::from_ref(job), &Cancel::new()).remove(0)?;
    let pixels = frame.color.as_ref().context("the frame has no colour")?.to_vec();
    RgbImage::from_raw(frame.width, frame.height, pixels).context("the frame is short")
}

/// Channels of an image, made linear.
fn linear(image: &RgbImage) -> Vec<f64> {
    image.iter().map(|&byte| f64::from(linear_from_srgb(f32::from(byte) / 255.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_methods_have_knobs_in_range_and_differ() {
        for options in [Options::default(), Options::quick()] {
            for (index, method) in options.methods.iter().enumerate() {
                assert_eq!(method.validate(), Ok(()));
                assert!(!options.methods[..index].contains(method));
            }
        }
    }
}
