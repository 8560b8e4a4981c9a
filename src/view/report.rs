//! What `argus view` reports of a view.

use std::collections::BTreeMap;
use std::path::Path;

use argus_scene::frame::Decision;
use argus_scene::{
    Camera, Frame, FrameDigest, FrameSource, Holes, LightLevel, Plan, Prediction, SceneHash, Served,
    Specification, Stage, View,
};
use serde::Serialize;

use crate::args;

/// A view that was rendered.
pub(super) struct Taken {
    pub(super) view: View,
    pub(super) frame: Frame,
    /// The scene's name and hash.
    pub(super) scene: (String, SceneHash),
    /// Scene seconds from one epoch to the next.
    pub(super) epoch_secs: f64,
    /// The worker's name; empty without a service.
    pub(super) worker: String,
    /// Times before the view was rendered, where this process started for it.
    pub(super) start: Vec<Stage>,
    /// Milliseconds that the frame spent within the service.
    pub(super) age_ms: f64,
    pub(super) total_ms: f64,
    pub(super) attempts: u32,
}

/// The report of a view.
#[derive(Serialize)]
pub(super) struct Report {
    width: u32,
    height: u32,
    camera: Camera,
    epoch: u64,
    /// How much of the set's light is shown: direct, coarse or full.
    light: LightLevel,
    /// The search's name, or `direct`.
    search: &'static str,
    /// Samples of a reconstructed view, or the direct frames that it was warped from.
    samples: Vec<String>,
    /// Samples a pixel of a direct view, sub-pixels a pixel of a reconstructed one.
    samples_per_pixel: u32,
    unresolved_fraction: f64,
    /// Pixels by how they were served; all 0 for a direct view.
    served: Served,
    /// `mark` or `trace`; absent for a direct view.
    holes: Option<Holes>,
    /// Why the service chose the plan, with its prediction; absent if the arguments name the plan.
    decision: Option<Decision>,
    /// The service's prediction: an upper bound of the mean FLIP error, and milliseconds of rendering.
    predicted: Option<Prediction>,
    /// Milliseconds of rendering, including frames that were rejected because they missed the bound.
    measured_ms: f64,
    /// Mean FLIP against the reference, with --verify.
    pub(super) true_error: Option<f64>,
    /// The worker's name; empty without a service.
    worker: String,
    device: String,
    /// How the samples were rendered, or the view itself where it comes from triangles.
    specification: Option<Specification>,
    /// BLAKE3 of the specification, hexadecimal.
    specification_hash: Option<String>,
    /// BLAKE3 of the images in the order of their outputs, each in its raw layout, hexadecimal.
    digest: FrameDigest,
    stages_ms: BTreeMap<String, f64>,
    /// Milliseconds that the frame spent within the service.
    age_ms: f64,
    /// Milliseconds from the request to the whole frame, measured by this client; without a service, from the start.
    total_ms: f64,
    attempts: u32,
}

impl Report {
    pub(super) fn of(taken: &Taken) -> Self {
        let Taken { view, frame, worker, start, age_ms, total_ms, attempts, .. } = taken;
        let (search, samples, samples_per_pixel) = match &frame.provenance.plan {
            Plan::Direct { samples_per_pixel, .. } => ("direct", Vec::new(), *samples_per_pixel),
            Plan::Warp(warp) => {
                let frames = warp.frames.iter().map(FrameSource::id);
                let samples = warp.samples.iter().copied().chain(frames).map(|id| id.to_string()).collect();
                (warp.search.name(), samples, warp.supersampling.pow(2))
            }
        };
        let holes = match &frame.provenance.plan {
            Plan::Direct { .. } => None,
            Plan::Warp(warp) => Some(warp.holes),
        };
        let mut stages_ms = BTreeMap::new();
        for stage in start.iter().chain(&frame.stages) {
            // The times of a pass that ran more than once are added.
            *stages_ms.entry(stage.name.clone()).or_default() += stage.ms;
        }
        Self {
            width: frame.width,
            height: frame.height,
            camera: view.camera,
            epoch: frame.provenance.state.epoch,
            light: frame.provenance.state.light,
            search,
            samples,
            samples_per_pixel,
            unresolved_fraction: frame.unresolved_fraction,
            served: frame.served,
            holes,
            decision: frame.decision,
            predicted: frame.predicted,
            measured_ms: frame.rendering_ms(),
            true_error: None,
            worker: worker.clone(),
            device: frame.provenance.device.clone(),
            specification: frame.provenance.specification,
            specification_hash: frame
                .provenance
                .specification
                .map(|specification| specification.hash().to_string()),
            digest: frame.images.digest(),
            stages_ms,
            age_ms: *age_ms,
            total_ms: *total_ms,
            attempts: *attempts,
        }
    }

    /// Prints the report of a view that was written to a file, and whether it misses a bound on its error.
    pub(super) fn print(&self, out: &Path, max_error: Option<f64>) {
        println!("{}: {}x{}, {}", out.display(), self.width, self.height, self.search);
        println!("  camera      {}", args::flags_of(&self.camera));
        if self.worker.is_empty() {
            println!("  light       {}, without a service", self.light);
        } else {
            println!("  worker      {}, from {} samples", self.worker, self.samples.len());
        }
        if let Some(decision) = self.decision {
            println!("  because     {}", decision.reason.phrase());
        }
        println!("  unresolved  {:.3}% of the pixels", self.unresolved_fraction * 100.0);
        if let Some(Prediction { error, ms }) = self.predicted {
            println!("  predicted   an error of at most {error:.4}, {ms:.1} ms of rendering");
            if let Some(bound) = max_error.filter(|bound| error > *bound) {
                println!("  bound       of {bound} is missed");
            }
        }
        if let Some(error) = self.true_error {
            println!("  true error  {error:.4} (mean FLIP against the reference)");
        }
        println!("  rendering   {:.1} ms", self.measured_ms);
        match self.worker.is_empty() {
            true => println!("  took        {:.1} ms, from the start", self.total_ms),
            false => {
                println!(
                    "  took        {:.1} ms, {:.1} ms of them within the service",
                    self.total_ms, self.age_ms
                );
            }
        }
        for (name, ms) in &self.stages_ms {
            println!("    {ms:9.3} ms  {name}");
        }
    }
}
