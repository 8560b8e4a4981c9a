//! The state that all pages share, and the encoding of their images.

use std::sync::Arc;

use argus_client::Client;
use argus_scene::{Camera, Frame, Output, PlanRequest};
use glam::DVec3;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::access::Access;
use super::simulated_link::LinkSettings;
use super::viewers::Viewers;

/// Largest number of single frames in work.
pub(super) const MAX_FRAMES: usize = 16;

/// Largest number of open pages, each with a session of the service.
pub(super) const MAX_PAGES: usize = 16;

/// State shared by all pages.
pub(super) struct Site {
    pub(super) access: Access,
    /// The requested plan of each view, unless it asks for a direct one.
    pub(super) plan: PlanRequest,
    /// Whether only this machine can reach the server.
    pub(super) local: bool,
    /// A link that is simulated between pages and their bridges.
    pub(super) link: Option<LinkSettings>,
    /// Where viewers are who want to be seen.
    pub(super) viewers: Viewers,
    pub(super) frames: Semaphore,
    pub(super) pages: Arc<Semaphore>,
    /// Cancelled when pages must end.
    pub(super) closing: CancellationToken,
    /// The tasks of open pages.
    pub(super) open: TaskTracker,
}

impl Site {
    pub(super) fn new(access: Access, plan: PlanRequest, local: bool, link: Option<LinkSettings>) -> Self {
        Self {
            access,
            plan,
            local,
            link,
            viewers: Viewers::default(),
            frames: Semaphore::new(MAX_FRAMES),
            pages: Arc::new(Semaphore::new(MAX_PAGES)),
            closing: CancellationToken::new(),
            open: TaskTracker::new(),
        }
    }
}

/// The default camera of a view: the scene's first one.
pub(super) fn usual_camera(client: &Client) -> Camera {
    let named = client.description().cameras.first();
    named.map_or(Camera::look_at(DVec3::ONE, DVec3::ZERO), |named| named.camera)
}

/// Encodes a frame's colour as JPEG of a quality, 1 to 100. Takes milliseconds: do not call it on an async thread.
pub(super) fn jpeg(frame: &Frame, quality: u8) -> anyhow::Result<Vec<u8>> {
    let Some(color) = &frame.images[Output::Color] else { anyhow::bail!("the frame has no colour") };
    argus_proto::jpeg::encode(color, frame.width, frame.height, quality)
        .ok_or_else(|| anyhow::anyhow!("{} × {} pixels are too many for a JPEG", frame.width, frame.height))
}
