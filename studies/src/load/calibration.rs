//! Calibration: the cost and the error of every setting, for views all over a scene.
//!
//! The result is the [`Model`] with which a coordinator chooses settings.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_cluster::core::quality::{Answer, Model, Observed, Setting, Situation, Trial};
use argus_gpu::Gpu;
use argus_sampler::SamplerSettings;
use argus_scene::reference::cache;
use argus_scene::{
    Camera, Cancel, Compositor, Frame, Holes, Output, Outputs, PixelJob, RenderError, Rig, RigKind,
    RigSettings, SampleId, Sampler, Search, ViewJob, metrics, path,
};
use glam::DVec2;
use image::RgbImage;
use indicatif::ProgressBar;

use crate::bench::Bench;

/// The most samples that serve a view of a study.
const MOST_SAMPLES: usize = 8;
/// Rays a side that test whether a random view shows anything.
const PROBES: u32 = 7;

/// Candidate settings: the best search of each kind at several prices, and direct views. [`Answers::supported`] removes
/// those that the compositor rejects.
pub fn settings(rig: &Rig) -> Vec<Setting> {
    let counts: &[u32] = match rig {
        Rig::TileCorners { .. } => &[2, 4],
        Rig::Cell { .. } => &[4, 8],
    };
    let warp = |search, steps, supersampling, samples, holes| Setting::Warp {
        search,
        steps,
        supersampling,
        samples,
        holes,
    };
    let mut settings = Vec::new();
    for &samples in counts {
        for supersampling in [1, 2, 3] {
            settings.push(warp(Search::Splat, 0, supersampling, samples, Holes::Mark));
        }
    }
    let most = counts[counts.len() - 1];
    settings.push(warp(Search::Pyramid, 0, 2, most, Holes::Mark));
    settings.push(warp(Search::Seeded, 4, 2, most, Holes::Mark));
    settings.push(warp(Search::Splat, 0, 2, most, Holes::Trace));
    settings.extend([1, 4, 16].map(|samples_per_pixel| Setting::Direct { samples_per_pixel }));
    settings
}

/// One scene on one device, ready to answer views with any setting.
pub struct Answers {
    bench: Bench,
    device: String,
    held: BTreeSet<SampleId>,
}

impl Answers {
    /// Opens a scene, as [`argus_scene::open`] takes it.
    ///
    /// # Errors
    /// A scene that cannot be opened or sampled.
    pub fn open(gpu: &Arc<Gpu>, spec: &str, rig: &RigSettings) -> Result<Self> {
        let bench = Bench::new(gpu, spec, rig, SamplerSettings::default())?;
        Ok(Self { bench, device: gpu.kind().to_owned(), held: BTreeSet::new() })
    }

    /// The rig that places the sample cameras.
    pub fn rig(&self) -> Rig {
        self.bench.info.rig
    }

    /// `count` random views that stand in the open and show something. With a `Cell` rig they are drawn from `places`
    /// cells, since each new cell costs as many samples as it has corners.
    pub fn views(&self, count: usize, places: usize, seed: u64) -> Vec<Camera> {
        let (bounds, rig) = (self.bench.info.extent, self.bench.info.rig);
        let kind = match rig {
            Rig::TileCorners { .. } => RigKind::TileCorners,
            Rig::Cell { .. } => RigKind::Cell,
        };
        let open = || path::wandering(bounds, kind, seed).take(10_000).filter(|c| self.shows_something(c));
        let Rig::Cell { origin, spacing, .. } = rig else { return open().take(count).collect() };
        // Each random view is moved into one of the cells, at the same position within the cell.
        let cell_of = |camera: &Camera| ((camera.eye - origin) / spacing).floor();
        let mut cells = Vec::new();
        for camera in path::wandering(bounds, kind, 1).take(10_000).filter(|c| self.shows_something(c)) {
            let cell = cell_of(&camera);
            if !cells.contains(&cell) {
                cells.push(cell);
            }
            if cells.len() == places {
                break;
            }
        }
        let moved = |(i, camera): (usize, Camera)| {
            let cell = cells.get(i % cells.len().max(1)).copied().unwrap_or(cell_of(&camera));
            let by = (cell - cell_of(&camera)) * spacing;
            Camera { eye: camera.eye + by, target: camera.target + by, ..camera }
        };
        let all = path::wandering(bounds, kind, seed).take(100_000).enumerate().map(moved);
        all.filter(|c| self.shows_something(c)).take(count).collect()
    }

    /// Whether more than half of a view shows surfaces, all of them front faces and none very close.
    fn shows_something(&self, camera: &Camera) -> bool {
        let extent = self.bench.info.extent.size().max_element();
        let mut seen = 0;
        for i in 0..PROBES * PROBES {
            let pixel = DVec2::new(f64::from(i % PROBES), f64::from(i / PROBES)) + 0.5;
            let Some(hit) = self.bench.tracer.trace(camera.eye, camera.direction(pixel, PROBES, PROBES))
            else {
                continue;
            };
            if hit.range < 0.01 * extent {
                return false;
            }
            let material = &self.bench.scene.materials[self.material_of(hit.instance)];
            if !hit.front && !material.double_sided {
                return false;
            }
            seen += 1;
        }
        seen * 2 > PROBES * PROBES
    }

    fn material_of(&self, instance: u32) -> usize {
        let mesh = self.bench.scene.instances[instance as usize].mesh;
        self.bench.scene.meshes[mesh as usize].material as usize
    }

    /// The reference image of a view, from the cache or traced.
    pub fn reference(&self, camera: &Camera, size: [u32; 2], samples_per_pixel: u32) -> RgbImage {
        let folder = cache::directory();
        let image =
            cache::render(folder.as_deref(), &self.bench.tracer, camera, size, samples_per_pixel, |_| ());
        image.display(self.bench.scene.lighting.exposure)
    }

    /// Renders the samples that the views may use and that are not held yet. Returns the milliseconds it took.
    ///
    /// # Errors
    /// Any error of the sampler or the compositor.
    pub fn hold(&mut self, cameras: &[Camera]) -> Result<f64> {
        let wanted: BTreeSet<SampleId> =
            cameras.iter().flat_map(|camera| self.bench.sample_ids(camera, MOST_SAMPLES)).collect();
        let ids: Vec<SampleId> = wanted.difference(&self.held).copied().collect();
        let began = Instant::now();
        self.bench.hold(&ids)?;
        self.held.extend(ids);
        Ok(began.elapsed().as_secs_f64() * 1e3)
    }

    /// Renders a view whose samples are held. Returns the frame and the milliseconds it took.
    ///
    /// # Errors
    /// Any error of the sampler or the compositor; an invalid `plan.search` if the compositor has no such search.
    pub fn answer(&mut self, camera: &Camera, size: [u32; 2], setting: Setting) -> Result<(Frame, f64)> {
        let plan = setting.plan(self.bench.sample_ids(camera, setting.samples()));
        let of_samples = (!setting.is_direct()).then_some(Output::Confidence);
        let traced = setting.traces().then_some(Output::Mask);
        let outputs: Outputs = [Some(Output::Color), of_samples, traced].into_iter().flatten().collect();
        let job = self.bench.job(*camera, size, outputs, plan);
        let cancel = Cancel::new();
        let began = Instant::now();
        let frames = match setting {
            Setting::Direct { .. } => self.bench.sampler.render_views(std::slice::from_ref(&job), &cancel),
            Setting::Warp { .. } => self.bench.compositor.compose(std::slice::from_ref(&job), &cancel),
        };
        let mut frame = frames.into_iter().next().context("the role returned no frame")??;
        if let Setting::Warp { holes: Holes::Trace, supersampling, .. } = setting {
            self.trace_holes(&job, supersampling, &mut frame)?;
        }
        Ok((frame, began.elapsed().as_secs_f64() * 1e3))
    }

    /// Traces the holes of a frame with the sampler, as a worker does.
    fn trace_holes(&mut self, job: &ViewJob, supersampling: u32, frame: &mut Frame) -> Result<()> {
        let mask = frame.images[Output::Mask].as_ref().context("the frame has no mask")?;
        let holes = mask.iter().enumerate().filter(|(_, m)| **m == 255).map(|(i, _)| i as u32);
        let pixels: Vec<u32> = holes.collect();
        if pixels.is_empty() {
            return Ok(());
        }
        let ViewJob { camera, width, height, state, time_secs, reflections, .. } = *job;
        let samples_per_pixel = supersampling * supersampling;
        let wanted =
            PixelJob { camera, width, height, pixels, samples_per_pixel, state, time_secs, reflections };
        let traced = self.bench.sampler.render_pixels(std::slice::from_ref(&wanted), &Cancel::new());
        let traced = traced.into_iter().next().context("the sampler traced nothing")??;
        let mut color = frame.images[Output::Color].take().context("the frame has no colour")?.to_vec();
        for (&pixel, texel) in wanted.pixels.iter().zip(traced.color.chunks_exact(3)) {
            let at = pixel as usize * 3;
            color[at..at + 3].copy_from_slice(texel);
        }
        frame.images[Output::Color] = Some(color.into());
        frame.served.traced += wanted.pixels.len() as u64;
        frame.served.unresolved = frame.served.unresolved.saturating_sub(wanted.pixels.len() as u64);
        frame.unresolved_fraction = 0.0;
        Ok(())
    }

    /// The settings that this build supports, tested on one view. The view's samples must be held.
    ///
    /// # Errors
    /// Any error but an invalid plan.
    pub fn supported(&mut self, camera: &Camera, settings: &[Setting]) -> Result<Vec<Setting>> {
        let mut supported = Vec::new();
        for &setting in settings {
            match self.answer(camera, [16, 12], setting) {
                Ok(_) => supported.push(setting),
                Err(error) => match error.downcast_ref::<RenderError>() {
                    Some(RenderError::Invalid(_)) => {}
                    _ => return Err(error),
                },
            }
        }
        Ok(supported)
    }

    /// Renders each view alone with every setting, like interactive requests, and compares the frames with the
    /// references. `progress` counts views.
    ///
    /// # Errors
    /// Any error of [`Answers::answer`].
    pub fn trials(
        &mut self,
        cameras: &[Camera],
        size: [u32; 2],
        settings: &[Setting],
        reference_samples: u32,
        progress: &ProgressBar,
    ) -> Result<Vec<Trial>> {
        // The first frame of a setting compiles its pipelines.
        if let Some(camera) = cameras.first() {
            for &setting in settings {
                self.answer(camera, size, setting)?;
            }
        }
        let mut trials = Vec::new();
        for camera in cameras {
            let reference = self.reference(camera, size, reference_samples);
            let mut answers = Vec::new();
            for &setting in settings {
                let (frame, ms) = self.answer(camera, size, setting)?;
                let observed = Observed::of(&frame).context("the frame has no colour")?;
                answers.push(Answer { setting, error: error(&frame, &reference)?, ms, observed });
            }
            let rig = (&self.bench.info.rig, self.bench.sight());
            let situation = Situation::new(camera, size[1], rig, &self.bench.info.extent);
            trials.push(Trial { situation, pixels: u64::from(size[0]) * u64::from(size[1]), answers });
            progress.inc(1);
        }
        Ok(trials)
    }

    /// Times settings at further sizes: (setting, pixels, milliseconds), each the faster of two frames.
    ///
    /// # Errors
    /// Any error of [`Answers::answer`].
    pub fn timings(
        &mut self,
        cameras: &[Camera],
        sizes: &[[u32; 2]],
        settings: &[Setting],
    ) -> Result<Vec<(Setting, u64, f64)>> {
        let mut timings = Vec::new();
        for &size in sizes {
            for &setting in settings {
                for camera in cameras {
                    let (_, first) = self.answer(camera, size, setting)?;
                    let (_, second) = self.answer(camera, size, setting)?;
                    timings.push((setting, u64::from(size[0]) * u64::from(size[1]), first.min(second)));
                }
            }
        }
        Ok(timings)
    }

    /// Fits the model to the calibration.
    pub fn fit(&self, trials: &[Trial], timings: &[(Setting, u64, f64)]) -> Model {
        Model::fit(self.bench.info.scene, self.bench.info.rig, self.device.clone(), trials, timings)
    }
}

/// Mean FLIP of a frame, at 67 pixels per degree.
///
/// # Errors
/// The frame has no colour or another size.
pub fn error(frame: &Frame, reference: &RgbImage) -> Result<f64> {
    let pixels = frame.images[Output::Color].as_ref().context("the frame has no colour")?.to_vec();
    let image = RgbImage::from_raw(frame.width, frame.height, pixels).context("the frame is short")?;
    Ok(metrics::flip_mean(reference, &image)?)
}

/// The share of items for which `of` holds, 0–1.
pub(crate) fn share<T>(items: &[T], of: impl Fn(&T) -> bool) -> f64 {
    items.iter().filter(|item| of(item)).count() as f64 / items.len().max(1) as f64
}

/// How often each setting was chosen, as `name ×count` in order of falling count.
pub(crate) fn tally(settings: impl Iterator<Item = Setting>) -> String {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    settings.for_each(|setting| *counts.entry(setting.name()).or_default() += 1);
    let mut counts: Vec<(String, usize)> = counts.into_iter().collect();
    counts.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    counts.into_iter().map(|(name, n)| format!("{name} ×{n}")).collect::<Vec<_>>().join(", ")
}
