//! What the core is told, and what it tells its shell to do.

use std::ops::Add;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::Fault;
use argus_scene::frame::{Decision, Provenance, Reason};
use argus_scene::rig::Survey;
use argus_scene::{Plan, Prediction, SampleId, SceneState, View, Visibility};
use serde::Serialize;

use super::quality::{Cost, Observed};

/// A client, as it is told apart from others: the name of its token, or else its address.
pub type Client = Arc<str>;

/// One joining of one worker process. A process that joins again gets another, so that what its earlier
/// stream still says cannot be mistaken for news.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub struct WorkerId(pub u64);

/// One view on its way through the cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub struct ViewId(pub u64);

/// What a worker does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Renders samples and direct views.
    Sampler,
    /// Reconstructs views from samples.
    Compositor,
    /// Both: the only worker of a cluster.
    Both,
}

impl Role {
    /// Whether samples and direct views are its work.
    pub fn samples(self) -> bool {
        matches!(self, Self::Sampler | Self::Both)
    }

    /// Whether reconstructed views are its work.
    pub fn composites(self) -> bool {
        matches!(self, Self::Compositor | Self::Both)
    }

    /// Whether taking this role after `before` gives something up, so that a queue must be drained first.
    pub fn gives_up_something_of(self, before: Role) -> bool {
        (before.samples() && !self.samples()) || (before.composites() && !self.composites())
    }
}

/// What a worker says of itself when it joins.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Hello {
    /// Chosen by the worker, the same when it joins again.
    pub name: String,
    /// Process id on its machine.
    pub pid: u32,
    /// Where others reach it.
    pub address: String,
    /// Where clients reach it, whose sessions may then be sent there.
    pub public_address: Option<String>,
    /// Adapter, driver and version.
    pub device: String,
    /// CPU cores of its machine.
    pub cores: u32,
}

/// Frames from samples of which a few pixels were traced, to see how well their error was predicted.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Probed {
    /// How many.
    pub count: u64,
    /// Sum of the errors that were found: mean FLIP above that of a direct view.
    pub error: f64,
    /// Sum of the errors that were predicted.
    pub predicted: f64,
}

impl Probed {
    /// The mean error found and the mean error predicted, of the frames that were probed since; `None` of none.
    pub fn since(&self, before: &Self) -> Option<(f64, f64)> {
        let count = self.count.checked_sub(before.count).filter(|count| *count > 0)? as f64;
        Some(((self.error - before.error) / count, (self.predicted - before.predicted) / count))
    }
}

impl Add for Probed {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            error: self.error + other.error,
            predicted: self.predicted + other.predicted,
        }
    }
}

/// What a worker measured. Counts and busy times are since its process started.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Report {
    /// Sequence of the newest assignment that has taken effect; 0: none yet.
    pub applied: u64,
    /// Milliseconds of one process for a sample, over what it rendered lately.
    pub sample_ms: Option<f64>,
    /// Milliseconds of one process for a direct view, over what it rendered lately.
    pub direct_ms: Option<f64>,
    /// Milliseconds of one process for a reconstructed view, over what it rendered lately.
    pub view_ms: Option<f64>,
    /// Milliseconds of one process for a single ray of a pixel that no sample saw, over what it traced lately.
    pub ray_ms: Option<f64>,
    /// Samples that wait or are in work.
    pub queued_samples: u32,
    /// Views that wait or are in work.
    pub queued_views: u32,
    /// Samples rendered.
    pub samples_rendered: u64,
    /// Views reconstructed.
    pub views_composed: u64,
    /// Views rendered directly.
    pub views_direct: u64,
    /// Rays of pixels that no sample saw.
    pub rays_traced: u64,
    /// Milliseconds spent on samples, direct views and single rays.
    pub sampling_busy_ms: f64,
    /// Milliseconds spent on reconstructing.
    pub compositing_busy_ms: f64,
    /// Samples that came from other workers.
    pub samples_received: u64,
    /// Milliseconds spent on unpacking them, beside rendering.
    pub unpacking_ms: f64,
    /// Milliseconds of its render thread, part of what reconstructing took, for taking samples up.
    pub holding_ms: f64,
    /// Samples it can serve and reconstruct from.
    pub held: Vec<SampleId>,
    /// It is about to leave.
    pub leaving: bool,
    /// Milliseconds that its render thread has been at the piece of work that it is at; 0 while it waits, or gets ready.
    pub piece_ms: f64,
    /// Milliseconds of one process for a part of a sample that nobody waits for: how long a view waits that comes while one
    /// is rendered.
    pub part_ms: Option<f64>,
    /// Share of the samples in work that is rendered, 0 to 1; `None` while none is in work.
    pub sample_progress: Option<f64>,
    /// Texel bytes of the largest sample that it keeps; 0: it keeps none.
    pub sample_bytes: u64,
    /// What a view from triangles costs there; measured before it is ready.
    pub direct_cost: Option<Cost>,
    /// What a view from samples costs there.
    pub warp_cost: Option<Cost>,
    /// How well the errors of frames from samples are predicted.
    pub probed: Probed,
    /// What each way to see triangles costs there, ms for a tile of a sample; where it was told to measure.
    pub ways: Vec<(Visibility, f64)>,
}

/// A session's last answered view whose request left the way open.
#[derive(Debug, Clone, PartialEq)]
pub struct LastView {
    /// What was asked for.
    pub view: View,
    /// What its frame was made of.
    pub provenance: Provenance,
    /// Why it was answered so.
    pub reason: Reason,
    /// Time since the session's frames last changed their way; `None`: they never did.
    pub since_change: Option<Duration>,
}

/// How an attempt at a view ended without its frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// Another worker may succeed, and nothing says that this one is at fault.
    TryElsewhere,
    /// Another worker may succeed: the failure is this worker's own.
    OfWorker,
    /// The failure is the view's own, or part of the frame is already with the client.
    Final,
}

/// What happened.
#[derive(Debug, Clone)]
#[allow(
    clippy::large_enum_variant,
    reason = "one event exists at a time, and most are reports, the largest kind"
)]
pub enum Event {
    /// A worker joined.
    Joined {
        /// Given by the shell, never used before.
        worker: WorkerId,
        /// What it says of itself.
        hello: Hello,
    },
    /// A worker reported.
    Reported {
        /// Which.
        worker: WorkerId,
        /// What.
        report: Report,
    },
    /// A worker's stream ended.
    Left {
        /// Which.
        worker: WorkerId,
    },
    /// A validated view is asked for.
    Requested {
        /// Given by the shell, never used before.
        view_id: ViewId,
        /// Which client asks.
        client: Client,
        /// What is asked for.
        view: Box<View>,
        /// The answer is worthless after this.
        deadline: Option<Duration>,
        /// What the view will show, where that is known: see [`super::Core::survey_wanted`].
        survey: Option<Box<Survey>>,
        /// Its session's last view, where it has one.
        last: Option<Box<LastView>>,
    },
    /// What a view shows is known, and which samples would show it: see [`super::Core::bundle_survey_wanted`].
    Surveyed {
        /// Of the view, sub-pixels counted.
        pixels: u64,
        /// What it shows.
        survey: Box<Survey>,
    },
    /// The frame of an attempt that is to be judged begins to arrive; [`Action::Deliver`] or another
    /// [`Action::Dispatch`] follows.
    Judged {
        /// Which view.
        view_id: ViewId,
        /// Of [`Order::attempt`].
        attempt: u32,
        /// What its pixels say; absent if the worker did not tell.
        observed: Option<Observed>,
        /// Milliseconds that rendering it took.
        ms: f64,
    },
    /// The frame of an attempt was relayed whole.
    Answered {
        /// Which view.
        view_id: ViewId,
        /// Of [`Order::attempt`].
        attempt: u32,
        /// Pixels that none of the plan's samples saw, whatever became of them; absent where nobody says.
        uncovered: Option<u64>,
        /// Milliseconds that rendering it took, unless [`Event::Judged`] said so already.
        ms: Option<f64>,
    },
    /// An attempt failed.
    Failed {
        /// Which view.
        view_id: ViewId,
        /// Of [`Order::attempt`].
        attempt: u32,
        /// What may still help.
        failure: Failure,
    },
    /// Nobody waits for the view any more.
    Cancelled {
        /// Which view.
        view_id: ViewId,
    },
    /// A client opened a session; [`super::Core::check_session`] let it.
    SessionOpened {
        /// Who.
        client: Client,
    },
    /// A session ended.
    SessionClosed {
        /// Whose.
        client: Client,
    },
    /// A session's camera was overtaken by a newer one before it was rendered.
    CameraSuperseded,
    /// No new views from here on.
    Drain,
    /// Time passed; sent several times a tick.
    Tick,
}

/// What a worker is told to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assignment {
    /// Ascending for a worker, from 1.
    pub sequence: u64,
    /// What it shall do once what it then no longer does is finished.
    pub role: Role,
    /// Samples that it shall have at hand ahead of demand, in place of those it was told before;
    /// without an address, it renders them itself when nothing else waits.
    pub prefetch: Vec<Source>,
    /// Samples of versions with a lower number are of no use any more.
    pub kept_from: u64,
    /// It shall measure what each way to see triangles costs, and report that with this assignment.
    pub measure_ways: bool,
    /// Addresses of workers that seem to hang: what is awaited from there is to be had elsewhere.
    pub suspected: Vec<String>,
}

/// The workers that hold or can render a sample, best first. Where none of them has it, the worker renders it itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Which sample.
    pub id: SampleId,
    /// Addresses of workers.
    pub addresses: Vec<String>,
    /// The view can do without it: where none of them has it, it goes back ([`Failure::TryElsewhere`]) and gets a plan
    /// without it, since no view waits for a refinement to be rendered.
    pub dispensable: bool,
}

/// A view for a worker.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Number of the attempt at the view, from 1.
    pub attempt: u32,
    /// Which worker shall answer.
    pub worker: WorkerId,
    /// Where it is.
    pub address: String,
    /// What of the scene it shows: what the version of the plan's samples shows.
    pub state: SceneState,
    /// How.
    pub plan: Plan,
    /// Where the plan's samples are, for those the worker may lack.
    pub sources: Vec<Source>,
    /// Addresses of those who can trace the pixels that no sample saw, best first; none where the plan does not
    /// want that, or where the worker is the only one who can.
    pub tracers: Vec<String>,
    /// What is expected of the frame.
    pub expected: Option<Prediction>,
    /// Whether the worker shall look at the frame, and [`Event::Judged`] decide whether it is delivered.
    pub judged: bool,
    /// How the plan was chosen; `None` where the request, or its pin, named it.
    pub decision: Option<Decision>,
    /// Samples a pixel of the direct view that the worker renders instead, where it lacks a sample of the plan or its frame
    /// from samples is not good enough.
    pub fallback: Option<u32>,
}

/// What the shell must do.
#[derive(Debug, Clone)]
pub enum Action {
    /// Tell a worker its role.
    Assign {
        /// Which worker.
        worker: WorkerId,
        /// What.
        assignment: Assignment,
    },
    /// End a worker's stream: it is lost, replaced or unknown. If it lives it joins again.
    Expel {
        /// Which worker.
        worker: WorkerId,
        /// Why, for the log and for the worker.
        reason: String,
    },
    /// Send a view to a worker; an earlier attempt at it, if any, is void.
    Dispatch {
        /// Which view.
        view_id: ViewId,
        /// To whom and how.
        order: Box<Order>,
    },
    /// Let the frame that was judged pass.
    Deliver {
        /// Which view.
        view_id: ViewId,
        /// Of [`Order::attempt`].
        attempt: u32,
        /// What is expected of it, now that it was looked at.
        expected: Prediction,
    },
    /// Answer a view with a fault; it is forgotten.
    Refuse {
        /// Which view.
        view_id: ViewId,
        /// Why.
        fault: Fault,
    },
}
