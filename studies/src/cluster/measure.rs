//! One run of a real cluster: tick after tick of the same views, and what a tick takes.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use argus_client::load::path_views;
use argus_client::{Client, ClusterStatus};
use argus_scene::{PlanRequest, Stage, View};
use parking_lot::Mutex;
use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use super::Way;
use crate::burst::{connect, patient};
use crate::local_cluster::LocalCluster;
use crate::processes::cpu_secs;

/// What is run.
#[derive(Debug, Clone)]
pub(super) struct Run<'a> {
    pub(super) argus: &'a Path,
    pub(super) scene: &'a str,
    pub(super) processes: usize,
    pub(super) views: u32,
    pub(super) size: [u32; 2],
    pub(super) way: Way,
    /// Ticks that are measured.
    pub(super) ticks: usize,
    /// Roles must not have changed for so long before that begins.
    pub(super) settle: Duration,
}

/// What came of it; times are seconds a tick.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    pub(super) tick_secs: f64,
    pub(super) samplers: u32,
    pub(super) device: String,
    /// g, g_direct and c as the workers measured them, seconds.
    pub(super) sample_secs: f64,
    pub(super) direct_secs: f64,
    pub(super) view_secs: f64,
    pub(super) sampling: f64,
    pub(super) compositing: f64,
    /// Uploads, and frames on their way from the device to the host.
    pub(super) readback: f64,
    pub(super) encode: f64,
    /// From the worker's last byte to the client, by way of the coordinator.
    pub(super) network: f64,
    /// Samples that were rendered anew.
    pub(super) samples: f64,
    /// Seconds on a core a tick: samplers, compositors, the coordinator, this process.
    pub(super) cpu: [f64; 4],
}

/// Sums over frames.
#[derive(Debug, Default)]
struct Sums {
    frames: u64,
    compositing: f64,
    readback: f64,
    encode: f64,
    network: f64,
    /// By tick: views answered, and when the last was.
    ticks: BTreeMap<usize, (u32, Option<Instant>)>,
    failure: Option<String>,
}

/// Stages that move pixels between the device and the host.
const READBACK: [&str; 2] = ["record passes", "unpack frames"];

/// Starts a cluster, lets its roles settle under the load, and measures.
pub(super) async fn measure(run: &Run<'_>) -> Result<Measured> {
    let refresh = match run.way {
        Way::Proposed | Way::Helping => run.views,
        Way::Naive | Way::Still => 0,
    };
    let arguments = [
        format!("--samplers-composite={}", run.way == Way::Helping),
        "--refining-share=0".to_owned(),
        "--visibility=auto".to_owned(),
        format!("--refresh-views={refresh}"),
        "--epoch-ms=25".to_owned(),
    ];
    let cluster = LocalCluster::start(run.argus, run.scene, run.processes, &arguments)?;
    let client = connect(&cluster, run.processes).await?;
    let plan = PlanRequest { direct: run.way == Way::Naive, ..PlanRequest::default() };
    let views = path_views(client.description(), run.views, run.size, plan);
    let sums = Arc::new(Mutex::new(Sums::default()));
    let asking = tokio::spawn(ask(client.clone(), views, run.processes, refresh > 0, sums.clone()));
    let measured = watch(run, &cluster, &client, &sums).await;
    asking.abort();
    let _ = asking.await;
    let measured = measured?;
    drop(client);
    cluster.stop()?;
    Ok(measured)
}

/// Asks for the views, tick after tick, until it is aborted. As in the paper's pipeline, a tick's views are asked for
/// while those of the one before are composed, and are not composed from that one's samples.
async fn ask(client: Client, views: Vec<View>, processes: usize, refreshed: bool, sums: Arc<Mutex<Sums>>) {
    let room = Arc::new(Semaphore::new((128 * processes).min(2 * views.len()).min(1024)));
    let mut epochs: Vec<u64> = Vec::new();
    let mut tasks = JoinSet::new();
    for tick in 0.. {
        loop {
            let epoch = client.status().await.map_or(0, |status| status.epoch);
            if !refreshed || tick < 2 || epoch > epochs[tick - 1] {
                epochs.push(epoch);
                break;
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        for view in &views {
            let Ok(turn) = room.clone().acquire_owned().await else { return };
            while tasks.try_join_next().is_some() {}
            let (client, view, sums) = (client.clone(), view.clone(), sums.clone());
            tasks.spawn(async move {
                let outcome = client.render(&view, &patient()).await;
                drop(turn);
                let mut sums = sums.lock();
                match outcome {
                    Ok(answer) => {
                        let of = |is: &dyn Fn(&str) -> bool| -> f64 {
                            answer.frame.stages.iter().filter(|s| is(&s.name)).map(|s| s.ms * 1e-3).sum()
                        };
                        let readback = of(&|name| READBACK.contains(&name));
                        sums.compositing += of(&|name| !Stage::is_on_the_way(name)) - readback;
                        sums.readback += readback;
                        sums.encode += of(&|name| name == "encode");
                        sums.network += of(&|name| name == "relay");
                        sums.frames += 1;
                        let of_tick = sums.ticks.entry(tick).or_default();
                        *of_tick = (of_tick.0 + 1, Some(Instant::now()));
                    }
                    Err(error) => _ = sums.failure.get_or_insert(error.to_string()),
                }
            });
        }
    }
}

/// Whole ticks that are answered.
fn whole(sums: &Mutex<Sums>, views: u32) -> Result<usize> {
    let sums = sums.lock();
    if let Some(error) = &sums.failure {
        bail!("a view was not answered: {error}");
    }
    Ok(sums.ticks.values().take_while(|(answered, _)| *answered == views).count())
}

async fn watch(
    run: &Run<'_>,
    cluster: &LocalCluster,
    client: &Client,
    sums: &Mutex<Sums>,
) -> Result<Measured> {
    let pause = || tokio::time::sleep(Duration::from_millis(50));
    // Programs are compiled with the first views; roles follow costs.
    let begin = Instant::now();
    let mut settled = (client.status().await?.counters.roles_changed, Instant::now());
    loop {
        pause().await;
        let changed = client.status().await?.counters.roles_changed;
        if changed != settled.0 {
            settled = (changed, Instant::now());
        }
        if whole(sums, run.views)? >= 2 && settled.1.elapsed() >= run.settle {
            break;
        }
        anyhow::ensure!(
            begin.elapsed() < Duration::from_secs(300),
            "the first ticks take more than five minutes"
        );
    }
    let before = snapshot(client, cluster).await?;
    let (from, frames_before) = {
        let mut sums = sums.lock();
        let Sums { compositing, readback, encode, network, .. } = &mut *sums;
        (*compositing, *readback, *encode, *network) = (0.0, 0.0, 0.0, 0.0);
        (sums.ticks.values().take_while(|t| t.0 == run.views).count(), sums.frames)
    };
    while whole(sums, run.views)? < from + run.ticks {
        pause().await;
    }
    let after = snapshot(client, cluster).await?;
    let sums = sums.lock();
    let ended = |tick: usize| sums.ticks.get(&tick).and_then(|tick| tick.1).context("a tick without an end");
    let last = from + run.ticks - 1;
    let tick_secs = (ended(last)? - ended(from - 1)?).as_secs_f64() / run.ticks as f64;
    // What was counted between the two looks, by as many ticks as that were.
    let ticks = (sums.frames - frames_before) as f64 / f64::from(run.views);
    let status = &after.status;
    let count = |of: fn(&argus_client::WorkerStatus) -> u64| -> f64 {
        let sum = |status: &ClusterStatus| status.workers.iter().map(of).sum::<u64>();
        (sum(&after.status) as f64 - sum(&before.status) as f64).max(0.0) / ticks
    };
    let samples = count(|w| w.samples_rendered);
    let mut cpu = [0.0; 4];
    for (pid, secs) in &after.cpu {
        let role = after.status.workers.iter().find(|w| w.pid == *pid).map(|w| w.role.as_str());
        let place = match role {
            Some("compositor") => 1,
            Some(_) => 0,
            None if *pid == cluster.pid() => 2,
            None => 3,
        };
        cpu[place] += (secs - before.cpu.get(pid).copied().unwrap_or(*secs)) / ticks;
    }
    Ok(Measured {
        tick_secs,
        samplers: status.samplers,
        device: status.workers.first().map(|w| w.device.clone()).unwrap_or_default(),
        sample_secs: status.sample_ms * 1e-3,
        direct_secs: status.direct_ms * 1e-3,
        view_secs: status.view_ms * 1e-3,
        sampling: samples * status.sample_ms * 1e-3,
        compositing: sums.compositing / ticks,
        readback: sums.readback / ticks,
        encode: sums.encode / ticks,
        network: sums.network / ticks,
        samples,
        cpu,
    })
}

/// A look at the cluster.
struct Snapshot {
    status: ClusterStatus,
    cpu: BTreeMap<u32, f64>,
}

async fn snapshot(client: &Client, cluster: &LocalCluster) -> Result<Snapshot> {
    let status = client.status().await?;
    let pids = status.workers.iter().map(|w| w.pid).chain([cluster.pid(), std::process::id()]);
    let cpu = pids.filter_map(|pid| Some((pid, cpu_secs(pid)?))).collect();
    Ok(Snapshot { status, cpu })
}
