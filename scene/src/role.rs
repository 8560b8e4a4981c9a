//! The two roles a process can play, as traits: `sampler` and `compositor` implement them, the cluster's
//! worker drives them, and neither knows the other.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::{Camera, Frame, Outputs, Plan, RenderError, Sample, SampleId, SampleSet, SampleSetInfo};

/// A flag that whoever waits for a result raises when it no longer does. Renders look at it between
/// submissions, so a batch ends early rather than at once.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Not cancelled.
    pub fn new() -> Self {
        Self::default()
    }

    /// Says that nobody waits any more.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether nobody waits any more.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

/// An order for samples.
#[derive(Debug, Clone)]
pub struct SampleJob {
    /// Scene, rig, epoch, generation and lighting they shall have.
    pub info: Arc<SampleSetInfo>,
    /// Which cameras of the rig.
    pub ids: Vec<SampleId>,
    /// Whether the planes are to be read back (another process needs them) or stay on the device.
    pub to_host: bool,
}

/// An order for one view; validated, its plan complete.
#[derive(Debug, Clone)]
pub struct ViewJob {
    /// Viewpoint.
    pub camera: Camera,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Which images.
    pub outputs: Outputs,
    /// How.
    pub plan: Plan,
    /// Scene time.
    pub epoch: u64,
}

/// Renders from triangles: samples for others, and direct views.
pub trait Sampler: Send {
    /// Kind of device, as [`crate::Provenance::device`] has it.
    fn device(&self) -> &str;

    /// Renders the samples of `job`, one result each, in order.
    fn render_samples(&mut self, job: &SampleJob, cancel: &Cancel) -> Vec<Result<Sample, RenderError>>;

    /// Renders views whose plan is [`Plan::Direct`], one result each, in order.
    fn render_views(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>>;
}

/// Reconstructs views from samples; never sees a triangle.
pub trait Compositor: Send {
    /// Kind of device, as [`crate::Provenance::device`] has it.
    fn device(&self) -> &str;

    /// Takes samples in, replacing those of the same id.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they do not fit, [`RenderError::Invalid`] if a plane is malformed.
    fn hold(&mut self, set: &SampleSet) -> Result<(), RenderError>;

    /// Forgets samples; unknown ids are ignored.
    fn release(&mut self, ids: &[SampleId]);

    /// Reconstructs views whose plan is [`Plan::Warp`], one result each, in order. Views of different
    /// sizes and plans may share a batch; that they do never shows in their bytes.
    fn compose(&mut self, views: &[ViewJob], cancel: &Cancel) -> Vec<Result<Frame, RenderError>>;
}
