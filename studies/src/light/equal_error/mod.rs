//! Equal error: what a view with all light costs from samples, and what renderers that share nothing pay for the same error.
//!
//! Sun, soft shadows, sky and light between surfaces are on, exposure is metered. Four ways stand side by side, each with
//! its mean FLIP against a converged reference of several views:
//!
//! - *samples*: views warped from samples of some resolution, or from direct frames of neighbours ([`reuse`]);
//! - *direct*: views from triangles, which look up the same cached light between surfaces as samples do;
//! - *paths*: the reference tracer, which caches nothing: paths from every pixel, in f64;
//! - *mitsuba*: Mitsuba 3, if the script is given, against its own converged images.
//!
//! A row of samples says how long each other way takes for the row's own error ([`curve`]), and from how many views on the
//! samples of a viewpoint cost less than direct views of that error.

mod curve;
mod mitsuba;
mod reuse;
mod rivals;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::{Indirect, PathSettings, SamplerSettings};
use argus_scene::metrics::{FlipTiles, flip_tiles};
use argus_scene::reference::{DirectLight, Indirect as Paths};
use argus_scene::{
    Camera, LightEffects, Outputs, Plan, RigKind, RigSettings, Scene, ViewJob, Visibility, Warp,
};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use self::mitsuba::Mitsuba;
use self::rivals::Rival;
use crate::arguments::{count, or_quick, positive, size};
use crate::bench::{Bench, image_of};
use crate::light::radiance::{RadianceError, Reference};
use crate::load::break_even::break_even;
use crate::median::{mean, median};
use crate::metered::open_metered;
use crate::{Machine, Report, report};

/// Measures what a view with all light costs from samples, directly, by paths without a cache and by Mitsuba, at equal error
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study light equal-error --scene sponza.glb --mitsuba scripts/mitsuba --out figures")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = "rooms")]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "48x36"))]
    pub size: [u32; 2],
    /// Number of views, along a walk from the scene's viewpoints
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub views: usize,
    /// Samples that a view is warped from
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub samples: usize,
    /// Distances in metres of direct frames that serve as samples, to the left and right of a view
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("0.05,0.2,0.8", "0.1"))]
    pub frames_aside: Vec<f64>,
    /// Resolutions of samples: texels along a cube's edge x sub-samples of a texel
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = size, default_value = or_quick("512x4,256x4,256x1,128x1,64x1", "64x1"))]
    pub resolutions: Vec<[u32; 2]>,
    /// Settings of the tracer without cache: samples a pixel x paths of each
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = size, default_value = or_quick("1x1,1x4,4x4,4x16,16x16", "1x1,1x4"))]
    pub tracer: Vec<[u32; 2]>,
    /// Samples a pixel of direct views
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = or_quick("1,4,16", "1,4"))]
    pub direct: Vec<u32>,
    /// Seconds of a view beyond which slower settings of the tracer are left out
    #[arg(long, value_name = "SECONDS", value_parser = positive, default_value = "20")]
    pub patience_secs: f64,
    /// Measure Mitsuba 3, too, by this script: `scripts/mitsuba`, which installs it
    #[arg(long, value_name = "SCRIPT")]
    pub mitsuba: Option<PathBuf>,
    /// Paths a pixel of Mitsuba's converged images, against which its noise is judged
    #[arg(long, value_name = "N", default_value = "512", requires = "mitsuba", value_parser = clap::value_parser!(u32).range(2..=65536))]
    pub mitsuba_converged: u32,
    /// Samples a pixel of the reference
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("16", "4"))]
    pub truth_samples: u32,
    /// Paths of the reference for each of these samples; its time is proportional
    #[arg(long = "paths", value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("8", "4"))]
    pub truth_paths: u32,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Folder for all images
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
}

impl Options {
    /// Mitsuba, if it is to be measured.
    fn mitsuba(&self) -> Option<Mitsuba> {
        let (script, converged) = (self.mitsuba.clone()?, self.mitsuba_converged);
        let paths = [1, 4, 16, 64, 256].into_iter().filter(|paths| *paths < converged).collect();
        Some(Mitsuba { script, paths, converged })
    }
}

/// The light of all ways: paths between leaf sides with the service's settings.
fn light() -> (LightEffects, PathSettings) {
    (LightEffects::ALL, PathSettings::default())
}

/// The scene, its views, and their references.
struct Subject<'a> {
    options: &'a Options,
    gpu: Arc<Gpu>,
    scene: Arc<Scene>,
    views: Vec<Camera>,
    references: Vec<Reference>,
    truths: Vec<RgbImage>,
}

/// Mean errors of views.
#[derive(Clone)]
struct Errors {
    flip: f64,
    /// Of each view, by tiles of [`TILE`] pixels.
    tiles: Vec<FlipTiles>,
    radiance: RadianceError,
}

/// Views from samples.
struct FromSamples {
    /// The samples in a few words.
    name: String,
    view_ms: f64,
    errors: Errors,
    unresolved: f64,
    /// Milliseconds of the samples of one view.
    samples_ms: f64,
}

/// Edge of a tile in pixels, as the service judges views by tiles.
const TILE: u32 = 32;

/// Runs the study; `progress` counts settings.
///
/// # Errors
/// A scene that cannot be opened, no GPU, a render that fails, or Mitsuba's script fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let settings = options.resolutions.len()
        + options.frames_aside.len()
        + options.direct.len()
        + options.tracer.len()
        + 1;
    progress.set_length(settings as u64);
    progress.set_message("tracing the reference");
    let scene = open_metered(&options.scene)?;
    let mut bench = bench(&gpu, &scene, [64, 1])?;
    let subject = Subject::new(options, &gpu, &bench);
    subject.save("reference", &subject.truths)?;
    progress.inc(1);
    let (direct, base) = subject.direct(&mut bench, progress)?;
    let mut rivals = vec![direct];
    let mut found = Vec::new();
    for &aside in &options.frames_aside {
        progress.set_message("direct frames as samples");
        found.push(subject.samples_from_frames(&mut bench, aside)?);
        progress.inc(1);
    }
    drop(bench);
    for &resolution in &options.resolutions {
        progress.set_message(format!("samples of {}", name_of(resolution)));
        found.push(subject.of_samples(resolution)?);
        progress.inc(1);
    }
    rivals.push(subject.paths(progress)?);
    rivals.extend(options.mitsuba().map(|mitsuba| subject.mitsuba(&mitsuba, progress)).transpose()?);
    Ok(subject.report(&found, &rivals, &base))
}

/// The shared setup, with samples of a resolution.
fn bench(gpu: &Arc<Gpu>, scene: &Arc<Scene>, [face, sub_samples]: [u32; 2]) -> Result<Bench> {
    let (effects, paths) = light();
    let rig = RigSettings { kind: Some(RigKind::Cell), face: Some(face), ..RigSettings::default() };
    let settings = SamplerSettings {
        sub_samples,
        effects,
        indirect: Indirect::Paths(paths),
        ..SamplerSettings::default()
    };
    let mut bench = Bench::with_scene(gpu, Arc::clone(scene), &rig, settings)?;
    bench.set_visibility(Visibility::Cpu);
    // The reference has four rays to the sun a pixel at least, and forty to the sky.
    bench.light_references(DirectLight { effects, rays: 1 }, None);
    Ok(bench)
}

impl<'a> Subject<'a> {
    fn new(options: &'a Options, gpu: &Arc<Gpu>, bench: &Bench) -> Self {
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
    fn judge(&self, name: &str, images: &[RgbImage]) -> Result<Errors> {
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

    fn save(&self, name: &str, images: &[RgbImage]) -> Result<()> {
        let Some(folder) = &self.options.images else { return Ok(()) };
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let name: String = name.chars().map(plain).collect();
        for (view, image) in images.iter().enumerate() {
            image.save(folder.join(format!("{name}-{view}.png")))?;
        }
        Ok(())
    }

    fn jobs(&self, bench: &Bench, plan: impl Fn(&Camera) -> Plan) -> Vec<ViewJob> {
        let job = |view: &Camera| bench.job(*view, self.options.size, Outputs::COLOR, plan(view));
        self.views.iter().map(job).collect()
    }

    fn of_samples(&self, resolution: [u32; 2]) -> Result<FromSamples> {
        let mut bench = bench(&self.gpu, &self.scene, resolution)?;
        let ids = bench.all_ids(&self.views, self.options.samples);
        // The leaf sides are lit by a view, so that no sample pays for them.
        bench.time(&self.jobs(&bench, |_| Plan::direct(1))[..1])?;
        let cost = bench.render_timed(ids, 1)?;
        let of_view =
            |view: &Camera| Warp { samples: bench.sample_ids(view, self.options.samples), ..Warp::default() };
        let jobs = self.jobs(&bench, |view| Plan::Warp(of_view(view)));
        let samples = mean(self.views.iter().map(|view| of_view(view).samples.len() as f64));
        let samples_ms = cost.ms / cost.count.max(1) as f64 * samples;
        self.composed(&mut bench, &jobs, name_of(resolution), samples_ms)
    }

    /// Times and judges views from samples that are held.
    fn composed(
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

    fn report(&self, found: &[FromSamples], rivals: &[Rival], base: &Errors) -> Report {
        let mut rows: Vec<Map<String, Value>> = Vec::new();
        let empty = |way: &str, setting: String, view_ms: f64, flip: f64, radiance: Option<RadianceError>| {
            report::row(json!({
                "way": way, "setting": setting, "view_ms": view_ms, "flip": flip,
                "error": radiance.map(|r| r.error), "bias": radiance.map(|r| r.bias),
                "energy": radiance.map(|r| r.energy), "excess_flip": null, "excess_tile": null, "unresolved": null,
                "samples_ms": null, "direct_ms": null, "paths_ms": null, "mitsuba_ms": null, "pays_from": null,
            }))
        };
        for samples in found {
            let Errors { flip, radiance, .. } = samples.errors;
            let mut row = empty("samples", samples.name.clone(), samples.view_ms, flip, Some(radiance));
            row.insert("excess_flip".to_owned(), (flip - base.flip).into());
            row.insert("excess_tile".to_owned(), worst_excess(&samples.errors.tiles, &base.tiles).into());
            row.insert("unresolved".to_owned(), samples.unresolved.into());
            row.insert("samples_ms".to_owned(), samples.samples_ms.into());
            for rival in rivals {
                let ms = rival.curve().ms_at(samples.errors.flip);
                row.insert(format!("{}_ms", rival.way), ms.into());
                if rival.way == "direct" {
                    let views = ms.and_then(|ms| break_even(samples.samples_ms, samples.view_ms, ms));
                    row.insert("pays_from".to_owned(), views.into());
                }
            }
            rows.push(row);
        }
        for rival in rivals {
            let settings = rival.settings.iter();
            rows.extend(settings.map(|s| empty(rival.way, s.name.clone(), s.view_ms, s.flip, s.radiance)));
        }
        let mut report = Report::new(&self.scene.name, Machine::here(self.gpu.kind()), rows);
        report.notes = self.notes(found, rivals);
        report.plots = vec![self.plot(found, rivals)];
        report.note_longest_pass(&self.gpu);
        report
    }

    fn notes(&self, found: &[FromSamples], rivals: &[Rival]) -> Vec<String> {
        let Options { size: [width, height], views, truth_samples, truth_paths, .. } = *self.options;
        let mut notes = vec![
            format!(
                "{views} views of {width}×{height} pixels. Reference: {truth_samples} samples a pixel with {truth_paths} paths \
                 each; FLIP between its halves: {:.3}, and its noise adds about half of that to every row.",
                mean(self.references.iter().map(Reference::noise))
            ),
            "error: root mean squared error of radiance over the root mean square, free of the reference's noise; bias: the same \
             of blocks of 8×8 pixels; energy: mean radiance over the reference's. White pixels are left out."
                .to_owned(),
            "excess_flip: FLIP minus that of direct views with one sample a pixel; excess_tile: largest such difference of a \
             tile. Frames: the views are warped from two direct frames, taken left and right of each."
                .to_owned(),
            "samples_ms: the samples of one view, all six faces. direct_ms, paths_ms, mitsuba_ms: a view of that way with the \
             row's error, between measured settings; none, if no measured setting is that good. pays_from: views of a \
             viewpoint from which its samples cost less than such direct views. Lighting the scene's leaf sides, which \
             samples and direct views share, is in none of these times."
                .to_owned(),
        ];
        for samples in found {
            let times: Vec<String> =
                rivals.iter().map(|rival| rival.times_of(samples.errors.flip, samples.view_ms)).collect();
            notes.push(format!(
                "Samples, {}: {:.2} ms a view with FLIP {:.3}. At that error: {}.",
                samples.name,
                samples.view_ms,
                samples.errors.flip,
                times.join("; ")
            ));
        }
        notes
    }

    fn plot(&self, found: &[FromSamples], rivals: &[Rival]) -> Plot {
        let samples = Series {
            name: "samples".to_owned(),
            points: found.iter().map(|samples| (samples.view_ms, samples.errors.flip)).collect(),
            line: false,
        };
        let of_rival = |rival: &Rival| Series {
            name: rival.way.to_owned(),
            points: rival.settings.iter().map(|s| (s.view_ms, s.flip)).collect(),
            line: true,
        };
        let [width, height] = self.options.size;
        Plot {
            name: "flip".to_owned(),
            title: format!("{}, {width}×{height}: a view with all light", self.scene.name),
            x: Axis::log("milliseconds a view"),
            y: Axis::log("mean FLIP against a converged reference"),
            series: std::iter::once(samples).chain(rivals.iter().map(of_rival)).collect(),
            ..Plot::default()
        }
    }
}

/// The largest excess of a tile's error over that of the same tile in other images.
fn worst_excess(tiles: &[FlipTiles], base: &[FlipTiles]) -> f64 {
    let views = tiles.iter().zip(base).flat_map(|(view, base)| view.tiles.iter().zip(&base.tiles));
    views.map(|(tile, base)| tile - base).fold(0.0, f64::max)
}

/// A resolution of samples in a few words.
fn name_of([face, sub_samples]: [u32; 2]) -> String {
    match sub_samples {
        1 => format!("6×{face}²"),
        _ => format!("6×{face}², {sub_samples} sub-samples"),
    }
}
