//! Many sessions for a long time: every accepted camera answered, latencies, memory of each process over time; and, with
//! chaos, workers that are killed and paused meanwhile, each frame that is looked at compared with a pinned repeat.

mod chaos;
mod session;
mod tail;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use argus_client::load::{burst, path_views};
use argus_client::{Client, ConnectOptions, RenderOptions};
use argus_scene::{PlanRequest, View};
use indicatif::ProgressBar;
use parking_lot::Mutex;
use serde_json::json;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use self::chaos::Chaos;
use self::session::Heard;
use crate::burst::{connect, patient};
use crate::local_cluster::LocalCluster;
use crate::plot::{Axis, Plot, Series};
use crate::processes::resident_bytes;
use crate::{Effort, Machine, Report, report};

/// What is run, and for how long.
#[derive(Debug, Clone)]
pub struct Options {
    /// Scene, as [`argus_scene::open`] takes it.
    pub scene: String,
    /// Sessions at the same time.
    pub sessions: u32,
    /// Cameras a second of all sessions together; `None`: [`LOAD`] or [`CHAOS_LOAD`] of what the machine was
    /// measured to carry.
    pub rate: Option<f64>,
    /// Pixels of a view.
    pub size: [u32; 2],
    /// Worker processes.
    pub workers: usize,
    /// Whether sessions fetch their frames from the workers, instead of having them relayed.
    pub redirect: bool,
    /// Time that is measured.
    pub duration: Duration,
    /// Seed of the kills and pauses, and how often one happens; `None`: none do.
    pub chaos: Option<(u64, Duration)>,
    /// Whether latencies, gaps, memory and the number of disturbances are judged: those of a few seconds are noise. That
    /// nothing is lost or wrong is judged always.
    pub judged: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            scene: "terrain:500000".to_owned(),
            sessions: 1000,
            rate: None,
            size: [200, 150],
            workers: 2,
            redirect: false,
            duration: Duration::from_secs(600),
            chaos: None,
            judged: true,
        }
    }
}

impl Effort for Options {
    fn quick() -> Self {
        Self {
            scene: "terrain:20000".to_owned(),
            sessions: 20,
            rate: Some(20.0),
            size: [96, 72],
            duration: Duration::from_secs(4),
            judged: false,
            ..Self::default()
        }
    }
}

/// The share of what a machine was measured to carry that it is loaded with: beyond, any hiccup queues.
pub const LOAD: f64 = 0.6;

/// The share of that capacity while workers are killed and paused: one is away most of the time, and its restart takes time from the rest.
pub const CHAOS_LOAD: f64 = 0.2;

/// Views of the burst that measures what the machine carries, and how many are in flight.
const TRIAL: (u32, usize) = (400, 128);

/// Connections that all sessions share.
const CONNECTIONS: usize = 8;

/// Before memory is said to be flat or not: caches fill, programs are compiled, and samples are placed where views had holes.
/// Latencies are judged from the beginning; what they are after it stands beside.
const WARM_UP: f64 = 0.25;

/// What a run must keep to: p99 by p50, the swing of the service's memory, and with chaos the longest that a session waits
/// for a frame, and disturbances a second: 200 in ten minutes.
const MOST_P99_PER_P50: f64 = 3.0;
const MOST_SWING: f64 = 0.05;
const LONGEST_GAP: Duration = Duration::from_secs(3);
const DISTURBANCES_PER_SEC: f64 = 200.0 / 600.0;

/// After the last camera was sent, its answer is waited for.
const PATIENCE: Duration = Duration::from_secs(30);

/// Resident bytes of one process over time, seconds.
#[derive(Debug, Clone, Default)]
struct Memory(Vec<(f64, u64)>);

impl Memory {
    /// How far it is from its middle at most, after the warm-up, as a share of it; `None` where that is not known.
    fn swing(&self, whole_secs: f64) -> Option<f64> {
        let warm =
            self.0.iter().filter(|(secs, _)| *secs >= WARM_UP * whole_secs).map(|(_, bytes)| *bytes as f64);
        let (least, most) = warm.fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
        (most > 0.0).then(|| (most - least) / (most + least))
    }
}

/// Which bars are met; `None` where one is not judged.
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

/// Runs it with a cluster of the program `argus`.
///
/// # Errors
/// A cluster that does not come up.
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

    progress.set_length(options.duration.as_secs().max(1));
    let begin = Instant::now();
    let heard = Arc::new(Mutex::new(Heard::default()));
    let ending = CancellationToken::new();
    let mut sessions = JoinSet::new();
    let each = rate / f64::from(options.sessions);
    for index in 0..options.sessions {
        let asks = session::Asks { index, rate: each, size: options.size, phase: f64::from(index) / rate };
        sessions.spawn(session::run(client.clone(), asks, heard.clone(), begin, ending.clone()));
    }
    let checking = tokio::spawn(session::check(first.clone(), heard.clone()));
    let mut chaos = options.chaos.map(|(seed, every)| Chaos::new(seed, every));
    let mut memory: BTreeMap<String, Memory> = BTreeMap::new();
    let pause = (options.duration / 100).clamp(Duration::from_millis(250), Duration::from_secs(5));
    let mut looked = Instant::now();
    while begin.elapsed() < options.duration {
        tokio::time::sleep(Duration::from_millis(50)).await;
        if let Some(chaos) = &mut chaos {
            chaos.go_on(&first, options.duration.saturating_sub(begin.elapsed())).await;
        }
        if looked.elapsed() >= pause {
            looked = Instant::now();
            remember(&mut memory, &first, cluster.pid(), begin.elapsed().as_secs_f64()).await;
            progress.set_position(begin.elapsed().as_secs());
            let said = {
                let heard = heard.lock();
                format!("{} frames, {} lost", heard.answered, heard.lost)
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
    let counters = first.status().await?.counters;
    drop((client, first));
    cluster.stop().or_else(|error| if options.chaos.is_some() { Ok(()) } else { Err(error) })?;

    let heard = std::mem::take(&mut *heard.lock());
    let over_time = heard.latencies_ms;
    let warm_secs = WARM_UP * measured_secs;
    let [latencies, settled] =
        [0.0, warm_secs].map(|from_secs| sorted(&over_time, &(from_secs..f64::INFINITY)));
    let (p50, p99) = (quantile(&latencies, 0.5), quantile(&latencies, 0.99));
    let lost = heard.lost + unfinished;
    let swing = |of: &str| {
        let of = memory.iter().filter(|(name, _)| name.starts_with(of));
        of.filter_map(|(_, memory)| memory.swing(measured_secs)).reduce(f64::max)
    };
    let megabytes = |of: &str| {
        let of = memory.iter().filter(|(name, _)| name.starts_with(of));
        of.filter_map(|(_, memory)| memory.0.last()).map(|(_, bytes)| *bytes as f64 / 1e6).reduce(f64::max)
    };
    let worker_swing = if options.chaos.is_none() { swing("worker") } else { None };
    let most_swing = [swing("coordinator"), worker_swing].into_iter().flatten().reduce(f64::max);
    let p99_per_p50 = p50.zip(p99).map(|(p50, p99)| p99 / p50);
    let disturbances = disturbed.kills + disturbed.pauses;
    let bars = Bars {
        lost: lost == 0,
        wrong: heard.wrong == 0 && (!options.judged || heard.checked > 0),
        p99: p99_per_p50.filter(|_| options.judged && options.chaos.is_none()).map(|r| r <= MOST_P99_PER_P50),
        memory: most_swing.filter(|_| options.judged && options.chaos.is_none()).map(|s| s <= MOST_SWING),
        gap: (options.judged && options.chaos.is_some()).then_some(heard.worst_gap.lasts <= LONGEST_GAP),
        disturbances: (options.judged && options.chaos.is_some())
            .then_some(disturbances as f64 >= DISTURBANCES_PER_SEC * measured_secs),
        redirected: options.redirect.then_some(heard.redirected > 0),
    };
    let mut row = json!({
        "scene": options.scene,
        "sessions": options.sessions,
        "workers": options.workers,
        "redirect": options.redirect,
        "redirected": heard.redirected,
        "secs": measured_secs,
        "cameras_per_sec": rate,
        "sent": heard.sent,
        "answered": heard.answered,
        "superseded": heard.sent.saturating_sub(heard.answered + heard.rejected + lost),
        "rejected": heard.rejected,
        "lost": lost,
        "p50_ms": p50,
        "p90_ms": quantile(&latencies, 0.9),
        "p99_ms": p99,
        "p99_per_p50": p99_per_p50,
        "max_ms": latencies.last(),
        "settled_p50_ms": quantile(&settled, 0.5),
        "settled_p99_ms": quantile(&settled, 0.99),
        "settled_max_ms": settled.last(),
        "worst_gap_secs": heard.worst_gap.lasts.as_secs_f64(),
        "worst_gap_since_secs": heard.worst_gap.since.map(|since| (since - begin).as_secs_f64()),
        "kills": disturbed.kills,
        "pauses": disturbed.pauses,
        "views_retried": counters.views_retried,
        "frames_checked": heard.checked,
        "frames_wrong": heard.wrong,
        "repeats_failed": heard.repeats_failed,
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
    report.notes.extend(heard.first_failure.map(|failure| format!("The first failure: {failure}")));
    report.notes.extend(heard.tail.sentence());
    report.notes.push(
        "Lost: a camera that is the newest of its session and is neither answered nor turned away. Latency: from when a \
         camera was due; settled: after the first quarter of the time. Gap: the longest that a session which had asked \
         for a frame got none, whether its cameras were overtaken, turned away or lost meanwhile. Redirected: frames that a session fetched from a worker. Repeats that \
         failed were not compared. Swing: half of the range of resident memory after the first quarter of the time, by its \
         middle."
            .to_owned(),
    );
    report.notes.push(format!(
        "Bars, each met or not, empty where it is not judged: nothing lost; no frame wrong, and some compared; some \
         redirected where that was asked for; p99 at most {MOST_P99_PER_P50} times p50 and memory within {:.0}% (without \
         chaos); no gap beyond {} s and 200 disturbances in ten minutes (with chaos). passed: all of them.",
        100.0 * MOST_SWING,
        LONGEST_GAP.as_secs()
    ));
    if options.chaos.is_some() {
        report.notes.push(
            "Workers are killed and started anew, or paused for up to 2 s. The coordinator is not restarted and nobody is \
             cut off: both are tests of their own."
                .to_owned(),
        );
    }
    Ok(report)
}

/// Cameras a second: what was asked for, or what the machine carries.
async fn rate(client: &Client, options: &Options) -> Result<f64> {
    if let Some(rate) = options.rate {
        return Ok(rate);
    }
    let views = || path_views(client.description(), TRIAL.0, options.size, PlanRequest::default());
    // The first compiles programs and renders samples.
    let mut rate = 0.0;
    for _ in 0..2 {
        let trial = burst(client, views(), TRIAL.1, &patient(), |_, _| ()).await;
        anyhow::ensure!(trial.failed == 0, "a view was not answered: {:?}", trial.first_error);
        rate = trial.views_per_sec;
    }
    Ok(rate * if options.chaos.is_some() { CHAOS_LOAD } else { LOAD })
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
    // Of workers that came in place of killed ones, the first few.
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

/// Latencies of the frames that came in a span of time, ascending.
fn sorted(over_time: &[(f64, f64)], span: &Range<f64>) -> Vec<f64> {
    let of_span = over_time.iter().filter(|(secs, _)| span.contains(secs));
    let mut latencies: Vec<f64> = of_span.map(|(_, ms)| *ms).collect();
    latencies.sort_by(f64::total_cmp);
    latencies
}

fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    sorted.get((sorted.len() as f64 * share) as usize).copied()
}

/// What half of the frames and what nearly all of them took, hundredth by hundredth of the time.
fn over_time_plot(over_time: &[(f64, f64)], whole_secs: f64) -> Plot {
    const SPANS: u32 = 100;
    let edge = |i: u32| whole_secs * f64::from(i) / f64::from(SPANS);
    let spans: Vec<(f64, Vec<f64>)> =
        (0..SPANS).map(|i| (edge(i), sorted(over_time, &(edge(i)..edge(i + 1))))).collect();
    let series = [("half of the frames", 0.5), ("99 of 100", 0.99)].map(|(name, share)| Series {
        name: name.to_owned(),
        points: spans.iter().filter_map(|(secs, ms)| Some((*secs, quantile(ms, share)?))).collect(),
        line: true,
    });
    Plot {
        name: "latency-over-time".to_owned(),
        title: "Latency".to_owned(),
        x: Axis::linear("seconds"),
        y: Axis::log("milliseconds from when it was due, at most"),
        series: series.into(),
        ..Plot::default()
    }
}

/// The share of frames that took longer, against how long.
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

/// A pinned repeat of a view must be answered within this.
fn repeat_options() -> RenderOptions {
    RenderOptions { deadline: Duration::from_secs(60), ..RenderOptions::default() }
}

/// A view that asks for a frame of exactly that provenance.
fn pinned(view: &View, provenance: argus_scene::Provenance) -> View {
    View { pin: Some(provenance), ..view.clone() }
}

/// The colour of a frame, which every frame here has.
fn color(frame: &argus_scene::Frame) -> Result<bytes::Bytes> {
    frame.color.clone().context("a frame without colour")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bar_that_is_judged_and_not_met_is_enough_to_fail() {
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
