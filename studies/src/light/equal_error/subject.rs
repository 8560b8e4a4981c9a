//! The scene with its views and references, and what views are judged by.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_gpu::Gpu;
use argus_sampler::PathSettings;
use argus_scene::metrics::{FlipTiles, flip_tiles};
use argus_scene::reference::Indirect as Paths;
use argus_scene::{Camera, LightEffects, Outputs, Plan, Scene, ViewJob};
use image::RgbImage;

use super::options::Options;
use crate::bench::{Bench, image_of};
use crate::light::radiance::{RadianceError, Reference};
use crate::median::{mean, median};

/// The light of all ways: paths between leaf sides with the service's settings.
pub(super) fn light() -> (LightEffects, PathSettings) {
    (LightEffects::ALL, PathSettings::default())
}

/// The scene, its views, and their references.
pub(super) struct Subject<'a> {
    pub(super) options: &'a Options,
    pub(super) gpu: Arc<Gpu>,
    pub(super) scene: Arc<Scene>,
    pub(super) views: Vec<Camera>,
    pub(super) references: Vec<Reference>,
    pub(super) truths: Vec<RgbImage>,
}

/// Mean errors of views.
#[derive(Clone)]
pub(super) struct Errors {
    pub(super) flip: f64,
    /// Of each view, by tiles of [`TILE`] pixels.
    pub(super) tiles: Vec<FlipTiles>,
    pub(super) radiance: RadianceError,
}

/// Views from samples.
pub(super) struct FromSamples {
    /// The samples in a few words.
    pub(super) name: String,
    pub(super) view_ms: f64,
    pub(super) errors: Errors,
    pub(super) unresolved: f64,
    /// Milliseconds of the samples of one view.
    pub(super) samples_ms: f64,
}

/// Edge of a tile in pixels, as the service judges views by tiles.
const TILE: u32 = 32;

impl<'a> Subject<'a> {
    pub(super) fn new(options: &'a Options, gpu: &Arc<Gpu>, bench: &Bench) -> Self {
        let views = bench.walk(options.views);
        // The halves share the paths.
        let paths = Paths { paths: (options.truth_paths / 2).max(1), bounces: light().1.bounces };
        let reference = |camera: &Camera| {
            let (size, samples) = (options.size, options.truth_samples);
            Reference::render(&bench.tracer, &bench.scene.lighting, camera, size, samples, Some(paths))
        };
        let references: Vec<Reference> = views.iter().map(reference).collect();
        let truths = references.iter().map(Reference::display).collect();
        Self { options, gpu: Arc::clone(gpu), scene: Arc::clone(&bench.scene), views, references, truths }
    }

    /// Mean errors of images against the references; saves the images.
    pub(super) fn judge(&self, name: &str, images: &[RgbImage]) -> Result<Errors> {
        let tiles = self.truths.iter().zip(images).map(|(truth, image)| flip_tiles(truth, image, TILE));
        let tiles = tiles.collect::<Result<Vec<_>, _>>()?;
        let radiance: Vec<RadianceError> =
            self.references.iter().zip(images).map(|(reference, image)| reference.errors(image)).collect();
        self.save(name, images)?;
        // A view without light has no relative error.
        let of =
            |field: fn(&RadianceError) -> f64| mean(radiance.iter().map(field).filter(|e| e.is_finite()));
        let radiance =
            RadianceError { error: of(|r| r.error), bias: of(|r| r.bias), energy: of(|r| r.energy) };
        Ok(Errors { flip: mean(tiles.iter().map(|view| view.mean)), tiles, radiance })
    }

    pub(super) fn save(&self, name: &str, images: &[RgbImage]) -> Result<()> {
        let Some(folder) = &self.options.images else { return Ok(()) };
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let name: String = name.chars().map(plain).collect();
        for (view, image) in images.iter().enumerate() {
            image.save(folder.join(format!("{name}-{view}.png")))?;
        }
        Ok(())
    }

    pub(super) fn jobs(&self, bench: &Bench, plan: impl Fn(&Camera) -> Plan) -> Vec<ViewJob> {
        let job = |view: &Camera| bench.job(*view, self.options.size, Outputs::COLOR, plan(view));
        self.views.iter().map(job).collect()
    }

    /// Times and judges views from samples that are held.
    pub(super) fn composed(
        &self,
        bench: &mut Bench,
        jobs: &[ViewJob],
        name: String,
        samples_ms: f64,
    ) -> Result<FromSamples> {
        bench.decide_program(jobs)?;
        let (mut times, mut frames) = (Vec::new(), Vec::new());
        for _ in 0..self.options.rounds.max(1) {
            let (ms, found) = bench.time(jobs)?;
            times.push(ms / jobs.len() as f64);
            frames = found;
        }
        let images = frames.iter().map(image_of).collect::<Result<Vec<_>>>()?;
        let errors = self.judge(&format!("samples {name}"), &images)?;
        let unresolved = mean(frames.iter().map(|frame| frame.unresolved_fraction));
        Ok(FromSamples { name, view_ms: median(&times), errors, unresolved, samples_ms })
    }
}
