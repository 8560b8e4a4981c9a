//! The sample set that this worker serves: scene, specification, and recent versions.

use std::collections::VecDeque;
use std::sync::Arc;

use argus_proto::Fault;
use argus_scene::{
    Limits, RenderError, SampleSetInfo, Scene, SceneState, SpecificationHash, Version, Visibility,
};
use parking_lot::Mutex;

use crate::worker::histories::Histories;
use crate::worker::queue::{Queue, Work};
use crate::worker::sources::SourceStore;
use crate::worker::store::Store;

/// Greatest number of versions that are kept: those of views in work, and the next ones.
const MOST_VERSIONS: usize = 16;

/// The served sample set.
pub(in crate::worker) struct ServedSet {
    queue: Arc<Queue>,
    store: Arc<Store>,
    histories: Arc<Histories>,
    sources: Arc<SourceStore>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    scene: Option<Arc<Scene>>,
    set: Option<Arc<SampleSetInfo>>,
    /// The set in its most recently requested versions, newest first.
    versions: VecDeque<Arc<SampleSetInfo>>,
    limits: Limits,
    /// The cluster has not chosen the visibility backend of samples.
    visibility_is_open: bool,
}

impl ServedSet {
    /// Serves no set.
    pub(super) fn new(
        queue: Arc<Queue>,
        store: Arc<Store>,
        histories: Arc<Histories>,
        sources: Arc<SourceStore>,
    ) -> Self {
        Self { queue, store, histories, sources, state: Mutex::default() }
    }

    /// The served set, and the limits of a view's size.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] until the scene is loaded.
    pub(in crate::worker) fn set(&self) -> Result<(Arc<SampleSetInfo>, Limits), Fault> {
        let state = self.state.lock();
        Ok((state.set.clone().ok_or_else(not_loaded)?, state.limits))
    }

    /// The served set, for an order to the render thread.
    ///
    /// # Errors
    /// [`RenderError::Internal`] until the scene is loaded.
    pub(super) fn set_to_render(&self) -> Result<Arc<SampleSetInfo>, RenderError> {
        let set = self.state.lock().set.clone();
        set.ok_or_else(|| RenderError::Internal("the scene is not loaded yet".to_owned()))
    }

    /// The set in a version. All callers get the same `Arc` for a version, so that sets are compared by address.
    ///
    /// A new coordinator restarts the numbers of versions. Samples of an unknown version under a used number are
    /// therefore forgotten: they may show another state.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] until the scene is loaded; [`Fault::NotFound`] for another state of a still scene.
    pub(in crate::worker) fn set_in(&self, version: Version) -> Result<(Arc<SampleSetInfo>, Limits), Fault> {
        let (info, limits) = self.set_showing(version.state)?;
        let mut state = self.state.lock();
        if let Some(same) = state.versions.iter().find(|info| info.version == version) {
            return Ok((same.clone(), limits));
        }
        let info = Arc::new(SampleSetInfo { version, ..(*info).clone() });
        state.versions.retain(|other| other.version.number != version.number);
        self.store.begin_version(version);
        state.versions.push_front(info.clone());
        state.versions.truncate(MOST_VERSIONS);
        Ok((info, limits))
    }

    /// The set in any version that shows a state of the scene. Rendering from triangles needs no particular version.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] until the scene is loaded; [`Fault::NotFound`] for another state of a still scene.
    pub(in crate::worker) fn set_showing(
        &self,
        state: SceneState,
    ) -> Result<(Arc<SampleSetInfo>, Limits), Fault> {
        let (set, limits) = self.set()?;
        if state.revision != 0
            && self.scene().is_none_or(|scene| scene.revisions.get(state.revision).is_none())
        {
            let reason =
                format!("transforms of revision {} are not known to this worker any more", state.revision);
            return Err(Fault::Unavailable(reason));
        }
        if let Some(same) = self.state.lock().versions.iter().find(|info| info.version.state == state) {
            return Ok((same.clone(), limits));
        }
        if set.epoch_secs == 0.0 && state.epoch != set.version.state.epoch {
            let (asked, served) = (state.epoch, set.version.state.epoch);
            return Err(Fault::NotFound(format!("this worker serves epoch {served}, not epoch {asked}")));
        }
        let scene = self.scene().ok_or_else(not_loaded)?;
        let version = Version { state, ..set.version };
        Ok((Arc::new(set.at_version(&scene, version)), limits))
    }

    /// The loaded scene.
    pub(in crate::worker) fn scene(&self) -> Option<Arc<Scene>> {
        self.state.lock().scene.clone()
    }

    /// Serves another set, under the sky of the scene, of which only a part travels with sets. Forgets the samples of the
    /// previous set. A new version of the same set keeps them. Returns whether the set needs another sampler.
    pub(in crate::worker) fn serve(
        &self,
        scene: &Arc<Scene>,
        mut set: SampleSetInfo,
        limits: Limits,
    ) -> bool {
        let mut state = self.state.lock();
        set.lighting.sky = scene.lighting.sky.clone();
        let set = Arc::new(set);
        // A sampler is made for one scene, one number of sub-samples, one kind of light, and one exposure.
        let of_sampler =
            |set: &SampleSetInfo| (set.sub_samples, set.effects, set.indirect, set.lighting.exposure);
        let same_sampler = state.set.as_deref().is_some_and(|old| of_sampler(old) == of_sampler(&set));
        let same_scene = state.scene.as_ref().is_some_and(|old| Arc::ptr_eq(old, scene));
        let new_sampler = !(same_scene && same_sampler);
        if new_sampler {
            state.scene = Some(scene.clone());
            self.queue.order(Work::Scene { scene: scene.clone(), set: set.clone() });
        }
        let is_same = |old: &SampleSetInfo| SampleSetInfo { version: set.version, ..old.clone() } == *set;
        if !state.set.as_deref().is_some_and(is_same) {
            state.versions =
                if set.epoch_secs == 0.0 { VecDeque::from([set.clone()]) } else { VecDeque::new() };
            state.set = Some(set);
            self.store.clear();
            state.versions.iter().for_each(|set| self.store.begin_version(set.version));
            self.histories.clear();
            self.sources.clear();
        } else if state.set.as_ref().is_some_and(|old| old.version.number < set.version.number) {
            state.set = Some(set);
        }
        state.limits = limits;
        new_sampler
    }

    /// Checks that samples of `info` belong to the served set. Samples of an earlier set are useless.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] if another set is served.
    pub(super) fn check(&self, info: &SampleSetInfo) -> Result<(), Fault> {
        let (served, _) = self.set()?;
        let rendered_by = |set: &SampleSetInfo| (set.scene, set.specification());
        match rendered_by(&served) == rendered_by(info) {
            true => Ok(()),
            false => Err(Fault::Unavailable("another sample set is served now".to_owned())),
        }
    }

    /// Checks that a result of `info` shows the served scene. The render thread may have begun with another one meanwhile.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] if another scene is served.
    pub(super) fn check_scene(&self, info: &SampleSetInfo) -> Result<(), Fault> {
        match self.set()?.0.scene == info.scene {
            true => Ok(()),
            false => Err(Fault::Unavailable("another scene is served now".to_owned())),
        }
    }

    /// Sets whether the cluster has yet to choose the visibility backend of samples.
    pub(in crate::worker) fn set_visibility_is_open(&self, is_open: bool) {
        self.state.lock().visibility_is_open = is_open;
    }

    /// The visibility backend of direct views: the set's, or the device's expected best until the set's is chosen.
    pub(in crate::worker) fn visibility_of_views(&self, info: &SampleSetInfo) -> Visibility {
        match self.state.lock().visibility_is_open {
            true => self.queue.usual_visibility(),
            false => info.visibility,
        }
    }
}

fn not_loaded() -> Fault {
    Fault::Unavailable("the scene is not loaded yet".to_owned())
}

/// Checks that a requested specification is the served one, so that a plan never mixes samples of two specifications.
///
/// # Errors
/// [`Fault::NotFound`] for another specification.
pub(in crate::worker) fn check_specification(
    info: &SampleSetInfo,
    asked: SpecificationHash,
) -> Result<(), Fault> {
    let served = info.specification();
    match served.hash() == asked {
        true => Ok(()),
        false => Err(Fault::NotFound(format!(
            "this worker serves specification {} ({served}), not {asked}",
            served.hash()
        ))),
    }
}
