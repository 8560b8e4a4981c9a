//! Inputs and outputs of the core: events, actions, and what they carry.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::Fault;
use argus_proto::v1::LightCells;
use argus_scene::effects::EffectCost;
use argus_scene::frame::{Decision, Provenance, Reason};
use argus_scene::{
    FaceMask, FrameSource, LightLevel, Plan, Prediction, SampleId, SceneState, View, Visibility,
};
use serde::Serialize;

use super::quality::{Cost, Observed};

/// A client's identity: the name of its token, or else its address.
pub type Client = Arc<str>;

/// Identifies one joining of a worker process. A process that joins again gets a new id, so that messages of its
/// earlier stream are ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub struct WorkerId(pub u64);

/// Identifies a view within the core. Ids ascend with arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub struct ViewId(pub u64);

/// The role of a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Renders samples and direct views.
    Sampler,
    /// Reconstructs views from samples.
    Compositor,
    /// Both roles: the only worker of a cluster.
    Both,
}

impl Role {
    /// Whether the role renders samples and direct views.
    pub fn samples(self) -> bool {
        matches!(self, Self::Sampler | Self::Both)
    }

    /// Whether the role reconstructs views.
    pub fn composites(self) -> bool {
        matches!(self, Self::Compositor | Self::Both)
    }

    /// Whether changing from `before` to this role gives up kinds of work, so that a queue must be drained first.
    pub fn gives_up_something_of(self, before: Role) -> bool {
        (before.samples() && !self.samples()) || (before.composites() && !self.composites())
    }
}

/// A worker's introduction when it joins.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Hello {
    /// A name chosen by the worker, which it keeps when it joins again.
    pub name: String,
    /// Process id on its machine.
    pub pid: u32,
    /// The address for other processes of the cluster.
    pub address: String,
    /// The address for clients, whose sessions may be redirected there; `None`: clients cannot reach it.
    pub public_address: Option<String>,
    /// Adapter, driver and version of its device.
    pub device: String,
    /// Number of CPU cores of its machine.
    pub cores: u32,
}

/// A source that a worker must render: a direct frame that other views are warped from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Purchase {
    /// The frame. Without a light, the worker lights it by cells if they are filled, else by rays.
    pub source: FrameSource,
    /// The state of the scene that it shows.
    pub state: SceneState,
}

/// A source that a worker holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeldSource {
    /// Its id as a sample, of version [`SampleId::FRAMES`].
    pub id: SampleId,
    /// The frame, with the light that it has.
    pub source: FrameSource,
    /// The state of the scene that it shows.
    pub state: SceneState,
    /// The visibility backend that rendered it.
    pub visibility: Visibility,
    /// Inverse range in 1/m at the centres of a grid of [`FrameSource::GRID`] over its image, row by row; 0: sky or none.
    #[serde(skip)]
    pub ranges: Arc<[f32]>,
    /// Whether it was rendered for the cluster, and not for a client's view.
    pub bought: bool,
    /// Milliseconds of rendering it; 0 if another worker did.
    pub render_ms: f32,
}

/// Changes of the sources that a worker holds.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct SourceNews {
    /// `added` is the beginning of all that it holds: forget what it reported before.
    pub whole: bool,
    /// Sources that it holds since its last report.
    pub added: Vec<HeldSource>,
    /// Sources that it dropped since then.
    pub dropped: Vec<SampleId>,
}

/// Errors of a frame and of other plans of its view, as a worker measured them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProbeResult {
    /// The view.
    pub view_id: ViewId,
    /// The number of the attempt, [`Order::attempt`].
    pub attempt: u32,
    /// Mean FLIP of the answered frame, and then of each plan of [`Order::probe`], minus that of the view from triangles at
    /// one sample a pixel, all against 16 samples. NaN: not measured.
    pub excess: Vec<f32>,
}

/// A worker's report of its measurements. Counts and busy times are since its process started.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Report {
    /// Sequence number of the newest assignment in effect; 0: none yet.
    pub applied: u64,
    /// Recent milliseconds of one process for a sample.
    pub sample_ms: Option<f64>,
    /// Recent milliseconds of one process for a direct view.
    pub direct_ms: Option<f64>,
    /// Recent milliseconds of one process for a reconstructed view.
    pub view_ms: Option<f64>,
    /// Recent milliseconds of one process for a single ray, for a pixel that no sample saw.
    pub ray_ms: Option<f64>,
    /// Samples queued or in work.
    pub queued_samples: u32,
    /// Views queued or in work.
    pub queued_views: u32,
    /// Number of samples rendered.
    pub samples_rendered: u64,
    /// Number of views reconstructed.
    pub views_composed: u64,
    /// Number of views rendered from triangles.
    pub views_direct: u64,
    /// Number of rays traced for pixels that no sample saw.
    pub rays_traced: u64,
    /// Busy milliseconds of samples, direct views and single rays.
    pub sampling_busy_ms: f64,
    /// Busy milliseconds of reconstruction.
    pub compositing_busy_ms: f64,
    /// Number of samples received from other workers.
    pub samples_received: u64,
    /// Milliseconds of unpacking them, outside of the render thread.
    pub unpacking_ms: f64,
    /// Milliseconds of its render thread for uploading samples; part of the time of reconstruction.
    pub holding_ms: f64,
    /// Samples that it can serve and reconstruct from.
    pub held: Vec<SampleId>,
    /// Samples of `held` that lack faces, with the faces that they have.
    pub partial: Vec<(SampleId, FaceMask)>,
    /// Whether it is about to leave.
    pub leaving: bool,
    /// Milliseconds since its render thread began its present piece of work; 0 while it waits or starts.
    pub piece_ms: f64,
    /// Milliseconds of one process for a slice of a sample that no view waits for. A view that arrives meanwhile
    /// waits for as long.
    pub part_ms: Option<f64>,
    /// Share of the samples in work that is rendered, 0 to 1; `None` while none is in work.
    pub sample_progress: Option<f64>,
    /// Texel bytes of the largest sample that it holds; 0: none.
    pub sample_bytes: u64,
    /// The best light that its sampler has ready.
    pub light: LightLevel,
    /// Cost of a view from triangles. Measured in slices once the worker can answer.
    pub direct_cost: Option<Cost>,
    /// Cost of a view from triangles with few rays of light, by the pixels that are rendered.
    pub few_rays_cost: Option<Cost>,
    /// Cost of a view from samples.
    pub warp_cost: Option<Cost>,
    /// Cost of a view that is warped from recent frames.
    pub frame_cost: Option<Cost>,
    /// What effects of light cost in views from triangles. For people: no decision reads it.
    pub effect_costs: Vec<EffectCost>,
    /// Number of recent frames that it keeps.
    pub frames_held: u64,
    /// Their bytes.
    pub frames_bytes: u64,
    /// The light cells of its sampler; `None` without any.
    pub light_cells: Option<LightCells>,
    /// The sources that it holds, or their changes; `None`: no change.
    pub sources: Option<SourceNews>,
    /// Errors that it measured since its last report.
    pub probes: Vec<ProbeResult>,
    /// Cost of each visibility backend, milliseconds for a tile of a sample, if the assignment asked for them.
    pub backend_costs: Vec<(Visibility, f64)>,
}

impl Report {
    /// What a report says of the process alone. Costs and samples are of the scene that the process has open.
    pub fn of_process(self) -> Self {
        let Self { applied, queued_samples, queued_views, leaving, piece_ms, .. } = self;
        Self { applied, queued_samples, queued_views, leaving, piece_ms, ..Self::default() }
    }
}

/// A session's last answered view, whose request left the way open.
#[derive(Debug, Clone, PartialEq)]
pub struct LastView {
    /// The requested view.
    pub view: View,
    /// Its frame's provenance.
    pub provenance: Provenance,
    /// The planner's reason for its plan.
    pub reason: Reason,
}

/// Why an attempt at a view failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// Another worker may succeed; this one is not at fault.
    TryElsewhere,
    /// Another worker may succeed; this one is at fault.
    OfWorker,
    /// No other worker can succeed: the view itself is at fault, or the client has part of the frame.
    Final,
}

/// An event: an input of the core.
#[derive(Debug, Clone)]
#[allow(
    clippy::large_enum_variant,
    reason = "one event exists at a time, and most are reports, the largest kind"
)]
pub enum Event {
    /// A worker joined.
    Joined {
        /// A new id from the shell.
        worker: WorkerId,
        /// Its introduction.
        hello: Hello,
    },
    /// A worker reported.
    Reported {
        /// The worker.
        worker: WorkerId,
        /// The report.
        report: Report,
    },
    /// A worker's stream ended.
    Left {
        /// The worker.
        worker: WorkerId,
    },
    /// A client requested a view, which was validated.
    Requested {
        /// A new id from the shell.
        view_id: ViewId,
        /// The client.
        client: Client,
        /// The view.
        view: Box<View>,
        /// Time until the answer is worthless; `None`: no deadline.
        deadline: Option<Duration>,
        /// The session's last view, if there is one.
        last: Option<Box<LastView>>,
    },
    /// The header of a frame that must be judged arrived. [`Action::Deliver`] or another [`Action::Dispatch`]
    /// follows.
    Judged {
        /// The view.
        view_id: ViewId,
        /// The number of the attempt, [`Order::attempt`].
        attempt: u32,
        /// The statistics of its pixels; `None` if the worker sent none.
        observed: Option<Observed>,
        /// Milliseconds of rendering.
        ms: f64,
    },
    /// The client has the whole frame of an attempt.
    Answered {
        /// The view.
        view_id: ViewId,
        /// The number of the attempt, [`Order::attempt`].
        attempt: u32,
        /// Number of pixels that none of the plan's samples saw, whether or not they were traced; `None` if unknown.
        uncovered: Option<u64>,
        /// Milliseconds of rendering, unless [`Event::Judged`] reported them.
        ms: Option<f64>,
        /// Whether the worker rendered the frame from triangles, since the one by its plan was not good enough.
        fell_short: bool,
    },
    /// An attempt failed.
    Failed {
        /// The view.
        view_id: ViewId,
        /// The number of the attempt, [`Order::attempt`].
        attempt: u32,
        /// Whether a retry may help.
        failure: Failure,
    },
    /// The client cancelled the view.
    Cancelled {
        /// The view.
        view_id: ViewId,
    },
    /// A client opened a session, which [`super::Core::check_session`] allowed.
    SessionOpened {
        /// The client.
        client: Client,
    },
    /// A session ended.
    SessionClosed {
        /// The client.
        client: Client,
    },
    /// A session's camera was superseded before it was rendered.
    CameraSuperseded,
    /// Refuse new views from now on.
    Drain,
    /// Time passed. Sent several times a tick.
    Tick,
}

/// An assignment: what a worker must do.
#[derive(Debug, Clone, PartialEq)]
pub struct Assignment {
    /// Sequence number, ascending from 1 for each worker.
    pub sequence: u64,
    /// The role. Work that the role gives up is finished first.
    pub role: Role,
    /// Samples to hold ahead of demand. Replaces the previous list. The worker renders a sample without addresses
    /// itself, when nothing else waits.
    pub prefetch: Vec<Source>,
    /// Sources to render, in this order, one at a time, in slices between views. Replaces the previous list. The worker
    /// leaves out those that it holds and those that it failed at.
    pub purchases: Vec<Purchase>,
    /// Samples of versions below this number can be dropped.
    pub kept_from: u64,
    /// Whether to measure each visibility backend, and to report the costs with this assignment.
    pub measure_backends: bool,
    /// Addresses of suspected workers: samples awaited from them must be fetched elsewhere.
    pub suspected: Vec<String>,
    /// Addresses of other workers that hold light cells.
    pub cell_holders: Vec<String>,
}

#[cfg(test)]
impl Report {
    /// The faces of a sample that is held.
    pub(in crate::core) fn faces(&self, id: SampleId) -> FaceMask {
        self.partial.iter().find(|(partial, _)| *partial == id).map_or(FaceMask::ALL, |(_, faces)| *faces)
    }
}

/// Where to get a sample. A worker that finds it at no address renders it itself.
///
/// A sample of version [`SampleId::FRAMES`] is a frame of the plan, by the id of its [`HeldSource`]. If no address has it, the
/// order's fallback is rendered; a frame of a pinned view is rendered again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The sample, or the frame.
    pub id: SampleId,
    /// The faces that are needed.
    pub faces: FaceMask,
    /// Addresses of workers that hold or can render it, best first.
    pub addresses: Vec<String>,
    /// Whether the view can do without it. If no address has it, the attempt fails with [`Failure::TryElsewhere`],
    /// and the view gets a plan without it: no view waits for a refinement.
    pub dispensable: bool,
}

/// What replaces a frame from samples that is not good enough.
#[derive(Debug, Clone, PartialEq)]
pub struct Fallback {
    /// A view from triangles, in as much detail as there is time for.
    pub plan: Plan,
    /// Share of pixels that no source saw, beyond which the frame is replaced.
    pub max_uncovered: f64,
}

/// An order: a view for a worker.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// The view.
    pub view_id: ViewId,
    /// Number of the attempt, from 1.
    pub attempt: u32,
    /// The worker.
    pub worker: WorkerId,
    /// The worker's address.
    pub address: String,
    /// The state of the scene that the view shows.
    pub state: SceneState,
    /// The plan. Its frames without a light are used as the worker holds them.
    pub plan: Plan,
    /// Where to get the plan's samples and frames that the worker may lack.
    pub sources: Vec<Source>,
    /// Addresses of workers that trace the pixels that no sample saw, best first. Empty if the plan traces none, or
    /// if only this worker can.
    pub tracers: Vec<String>,
    /// The predicted error and time of the frame.
    pub expected: Option<Prediction>,
    /// Whether the worker must report statistics of the frame, by which [`Event::Judged`] accepts or rejects it.
    pub judged: bool,
    /// The planner's decision; `None` if the request or its pin named the plan.
    pub decision: Option<Decision>,
    /// What replaces the frame, if the worker lacks a sample or the frame from samples is not good enough.
    pub fallback: Option<Fallback>,
    /// Whether the worker keeps the frame, if it is from triangles, to warp other views from it.
    pub keeps_frame: bool,
    /// Other plans of the view, whose errors the worker measures in spare time, with that of the answered frame; `None`: no probe.
    pub probe: Option<Vec<Plan>>,
}

/// An action that the shell must execute.
#[derive(Debug, Clone)]
pub enum Action {
    /// Send a worker its assignment.
    Assign {
        /// The worker.
        worker: WorkerId,
        /// The assignment.
        assignment: Assignment,
    },
    /// End a worker's stream, since the worker is lost, replaced or unknown. If it lives, it joins again.
    Expel {
        /// The worker.
        worker: WorkerId,
        /// The reason, for the log and for the worker.
        reason: String,
    },
    /// Send a view to a worker. Earlier attempts are void.
    Dispatch {
        /// The view.
        view_id: ViewId,
        /// The order.
        order: Box<Order>,
    },
    /// Deliver the judged frame.
    Deliver {
        /// The view.
        view_id: ViewId,
        /// The number of the attempt, [`Order::attempt`].
        attempt: u32,
        /// The prediction after the judgement.
        expected: Prediction,
    },
    /// Answer a view with a fault, and forget it.
    Refuse {
        /// The view.
        view_id: ViewId,
        /// The fault.
        fault: Fault,
    },
}
