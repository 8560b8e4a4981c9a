//! Lights leaf sides in a thread of their own, while other light is shown.
//!
//! The thread takes half of the cores at most, at low priority: views that are rendered meanwhile take precedence.

use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex};
use std::thread::available_parallelism;

use argus_scene::{LightLevel, Lighting, RenderError};

use super::super::tracing::LightTracing;
use super::lit_leaves::LitLeaves;
use crate::surfaces::Surfaces;

/// Added to the priority of threads, where larger is less urgent: a third of the time of a thread that competes, so that light
/// comes to busy services, too.
#[cfg(target_os = "linux")]
const NICE: i32 = 5;

/// Leaf sides that another thread lights. If it is dropped, the thread finishes its work, which is then discarded.
pub(super) struct Preparation {
    light: LightLevel,
    lighting: Lighting,
    /// Whether things moved since it began.
    is_outdated: bool,
    /// Behind a lock, since samplers are shared between threads.
    result: Mutex<Receiver<Result<LitLeaves, RenderError>>>,
}

impl Preparation {
    /// Begins to light leaf sides of a level.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if threads cannot be started.
    pub(super) fn begin(
        mut leaves: LitLeaves,
        surfaces: &Arc<Surfaces>,
        tracing: &Arc<LightTracing>,
        light: LightLevel,
    ) -> Result<Self, RenderError> {
        let failed = |error: &dyn std::fmt::Display| {
            RenderError::Internal(format!("no thread can be started to prepare indirect light: {error}"))
        };
        let cores = available_parallelism().map_or(1, usize::from);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads((cores / 2).max(1))
            .thread_name(|number| format!("light {number}"))
            .start_handler(|_| yield_to_views())
            .build()
            .map_err(|error| failed(&error))?;
        let (sender, result) = channel();
        let (surfaces, tracing, lighting) = (surfaces.clone(), tracing.clone(), tracing.lighting.clone());
        let prepare = move || {
            let lit = pool.install(|| leaves.ready(&surfaces, &tracing));
            // The receiver is gone if the light is no longer needed.
            let _ = sender.send(lit.map(|_| leaves));
        };
        std::thread::Builder::new()
            .name("light".to_owned())
            .spawn(prepare)
            .map_err(|error| failed(&error))?;
        Ok(Self { light, lighting, is_outdated: false, result: Mutex::new(result) })
    }

    /// Says that things moved: what is prepared is of an earlier pose.
    pub(super) fn outdate(&mut self) {
        self.is_outdated = true;
    }

    /// Whether things moved since it began.
    pub(super) fn is_outdated(&self) -> bool {
        self.is_outdated
    }

    /// The level that it prepares.
    pub(super) fn level(&self) -> LightLevel {
        self.light
    }

    /// Whether it prepares this level under these lights.
    pub(super) fn is_of(&self, light: LightLevel, lighting: &Lighting) -> bool {
        self.light == light && self.lighting == *lighting
    }

    /// The lit leaf sides; `None` while the thread works.
    pub(super) fn prepared(&mut self) -> Option<Result<LitLeaves, RenderError>> {
        let received =
            self.result.get_mut().map_or(Err(TryRecvError::Disconnected), |result| result.try_recv());
        match received {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                let reason = "the thread that prepares indirect light ended early";
                Some(Err(RenderError::Internal(reason.to_owned())))
            }
        }
    }
}

/// Lowers the priority of the present thread, where threads have priorities of their own.
fn yield_to_views() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(NICE) {
        tracing::debug!(%error, "threads that prepare light keep their priority");
    }
}
