//! Device: the speed of a device's parts, namely atomics, rays, programs with two backends, readback and encoding. Rows
//! with a target show it beside the figure.

mod atomics;
mod backends;
mod measure;
mod options;
mod programs;
mod rays;
mod transfer;

use std::sync::Arc;

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use indicatif::ProgressBar;

pub use self::backends::{FRAGMENTS, FragmentProgram};
use self::measure::Measure;
pub use self::options::Options;
use crate::{Machine, Report};

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
    use crate::arguments::options;
    use crate::device::targets;

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
        assert_eq!(
            programs::names(&options(false)),
            [targets::WARP, targets::SEEN].map(|pair| pair.map(str::to_owned))
        );
        let quick = programs::names(&options(true));
        assert!(quick.iter().all(|[measure, variant]| {
            targets::of("parts", &Measure::new(measure.clone(), variant.clone(), 1.0, "µs").row()).is_none()
        }));
    }
}
