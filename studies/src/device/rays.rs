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

use crate::arguments::{count, or_quick, size};
use crate::median::median;
use crate::{Machine, Report};

/// Measures the tracers in millions of rays a second: primary rays, shadow rays to the sun and to a point light, sky rays
/// and bounces, on one thread of the CPU, on all, and on the device
///
/// Without a device its rows are left out.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Example:
  argus-lab study device rays --scene sponza.glb --json")]
pub struct Options {
    /// Scenes with commas between, each measured by itself: a file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or
    /// `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls, `?environment=FILE` for another sky
    #[arg(long = "scene", value_name = "S", value_delimiter = ',', default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scenes: Vec<String>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("400x300", "64x48"))]
    pub size: [u32; 2],
    /// Number of viewpoints whose visible points rays start from
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("4", "2"))]
    pub views: usize,
    /// Number of measured rounds, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("5", "1"))]
    pub rounds: usize,
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
