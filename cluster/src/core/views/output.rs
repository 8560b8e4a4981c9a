//! Outputs of views for the other parts. They are returned here, and applied by the machine.

use argus_scene::{Camera, FaceMask, SampleId};

use crate::core::event::{Action, ViewId, WorkerId};
use crate::core::workers::WorkKind;

/// One output of a view for workers, samples or the shell.
#[derive(Debug, Clone)]
pub(in crate::core) enum Output {
    /// An action for the shell.
    Act(Action),
    /// Demand for a view of this kind.
    Demand(WorkKind),
    /// A plan uses samples of these cameras.
    Used {
        /// The cameras.
        cameras: Vec<u64>,
    },
    /// A worker answered a view.
    Answered {
        /// The worker.
        worker: WorkerId,
        /// Whether it was rendered from triangles.
        direct: bool,
        /// Pixels that were rendered, with sub-pixels.
        work: u64,
    },
    /// A worker failed at a view, and is at fault.
    Blamed {
        /// The worker.
        worker: WorkerId,
        /// The view.
        view_id: ViewId,
    },
    /// A view left a worker's queue.
    TakenBack {
        /// The worker.
        worker: WorkerId,
        /// The view.
        view_id: ViewId,
        /// The samples of the view's plan, with the faces that it used.
        samples: Vec<(SampleId, FaceMask)>,
        /// Whether it was answered, so that the worker holds its samples.
        answered: bool,
    },
    /// Holes of a frame: pixels that none of its samples saw.
    Holes {
        /// The view's camera.
        camera: Camera,
        /// The cameras whose samples it used.
        used: Vec<u64>,
        /// Number of pixels that no sample saw.
        uncovered: u64,
        /// Number of all pixels.
        pixels: u64,
    },
}
