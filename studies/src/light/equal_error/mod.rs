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
mod options;
mod reuse;
mod rivals;
mod subject;

use std::sync::Arc;

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use argus_plot::{Axis, Plot, Series};
use argus_sampler::{Indirect, SamplerSettings};
use argus_scene::metrics::FlipTiles;
use argus_scene::reference::DirectLight;
use argus_scene::{Camera, Plan, RigKind, RigSettings, Scene, Visibility, Warp};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

pub use self::options::Options;
use self::rivals::Rival;
use self::subject::{Errors, FromSamples, Subject, light};
use crate::bench::Bench;
use crate::light::radiance::{RadianceError, Reference};
use crate::load::break_even::break_even;
use crate::median::mean;
use crate::metered::open_metered;
use crate::{Machine, Report, report};

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

impl Subject<'_> {
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
