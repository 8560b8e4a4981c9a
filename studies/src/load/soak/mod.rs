//! Soak: many sessions for a long time. Measures lost cameras, latencies, and each process's memory over time. With
//! chaos, workers are killed and paused meanwhile. Some frames are compared with a pinned repeat.

mod session;
mod tail;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use argus_client::load::{burst, path_views, patient};
use argus_client::{Client, ConnectOptions};
use argus_local::{LocalCluster, connect};
use argus_plot::{Axis, Plot, Series};
use argus_scene::PlanRequest;
use indicatif::ProgressBar;
use parking_lot::Mutex;
use serde_json::json;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use self::session::{PATIENCE, SessionStats};
use super::chaos::Chaos;
use crate::arguments::{count, is_quick, or_quick, positive, seconds, size};
use crate::processes::resident_bytes;
use crate::{Machine, Report, report};

/// Runs many sessions for a long time: lost frames, latencies, memory over time; with --chaos, workers are killed and
/// paused meanwhile, and frames are compared byte by byte with pinned repeats
///
/// The study starts and ends its own cluster on this machine.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Number of sessions at the same time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value = or_quick("1000", "20"))]
    pub sessions: u32,
    /// Cameras per second of all sessions together [default: 0.6 of the machine's measured capacity, 0.2 with --chaos; with
    /// --quick 20]
    #[arg(long, value_name = "N", value_parser = positive)]
    pub rate: Option<f64>,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "96x72"))]
    pub size: [u32; 2],
    /// Number of worker processes
    #[arg(long, value_name = "P", value_parser = count, default_value = "2")]
    pub workers: usize,
    /// Let sessions fetch their frames from the workers, instead of relaying them through the coordinator
    #[arg(long)]
    pub redirect: bool,
    /// Duration in minutes
    #[arg(long, value_name = "M", value_parser = positive, default_value = or_quick("10", "0.0667"))]
    pub minutes: f64,
    /// Kill and pause workers during the run
    #[arg(long)]
    pub chaos: bool,
    /// Random seed of the kills and pauses; the same seed repeats them
    #[arg(long, value_name = "N", default_value_t = 1, requires = "chaos")]
    pub seed: u64,
    /// Seconds between two kills or pauses; delayed while fewer than two workers run
    #[arg(long, value_name = "SECONDS", default_value = "2.8", value_parser = seconds, requires = "chaos")]
    pub chaos_every: Duration,
    /// Whether latencies, gaps, memory and the number of disturbances are judged; over a few seconds they are noise.
    /// Lost cameras and wrong frames are always judged.
    #[arg(skip = !is_quick())]
    pub judged: bool,
}

/// The load as a share of measured capacity. Above it, any delay makes queues grow.
pub const LOAD: f64 = 0.6;

/// The load as a share of measured capacity with chaos: one worker is away most of the time, and its restart takes
/// time from the rest.
pub const CHAOS_LOAD: f64 = 0.2;

/// Views of the burst that measures capacity, and views in flight.
const TRIAL: (u32, usize) = (400, 128);

/// Connections that all sessions share.
const CONNECTIONS: usize = 8;

/// Share of the time before memory is judged: caches fill, programs are compiled and samples are placed. Latencies
/// are judged from the start, and shown for the time after it too.
const WARM_UP: f64 = 0.25;

/// Limits: p99 over p50; swing of memory; longest gap between a session's frames with chaos; disturbances per second with
/// chaos (200 in ten minutes).
const MOST_P99_PER_P50: f64 = 3.0;
const MOST_SWING: f64 = 0.05;
const LONGEST_GAP: Duration = Duration::from_secs(3);
const DISTURBANCES_PER_SEC: f64 = 200.0 / 600.0;

/// Resident bytes of a process over time in seconds.
#[derive(Debug, Clone, Default)]
struct Memory(Vec<(f64, u64)>);

impl Memory {
    /// Largest deviation from the middle of the range after the warm-up, as a share of it; `None` without data.
    fn swing(&self, whole_secs: f64) -> Option<f64> {
        let warm =
            self.0.iter().filter(|(secs, _)| *secs >= WARM_UP * whole_secs).map(|(_, bytes)| *bytes as f64);
        let (least, most) = warm.fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
        (most > 0.0).then(|| (most - least) / (most + least))
    }
}

/// Whether each limit is kept; `None` if it is not judged.
struct Bars {
    lost: bool,
    wrong: bool,
    redirected: Option<bool>,
    p99: Option<bool>,
    memory: Option<bool>,
    gap: Option<bool>,
    disturbances: Option<bool>,
}

impl Bars {
    fn named(&self) -> [(&'static str, Option<bool>); 7] {
        let Self { lost, wrong, redirected, p99, memory, gap, disturbances } = *self;
        [
            ("bar_lost", Some(lost)),
            ("bar_wrong", Some(wrong)),
            ("bar_redirected", redirected),
            ("bar_p99", p99),
            ("bar_memory", memory),
            ("bar_gap", gap),
            ("bar_disturbances", disturbances),
        ]
    }

    fn met(&self) -> bool {
        self.named().iter().all(|(_, bar)| *bar != Some(false))
    }
}

/// Runs the study with a cluster of the program `argus`.
///
/// # Errors
/// A cluster that does not start, or that stops answering.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    progress.set_message("start");
    let redirect = options.redirect.then_some("--redirect");
    let more: Vec<String> = ["--visibility=auto"].into_iter().chain(redirect).map(str::to_owned).collect();
    let cluster = LocalCluster::start(argus, &options.scene, options.workers, &more)?;
    let first = connect(&cluster, options.workers).await?;
    let device = first.status().await?.workers.first().map(|w| w.device.clone()).unwrap_or_default();
    let rate = rate(&first, options).await?;
    let connections = ConnectOptions { connections: CONNECTIONS, ..ConnectOptions::default() };
    let client = Client::connect_with(cluster.url(), &connections).await?;

    let duration = Duration::from_secs_f64(options.minutes * 60.0);
    progress.set_length(duration.as_secs().max(1));
    let begin = Instant::now();
    let stats = Arc::new(Mutex::new(SessionStats::default()));
    let ending = CancellationToken::new();
    let mut sessions = JoinSet::new();
    let each = rate / f64::from(options.sessions);
    for index in 0..options.sessions {
        let load =
            session::SessionLoad { index, rate: each, size: options.size, phase: f64::from(index) / rate };
        sessions.spawn(session::run(client.clone(), load, stats.clone(), begin, ending.clone()));
    }
    let checking = tokio::spawn(session::check(first.clone(), stats.clone()));
    let mut chaos = options.chaos.then(|| Chaos::new(options.seed, options.chaos_every));
    let mut memory: BTreeMap<String, Memory> = BTreeMap::new();
    let pause = (duration / 100).clamp(Duration::from_millis(250), Duration::from_secs(5));
    let mut looked = Instant::now();
    while begin.elapsed() < duration {
        tokio::time::sleep(Duration::from_millis(50)).await;
        if let Some(chaos) = &mut chaos {
            chaos.run_due(&first, duration.saturating_sub(begin.elapsed())).await;
        }
        if looked.elapsed() >= pause {
            looked = Instant::now();
            remember(&mut memory, &first, cluster.pid(), begin.elapsed().as_secs_f64()).await;
            progress.set_position(begin.elapsed().as_secs());
            let said = {
                let stats = stats.lock();
                format!("{} frames, {} lost", stats.answered, stats.lost)
            };
            progress.set_message(said);
        }
    }
    let disturbed = chaos.map(Chaos::end).unwrap_or_default();
    let measured_secs = begin.elapsed().as_secs_f64();
    ending.cancel();
    let _ = tokio::time::timeout(PATIENCE + Duration::from_secs(5), async {
        while sessions.join_next().await.is_some() {}
    })
    .await;
    let unfinished = sessions.len() as u64;
    sessions.abort_all();
    checking.abort();
    let counters = first.status().await?.counts();
    drop((client, first));
    cluster.stop().or_else(|error| if options.chaos { Ok(()) } else { Err(error) })?;

    let stats = std::mem::take(&mut *stats.lock());
    let over_time = stats.latencies_ms;
    let warm_secs = WARM_UP * measured_secs;
    let [latencies, settled] =
        [0.0, warm_secs].map(|from_secs| sorted(&over_time, &(from_secs..f64::INFINITY)));
    let (p50, p99) = (quantile(&latencies, 0.5), quantile(&latencies, 0.99));
    let lost = stats.lost + unfinished;
    let swing = |of: &str| {
        let of = memory.iter().filter(|(name, _)| name.starts_with(of));
        of.filter_map(|(_, memory)| memory.swing(measured_secs)).reduce(f64::max)
    };
    let megabytes = |of: &str| {
        let of = memory.iter().filter(|(name, _)| name.starts_with(of));
        of.filter_map(|(_, memory)| memory.0.last()).map(|(_, bytes)| *bytes as f64 / 1e6).reduce(f64::max)
    };
    let worker_swing = if !options.chaos { swing("worker") } else { None };
    let most_swing = [swing("coordinator"), worker_swing].into_iter().flatten().reduce(f64::max);
    let p99_per_p50 = p50.zip(p99).map(|(p50, p99)| p99 / p50);
    let disturbances = disturbed.kills + disturbed.pauses;
    let bars = Bars {
        lost: lost == 0,
        wrong: stats.wrong == 0 && (!options.judged || stats.checked > 0),
        p99: p99_per_p50.filter(|_| options.judged && !options.chaos).map(|r| r <= MOST_P99_PER_P50),
        memory: most_swing.filter(|_| options.judged && !options.chaos).map(|s| s <= MOST_SWING),
        gap: (options.judged && options.chaos).then_some(stats.worst_gap.lasts <= LONGEST_GAP),
        disturbances: (options.judged && options.chaos)
            .then_some(disturbances as f64 >= DISTURBANCES_PER_SEC * measured_secs),
        redirected: options.redirect.then_some(stats.redirected > 0),
    };
    let mut row = json!({
        "scene": options.scene,
        "sessions": options.sessions,
        "workers": options.workers,
        "redirect": options.redirect,
        "redirected": stats.redirected,
        "secs": measured_secs,
        "cameras_per_sec": rate,
        "sent": stats.sent,
        "answered": stats.answered,
        "superseded": stats.sent.saturating_sub(stats.answered + stats.rejected + lost),
        "rejected": stats.rejected,
        "lost": lost,
        "p50_ms": p50,
        "p90_ms": quantile(&latencies, 0.9),
        "p99_ms": p99,
        "p99_per_p50": p99_per_p50,
        "max_ms": latencies.last(),
        "settled_p50_ms": quantile(&settled, 0.5),
        "settled_p99_ms": quantile(&settled, 0.99),
        "settled_max_ms": settled.last(),
        "worst_gap_secs": stats.worst_gap.lasts.as_secs_f64(),
        "worst_gap_since_secs": stats.worst_gap.since.map(|since| (since - begin).as_secs_f64()),
        "kills": disturbed.kills,
        "pauses": disturbed.pauses,
        "views_retried": counters.views_retried,
        "frames_checked": stats.checked,
        "frames_wrong": stats.wrong,
        "repeats_failed": stats.repeats_failed,
        "coordinator_mb": megabytes("coordinator"),
        "coordinator_swing": swing("coordinator"),
        "worker_mb": megabytes("worker"),
        "worker_swing": worker_swing,
        "client_mb": megabytes("client"),
        "client_swing": swing("client"),
    });
    for (name, bar) in bars.named() {
        row[name] = json!(bar);
    }
    row["passed"] = json!(bars.met());
    let mut report = Report::new(options.scene.clone(), Machine::here(&device), vec![report::row(row)]);
    report.plots =
        vec![memory_plot(&memory), latency_plot(&latencies), over_time_plot(&over_time, measured_secs)];
    report.notes.extend(stats.first_failure.map(|failure| format!("The first failure: {failure}")));
    report.notes.extend(stats.tail.sentence());
    report.notes.push(
        "lost: a session's newest camera that is neither answered nor rejected. Latency: from when a camera was due; settled: \
        after the first quarter of the time. Gap: the longest time in which a session waited for a frame and got none, even \
        if its cameras were superseded, rejected or lost. redirected: frames fetched from a worker. repeats_failed: repeats \
        that were not answered, so not compared. Swing: half of the range of resident memory after the first quarter of the \
        time, over its middle."
            .to_owned(),
    );
    report.notes.push(format!(
        "Bars, true if kept, empty if not judged: nothing lost; no frame wrong, and some compared; some frames redirected if \
        requested; without chaos, p99 at most {MOST_P99_PER_P50} times p50 and memory within {:.0}%; with chaos, no gap \
        beyond {} s and 200 disturbances in ten minutes. passed: all of them.",
        100.0 * MOST_SWING,
        LONGEST_GAP.as_secs()
    ));
    if options.chaos {
        report.notes.push(
            "Workers are killed and restarted, or paused for up to 2 s. The coordinator is not restarted and the network is \
            not cut: both have tests of their own."
                .to_owned(),
        );
    }
    Ok(report)
}

/// Cameras per second: the given rate, or a share of the measured capacity.
async fn rate(client: &Client, options: &Options) -> Result<f64> {
    if let Some(rate) = options.rate.or(is_quick().then_some(20.0)) {
        return Ok(rate);
    }
    let views = || path_views(client.description(), TRIAL.0, options.size, PlanRequest::default());
    // The first burst compiles programs and renders samples.
    let mut rate = 0.0;
    for _ in 0..2 {
        let trial = burst(client, views(), TRIAL.1, &patient(), |_, _| ()).await;
        anyhow::ensure!(trial.failed == 0, "a view was not answered: {:?}", trial.first_error);
        rate = trial.views_per_sec;
    }
    Ok(rate * if options.chaos { CHAOS_LOAD } else { LOAD })
}

async fn remember(memory: &mut BTreeMap<String, Memory>, client: &Client, coordinator: u32, secs: f64) {
    let status = client.status().await;
    let workers = status.into_iter().flat_map(|status| status.workers);
    let mut processes: Vec<(String, u32)> = workers.map(|w| (format!("worker {}", w.id), w.pid)).collect();
    processes.push(("coordinator".to_owned(), coordinator));
    processes.push(("client".to_owned(), std::process::id()));
    for (name, pid) in processes {
        if let Some(bytes) = resident_bytes(pid) {
            memory.entry(name).or_default().0.push((secs, bytes));
        }
    }
}

fn memory_plot(memory: &BTreeMap<String, Memory>) -> Plot {
    // Restarted workers are further processes; the plot shows the first few.
    let series = memory.iter().take(6).map(|(name, memory)| Series {
        name: name.clone(),
        points: memory.0.iter().map(|(secs, bytes)| (*secs, *bytes as f64 / 1e6)).collect(),
        line: true,
    });
    Plot {
        name: "memory".to_owned(),
        title: "Resident memory".to_owned(),
        x: Axis::linear("seconds"),
        y: Axis::linear("megabytes"),
        series: series.collect(),
        ..Plot::default()
    }
}

/// Latencies in milliseconds of the frames that came in a time span, ascending.
fn sorted(over_time: &[(f64, f64)], span: &Range<f64>) -> Vec<f64> {
    let of_span = over_time.iter().filter(|(secs, _)| span.contains(secs));
    let mut latencies: Vec<f64> = of_span.map(|(_, ms)| *ms).collect();
    latencies.sort_by(f64::total_cmp);
    latencies
}

fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    sorted.get((sorted.len() as f64 * share) as usize).copied()
}

/// Median and 99th percentile of latency for each hundredth of the time.
fn over_time_plot(over_time: &[(f64, f64)], whole_secs: f64) -> Plot {
    const SPANS: u32 = 100;
    let edge = |i: u32| whole_secs * f64::from(i) / f64::from(SPANS);
    let spans: Vec<(f64, Vec<f64>)> =
        (0..SPANS).map(|i| (edge(i), sorted(over_time, &(edge(i)..edge(i + 1))))).collect();
    let series = [("p50", 0.5), ("p99", 0.99)].map(|(name, share)| Series {
        name: name.to_owned(),
        points: spans.iter().filter_map(|(secs, ms)| Some((*secs, quantile(ms, share)?))).collect(),
        line: true,
    });
    Plot {
        name: "latency-over-time".to_owned(),
        title: "Latency".to_owned(),
        x: Axis::linear("seconds"),
        y: Axis::log("milliseconds from when it was due"),
        series: series.into(),
        ..Plot::default()
    }
}

/// The share of slower frames against latency.
fn latency_plot(sorted: &[f64]) -> Plot {
    let count = sorted.len().max(1) as f64;
    let at = |share: f64| (sorted.get((count * share) as usize).copied().unwrap_or(f64::NAN), 1.0 - share);
    let shares = (0..60).map(|i| 1.0 - 0.85_f64.powi(i)).filter(|share| (1.0 - share) * count >= 1.0);
    Plot {
        name: "latency".to_owned(),
        title: "Frames that took longer".to_owned(),
        x: Axis::log("milliseconds from when it was due"),
        y: Axis::log("share of frames"),
        series: vec![Series {
            name: "all sessions".to_owned(),
            points: shares.map(at).collect(),
            line: true,
        }],
        ..Plot::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_missed_bar_fails_the_run() {
        let bars = || Bars {
            lost: true,
            wrong: true,
            redirected: None,
            p99: None,
            memory: Some(true),
            gap: None,
            disturbances: None,
        };
        assert!(bars().met());
        assert!(!Bars { lost: false, ..bars() }.met());
        assert!(!Bars { wrong: false, ..bars() }.met());
        assert!(!Bars { redirected: Some(false), ..bars() }.met());
        assert!(!Bars { p99: Some(false), ..bars() }.met());
        assert!(!Bars { memory: Some(false), ..bars() }.met());
        assert!(!Bars { gap: Some(false), ..bars() }.met());
        assert!(!Bars { disturbances: Some(false), ..bars() }.met());
    }
}
