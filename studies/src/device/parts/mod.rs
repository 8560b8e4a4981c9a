//! Device: the speed of a device's parts, namely atomics, rays, programs with two backends, readback and encoding. Rows
//! with a target show it beside the figure.

mod atomics;
mod backends;
mod programs;
mod rays;
mod transfer;

use std::sync::Arc;

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

pub use self::backends::{FRAGMENTS, FragmentProgram};
use crate::device::targets;
use crate::{Effort, Machine, Report, report};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// A scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// View size in pixels.
    pub size: [u32; 2],
    /// Warped views in a batch.
    pub batch: usize,
    /// Samples used for each warped view.
    pub samples: usize,
    /// Side in pixels of the image whose coherent rays are timed.
    pub rays_side: u32,
    /// Number of incoherent rays of the CPU's tracers.
    pub scattered_rays: usize,
    /// Number of incoherent rays of the device's tracer.
    pub device_rays: usize,
    /// Sizes in bytes of the buffers for scattered atomics.
    pub buffers: Vec<u64>,
    /// Target duration of a dispatch of atomics, in milliseconds.
    pub dispatch_ms: f64,
    /// Sizes in bytes of the readbacks.
    pub readbacks: Vec<u64>,
    /// Measured rounds; each figure is their median.
    pub rounds: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            scene: "terrain:500000".to_owned(),
            size: [200, 150],
            batch: 64,
            samples: 4,
            rays_side: 1024,
            scattered_rays: 1 << 20,
            device_rays: 1 << 22,
            // Within and beyond the caches of a data-centre GPU.
            buffers: vec![15_000_000, 4_000_000_000],
            dispatch_ms: 50.0,
            // A view of 128², one of 200×150, and a batch of large ones, at four bytes per pixel.
            readbacks: vec![65_536, 120_000, 64 << 20],
            rounds: 5,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self {
            scene: "terrain:20000".to_owned(),
            size: [96, 72],
            batch: 4,
            samples: 2,
            rays_side: 128,
            scattered_rays: 1 << 14,
            device_rays: 1 << 16,
            dispatch_ms: 2.0,
            rounds: 1,
            ..Self::default()
        }
    }
}

/// One row. `figure` is `None` if it could not be measured; `note` then gives the reason.
#[derive(Debug, Clone, PartialEq)]
struct Measure {
    measure: String,
    variant: String,
    figure: Option<f64>,
    unit: &'static str,
    note: String,
}

impl Measure {
    fn new(measure: impl Into<String>, variant: impl Into<String>, figure: f64, unit: &'static str) -> Self {
        let figure = figure.is_finite().then_some(figure);
        Self { measure: measure.into(), variant: variant.into(), figure, unit, note: String::new() }
    }

    /// A figure that could not be measured, with the reason.
    fn absent(
        measure: impl Into<String>,
        variant: impl Into<String>,
        unit: &'static str,
        why: String,
    ) -> Self {
        Self { note: why, ..Self::new(measure, variant, f64::NAN, unit) }
    }

    fn noting(self, note: impl Into<String>) -> Self {
        Self { note: note.into(), ..self }
    }

    fn row(&self) -> Map<String, Value> {
        let mut row = report::row(json!({
            "measure": self.measure, "variant": self.variant, "figure": self.figure, "unit": self.unit,
            "target": null, "ratio": null, "note": self.note,
        }));
        if let Some(target) = targets::of("parts", &row) {
            row.insert("target".to_owned(), json!(target.bound.text()));
            let ratio = self.figure.and_then(|figure| target.bound.ratio(figure));
            row.insert("ratio".to_owned(), json!(ratio));
        }
        row
    }
}

/// Runs the study; `progress` counts its parts.
///
/// # Errors
/// A scene that cannot be opened, no GPU, or a render that fails.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length(PARTS.len() as u64);
    let mut rows = Vec::new();
    for (name, part) in PARTS {
        progress.set_message(name);
        rows.extend(part(&gpu, options)?.iter().map(Measure::row));
        progress.inc(1);
    }
    let mut report = Report::new(options.scene.clone(), Machine::here(gpu.kind()), rows);
    report.notes = vec![
        "ratio: how many times over the target is met, for a data-centre GPU of the H100's class.".to_owned(),
        "Times of programs are device times where it has timestamps; times of readbacks and encoders are wall times.".to_owned(),
    ];
    report.note_longest_pass(&gpu);
    Ok(report)
}

/// A part of the study.
type Part = fn(&Arc<Gpu>, &Options) -> Result<Vec<Measure>>;

/// The parts, the most valuable first.
const PARTS: [(&str, Part); 4] = [
    ("atomics", atomics::measure),
    ("programs", programs::measure),
    ("rays", rays::measure),
    ("readback and encoding", transfer::measure),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_row_with_a_target_has_a_ratio() {
        let [measure, variant] = targets::WARP;
        let row = Measure::new(measure, variant, 30.0, "µs").row();
        assert_eq!((row["target"].as_str(), row["ratio"].as_f64()), (Some("≤ 15"), Some(0.5)));
        let row = Measure::new(measure, "another", 30.0, "µs").row();
        assert!(row["target"].is_null() && row["ratio"].is_null());
    }

    #[test]
    fn a_figure_that_could_not_be_measured_has_a_reason_and_no_ratio() {
        let [measure, variant] = targets::SCATTERED_RAYS;
        let row = Measure::absent(measure, variant, "M/s", "there is none".to_owned()).row();
        assert!(row["figure"].is_null() && row["ratio"].is_null());
        assert_eq!((row["target"].as_str(), row["note"].as_str()), (Some("≥ 1000"), Some("there is none")));
    }

    #[test]
    fn the_default_options_measure_the_targets_figures() {
        let options = Options::default();
        assert_eq!(
            programs::names(&options),
            [targets::WARP, targets::SEEN].map(|pair| pair.map(str::to_owned))
        );
        let quick = programs::names(&Options::quick());
        assert!(quick.iter().all(|[measure, variant]| {
            targets::of("parts", &Measure::new(measure.clone(), variant.clone(), 1.0, "µs").row()).is_none()
        }));
    }
}
