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
mod overload;
mod predictions;
mod regret;
mod row;
mod truth;
mod walk;
mod watch;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use argus_client::load::{Ended, LoadOptions, run_along};
use argus_client::{Client, ClusterStatus, ConnectOptions, RenderOptions};
use argus_local::{LocalCluster, settle};
use argus_scene::{Frame, Outputs, Plan, View};
use indicatif::ProgressBar;

pub use self::mode::Mode;
pub use self::walk::Walk;

use self::mode::Phase;
use self::row::{Measured, plot, row};
use self::truth::{Judged, Truths};
use self::watch::Samples;
use crate::arguments::{count, or_quick, positive, size};
use crate::median::mean;
use crate::{Machine, Report};

/// Measures the service from its users' side: time to the first view, latency and error under an open load, cold and
/// warm; by default, and with direct or warped views forced
///
/// Each mode has a new cluster. Cold: clients send as soon as there is an address. Warm: the same walk again, after a warm-up
/// walk and time to settle. Each view's due time is fixed beforehand, and its latency counts from then; a view without a frame
/// after 30 s has failed and counts with that time. 24 views of each phase are compared with direct views of 16 samples a
/// pixel. The planner's predictions are compared with the frames: time_predicted is the share of frames within 30% or 5 ms,
/// error_bounded the share of frames from samples whose error is at most the predicted one, planning_us the coordinator's
/// microseconds a view. Takes two or three minutes a run, more if views are late.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study load service --scene sponza.glb --out figures
  argus-lab study load service --scene sponza.glb --size 640x480 --rate 10 --walk jumps --runs 5
  argus-lab study load service --scene sponza.glb --overload --regret-views 100
  argus-lab study load service --scene room.glb -- --rig cell --cell 0.5")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("320x240", "96x72"))]
    pub size: [u32; 2],
    /// Number of clients at the same time, each on its own path
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("4", "2"))]
    pub clients: u32,
    /// Views per second of each client
    #[arg(long, value_name = "R", value_parser = positive, default_value = "5")]
    pub rate: f64,
    /// How clients move: smoothly, from the recommended viewpoints through the scene or down to it (steady); to another
    /// place each second (jumps); not at all (stand)
    #[arg(long, value_name = "HOW", value_enum, hide_possible_values = true, default_value = "steady")]
    pub walk: Walk,
    /// Seconds of each phase
    #[arg(long, value_name = "T", value_parser = positive, default_value = or_quick("10", "2"))]
    pub seconds: f64,
    /// Number of worker processes
    #[arg(long, value_name = "P", value_parser = count, default_value = "2")]
    pub workers: usize,
    /// Number of repetitions; rows are their medians, and `spread` holds the minima and maxima
    #[arg(long, value_name = "N", value_parser = count, default_value = "1")]
    pub runs: usize,
    /// Views per phase whose error is measured
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64), default_value = or_quick("24", "4"))]
    pub judged: u64,
    /// Longest time in seconds for the service to settle, before the warm-up and again before the warm phase
    #[arg(long, value_name = "SECONDS", value_parser = positive, default_value = or_quick("15", "3"))]
    pub settle_secs: f64,
    /// Start each cluster with empty caches, like a machine that never ran Argus. Drivers then compile every program
    /// anew, which takes the software driver seconds. Otherwise a start that is not measured fills them first
    #[arg(long)]
    pub empty_caches: bool,
    /// Number of views to render one at a time with every method, to measure the planner's regret: the time by
    /// default over that of the best method within the error bound, minus 1. Takes up to 90 s; 0 skips it
    #[arg(long, value_name = "N", default_value = or_quick("24", "4"))]
    pub regret_views: u32,
    /// A way of requesting views; may be given more than once [default: all]
    #[arg(long = "mode", value_name = "MODE", value_enum)]
    pub modes: Vec<Mode>,
    /// Also measure two and four times the capacity for direct views, in every mode: `share_of_peak` is the rate of
    /// answered views over that of the best forced method that is as good. Takes two or three minutes more a run
    #[arg(long)]
    pub overload: bool,
    /// Further arguments of `argus serve`
    #[arg(last = true, value_name = "ARGUMENT")]
    pub serve: Vec<String>,
}

/// A view without a frame after this time has failed.
const DEADLINE: Duration = Duration::from_secs(30);
/// Deadline of a view that fills caches.
const FIRST_DEADLINE: Duration = Duration::from_secs(120);
/// Largest number of connections that all clients share.
const CONNECTIONS: u32 = 4;

/// The load of a phase.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Load {
    /// Views per second of each client.
    rate: f64,
    /// A view without a frame after this time has failed.
    deadline: Duration,
}

impl Load {
    /// The load that the options ask for.
    fn of(options: &Options) -> Self {
        Self { rate: options.rate, deadline: DEADLINE }
    }
}

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
        fill_caches(argus, options).await.context("filling caches")?;
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
async fn fill_caches(argus: &Path, options: &Options) -> Result<()> {
    let cluster = LocalCluster::start(argus, &options.scene, options.workers, &options.serve)?;
    let client = connect(&cluster, options).await?;
    let ([width, height], description) = (options.size, client.description());
    for mode in Mode::ALL {
        let (camera, plan) = (options.walk.camera(description, 0, 0.0), mode.plan());
        let view = View { camera, width, height, outputs: Outputs::COLOR, plan, pin: None };
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

/// Connects a client with as many connections as the load needs.
async fn connect(cluster: &LocalCluster, options: &Options) -> Result<Client> {
    let connections = options.clients.clamp(1, CONNECTIONS) as usize;
    let connect = ConnectOptions { connections, ..ConnectOptions::default() };
    let until = Instant::now() + FIRST_DEADLINE;
    loop {
        // On a busy machine the service may answer late; try again.
        match Client::connect_with(cluster.url(), &connect).await {
            Err(_) if Instant::now() < until => tokio::time::sleep(Duration::from_millis(20)).await,
            connected => return Ok(connected?),
        }
    }
}

/// Mean microseconds to plan a view, for views planned between two statuses.
fn planning_us(before: &ClusterStatus, after: &ClusterStatus) -> Option<f64> {
    let views = after.views_planned.checked_sub(before.views_planned).filter(|views| *views > 0)?;
    Some((after.planning_us - before.planning_us) / views as f64)
}

/// What is kept of a phase's views.
#[derive(Default)]
struct Views {
    /// When the first frame arrived.
    first: Option<Instant>,
    judged: Vec<Judged>,
}

/// Runs one load, from its first view to the last answer.
async fn of_phase(client: &Client, options: &Options, mode: Mode, load: Load) -> Result<(Measured, Views)> {
    let asked = LoadOptions {
        clients: options.clients,
        duration: Duration::try_from_secs_f64(options.seconds)?,
        rate: load.rate,
        size: options.size,
        plan: mode.plan(),
        deadline: load.deadline,
        ..LoadOptions::default()
    };
    let judged = spread_over(asked.views_per_client(), options.clients, options.judged);
    let (description, walk) = (client.description().clone(), options.walk);
    let cameras = Arc::new(move |client, secs| walk.camera(&description, client, secs));
    let (mut measured, mut views, mut unresolved) = (Measured::default(), Views::default(), Vec::new());
    let before = client.status().await?;
    let report = run_along(client, &asked, cameras, |ended: Ended| match ended.outcome {
        Ok(frame) => {
            measured.latencies_ms.push((ended.at - ended.due).as_secs_f64() * 1e3);
            *measured.methods.entry(method_of(&frame)).or_default() += 1;
            measured.timed.take(&frame);
            unresolved.push(frame.unresolved_fraction);
            let at = ended.at.into_std();
            views.first = Some(views.first.map_or(at, |first| first.min(at)));
            if judged.contains(&(ended.client, ended.index)) {
                views.judged.push(Judged { camera: ended.view.camera, frame });
            }
        }
        Err(error) => {
            // A fast rejection counts as slow as the deadline.
            measured.latencies_ms.push(load.deadline.as_secs_f64() * 1e3);
            measured.first_error.get_or_insert_with(|| error.to_string());
        }
    });
    let report = report.await?;
    measured.latencies_ms.sort_by(f64::total_cmp);
    (measured.sent, measured.answered, measured.rejected) = (report.sent, report.answered, report.rejected);
    measured.views_per_sec = report.views_per_sec;
    measured.unresolved = (!unresolved.is_empty()).then(|| mean(unresolved));
    let after = client.status().await?;
    measured.planning_us = planning_us(&before, &after);
    measured.error_factor = (measured.timed.share().is_some()).then_some(after.error_factor);
    measured.samples = Samples::of(client).await?;
    Ok((measured, views))
}

/// How a frame was made: one of [`row::METHODS`].
fn method_of(frame: &Frame) -> &'static str {
    let [direct, warp, traced] = row::METHODS;
    match frame.provenance.plan {
        Plan::Direct { .. } => direct,
        Plan::Warp(_) if frame.served.traced > 0 => traced,
        Plan::Warp(_) => warp,
    }
}

/// Picks `count` views to judge, as (client, index), evenly spread over time and clients.
fn spread_over(views: u64, clients: u32, count: u64) -> BTreeSet<(u32, u64)> {
    let count = count.min(views.saturating_mul(u64::from(clients)));
    let step = (u64::from(clients) / count.max(1)).max(1);
    let at = |k: u64| {
        let client = (k * step) % u64::from(clients.max(1));
        (client as u32, ((2 * k + 1) * views / (2 * count)).min(views.saturating_sub(1)))
    };
    (0..count).map(at).collect()
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
        view in which the coordinator chose method and worker. error_factor: the factor on predicted excess, learned from \
        probes."
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn judged_views_are_spread_over_time_and_clients() {
        let judged = spread_over(40, 4, 12);
        assert_eq!(judged.len(), 12);
        for client in 0..4 {
            assert_eq!(judged.iter().filter(|(c, _)| *c == client).count(), 3, "{judged:?}");
        }
        let mut times: Vec<u64> = judged.iter().map(|(_, index)| *index).collect();
        times.sort_unstable();
        assert!(times.windows(2).all(|pair| (3..=4).contains(&(pair[1] - pair[0]))), "{times:?}");
        assert!(times[0] < 3 && times[11] > 36, "{times:?}");
    }

    #[test]
    fn with_many_clients_the_judged_clients_are_spread_too() {
        let judged = spread_over(50, 100, 10);
        let clients: Vec<u32> = judged.iter().map(|(client, _)| *client).collect();
        assert_eq!(clients, [0, 10, 20, 30, 40, 50, 60, 70, 80, 90]);
    }

    #[test]
    fn no_more_views_are_judged_than_there_are() {
        assert_eq!(spread_over(1, 1, 12), BTreeSet::from([(0, 0)]));
        assert!(spread_over(1, 3, 12).len() <= 3);
        assert!(spread_over(40, 4, 0).is_empty() && spread_over(0, 4, 12).is_empty());
        assert!(spread_over(3, 7, 12).iter().all(|(client, index)| *client < 7 && *index < 3));
    }
}
