//! What follows from a view for workers and samples: returned here, passed on by the machine.

use argus_scene::{Camera, SampleId};

use crate::core::event::{Action, ViewId, WorkerId};
use crate::core::workers::WorkKind;

/// One thing that follows from what became of a view.
#[derive(Debug, Clone)]
pub(in crate::core) enum Output {
    /// The shell has something to do.
    Act(Action),
    /// A view of that kind is asked for.
    Demand(WorkKind),
    /// A plan names the samples of these cameras.
    Used {
        /// Which.
        cameras: Vec<u64>,
    },
    /// A worker answered a view.
    Answered {
        /// Which worker.
        worker: WorkerId,
        /// From the triangles.
        direct: bool,
        /// Pixels that were rendered for it, sub-pixels counted.
        work: u64,
    },
    /// A worker failed at a view by its own fault.
    Blamed {
        /// Which worker.
        worker: WorkerId,
        /// Which view.
        view_id: ViewId,
    },
    /// A worker no longer has a view.
    TakenBack {
        /// Which worker.
        worker: WorkerId,
        /// Which view.
        view_id: ViewId,
        /// What the view was made from.
        samples: Vec<SampleId>,
        /// Its frame is there: the worker holds what it needed.
        answered: bool,
    },
    /// A frame has pixels that none of its samples saw.
    Holes {
        /// Where the view was.
        camera: Camera,
        /// Whose samples it used.
        used: Vec<u64>,
        /// How many pixels no sample saw.
        uncovered: u64,
        /// How many pixels there are.
        pixels: u64,
    },
    /// Samples of these cameras saved a view some time.
    Saved {
        /// Whose samples it used.
        cameras: Vec<u64>,
        /// Seconds of one process.
        secs: f64,
    },
    /// Samples of these cameras would have saved views some time.
    WouldSave {
        /// Whose samples they would have used.
        cameras: Vec<u64>,
        /// Seconds of one process.
        secs: f64,
    },
}
