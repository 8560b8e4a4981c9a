//! Service: the time to the first view, latency under an open load, and image error, by default and with each
//! method forced.
//!
//! Each mode runs on a new cluster, in two phases. In the *cold* phase clients send as soon as the service has an
//! address. The same walk then warms the service up; it may settle; the *warm* phase repeats the walk. The time at
//! which each view is due is fixed beforehand, and its latency counts from then.
//!
//! Some views of each phase are judged as they came under load. Their references, direct views of 16 samples per
//! pixel, are rendered after the loads. Afterwards some views are requested one at a time, by default and with each
//! method forced, to measure the planner's regret. Optionally, loads beyond the capacity of direct views follow.

mod mode;
mod options;
mod overload;
mod phase;
mod predictions;
mod regret;
mod row;
mod truth;
mod walk;
mod watch;

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, Result};
use argus_client::RenderOptions;
use argus_local::{LocalCluster, settle};
use argus_scene::View;
use indicatif::ProgressBar;

pub use self::mode::Mode;
pub use self::options::Options;
pub use self::walk::Walk;

use self::mode::Phase;
use self::phase::{DEADLINE, FIRST_DEADLINE, Load, connect, of_phase};
use self::row::{Measured, plot, row};
use self::truth::Truths;
use crate::{Machine, Report};

/// The phases of every mode, without overloads.
const PHASES: [Phase; 2] = [Phase::Cold, Phase::Warm];

/// Runs the study with clusters of the program `argus`; `progress` counts phases.
///
/// # Errors
/// A cluster that does not start or that ends, options without load, or a reference that is not rendered. Views that fail
/// under load are counted, and are not an error.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    let runs = options.runs.max(1);
    let phases = PHASES.len() + if options.overload { 2 } else { 0 };
    let modes = match options.modes.is_empty() {
        true => Mode::ALL.to_vec(),
        false => options.modes.clone(),
    };
    progress.set_length((runs * modes.len() * phases) as u64);
    let (mut truths, mut measured, mut device) = (Truths::default(), Vec::new(), String::new());
    if !options.empty_caches {
        progress.set_message("filling caches");
        fill_caches(argus, options, &modes).await.context("filling caches")?;
    }
    for run in 0..runs {
        for turn in 0..modes.len() {
            // Modes take turns to be first, so that none always profits from the one before it.
            let mode = modes[(run + turn) % modes.len()];
            let outcome = of_mode(argus, options, mode, &mut truths, progress).await;
            let (used, phases) = outcome.with_context(|| format!("mode {}", mode.name()))?;
            device = used;
            measured.extend(PHASES.into_iter().zip(phases).map(|(phase, of)| (mode, phase, of)));
        }
        if options.overload {
            measured.extend(overload::run(argus, options, &mut truths, progress).await.context("overload")?);
        }
    }
    let rows = Mode::ALL.into_iter().flat_map(|mode| Phase::ALL.map(|phase| (mode, phase)));
    let rows = rows.filter_map(|(mode, phase)| {
        let of = measured.iter().filter(|(m, p, _)| (*m, *p) == (mode, phase));
        let of: Vec<&Measured> = of.map(|(.., measured)| measured).collect();
        (!of.is_empty()).then(|| row(mode, phase, &of))
    });
    let mut report = Report::new(options.scene.clone(), Machine::here(&device), rows.collect());
    report.notes = notes(options, &measured);
    report.plots = vec![plot(&measured, &options.scene)];
    Ok(report)
}

/// Renders a view of each mode on a cluster that is not measured. The driver's cache then holds all programs, whose
/// compilation takes seconds.
async fn fill_caches(argus: &Path, options: &Options, modes: &[Mode]) -> Result<()> {
    let cluster = LocalCluster::start(argus, &options.scene, options.workers, &options.serve)?;
    let client = connect(&cluster, options).await?;
    let ([width, height], description) = (options.size, client.description());
    for mode in modes {
        let (camera, plan) = (options.walk.camera(description, 0, 0.0), mode.plan());
        let view = View::new(camera, [width, height], plan);
        let patience = RenderOptions { deadline: FIRST_DEADLINE, ..RenderOptions::default() };
        // A failed view leaves the caches as they are, which the figures will show.
        drop(client.render(&view, &patience).await);
    }
    drop(client);
    cluster.stop()
}

/// Both phases of a mode on its own cluster, and the workers' device.
async fn of_mode(
    argus: &Path,
    options: &Options,
    mode: Mode,
    truths: &mut Truths,
    progress: &ProgressBar,
) -> Result<(String, [Measured; 2])> {
    let say = |phase: &'static str| progress.set_message(format!("{}: {phase}", mode.name()));
    say("cold");
    let caches = tempfile::tempdir()?;
    let (scene, workers, serve) = (&options.scene, options.workers, &options.serve);
    let cluster = match options.empty_caches {
        true => LocalCluster::with_caches(argus, scene, workers, serve, caches.path())?,
        false => LocalCluster::start(argus, scene, workers, serve)?,
    };
    let client = connect(&cluster, options).await?;
    let (mut cold, cold_views) = of_phase(&client, options, mode, Load::of(options)).await?;
    progress.inc(1);

    say("warming up");
    let patience = Duration::try_from_secs_f64(options.settle_secs)?;
    settle(&client, options.workers, patience).await?;
    let (_, between) = of_phase(&client, options, mode, Load::of(options)).await?;
    // If every view of the cold phase failed, the first frame came during the warm-up.
    let first = cold_views.first.or(between.first);
    cold.first_view_ms = first.map(|at| (at - cluster.started()).as_secs_f64() * 1e3);
    let settled = settle(&client, options.workers, patience).await?;
    say("warm");
    let (mut warm, warm_views) = of_phase(&client, options, mode, Load::of(options)).await?;
    warm.settled = Some(settled);
    progress.inc(1);

    say("references");
    cold.errors = truths.judge(&client, &cold_views.judged).await?;
    warm.errors = truths.judge(&client, &warm_views.judged).await?;
    if mode == Mode::Default && options.regret_views > 0 {
        say("each method alone");
        warm.regret = regret::measure(&client, options, truths).await?;
    }
    let device = client.status().await?.workers.first().map(|w| w.device.clone()).unwrap_or_default();
    drop(client);
    cluster.stop()?;
    Ok((device, [cold, warm]))
}

fn notes(options: &Options, measured: &[(Mode, Phase, Measured)]) -> Vec<String> {
    let Options { clients, rate, size: [width, height], seconds, workers, .. } = options;
    let mut notes = vec![format!(
        "{clients} clients, {rate} views a second each, {width}×{height} pixels, walk `{}`, {seconds} s a phase, {workers} \
        workers, {} run(s). A view without a frame after {} s has failed and counts with that time in p50 and p99. \
        {}",
        options.walk.name(),
        options.runs.max(1),
        DEADLINE.as_secs(),
        match options.empty_caches {
            true => "Clusters start with empty caches: drivers compile every program anew.",
            false => "Compiled programs stay in the driver's cache between starts.",
        }
    )];
    let mut said = BTreeSet::new();
    for (mode, phase, of) in measured {
        let name = format!("{}, {}", mode.name(), phase.name());
        if let Some(error) = of.first_error.as_ref().filter(|_| said.insert(name.clone())) {
            notes.push(format!("{name}: the first failed view: {error}."));
        }
    }
    if options.overload {
        let carried = measured.iter().find_map(|(_, phase, of)| {
            of.offered_per_sec.filter(|_| *phase == Phase::Twice).map(|offered| offered / 2.0)
        });
        notes.push(format!(
            "Overload: the capacity for direct views is {:.1} views a second. share_of_peak: views a second, over the most that \
            a forced method answers in either overload with frames within bound or as good.",
            carried.unwrap_or(0.0)
        ));
    }
    notes.push(
        "time_predicted: share of planned frames whose queueing and rendering took the predicted time within 30% or 5 ms. \
        error_bounded, error_ratio: for judged frames from samples, the share whose mean FLIP is at most the predicted one \
        (the direct view's plus the predicted excess), and the median of predicted over true FLIP. regret: queueing and \
        rendering time over that of the best method within bound, minus 1, view by view. planning_us: microseconds per \
        view in which the coordinator chose method and worker. speed_up: the time that views would have taken from \
        triangles over the time that they took."
            .to_owned(),
    );
    if measured.iter().any(|(.., of)| of.settled == Some(false)) {
        let secs = options.settle_secs;
        notes.push(format!(
            "settled below 1: after {secs} s, samples were still being rendered or work was queued."
        ));
    }
    notes
}
