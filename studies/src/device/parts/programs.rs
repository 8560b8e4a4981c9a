//! Times programs that have both a fragment and a compute backend.

use std::sync::Arc;

use anyhow::Result;
use argus_compositor::{CompositorSettings, GpuCompositor, SearchBackend};
use argus_gpu::Gpu;
use argus_sampler::SamplerSettings;
use argus_scene::{
    Camera, Frame, Outputs, Plan, RenderError, RigSettings, Search, ViewJob, Visibility, Warp,
};

use super::measure::Measure;
use super::options::Options;
use crate::bench::{Bench, device_ms};
use crate::median::median;

pub(super) fn measure(gpu: &Arc<Gpu>, options: &Options) -> Result<Vec<Measure>> {
    let mut bench = Bench::new(gpu, &options.scene, &RigSettings::default(), SamplerSettings::default())?;
    let mut rows = Vec::new();
    for search in Search::ALL {
        rows.extend(warps(gpu, &mut bench, options, search)?);
    }
    rows.extend(triangles(&mut bench, options)?);
    Ok(rows)
}

/// Measure and variant of the rows for the best of several backends.
pub(super) fn names(options: &Options) -> [[String; 2]; 2] {
    let [width, height] = options.size;
    let triangles = options.scene.split_once(':').map_or(options.scene.as_str(), |(_, count)| count);
    [
        [warp_name(Search::Splat), format!("best program, {width}x{height}, {} views", options.batch)],
        [format!("triangles seen, {triangles}"), format!("best backend, {width}x{height}")],
    ]
}

fn warp_name(search: Search) -> String {
    format!("warp, {}", search.name())
}

/// Microseconds per view of a search: by each of its programs, and by the faster one.
fn warps(gpu: &Arc<Gpu>, bench: &mut Bench, options: &Options, search: Search) -> Result<Vec<Measure>> {
    let cameras = bench.walk(options.batch);
    let ids = bench.all_ids(&cameras, options.samples);
    let jobs: Vec<ViewJob> = cameras.iter().map(|camera| warp_job(bench, camera, options, search)).collect();
    let [_, best] = &names(options)[0];
    let variant = |program: &str| best.replace("best program", program);
    let mut rows: Vec<Measure> = Vec::new();
    for (program, search_backend) in
        [("fragment", SearchBackend::Fragment), ("compute", SearchBackend::Compute)]
    {
        replace_compositor(gpu, bench, search_backend)?;
        bench.hold(&ids)?;
        let times = timed(options.rounds, || Ok(device_ms(&bench.time(&jobs)?.1)))?;
        rows.push(Measure::new(warp_name(search), variant(program), median(&times) * 1e3, "µs"));
    }
    replace_compositor(gpu, bench, SearchBackend::Auto)?;
    bench.hold(&ids)?;
    let kept = format!("kept by default: {}", bench.decide_program(&jobs)?);
    rows.extend(best_of(&rows, &warp_name(search), &variant("best program"), &kept));
    Ok(rows)
}

fn replace_compositor(
    gpu: &Arc<Gpu>,
    bench: &mut Bench,
    search_backend: SearchBackend,
) -> Result<(), RenderError> {
    let settings = CompositorSettings { search_backend, ..CompositorSettings::default() };
    bench.compositor = GpuCompositor::with_settings(Arc::clone(gpu), settings)?;
    Ok(())
}

fn warp_job(bench: &Bench, camera: &Camera, options: &Options, search: Search) -> ViewJob {
    let plan = Plan::Warp(Warp {
        search,
        steps: search.usual_steps(),
        samples: bench.sample_ids(camera, options.samples),
        ..Warp::default()
    });
    bench.job(*camera, options.size, Outputs::COLOR, plan)
}

/// Microseconds of the visibility passes by each backend of the device and by the fastest, and of shading.
fn triangles(bench: &mut Bench, options: &Options) -> Result<Vec<Measure>> {
    let [_, [name, best]] = names(options);
    let variant = |backend: &str| best.replace("best backend", backend);
    let camera = bench.suggested()[0];
    let mut rows = Vec::new();
    let mut shading = Vec::new();
    for backend in Visibility::ALL {
        // Tests whether the device has the backend, and builds its tracer.
        match bench.sampler.identify(&camera, options.size, 1, backend) {
            Ok(_) => {}
            Err(RenderError::Invalid(why)) => {
                rows.push(Measure::absent(&name, variant(backend.name()), "µs", why.to_string()));
                continue;
            }
            Err(error) => return Err(error.into()),
        }
        bench.set_visibility(backend);
        let job = bench.job(camera, options.size, Outputs::COLOR, Plan::direct(1));
        let mut frames: Vec<Frame> = Vec::new();
        for round in 0..=options.rounds {
            let (_, rendered) = bench.time(std::slice::from_ref(&job))?;
            frames.extend(rendered.into_iter().filter(|_| round > 0));
        }
        let sum = |of: fn(&str) -> bool| -> Vec<f64> {
            let frame = |frame: &Frame| {
                frame.stages.iter().filter(|stage| of(&stage.name)).map(|stage| stage.ms).sum::<f64>()
            };
            frames.iter().map(frame).collect()
        };
        let seen = Measure::new(&name, variant(backend.name()), median(&sum(finds_triangles)) * 1e3, "µs");
        rows.push(match backend {
            Visibility::Cpu => seen.noting("all cores, without the upload of visibility"),
            _ => seen,
        });
        shading.extend(sum(|stage| stage.starts_with("shade")));
    }
    let kept = "`--visibility auto` measures which one runs";
    rows.extend(best_of(&rows, &name, &variant("best backend"), kept));
    let [width, height] = options.size;
    rows.push(
        Measure::new("shade", format!("compute, {width}x{height}"), median(&shading) * 1e3, "µs")
            .noting("compute only: there is no fragment program"),
    );
    Ok(rows)
}

/// Whether a stage is a visibility pass of a direct view.
fn finds_triangles(stage: &str) -> bool {
    ["rasterise", "trace", "trace cut-outs", "trace on the CPU"].contains(&stage)
}

/// The fastest row, under another name.
fn best_of(rows: &[Measure], name: &str, variant: &str, kept: &str) -> Option<Measure> {
    let timed = rows.iter().filter_map(|row| Some((row, row.figure.filter(|&figure| figure > 0.0)?)));
    let (best, figure) = timed.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let which = best.variant.split(',').next().unwrap_or_default();
    Some(Measure::new(name, variant, figure, best.unit).noting(format!("{which}; {kept}")))
}

/// The results of `rounds` rounds, after one warm-up round.
fn timed(rounds: usize, mut round: impl FnMut() -> Result<f64>) -> Result<Vec<f64>> {
    round()?;
    (0..rounds).map(|_| round()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_backend_is_the_fastest_timed_one() {
        let row = |variant: &str, figure| Measure::new("m", variant, figure, "µs");
        let rows =
            [row("fragment, x", 3.0), row("compute, x", 2.0), row("cpu, x", f64::NAN), row("odd, x", 0.0)];
        let best = best_of(&rows, "m", "best, x", "kept").map(|best| (best.figure, best.note));
        assert_eq!(best, Some((Some(2.0), "compute; kept".to_owned())));
        assert_eq!(best_of(&rows[2..], "m", "best", "kept"), None);
    }

    #[test]
    fn visibility_passes_are_told_from_shading_passes() {
        assert!(finds_triangles("rasterise") && finds_triangles("trace cut-outs"));
        assert!(!finds_triangles("shade view") && !finds_triangles("trace rays"));
    }
}
