//! Renders the frames that a data set lacks, in batches, and writes each as it arrives.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail, ensure};
use argus_client::{Batch, Client, ClientError, RenderOptions};
use argus_local::light_is_final;
use argus_proto::v1::Encoding;
use argus_scene::{Camera, Frame, Output, Outputs, PlanRequest, Specification, View};
use futures::stream::BoxStream;
use futures::{StreamExt, stream};
use indicatif::ProgressBar;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout};

use super::files::Writer;
use super::journal::{Entry, Journal};
use super::shots::{Cameras, Shot};
use crate::view::record::Record;

/// Cameras of a batch.
const BATCH: usize = 256;
/// Views in flight that are requested one by one.
const SINGLES: usize = 16;
/// Time between two looks at the service's light.
const PAUSE: Duration = Duration::from_millis(250);

/// A run's service, images and files.
pub(super) struct Job {
    pub(super) client: Client,
    pub(super) cameras: Arc<Cameras>,
    pub(super) outputs: Outputs,
    pub(super) plan: PlanRequest,
    pub(super) writer: Arc<Writer>,
    /// Longest wait for the next frame.
    pub(super) patience: Duration,
}

/// What became of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Outcome {
    pub(super) rendered: u64,
    pub(super) failed: u64,
    pub(super) first_error: Option<String>,
    pub(super) beyond: u64,
}

impl Job {
    /// The view of an image, by the request's plan. Flow leads to the camera of the next image; of the last one, to itself.
    pub(super) fn view(&self, index: usize) -> View {
        let Shot { camera, size, .. } = &self.cameras.shots[index];
        View {
            camera: *camera,
            width: size[0],
            height: size[1],
            outputs: self.outputs,
            plan: self.plan,
            pin: None,
            flow_to: self.flow_to(index),
            rays: None,
        }
    }

    fn flow_to(&self, index: usize) -> Option<Camera> {
        let next = self.cameras.shots.get(index + 1).unwrap_or(&self.cameras.shots[index]);
        self.outputs.has(Output::Flow).then_some(next.camera)
    }

    /// Whether an earlier run's frame is that of an image, and its files are as they were written.
    pub(super) fn is_finished(&self, index: usize, entry: &Entry) -> bool {
        let Shot { camera, size, .. } = &self.cameras.shots[index];
        let Record { camera: recorded, width, height, flow_to, .. } = &entry.record;
        recorded == camera
            && [*width, *height] == *size
            && *flow_to == self.flow_to(index)
            && self.writer.is_intact(&entry.written)
    }

    /// Renders and writes the images of these indices. A frame that fails is counted, and the others go on.
    ///
    /// # Errors
    /// The service does not answer in time, or renders otherwise than frames before, or a file cannot be written.
    pub(super) async fn run(
        &self,
        left: &[usize],
        like: Option<Specification>,
        journal: &mut Journal,
        bar: &ProgressBar,
    ) -> anyhow::Result<Outcome> {
        let mut by_size: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
        for index in left {
            by_size.entry(self.cameras.shots[*index].size).or_default().push(*index);
        }
        let mut run = Run { like, outcome: Outcome::default(), writing: JoinSet::new() };
        let at_once = std::thread::available_parallelism().map_or(1, usize::from) * 2;
        for shots in by_size.values().flat_map(|shots| shots.chunks(BATCH)) {
            bar.set_message("waiting for all light");
            self.wait_for_light().await?;
            bar.set_message("frames");
            let mut frames = self.frames(shots);
            loop {
                let next = timeout(self.patience, frames.next()).await;
                let next = next.with_context(|| {
                    let secs = self.patience.as_secs_f64();
                    format!("no frame came within {secs} s: see `argus status`, or allow more by --timeout")
                })?;
                let Some((index, result)) = next else { break };
                match result {
                    Ok(frame) => run.write(self, index, frame)?,
                    Err(error) => {
                        let name = &self.cameras.shots[index].name;
                        run.outcome.failed += 1;
                        run.outcome.first_error.get_or_insert_with(|| format!("{name}: {error}"));
                        bar.inc(1);
                    }
                }
                run.take(at_once, journal, bar).await?;
            }
        }
        run.take(1, journal, bar).await?;
        Ok(run.outcome)
    }

    /// The frames of images of one size, as they are done.
    fn frames(&self, shots: &[usize]) -> BoxStream<'static, (usize, Result<Frame, ClientError>)> {
        let shots = shots.to_vec();
        if self.outputs.has(Output::Flow) {
            // A batch has no second camera.
            let views: Vec<(usize, View)> = shots.iter().map(|index| (*index, self.view(*index))).collect();
            let (client, deadline) = (self.client.clone(), self.patience);
            let single = move |(index, view): (usize, View)| {
                let client = client.clone();
                let options = RenderOptions { deadline, ..RenderOptions::default() };
                async move { (index, client.render(&view, &options).await.map(|answer| answer.frame)) }
            };
            return stream::iter(views).map(single).buffer_unordered(SINGLES).boxed();
        }
        let [width, height] = shots.first().map_or([1, 1], |index| self.cameras.shots[*index].size);
        let batch = Batch {
            cameras: shots.iter().map(|index| self.cameras.shots[*index].camera).collect(),
            width,
            height,
            outputs: self.outputs,
            plan: self.plan,
        };
        let frames = self.client.render_batch(batch, Encoding::Unspecified);
        frames.map(move |(at, result)| (shots[at], result.map(|(frame, _)| frame))).boxed()
    }

    /// Waits until views show all light, so that all frames show the same.
    async fn wait_for_light(&self) -> anyhow::Result<()> {
        let until = Instant::now() + self.patience;
        loop {
            match self.client.status().await {
                Ok(status) if status.processes > 0 && light_is_final(&self.client, &status) => return Ok(()),
                Ok(_) => {}
                // A client that may ask for views may not ask for the status: then frames tell.
                Err(ClientError::Refused { .. }) => return Ok(()),
                Err(error) if error.is_transient() => {}
                Err(error) => return Err(error.into()),
            }
            if Instant::now() >= until {
                bail!(
                    "no worker of the service has all light yet: start workers, or allow more by --timeout"
                );
            }
            sleep(PAUSE).await;
        }
    }
}

/// Frames on their way into files.
struct Run {
    /// The specification of the frames before.
    like: Option<Specification>,
    outcome: Outcome,
    writing: JoinSet<anyhow::Result<Entry>>,
}

impl Run {
    /// Begins to write a frame.
    fn write(&mut self, job: &Job, index: usize, frame: Frame) -> anyhow::Result<()> {
        if let (Some(like), Some(mut is)) = (self.like, frame.provenance.specification) {
            // Equal up to rounding along edges; workers choose it.
            is.visibility = like.visibility;
            if let Some(at) = like.difference(&is, &frame.provenance.plan) {
                bail!(
                    "the service renders with {} {}, and earlier frames of this data set with {}: choose another --out",
                    at.field,
                    at.second,
                    at.first
                );
            }
        }
        self.like = self.like.or(frame.provenance.specification);
        let (cameras, writer, view) = (job.cameras.clone(), job.writer.clone(), job.view(index));
        let scene = job.client.description().scene_name.clone();
        self.writing.spawn_blocking(move || {
            let shot = &cameras.shots[index];
            let written = writer.write(shot, &frame)?;
            Ok(Entry { name: shot.name.clone(), written, record: Record::of(&view, &scene, &frame) })
        });
        Ok(())
    }

    /// Enters written frames into the journal until fewer than `most` are being written.
    async fn take(&mut self, most: usize, journal: &mut Journal, bar: &ProgressBar) -> anyhow::Result<()> {
        while self.writing.len() >= most {
            let Some(entry) = self.writing.join_next().await else { break };
            let entry = entry.context("a task of this process failed")??;
            journal.add(&entry)?;
            self.outcome.rendered += 1;
            self.outcome.beyond += entry.written.beyond;
            bar.inc(1);
        }
        ensure!(self.writing.len() < most, "frames are left unwritten");
        Ok(())
    }
}
