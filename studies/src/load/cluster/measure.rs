//! Measures one real cluster: the same views tick after tick, and the time of a tick.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use argus_client::load::{path_views, patient};
use argus_client::{Client, ClusterStatus};
use argus_local::{LocalCluster, connect};
use argus_proto::convert::specification_hash_bytes;
use argus_proto::v1;
use argus_proto::v1::sample_chunk::Body;
use argus_proto::v1::samples_client::SamplesClient;
use argus_scene::{Plan, PlanRequest, Stage, Version, View};
use parking_lot::Mutex;
use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use super::method::{Method, PLAIN};
use crate::processes::cpu_secs;

/// Longest time until pipelines are compiled, roles are stable, and a still scene has its samples.
const MOST_SETTLING: Duration = Duration::from_secs(300);

/// One run of a cluster.
#[derive(Debug, Clone)]
pub(super) struct Run<'a> {
    pub(super) argus: &'a Path,
    pub(super) scene: &'a str,
    pub(super) processes: usize,
    pub(super) views: u32,
    pub(super) size: [u32; 2],
    pub(super) method: Method,
    /// Ticks to measure.
    pub(super) ticks: usize,
    /// Time without role changes before measuring starts.
    pub(super) settle: Duration,
}

/// The result of a run; times are seconds per tick unless noted.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    pub(super) tick_secs: f64,
    pub(super) samplers: u32,
    pub(super) device: String,
    /// g, g_direct and c in seconds, as the workers measured them.
    pub(super) sample_secs: f64,
    pub(super) direct_secs: f64,
    pub(super) view_secs: f64,
    pub(super) sampling: f64,
    /// How a sample's time divides, by its reported stages.
    pub(super) sampling_shares: Option<Shares>,
    /// How frames' time divides, by their reported stages.
    pub(super) parts: Parts,
    /// Time beyond the stages: submission, and waiting for the device and for readback. For views from samples it is
    /// the rest of c; for direct views it is their stage `other`.
    pub(super) rest: f64,
    /// Samples rendered per tick.
    pub(super) samples: f64,
    /// Samples received by other workers per tick, and the seconds to unpack them and to hold them on the render thread.
    pub(super) received: f64,
    pub(super) unpacking: f64,
    pub(super) holding: f64,
    /// CPU seconds per tick: samplers, compositors, coordinator, this process.
    pub(super) cpu: [f64; 4],
}

/// Shares of a sample's time, 0–1.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shares {
    /// The stage `other`: submission, and waiting for the device and for readback.
    pub(super) rest: f64,
    /// CPU rays on all cores.
    pub(super) pooled: f64,
}

/// Seconds of frames' stages, summed over views. Stages from `passes` to `encode` are work; waits of many views overlap.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Parts {
    /// Passes on the device.
    pub(super) passes: f64,
    /// CPU rays on all cores.
    pub(super) pooled: f64,
    /// Host work: preparing and uploading views, recording passes.
    pub(super) record: f64,
    /// Host work: putting read-back pixels in their places.
    pub(super) unpack: f64,
    /// Stage `other` of direct views.
    other: f64,
    pub(super) encode: f64,
    /// The coordinator's relaying, and the frame's transfer from its worker to the client.
    pub(super) relay: f64,
    /// Waiting for a view's samples.
    pub(super) await_samples: f64,
    /// Waiting for a view's batch to start.
    pub(super) queue: f64,
}

/// The stage name of the CPU visibility backend.
const POOLED: &str = "trace on the CPU";

impl Parts {
    /// The share of direct views' work that runs on all cores at once, when `processes` busy processes share
    /// `cores` cores.
    pub(super) fn pooled_share(&self, processes: usize, cores: u32) -> f64 {
        let pooled = self.pooled * (f64::from(cores) / processes as f64).max(1.0);
        let all = pooled + self.passes + self.record + self.unpack + self.other;
        if all > 0.0 { pooled / all } else { 0.0 }
    }

    fn add(&mut self, stage: &Stage) {
        let part = match stage.name.as_str() {
            "prepare views" | "record passes" => &mut self.record,
            "unpack frames" => &mut self.unpack,
            "other" => &mut self.other,
            POOLED => &mut self.pooled,
            "encode" => &mut self.encode,
            "relay" => &mut self.relay,
            "samples" => &mut self.await_samples,
            "queue" => &mut self.queue,
            _ => &mut self.passes,
        };
        *part += stage.ms * 1e-3;
    }

    fn per(self, ticks: f64) -> Self {
        let Self { passes, pooled, record, unpack, other, encode, relay, await_samples, queue } = self;
        Self {
            passes: passes / ticks,
            pooled: pooled / ticks,
            record: record / ticks,
            unpack: unpack / ticks,
            other: other / ticks,
            encode: encode / ticks,
            relay: relay / ticks,
            await_samples: await_samples / ticks,
            queue: queue / ticks,
        }
    }
}

/// Sums over all frames.
#[derive(Debug, Default)]
struct Sums {
    frames: u64,
    parts: Parts,
    /// Views answered, by tick.
    ticks: BTreeMap<usize, u32>,
    failure: Option<String>,
}

/// Starts a cluster, waits until its roles settle under the load, and measures.
pub(super) async fn measure(run: &Run<'_>) -> Result<Measured> {
    let refresh = match run.method {
        Method::Proposed | Method::Helping => run.views,
        Method::Naive | Method::Still => 0,
    };
    let arguments = [
        format!("--samplers-composite={}", run.method == Method::Helping),
        "--refining-share=0".to_owned(),
        "--visibility=auto".to_owned(),
        format!("--refresh-views={refresh}"),
        "--epoch-ms=25".to_owned(),
        PLAIN.to_owned(),
    ];
    let cluster = LocalCluster::of_single_threads(run.argus, run.scene, run.processes, &arguments)?;
    let client = connect(&cluster, run.processes).await?;
    let plan = match run.method {
        Method::Naive => PlanRequest { direct: true, ..PlanRequest::default() },
        _ => PlanRequest::from_samples(),
    };
    let views = path_views(client.description(), run.views, run.size, plan);
    let sums = Arc::new(Mutex::new(Sums::default()));
    let asking = tokio::spawn(ask(client.clone(), views, run.processes, refresh > 0, sums.clone()));
    let measured = watch(run, &cluster, &client, &sums).await;
    asking.abort();
    let _ = asking.await;
    let mut measured = measured?;
    if run.method != Method::Naive {
        measured.sampling_shares = shares_of_samples(&client, run.size).await;
    }
    drop(client);
    cluster.stop()?;
    Ok(measured)
}

impl Sums {
    /// The number of complete ticks before the first incomplete one.
    fn whole(&self, views: u32) -> usize {
        self.ticks.values().take_while(|answered| **answered == views).count()
    }
}

/// Requests the views tick after tick until aborted. As in the paper's pipeline, a tick's views are requested while the
/// previous tick is composed, and are composed from newer samples.
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
                        answer.frame.stages.iter().for_each(|stage| sums.parts.add(stage));
                        sums.frames += 1;
                        *sums.ticks.entry(tick).or_default() += 1;
                    }
                    Err(error) => _ = sums.failure.get_or_insert(error.to_string()),
                }
            });
        }
    }
}

/// The number of complete ticks.
fn whole(sums: &Mutex<Sums>, views: u32) -> Result<usize> {
    let sums = sums.lock();
    if let Some(error) = &sums.failure {
        bail!("a view was not answered: {error}");
    }
    Ok(sums.whole(views))
}

async fn watch(
    run: &Run<'_>,
    cluster: &LocalCluster,
    client: &Client,
    sums: &Mutex<Sums>,
) -> Result<Measured> {
    let pause = || tokio::time::sleep(Duration::from_millis(50));
    // Wait until pipelines are compiled and roles are stable. In a still scene also wait until no more samples are
    // rendered: the last ones come after the first views.
    let begin = Instant::now();
    let state = |status: &ClusterStatus| {
        let rendered = status.workers.iter().map(|worker| worker.samples_rendered).sum::<u64>();
        (status.counts().roles_changed, if run.method == Method::Still { rendered } else { 0 })
    };
    let mut settled = (state(&client.status().await?), Instant::now());
    loop {
        pause().await;
        let now = state(&client.status().await?);
        if now != settled.0 {
            settled = (now, Instant::now());
        }
        if whole(sums, run.views)? >= 2 && settled.1.elapsed() >= run.settle {
            break;
        }
        anyhow::ensure!(begin.elapsed() < MOST_SETTLING, "the first ticks take more than five minutes");
    }
    let mut stretch = stretch_of(run, cluster, client, sums).await?;
    // A sample that was late on a busy machine belongs to the time before: such a stretch is measured anew.
    while run.method == Method::Still && stretch.samples_rendered() > 0 && begin.elapsed() < MOST_SETTLING {
        stretch = stretch_of(run, cluster, client, sums).await?;
    }
    let Stretch { before, after, frames_before, begin } = stretch;
    let sums = sums.lock();
    // Count ticks by frames between the two snapshots. Two ticks are in flight at a time, so the ends of single ticks
    // would be less exact.
    let ticks = (sums.frames - frames_before) as f64 / f64::from(run.views);
    let tick_secs = begin.elapsed().as_secs_f64() / ticks;
    let parts = sums.parts.per(ticks);
    let status = &after.status;
    let count = |of: fn(&argus_client::WorkerStatus) -> f64| -> f64 {
        let sum = |status: &ClusterStatus| status.workers.iter().map(of).sum::<f64>();
        (sum(&after.status) - sum(&before.status)).max(0.0) / ticks
    };
    let samples = count(|w| w.samples_rendered as f64);
    let mut cpu = [0.0; 4];
    for (pid, secs) in &after.cpu {
        let role = after.status.workers.iter().find(|w| w.pid == *pid).map(|w| w.role_name());
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
        sampling_shares: None,
        rest: match run.method {
            Method::Naive => parts.other,
            _ => (f64::from(run.views) * status.view_ms * 1e-3 - parts.passes - parts.record - parts.unpack)
                .max(0.0),
        },
        parts,
        samples,
        received: count(|w| w.samples_received as f64),
        unpacking: count(|w| w.unpacking_ms * 1e-3),
        holding: count(|w| w.holding_ms * 1e-3),
        cpu,
    })
}

/// The ticks between two moments.
struct Stretch {
    before: Snapshot,
    after: Snapshot,
    /// Frames that came before the first moment, and its time.
    frames_before: u64,
    begin: Instant,
}

impl Stretch {
    fn samples_rendered(&self) -> u64 {
        let of =
            |snapshot: &Snapshot| snapshot.status.workers.iter().map(|w| w.samples_rendered).sum::<u64>();
        of(&self.after).saturating_sub(of(&self.before))
    }
}

/// Waits for as many ticks as a run measures.
async fn stretch_of(
    run: &Run<'_>,
    cluster: &LocalCluster,
    client: &Client,
    sums: &Mutex<Sums>,
) -> Result<Stretch> {
    let before = snapshot(client, cluster).await?;
    let (from, frames_before, begin) = {
        let mut sums = sums.lock();
        sums.parts = Parts::default();
        (sums.whole(run.views), sums.frames, Instant::now())
    };
    while whole(sums, run.views)? < from + run.ticks {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    Ok(Stretch { before, after: snapshot(client, cluster).await?, frames_before, begin })
}

/// The cluster's status and CPU times at one moment.
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

/// How the time of one view's samples divides, as the workers that hold them report it; `None` if none does.
async fn shares_of_samples(client: &Client, size: [u32; 2]) -> Option<Shares> {
    let view = path_views(client.description(), 1, size, PlanRequest::from_samples()).pop()?;
    let frame = client.render(&view, &patient()).await.ok()?.frame;
    let Plan::Warp(plan) = &frame.provenance.plan else { return None };
    let specification = frame.provenance.specification?;
    let specification_hash = specification_hash_bytes(specification.hash());
    let mut stages: Vec<v1::Stage> = Vec::new();
    for worker in client.status().await.ok()?.workers {
        let Ok(mut worker) = SamplesClient::connect(worker.address).await else { continue };
        for id in &plan.samples {
            let request = v1::SubscribeRequest {
                scene_hash: frame.provenance.scene.0.to_vec().into(),
                version: Some(Version { number: id.version, state: frame.provenance.state }.into()),
                cameras: vec![id.camera],
                // A worker that does not hold the sample must not render it.
                prefetch: true,
                specification_hash: specification_hash.clone(),
                ..v1::SubscribeRequest::default()
            };
            let header = async { worker.subscribe(request).await.ok()?.into_inner().message().await.ok()? };
            let chunk = tokio::time::timeout(Duration::from_millis(300), header).await.ok().flatten();
            if let Some(Body::Header(header)) = chunk.and_then(|chunk| chunk.body) {
                stages.extend(header.stages);
            }
        }
    }
    let sum = |is: &dyn Fn(&str) -> bool| -> f64 {
        stages.iter().filter(|stage| is(&stage.name)).map(|stage| stage.ms).sum()
    };
    let all = sum(&|_| true);
    let share = |of: &str| sum(&|name| name == of) / all;
    (all > 0.0).then(|| Shares { rest: share("other"), pooled: share(POOLED) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_belongs_to_a_part_and_unknown_stages_are_passes() {
        let mut parts = Parts::default();
        let names = ["samples", "queue", "prepare views", "record passes", "splat samples", "mend"];
        names.iter().for_each(|name| parts.add(&Stage::new(*name, 1000.0)));
        for (name, ms) in
            [("unpack frames", 3e3), ("other", 5e3), ("encode", 7e3), ("relay", 11e3), (POOLED, 13e3)]
        {
            parts.add(&Stage::new(name, ms));
        }
        let parts = parts.per(2.0);
        let Parts { passes, pooled, record, unpack, other, encode, relay, await_samples, queue } = parts;
        assert_eq!((await_samples, queue, record, passes), (0.5, 0.5, 1.0, 1.0));
        assert_eq!((unpack, other, encode, relay, pooled), (1.5, 2.5, 3.5, 5.5, 6.5));
        // With two cores per process, each millisecond of pooled rays counts twice.
        assert_eq!(parts.pooled_share(2, 2), 6.5 / (6.5 + 1.0 + 1.0 + 1.5 + 2.5));
        assert_eq!(parts.pooled_share(1, 2), 13.0 / (13.0 + 1.0 + 1.0 + 1.5 + 2.5));
        assert_eq!(Parts::default().pooled_share(1, 2), 0.0);
    }
}
