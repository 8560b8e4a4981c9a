//! Capacity: the load that one coordinator process carries. Simulated sessions and workers talk to it over real gRPC.

mod peer;

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use argus_client::load::{burst, path_views, patient};
use argus_client::{Client, ConnectOptions, Session, SessionEvent, SessionOptions};
use argus_local::LocalCluster;
use argus_scene::{PlanRequest, View};
use futures::StreamExt as _;
use indicatif::ProgressBar;
use rand::rngs::SmallRng;
use rand::{Rng as _, RngCore as _, SeedableRng};
use serde_json::json;
use tokio::sync::watch;
use tokio::task::{AbortHandle, JoinSet};

use self::peer::PeerState;
use crate::arguments::{count, or_quick, seconds, size};
use crate::processes::{cpu_secs, most_open_files, open_files, resident_bytes};
use crate::{Machine, Report, report};

/// Measures the load that one coordinator carries, with simulated sessions and workers over real gRPC: CPU time, memory,
/// relayed frames, and the time until a lost worker's views have another worker
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Number of sessions open at the same time
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("10000", "50"))]
    pub sessions: usize,
    /// Number of connections to the coordinator that sessions share [default: one each, within the limit of open files]
    #[arg(long, value_name = "N", value_parser = count)]
    pub connections: Option<usize>,
    /// Number of simulated workers
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("1000", "20"))]
    pub workers: usize,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "200x150")]
    pub size: [u32; 2],
    /// Seconds between two camera moves of a session
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = or_quick("20", "0.5"))]
    pub camera_every: Duration,
    /// Seconds of each phase in which CPU time is measured
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = or_quick("15", "1"))]
    pub phase: Duration,
    /// Workers lost one after another, for each kind of loss
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("10", "1"))]
    pub losses: usize,
}

/// The smallest scene: nothing is rendered.
const SCENE: &str = "terrain:2000";

/// Files that each simulated worker opens in this process: its stream, the connections that carry its orders and redirect
/// tickets, and the client's end of the ticket connection.
const FILES_A_WORKER: usize = 4;

/// Further open files of this process.
const OTHER_FILES: usize = 256;

/// How long a lost view may wait for another worker before the study fails.
const PATIENCE: Duration = Duration::from_secs(20);

/// Runs the study against a coordinator of the program `argus`.
///
/// # Errors
/// The coordinator does not start, or does not answer a peer.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    progress.set_length(5);
    progress.set_message("workers join");
    // The limit must be raised before the coordinator starts, since it inherits it.
    let files = most_open_files();
    let spare = files.saturating_sub(FILES_A_WORKER * options.workers + OTHER_FILES).max(1);
    let wanted = options.connections.unwrap_or(options.sessions).max(1);
    let more = ["--refining-share=0".to_owned(), "--visibility=raster".to_owned()];
    let coordinator = LocalCluster::coordinator(argus, SCENE, &more)?;
    let pid = coordinator.pid();
    let mut pixels = vec![0; (options.size[0] * options.size[1] * 3) as usize];
    SmallRng::seed_from_u64(1).fill_bytes(&mut pixels);
    let shared = PeerState::new(pixels);
    let (port, _serving) = peer::serve(shared.clone()).await?;
    let watching = Client::connect(coordinator.url()).await?;
    let leads = async {
        while watching.status().await.is_err() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(30), leads).await.context("the coordinator does not lead")?;
    let began = Instant::now();
    let mut workers: Vec<AbortHandle> = Vec::new();
    for worker in 0..options.workers {
        let joining = peer::join(shared.clone(), coordinator.url().to_owned(), worker, port);
        workers.push(tokio::spawn(joining).abort_handle());
    }
    let ready = async {
        while watching.status().await.map_or(0, |status| status.processes as usize) < options.workers {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(120), ready)
        .await
        .context("not all workers joined in two minutes")?;
    let joined_secs = began.elapsed().as_secs_f64();
    progress.inc(1);

    progress.set_message("sessions open");
    let quiet_mb = resident_bytes(pid).unwrap_or(0) as f64 / 1e6;
    let open_before = open_files(pid).context("the coordinator is gone")?;
    let began = Instant::now();
    let connections = ConnectOptions { connections: wanted.min(spare), ..ConnectOptions::default() };
    let client = Client::connect_with(coordinator.url(), &connections).await?;
    let (moving, watched) = watch::channel(false);
    let mut sessions = open(&client, options, &shared, watched).await?;
    let opened_secs = began.elapsed().as_secs_f64();
    let connected =
        open_files(pid).context("the coordinator is gone")?.saturating_sub(open_before).min(wanted);
    // Sessions are open but idle; workers report.
    let idle_cores = cores(pid, options.phase).await?;
    progress.inc(1);

    progress.set_message("frames are fetched from workers");
    let fetching = moving_sessions(pid, &shared, &moving, options.phase).await?;
    let resident_mb = resident_bytes(pid).unwrap_or(0) as f64 / 1e6;
    // Wait until the sessions are idle again.
    tokio::time::sleep(Duration::from_secs(1)).await;
    progress.inc(1);

    progress.set_message("frames are relayed");
    let views = path_views(client.description(), 2000, options.size, PlanRequest::from_samples());
    let (before, answered, began) = (cpu_secs(pid), shared.answered.load(Ordering::Relaxed), Instant::now());
    while began.elapsed() < options.phase {
        let relayed = burst(&client, views.clone(), 256, &patient(), |_, _| ()).await;
        anyhow::ensure!(relayed.failed == 0, "a view was not answered: {:?}", relayed.first_error);
    }
    let relayed_secs = began.elapsed().as_secs_f64();
    let frames = (shared.answered.load(Ordering::Relaxed) - answered) as f64;
    let relaying =
        cpu_secs(pid).zip(before).map(|(after, before)| after - before).context("no time on a core")?;
    // Subtract the cost of the workers' reports, which continue meanwhile.
    let of_frames = (relaying - idle_cores * relayed_secs).max(1e-9);
    let busy_mb = resident_bytes(pid).unwrap_or(0) as f64 / 1e6;
    progress.inc(1);

    progress.set_message("workers are lost");
    let mut worst = [Duration::ZERO; 2];
    for (loss, worst) in [Loss::Breaks, Loss::Hangs].into_iter().zip(&mut worst) {
        for _ in 0..options.losses {
            *worst = (*worst).max(lose(&client, &shared, &mut workers, options, loss).await?);
        }
    }
    let [after_break_ms, after_hang_ms] = worst.map(|worst| worst.as_secs_f64() * 1e3);
    progress.inc(1);
    sessions.abort_all();
    while sessions.join_next().await.is_some() {}
    workers.iter().for_each(AbortHandle::abort);
    drop((client, watching));
    coordinator.stop()?;

    let bytes = f64::from(options.size[0] * options.size[1] * 3);
    let row = json!({
        "workers": options.workers,
        "sessions": options.sessions,
        "connections": connected,
        "camera_every_secs": options.camera_every.as_secs_f64(),
        "joined_secs": joined_secs,
        "opened_secs": opened_secs,
        "idle_cores": idle_cores,
        "redirected_per_sec": fetching.per_sec,
        "redirected_cores": fetching.cores,
        "redirected_per_sec_of_a_core": fetching.per_sec / (fetching.cores - idle_cores).max(1e-9),
        "resident_mb_workers": quiet_mb,
        "resident_mb": resident_mb,
        "resident_mb_relaying": busy_mb,
        "relayed_per_sec": frames / relayed_secs,
        "relayed_cores": relaying / relayed_secs,
        "relayed_per_sec_of_a_core": frames / of_frames,
        "relayed_mb_per_sec_of_a_core": frames * bytes / of_frames / 1e6,
        "us_per_frame": of_frames / frames * 1e6,
        "assigned_after_break_ms": after_break_ms,
        "assigned_after_hang_ms": after_hang_ms,
    });
    let mut report = Report::new("peers", Machine::here("none"), vec![report::row(row)]);
    report.notes.push(format!(
        "Sessions are redirected: they get tickets from the coordinator, fetch their frames from the workers, and return \
         receipts. connections: the sessions' connections to the coordinator; all sessions share one connection to each \
         worker, whose cost is not the coordinator's. idle_cores: while sessions request nothing. redirected_cores: while each \
         moves its camera every {} s, at redirected_per_sec frames a second in all. relayed_*: additional single views, \
         uncompressed and relayed undecoded, at us_per_frame each.",
        options.camera_every.as_secs_f64()
    ));
    report.notes.push(
        "assigned_after_break_ms: the longest time from the end of a worker's stream, as after a crash, until all of its \
         views were at another worker. assigned_after_hang_ms: the same from a worker's silence with its stream open, which \
         is suspected after three missing reports."
            .to_owned(),
    );
    if connected < wanted {
        report.notes.push(format!(
            "only {connected} of {wanted} connections were made: this process may open {files} files."
        ));
    }
    Ok(report)
}

/// CPU time of a process over `time`, in cores.
async fn cores(pid: u32, time: Duration) -> Result<f64> {
    let (before, began) = (cpu_secs(pid).context("the coordinator is gone")?, Instant::now());
    tokio::time::sleep(time).await;
    let after = cpu_secs(pid).context("the coordinator is gone")?;
    Ok((after - before) / began.elapsed().as_secs_f64())
}

/// The rate and CPU cost of redirected frames.
struct Fetching {
    per_sec: f64,
    cores: f64,
}

/// Moves the sessions' cameras for `time`, and measures what that costs.
async fn moving_sessions(
    pid: u32,
    shared: &PeerState,
    moving: &watch::Sender<bool>,
    time: Duration,
) -> Result<Fetching> {
    moving.send_replace(true);
    let (before, began) = (shared.redeemed.load(Ordering::Relaxed), Instant::now());
    let cores = cores(pid, time).await?;
    let redeemed = shared.redeemed.load(Ordering::Relaxed) - before;
    moving.send_replace(false);
    anyhow::ensure!(redeemed > 0, "no frame was fetched from a worker");
    Ok(Fetching { per_sec: redeemed as f64 / began.elapsed().as_secs_f64(), cores })
}

/// Opens the sessions, each with one redirected frame. Their cameras move while `moving` is true.
async fn open(
    client: &Client,
    options: &Options,
    shared: &PeerState,
    moving: watch::Receiver<bool>,
) -> Result<JoinSet<()>> {
    let view = path_views(client.description(), 1, [16, 12], PlanRequest::from_samples());
    let view = view.into_iter().next().context("a view")?;
    let opening = futures::stream::iter(0..options.sessions).map(|_| {
        let mut session = client.session(SessionOptions::default());
        session.send(&view);
        async move {
            match session.next().await? {
                SessionEvent::Frame { .. } => Ok(session),
                SessionEvent::Failed { error, .. } => Err(error),
            }
        }
    });
    let mut opened = opening.buffer_unordered(128);
    let mut sessions = JoinSet::new();
    let mut random = SmallRng::seed_from_u64(2);
    while let Some(session) = opened.next().await {
        // The cameras' first moves are spread over the interval.
        let first = options.camera_every.mul_f64(random.random());
        sessions.spawn(keep(session?, view.clone(), first, options.camera_every, moving.clone()));
    }
    let redeemed = shared.redeemed.load(Ordering::Relaxed);
    anyhow::ensure!(redeemed >= options.sessions as u64, "only {redeemed} sessions were redirected");
    Ok(sessions)
}

/// Runs one session until it ends.
async fn keep(
    mut session: Session,
    view: View,
    first: Duration,
    every: Duration,
    mut moving: watch::Receiver<bool>,
) {
    while moving.wait_for(|moving| *moving).await.is_ok() {
        tokio::time::sleep(first).await;
        let mut interval = tokio::time::interval(every);
        while *moving.borrow() {
            tokio::select! {
                _ = interval.tick() => drop(session.send(&view)),
                event = session.next() => if event.is_err() { return },
            }
        }
        // A frame still in flight holds memory at its worker.
        while !session.is_idle() {
            if session.next().await.is_err() {
                return;
            }
        }
    }
}

/// How a worker is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Loss {
    /// Its stream ends.
    Breaks,
    /// Its stream stays open, and nothing comes.
    Hangs,
}

/// Loses a worker that has views. Returns the time until all of its views have another worker.
async fn lose(
    client: &Client,
    shared: &PeerState,
    workers: &mut [AbortHandle],
    options: &Options,
    loss: Loss,
) -> Result<Duration> {
    // The worker that gets the next view stops answering.
    shared.silence_next();
    let views =
        path_views(client.description(), 2 * options.workers as u32, [16, 12], PlanRequest::from_samples());
    let asking = tokio::spawn({
        let client = client.clone();
        async move { burst(&client, views, 256, &patient(), |_, _| ()).await }
    });
    let reached = until(|| shared.silent());
    let worker = tokio::time::timeout(PATIENCE, reached).await.context("no view reaches any worker")?;
    // By now all other views are answered; the silent worker holds the open ones.
    tokio::time::sleep(Duration::from_millis(500)).await;
    let lost = Instant::now();
    match loss {
        Loss::Breaks => workers[worker].abort(),
        Loss::Hangs => shared.hang(),
    }
    let moved = until(|| shared.moved());
    let moved =
        tokio::time::timeout(PATIENCE, moved).await.context("a lost worker's views were not reassigned")?;
    let outcome = asking.await?;
    // A hung worker must not return during the next loss.
    workers[worker].abort();
    shared.end_silence();
    anyhow::ensure!(outcome.failed == 0, "a view was lost with its worker: {:?}", outcome.first_error);
    Ok(moved.saturating_duration_since(lost))
}

/// Polls until `there` returns a value.
async fn until<T>(mut there: impl FnMut() -> Option<T>) -> T {
    loop {
        if let Some(found) = there() {
            return found;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}
