//! What light cells of a first viewer save others: one beside, one a metre aside, and one who walks.

use anyhow::Result;
use argus_sampler::GpuSampler;
use argus_scene::{Sampler as _, ViewJob};
use glam::DVec3;
use serde_json::{Value, json};

use super::timed::timed;
use crate::median::mean;

/// Metres to the right of a viewer who stands beside the first one, and of one who stands aside.
const BESIDE: f64 = 0.05;
const ASIDE: f64 = 1.0;
/// Metres of a walk from one frame to the next: 17 cm are 5 m/s at 30 frames a second. And its frames.
const STEP: f64 = 0.17;
const STEPS: usize = 6;

/// Views of some viewers, in the order in which they were rendered.
pub(super) struct CellsFound {
    first: Found,
    beside: Found,
    aside: Found,
    walk: Found,
    /// Share of the pixels that cells do not describe, so that rays light them.
    bypass: f64,
}

/// Mean seconds of some views, and mean number of cells that each filled.
#[derive(Clone, Copy)]
struct Found {
    view_s: f64,
    filled: f64,
}

impl CellsFound {
    /// Renders views, which fill cells, and those of other viewers after them.
    ///
    /// # Errors
    /// A render that fails.
    pub(super) fn measure(sampler: &mut GpuSampler, views: &[ViewJob]) -> Result<Self> {
        let to_the_right =
            |metres: f64| views.iter().map(|job| moved(job, right(job) * metres)).collect::<Vec<_>>();
        let walk = (1..=STEPS).flat_map(|step| {
            let forward = move |job: &ViewJob| (job.camera.target - job.camera.eye).normalize_or_zero();
            views.iter().map(move |job| moved(job, forward(job) * (STEP * step as f64)))
        });
        let pixels = |sampler: &GpuSampler| {
            let report = sampler.light_cells().unwrap_or_default();
            [report.pixels, report.pixels_lit].map(|pixels| pixels as f64)
        };
        let before = pixels(sampler);
        let first = Found::of(sampler, views)?;
        let [asked, lit] = [0, 1].map(|at| pixels(sampler)[at] - before[at]);
        let bypass = 1.0 - lit / asked.max(1.0);
        Ok(Self {
            first,
            bypass,
            beside: Found::of(sampler, &to_the_right(BESIDE))?,
            aside: Found::of(sampler, &to_the_right(ASIDE))?,
            walk: Found::of(sampler, &walk.collect::<Vec<_>>())?,
        })
    }

    /// Columns of a row, by name: seconds of a view, cells that it filled as a share of those of a first view, and the share of pixels
    /// that rays light.
    pub(super) fn columns(&self) -> [(&'static str, Value); 8] {
        let share = |found: Found| json!(found.filled / self.first.filled.max(1.0));
        [
            ("first_view_s", json!(self.first.view_s)),
            ("beside_s", json!(self.beside.view_s)),
            ("beside_filled", share(self.beside)),
            ("aside_s", json!(self.aside.view_s)),
            ("aside_filled", share(self.aside)),
            ("walk_s", json!(self.walk.view_s)),
            ("walk_filled", share(self.walk)),
            ("bypass", json!(self.bypass)),
        ]
    }
}

impl Found {
    fn of(sampler: &mut GpuSampler, views: &[ViewJob]) -> Result<Self> {
        let filled = |sampler: &GpuSampler| sampler.light_cells().unwrap_or_default().filled;
        let before = filled(sampler);
        let times = views.iter().map(|job| Ok(timed(sampler, job)?.0)).collect::<Result<Vec<f64>>>()?;
        let filled = (filled(sampler) - before) as f64 / views.len().max(1) as f64;
        Ok(Self { view_s: mean(times), filled })
    }
}

/// To the right of a viewer, unit length.
fn right(job: &ViewJob) -> DVec3 {
    (job.camera.target - job.camera.eye).cross(job.camera.up).normalize_or_zero()
}

fn moved(job: &ViewJob, by: DVec3) -> ViewJob {
    let mut moved = job.clone();
    moved.camera.eye += by;
    moved.camera.target += by;
    moved
}
