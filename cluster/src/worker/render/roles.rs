//! Makes the two roles: a sampler in another thread, so that views are composed meanwhile, and anew after the loss of a device.

use std::sync::Arc;
use std::time::Instant;

use argus_scene::{Compositor, LightLevel, RenderError, SampleSetInfo, Sampler, Scene};
use tracing::{debug, info, warn};

use super::{Renderer, ms_since};
use crate::RoleFactory;
use crate::core::Role;
use crate::rate_limited_log::RateLimitedLog;
use crate::worker::queue::{Background, Queue, Work};
use crate::worker::warm;

/// A guard: while it lives, work that needs a sampler waits for one.
struct BeingMade(Arc<Queue>);

impl BeingMade {
    fn begin(queue: &Arc<Queue>) -> Self {
        queue.begin_sampler();
        Self(queue.clone())
    }
}

impl Drop for BeingMade {
    fn drop(&mut self) {
        self.0.end_sampler();
    }
}

impl Renderer {
    /// Returns the work, if it needs no sampler or one exists. Else postpones it and makes a sampler in another
    /// thread. A hierarchy over a scene's triangles takes a second or more, in which views are composed from held
    /// samples.
    pub(super) fn or_postpone(&mut self, work: Work) -> Work {
        if let Work::Prepare { info, .. } = &work {
            self.set = Some(info.clone());
        }
        if self.sampler.is_some() || !work.needs_sampler() {
            return work;
        }
        if let Some(set) = self.set.clone() {
            self.stand_by(set);
        }
        self.queue.postpone(work).unwrap_or(Work::Nothing)
    }

    /// Makes the sampler. Every role needs one, since a worker answers views from triangles in any role.
    pub(super) fn prepare(&mut self, role: Role) -> Result<(), RenderError> {
        self.role = role;
        self.sampler().map(drop)
    }

    /// Begins to make a sampler in another thread, unless one exists or is being made.
    pub(super) fn stand_by(&mut self, info: Arc<SampleSetInfo>) {
        let (None, None, Some(scene)) = (&self.sampler, &self.standby, self.scene.clone()) else { return };
        let (factory, being_made) = (self.factory.clone(), BeingMade::begin(&self.queue));
        let make = move || {
            let _being_made = being_made;
            warmed_sampler(factory.as_ref(), scene, &info)
        };
        // Without a thread, the sampler is made when it is needed.
        self.standby = std::thread::Builder::new().name("standby".to_owned()).spawn(make).ok();
    }

    /// Abandons the standby sampler. Its thread ends by itself.
    pub(super) fn retire_standby(&mut self) {
        self.retired.retain(|standby| !standby.is_finished());
        self.retired.extend(self.standby.take());
    }

    /// The sampler, made now if necessary.
    pub(super) fn sampler(&mut self) -> Result<&mut dyn Sampler, RenderError> {
        if self.sampler.is_none() {
            let scene_and_set = self.scene.clone().zip(self.set.clone());
            let (scene, set) =
                scene_and_set.ok_or_else(|| RenderError::Internal("no scene yet".to_owned()))?;
            let (standby, factory) = (self.standby.take(), self.factory.as_ref());
            let made = self.queue.making_role(|| {
                match standby.and_then(|thread| thread.join().ok()).and_then(Result::ok) {
                    Some(made) => Ok(made),
                    None => made_sampler(factory, scene, &set),
                }
            });
            let sampler = made.inspect_err(|error| self.health.failed(&error.to_string()))?;
            // Its first views had the light of the set's version.
            self.light_rises = set.first_light() == LightLevel::Direct;
            self.light = if self.light_rises { set.version.state.light } else { LightLevel::Full };
            self.queue.set_light(self.light);
            self.queue.set_usual_visibility(sampler.usual_visibility());
            self.sampler = Some(sampler);
            if !std::mem::replace(&mut self.measures_direct, true) {
                self.queue.push_background(Background::MeasureDirect);
            }
        }
        match &mut self.sampler {
            Some(sampler) => Ok(sampler.as_mut()),
            None => Err(RenderError::Internal("no sampler".to_owned())),
        }
    }

    /// The compositor, made now if necessary.
    pub(super) fn compositor(&mut self) -> Result<&mut dyn Compositor, RenderError> {
        if self.compositor.is_none() {
            let compositor = self.queue.making_role(|| self.factory.compositor());
            let failed = |error: &RenderError| self.health.failed(&error.to_string());
            self.compositor = Some(compositor.inspect_err(failed)?);
        }
        match &mut self.compositor {
            Some(compositor) => Ok(compositor.as_mut()),
            None => Err(RenderError::Internal("no compositor".to_owned())),
        }
    }

    /// Drops both roles. The next work recreates them.
    pub(super) fn rebuild(&mut self, reason: &str) {
        static LOST: RateLimitedLog = RateLimitedLog::new();
        if let Some(left_out) = LOST.now() {
            warn!(reason, left_out, "the device is lost, its roles are recreated");
        }
        self.rebuilt += 1;
        self.sampler = None;
        self.retire_standby();
        (self.compositor, self.is_measured) = (None, true);
        self.held.clear();
        self.store.forget_device_planes();
    }
}

/// Makes a sampler.
fn made_sampler(
    factory: &dyn RoleFactory,
    scene: Arc<Scene>,
    set: &SampleSetInfo,
) -> Result<Box<dyn Sampler>, RenderError> {
    let began = Instant::now();
    let sampler = factory.sampler(scene, set)?;
    info!(ms = ms_since(began), "sampler made");
    Ok(sampler)
}

/// Makes a sampler and renders a small view with it, so that its first view does not wait for a compiler.
fn warmed_sampler(
    factory: &dyn RoleFactory,
    scene: Arc<Scene>,
    info: &Arc<SampleSetInfo>,
) -> Result<Box<dyn Sampler>, RenderError> {
    let mut sampler = made_sampler(factory, scene.clone(), info)?;
    let began = Instant::now();
    // A sampler that cannot render is not used.
    warm::sampler(sampler.as_mut(), &scene, info)
        .inspect_err(|error| warn!(%error, "the new sampler cannot render"))?;
    debug!(ms = ms_since(began), "sampler warmed up");
    Ok(sampler)
}
