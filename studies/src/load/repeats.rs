//! Repeats: a batch equals single views, and those equal their replay by another cluster, while workers are killed under load.
//!
//! Each frame is made three times. First by a batch, or as a single view where its plan warps direct frames, which no batch does.
//! Then as a single view that pins the provenance of the first. Both under load, while workers are killed and paused. At last from
//! its record, by a cluster that has rendered nothing else. All must have the same digest.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use argus_client::load::{CameraPath, LoadOptions, patient, run_along};
use argus_client::{Batch, Client, ClientError};
use argus_local::{LocalCluster, connect};
use argus_proto::v1::Encoding;
use argus_scene::{
    Camera, Frame, FrameDigest, FrameSource, Holes, Outputs, Plan, PlanRequest, Provenance, View, Warp,
};
use futures::{StreamExt as _, stream};
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};
use serde_json::json;
use tokio_util::sync::CancellationToken;

use super::chaos::{Chaos, Disturbances};
use crate::arguments::{count, or_quick, positive, seconds, size};
use crate::{Machine, Report, report};

/// Shows that batches, single views and replays have equal bytes, under load and while workers are killed
///
/// A third of the frames each is from triangles, from samples and warped from direct frames; half of them by rays to the sky, half by
/// light cells. The study starts and ends its own clusters on this machine.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = "terrain:20000")]
    pub scene: String,
    /// Number of frames
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("10000", "60"))]
    pub frames: usize,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("96x72", "64x48"))]
    pub size: [u32; 2],
    /// Number of worker processes
    #[arg(long, value_name = "P", value_parser = count, default_value = "2")]
    pub workers: usize,
    /// Views a second that other clients ask for meanwhile
    #[arg(long, value_name = "N", value_parser = positive, default_value = "4")]
    pub rate: f64,
    /// Random seed of the kills and pauses
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Seconds between two kills or pauses; delayed while fewer than two workers run
    #[arg(long, value_name = "SECONDS", default_value = or_quick("6", "3"), value_parser = seconds)]
    pub chaos_every: Duration,
}

/// Cameras of a batch.
const BATCH: usize = 512;
/// Views of this study in flight.
const IN_FLIGHT: usize = 16;
/// How far beside a view its direct frame stands, as a share of the distance to its target.
const ASIDE: f64 = 0.01;

/// Where light of the sky is from, by each pixel's rays or by light cells, and the flag for that.
const LIGHTS: [(&str, &str); 2] = [("rays", "--indirect=off"), ("cells", "--indirect=cells")];

/// What a frame is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Origin {
    Triangles,
    Samples,
    Frames,
}

impl Origin {
    const ALL: [Self; 3] = [Self::Triangles, Self::Samples, Self::Frames];

    fn name(self) -> &'static str {
        match self {
            Self::Triangles => "triangles",
            Self::Samples => "samples",
            Self::Frames => "frames",
        }
    }

    fn of(plan: &Plan) -> Self {
        match plan {
            Plan::Direct { .. } => Self::Triangles,
            Plan::Warp(warp) if warp.frames.is_empty() => Self::Samples,
            Plan::Warp(_) => Self::Frames,
        }
    }
}

/// A frame as it is recorded: all that another cluster needs.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Record {
    camera: Camera,
    size: [u32; 2],
    provenance: Provenance,
    digest: FrameDigest,
}

impl Record {
    fn of(camera: Camera, frame: &Frame) -> Self {
        let size = [frame.width, frame.height];
        Self { camera, size, provenance: frame.provenance.clone(), digest: frame.images.digest() }
    }

    /// The view that makes the frame again.
    fn view(&self) -> View {
        pinned(self.camera, self.size, self.provenance.clone())
    }
}

fn pinned(camera: Camera, [width, height]: [u32; 2], pin: Provenance) -> View {
    let (outputs, plan) = (Outputs::COLOR, PlanRequest::default());
    View { camera, width, height, outputs, plan, pin: Some(pin), flow_to: None, rays: None }
}

/// Frames of one origin and what became of their repeats.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    first: u64,
    singles: u64,
    singles_differ: u64,
    replays: u64,
    replays_differ: u64,
}

/// Counts of one kind of light.
#[derive(Debug, Default)]
struct Counts {
    tallies: [Tally; 3],
    failed: u64,
    /// The first failure of each kind of request.
    failures: BTreeMap<&'static str, String>,
}

impl Counts {
    fn tally(&mut self, plan: &Plan) -> &mut Tally {
        &mut self.tallies[Origin::of(plan) as usize]
    }

    fn fail(&mut self, what: &'static str, error: &ClientError) {
        self.failed += 1;
        self.failures.entry(what).or_insert_with(|| error.to_string());
    }
}

/// Runs the study with clusters of the program `argus`.
///
/// # Errors
/// A cluster that does not start, or that stops answering.
pub async fn run(argus: &Path, options: &Options, progress: &ProgressBar) -> Result<Report> {
    progress.set_length(3 * options.frames as u64);
    let mut rows = Vec::new();
    let (mut device, mut failures) = (String::new(), Vec::new());
    for (light, flag) in LIGHTS {
        let flags = [flag, "--effects=all", "--exposure=0", "--visibility=cpu"].map(str::to_owned);
        let mut counts = Counts::default();
        let frames = options.frames.div_ceil(LIGHTS.len());
        let began = Instant::now();
        progress.set_message(format!("{light}: start"));
        let cluster = LocalCluster::start(argus, &options.scene, options.workers, &flags)?;
        let client = connect(&cluster, options.workers).await?;
        device = client.status().await?.workers.first().map(|w| w.device.clone()).unwrap_or_default();
        let trouble = Trouble::begin(&client, options);
        progress.set_message(format!("{light}: batches"));
        let records = first(&client, options, frames, &mut counts, progress).await?;
        progress.set_message(format!("{light}: single views"));
        repeat(&client, &records, &mut counts, progress, |tally, equal| {
            tally.singles += 1;
            tally.singles_differ += u64::from(!equal);
        })
        .await;
        let disturbed = trouble.end().await?;
        drop(client);
        // Workers that were killed have failed, which is what its status says.
        let _ = cluster.stop();

        progress.set_message(format!("{light}: replays by another cluster"));
        let cluster = LocalCluster::start(argus, &options.scene, options.workers, &flags)?;
        let client = connect(&cluster, options.workers).await?;
        let records = records.iter().map(|record| serde_json::from_str(&serde_json::to_string(record)?));
        let records = records.collect::<serde_json::Result<Vec<Record>>>()?;
        repeat(&client, &records, &mut counts, progress, |tally, equal| {
            tally.replays += 1;
            tally.replays_differ += u64::from(!equal);
        })
        .await;
        drop(client);
        cluster.stop()?;
        let secs = began.elapsed().as_secs_f64();
        failures.extend(counts.failures.iter().map(|(what, error)| format!("{light}, {what}: {error}")));
        rows.extend(Origin::ALL.map(|origin| row(light, origin, &counts, disturbed, secs)));
    }
    let mut report = Report::new(
        options.scene.clone(),
        Machine::here(&device),
        rows.into_iter().map(report::row).collect(),
    );
    report.notes =
        failures.into_iter().map(|failure| format!("The first failure of its kind: {failure}")).collect();
    report.notes.push(
        "first: frames of a batch, or single views where they are warped from direct frames. singles: single views that pin the \
         first one's provenance, under load, while workers are killed and paused. replays: from the record, by another cluster. \
         passed: all were answered and repeated, no digest differs, and a worker was killed or paused. kills, pauses, failed and secs are \
         those of all rows of a light."
            .to_owned(),
    );
    Ok(report)
}

fn row(
    light: &str,
    origin: Origin,
    counts: &Counts,
    disturbed: Disturbances,
    secs: f64,
) -> serde_json::Value {
    let Tally { first, singles, singles_differ, replays, replays_differ } = counts.tallies[origin as usize];
    let whole = first > 0 && singles == first && replays == first && counts.failed == 0;
    json!({
        "light": light,
        "from": origin.name(),
        "first": first,
        "singles": singles,
        "singles_differ": singles_differ,
        "replays": replays,
        "replays_differ": replays_differ,
        "failed": counts.failed,
        "kills": disturbed.kills,
        "pauses": disturbed.pauses,
        "secs": secs,
        "passed": whole && singles_differ + replays_differ == 0 && disturbed.kills + disturbed.pauses > 0,
    })
}

/// Makes the frames for the first time: a third each by a batch from triangles, by a batch from samples, and warped from a direct
/// frame beside the view.
async fn first(
    client: &Client,
    options: &Options,
    frames: usize,
    counts: &mut Counts,
    progress: &ProgressBar,
) -> Result<Vec<Record>> {
    let cameras: Vec<Camera> = (0..frames).map(|i| camera(client, i)).collect();
    let third = frames.div_ceil(3);
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    let samples = PlanRequest { holes: Some(Holes::Trace), ..PlanRequest::from_samples() };
    let mut records = Vec::new();
    for (plan, cameras) in [direct, samples].into_iter().zip(cameras.chunks(third)) {
        for cameras in cameras.chunks(BATCH) {
            records.extend(batch(client, options.size, cameras, plan, counts, progress).await);
        }
    }
    let like = records.first().context("no frame of a batch was answered")?.provenance.clone();
    let warped = cameras.get(2 * third..).unwrap_or_default().iter().map(|camera| {
        (*camera, pinned(*camera, options.size, warped_from(&like, beside(camera), options.size)))
    });
    let warped: Vec<(Camera, View)> = warped.collect();
    let mut answers = stream::iter(&warped)
        .map(|(camera, view)| async move { (*camera, client.render(view, &patient()).await) })
        .buffer_unordered(IN_FLIGHT);
    while let Some((camera, answer)) = answers.next().await {
        progress.inc(1);
        match answer {
            Ok(answer) => records.push(Record::of(camera, &answer.frame)),
            Err(error) => counts.fail("a view from a direct frame", &error),
        }
    }
    for record in &records {
        counts.tally(&record.provenance.plan).first += 1;
    }
    Ok(records)
}

/// The frames of a batch.
async fn batch(
    client: &Client,
    [width, height]: [u32; 2],
    cameras: &[Camera],
    plan: PlanRequest,
    counts: &mut Counts,
    progress: &ProgressBar,
) -> Vec<Record> {
    let batch = Batch { cameras: cameras.to_vec(), width, height, outputs: Outputs::COLOR, plan };
    let mut answers = std::pin::pin!(client.render_batch(batch, Encoding::Unspecified));
    let mut records = Vec::new();
    while let Some((index, answer)) = answers.next().await {
        progress.inc(1);
        match answer {
            Ok((frame, _)) => records.push(Record::of(cameras[index], &frame)),
            Err(error) => counts.fail("a frame of a batch", &error),
        }
    }
    records
}

/// The camera of a frame: all differ.
fn camera(client: &Client, index: usize) -> Camera {
    CameraPath::new(client.description(), index as u32).camera(0.01 * index as f64)
}

fn beside(camera: &Camera) -> Camera {
    let ahead = camera.target - camera.eye;
    let step = ahead.cross(camera.up).normalize() * ahead.length() * ASIDE;
    Camera { eye: camera.eye + step, target: camera.target + step, ..*camera }
}

/// The provenance of a view that is warped from the direct frame of a camera, like another frame of its cluster.
fn warped_from(like: &Provenance, camera: Camera, [width, height]: [u32; 2]) -> Provenance {
    let source =
        FrameSource { camera, width, height, samples_per_pixel: 1, band_rows: 0, light: like.plan.light() };
    let warp = Warp { frames: vec![source], holes: Holes::Trace, ..Warp::default() };
    Provenance { plan: Plan::Warp(warp), ..like.clone() }
}

/// Makes recorded frames again as single views, and tells whether each is equal.
async fn repeat(
    client: &Client,
    records: &[Record],
    counts: &mut Counts,
    progress: &ProgressBar,
    tell: impl Fn(&mut Tally, bool),
) {
    let mut answers = stream::iter(records)
        .map(|record| async move { (record, client.render(&record.view(), &patient()).await) })
        .buffer_unordered(IN_FLIGHT);
    while let Some((record, answer)) = answers.next().await {
        progress.inc(1);
        match answer {
            Ok(answer) => {
                let equal = answer.frame.images.digest() == record.digest;
                tell(counts.tally(&record.provenance.plan), equal);
            }
            Err(error) => counts.fail("a repeat", &error),
        }
    }
}

/// Load of other clients, and workers that are killed and paused.
struct Trouble {
    ending: CancellationToken,
    chaos: tokio::task::JoinHandle<Disturbances>,
    load: tokio::task::JoinHandle<()>,
}

impl Trouble {
    fn begin(client: &Client, options: &Options) -> Self {
        const CLIENTS: u32 = 4;
        let ending = CancellationToken::new();
        let load = LoadOptions {
            clients: CLIENTS,
            rate: options.rate / f64::from(CLIENTS),
            size: options.size,
            // It ends with the repeats.
            duration: Duration::from_secs(24 * 3600),
            ..LoadOptions::default()
        };
        let (loaded, description) = (client.clone(), client.description().clone());
        let cameras = move |index, secs| CameraPath::new(&description, index).camera(secs);
        let load = tokio::spawn(async move {
            // Its failures are those of clients that give up; what is compared has its own.
            let _ = run_along(&loaded, &load, Arc::new(cameras), |_| ()).await;
        });
        let (watched, ended) = (client.clone(), ending.clone());
        let mut chaos = Chaos::new(options.seed, options.chaos_every);
        let chaos = tokio::spawn(async move {
            while !ended.is_cancelled() {
                chaos.run_due(&watched, Duration::MAX).await;
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
            chaos.end()
        });
        Self { ending, chaos, load }
    }

    async fn end(self) -> Result<Disturbances> {
        self.ending.cancel();
        self.load.abort();
        self.chaos.await.context("the task that kills workers failed")
    }
}
