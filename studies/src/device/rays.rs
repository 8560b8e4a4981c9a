//! Rays: the speed of the tracers of the CPU and of the device on the rays that light needs.
//!
//! For each scene it traces primary rays, shadow rays to the sun and to a point light, sky rays and bounces from the points
//! that some views see, on one thread and on all. Tracers: eight-wide trees with one ray at a time (`wide`), packets with a
//! common origin (`packets`), f64 single rays through the binary tree (`single`), and one ray an invocation of the device
//! (`device`), where there is one.

use std::sync::Arc;

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::{RayCost, RayWork, device_ray_costs, ray_costs};
use argus_scene::{Camera, path};
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use crate::median::median;
use crate::{Effort, Machine, Report};

/// What the study measures.
#[derive(Debug, Clone)]
pub struct Options {
    /// Scenes, as [`argus_scene::open`] takes them.
    pub scenes: Vec<String>,
    /// View size in pixels.
    pub size: [u32; 2],
    /// Viewpoints whose visible points rays start from.
    pub views: usize,
    /// Measured rounds; each time is their median.
    pub rounds: usize,
}

impl Default for Options {
    /// Takes half a minute for each scene.
    fn default() -> Self {
        Self { scenes: vec!["terrain:500000".to_owned()], size: [400, 300], views: 4, rounds: 5 }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self { scenes: vec!["terrain:20000".to_owned()], size: [64, 48], views: 2, rounds: 1 }
    }
}

/// Runs the study; `progress` counts scenes.
///
/// # Errors
/// A scene that cannot be opened, or that is too large.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    progress.set_length(options.scenes.len() as u64);
    let mut rows = Vec::new();
    let mut notes = vec![
        "hit_fraction: `packets` and `single` pass through backs of single-sided triangles; `wide` and `device` do not. Sun, \
         point and sky rays end at any hit in `wide` and `device`, and at the nearest in the others."
            .to_owned(),
        "Rates of `device` are of the device's clock, where it has one; its threads are 0.".to_owned(),
    ];
    let gpu = Gpu::new(&GpuOptions::default())
        .inspect_err(|why| notes.push(format!("`device` has no rows: {why}")))
        .ok();
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        let scene = Arc::new(argus_scene::open(spec)?);
        let suggested: Vec<Camera> = match scene.cameras.as_slice() {
            [] => vec![scene.default_camera()],
            cameras => cameras.iter().map(|named| named.camera).collect(),
        };
        let work = RayWork {
            cameras: path::viewpoints(&suggested, options.views),
            size: options.size,
            rounds: options.rounds,
        };
        let (costs, build_ms, bytes) = ray_costs(&scene, &work)?;
        rows.extend(costs.iter().map(|cost| row(spec, cost)));
        if let Some(gpu) = &gpu {
            rows.extend(device_ray_costs(gpu, &scene, &work)?.iter().map(|cost| row(spec, cost)));
        }
        notes.push(format!(
            "{spec}: {} triangles; the wide trees took {build_ms:.0} ms to build from the binary ones, and {:.1} MiB.",
            scene.triangles(),
            bytes as f64 / f64::from(1 << 20)
        ));
        progress.inc(1);
    }
    let mut report = Report::new(
        options.scenes.join(" "),
        Machine::here(gpu.as_ref().map_or("none", |gpu| gpu.kind())),
        rows,
    );
    report.notes = notes;
    Ok(report)
}

fn row(spec: &str, cost: &RayCost) -> Map<String, Value> {
    let millions_per_sec = cost.rays as f64 / median(&cost.secs) * 1e-6;
    let columns = [
        ("scene", json!(spec)),
        ("rays", json!(cost.kind.name())),
        ("tracer", json!(cost.tracer.name())),
        ("threads", json!(cost.threads)),
        ("millions_per_sec", json!(millions_per_sec)),
        ("hit_fraction", json!(cost.hit_fraction)),
        ("count", json!(cost.rays)),
    ];
    columns.map(|(name, value)| (name.to_owned(), value)).into_iter().collect()
}
