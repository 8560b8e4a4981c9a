//! The samples that a compositor holds on its device.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock, Weak};

use argus_gpu::{EnvironmentTexture, Gpu, ReflectionProbes};
use argus_scene::camera::Face;
use argus_scene::{
    FaceMask, FaceMasks, InvalidField, RenderError, Sample, SampleCamera, SampleId, SampleSet, SampleSetInfo,
    Search,
};

use crate::arrays::PoolClass;
use crate::cull::FaceTiles;
use crate::host::HostFrame;
use crate::passes::build_pyramid::BuildPyramidPass;
use crate::pool::Pool;
use crate::sample_upload::{SampleUpload, Submission, UploadContext};
use crate::settings::CompositorSettings;
use crate::validate::class_of;

/// A sample on the device.
#[derive(Debug)]
pub(crate) struct HeldSample {
    /// The sample that it was uploaded from.
    sample: Weak<Sample>,
    pub(crate) info: Arc<SampleSetInfo>,
    pub(crate) camera: SampleCamera,
    /// Faces that were rendered.
    pub(crate) mask: FaceMask,
    pub(crate) faces: Vec<Face>,
    /// One entry a face.
    pub(crate) tiles: Vec<FaceTiles>,
    /// Index of its pool; [`NO_POOL`] if it is in memory alone.
    pub(crate) pool: usize,
    pub(crate) layer: u32,
    /// The planes in memory, once a view is computed from them; `None` within if they are elsewhere or of another kind.
    host: OnceLock<Option<Arc<HostFrame>>>,
}

/// Index of the pool of samples that are in memory alone.
pub(crate) const NO_POOL: usize = usize::MAX;

impl HeldSample {
    /// Whether it is a frame.
    fn is_frame(&self) -> bool {
        self.info.version.number == SampleId::FRAMES
    }

    /// Its planes in memory; `None` if it is no frame.
    pub(crate) fn host(&self) -> Option<&Arc<HostFrame>> {
        let frame = || {
            let sample = self.sample.upgrade().filter(|sample| sample.id.version == SampleId::FRAMES)?;
            HostFrame::new(&sample, self.info.lighting.exposure).map(Arc::new)
        };
        self.host.get_or_init(frame).as_ref()
    }
}

fn within_memory(bytes: u64, settings: &CompositorSettings) -> Result<(), RenderError> {
    if bytes <= settings.max_sample_bytes {
        return Ok(());
    }
    let (mib, most) = (bytes >> 20, settings.max_sample_bytes >> 20);
    let reason = format!("samples would fill {mib} MiB of the device, {most} are allowed");
    Err(RenderError::OutOfMemory(reason))
}

/// Work after which a submission is completed, in units of one copied texel: about 5 ms on the software driver.
const WORTH_SUBMITTING: u64 = 1 << 21;

/// Samples by id, and their texture arrays.
#[derive(Debug, Default)]
pub(crate) struct SampleStore {
    /// Whether views from frames are computed on the processor, so that frames stay in memory.
    frames_on_host: bool,
    held: BTreeMap<SampleId, Arc<HeldSample>>,
    /// Samples that are being uploaded.
    uploads: BTreeMap<SampleId, SampleUpload>,
    /// Reflection probes, with the sample that they were uploaded from.
    probes: BTreeMap<SampleId, (Weak<Sample>, Arc<ReflectionProbes>)>,
    /// Environment maps by hash.
    environments: BTreeMap<[u8; 32], Arc<EnvironmentTexture>>,
    /// `None` for a pool whose memory was freed, so that indices stay valid.
    pools: Vec<Option<Pool>>,
    bytes: u64,
    /// Upload programs that have run before.
    used: BTreeSet<&'static str>,
}

impl SampleStore {
    /// An empty store. `frames_on_host`: views from frames are computed on the processor, and frames stay in memory.
    pub(crate) fn new(frames_on_host: bool) -> Self {
        Self { frames_on_host, ..Self::default() }
    }

    /// Whether a view by this search is computed on the processor from these samples: from frames, where that is faster or where
    /// they differ in size. This depends on the plan and the device alone.
    pub(crate) fn serves_on_host(&self, search: Search, samples: &[Arc<HeldSample>]) -> bool {
        let differ = || samples.iter().any(|held| held.camera.size() != samples[0].camera.size());
        search == Search::Splat
            && !samples.is_empty()
            && samples.iter().all(|held| held.is_frame())
            && (self.frames_on_host || differ())
            && samples.iter().all(|held| held.host().is_some())
    }

    /// The reflection probes of an id.
    ///
    /// # Errors
    /// [`RenderError::MissingSample`] if they are not held.
    pub(crate) fn probes(&self, id: SampleId) -> Result<Arc<ReflectionProbes>, RenderError> {
        self.probes.get(&id).map(|(_, probes)| probes.clone()).ok_or(RenderError::MissingSample(id))
    }

    /// The samples of a plan, which uses these faces of theirs.
    ///
    /// # Errors
    /// [`RenderError::MissingSample`] for the first that is not held, or lacks a face. [`RenderError::Invalid`] if they differ in scene,
    /// epoch or generation; samples that are no frames, if they differ in size or format.
    pub(crate) fn of_plan(
        &self,
        ids: &[SampleId],
        faces: &FaceMasks,
    ) -> Result<Vec<Arc<HeldSample>>, RenderError> {
        let find = |id: &SampleId| {
            let used = faces.of(id.camera);
            let held = self.held.get(id).filter(|held| held.mask.contains(used.of_camera(&held.camera)));
            held.cloned().ok_or(RenderError::MissingSample(*id))
        };
        let samples = ids.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        if let Some((first, rest)) = samples.split_first() {
            let together = |other: &Arc<HeldSample>| {
                let is_alike = other.pool == first.pool || (other.host().is_some() && first.host().is_some());
                is_alike && (Arc::ptr_eq(&other.info, &first.info) || other.info == first.info)
            };
            if !rest.iter().all(together) {
                let reason = "samples of one plan must be of one scene, version, size and format";
                return Err(InvalidField::new("plan.samples", reason).into());
            }
        }
        Ok(samples)
    }

    /// The environment map of a set whose samples are held; `None` if its sky has none.
    pub(crate) fn environment(&self, info: &SampleSetInfo) -> Option<Arc<EnvironmentTexture>> {
        let map = info.lighting.sky.map.as_ref()?;
        self.environments.get(&map.hash()).cloned()
    }

    /// Uploads the environment map of a set, unless it is here.
    fn hold_environment(&mut self, gpu: &Gpu, info: &SampleSetInfo) -> Result<(), RenderError> {
        let sky = &info.lighting.sky;
        let Some(hash) = sky.map.as_ref().map(|map| map.hash()) else { return Ok(()) };
        if let Entry::Vacant(place) = self.environments.entry(hash) {
            place.insert(Arc::new(EnvironmentTexture::new(gpu, sky)?));
        }
        Ok(())
    }

    /// The pool of a held sample.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if there is none, which only a bug can cause.
    pub(crate) fn pool(&self, index: usize) -> Result<&Pool, RenderError> {
        let pool = self.pools.get(index).and_then(Option::as_ref);
        pool.ok_or_else(|| RenderError::Internal("a held sample has no pool".to_owned()))
    }

    /// Uploads samples until all are held or `is_over` returns true between two steps. Returns whether all are held. A
    /// later call continues.
    ///
    /// # Errors
    /// The errors of [`argus_scene::Compositor::hold`]. Samples that were not held before are abandoned.
    pub(crate) fn hold(
        &mut self,
        context: &UploadContext<'_>,
        set: &SampleSet,
        is_over: &dyn Fn() -> bool,
    ) -> Result<bool, RenderError> {
        self.hold_environment(context.gpu, &set.info)?;
        let gone = self.uploads.iter().filter(|(_, upload)| upload.sample.strong_count() == 0);
        let gone: Vec<SampleId> = gone.map(|(id, _)| *id).collect();
        self.abandon(&gone);
        // Of several samples with one id the last one is uploaded.
        let missing: BTreeMap<SampleId, &Arc<Sample>> =
            set.samples.iter().filter(|sample| !self.is_held(&set.info, sample)).map(|s| (s.id, s)).collect();
        let done = self.hold_missing(context, &set.info, &missing, !self.frames_on_host, is_over);
        if done.is_err() {
            self.abandon(&missing.keys().copied().collect::<Vec<_>>());
        }
        done
    }

    fn hold_missing(
        &mut self,
        context: &UploadContext<'_>,
        info: &Arc<SampleSetInfo>,
        missing: &BTreeMap<SampleId, &Arc<Sample>>,
        to_device: bool,
        is_over: &dyn Fn() -> bool,
    ) -> Result<bool, RenderError> {
        let (of_probes, of_rig): (Vec<&Arc<Sample>>, Vec<&Arc<Sample>>) =
            missing.values().partition(|sample| sample.id.is_reflection_probe());
        let stays = |sample: &&Arc<Sample>| !to_device && sample.id.version == SampleId::FRAMES;
        let (frames, of_rig): (Vec<&Arc<Sample>>, Vec<&Arc<Sample>>) = of_rig.into_iter().partition(stays);
        let classes = of_rig.iter().map(|sample| class_of(sample)).collect::<Result<Vec<_>, _>>()?;
        let probes = of_probes
            .iter()
            .map(|sample| Ok(Arc::new(ReflectionProbes::new(context.gpu, sample)?)))
            .collect::<Result<Vec<_>, RenderError>>()?;
        let replaced: u64 = missing.keys().map(|id| self.bytes_of(*id)).sum();
        let begun = |id: &SampleId| self.uploads.contains_key(id);
        let added = of_rig.iter().zip(&classes).filter(|(sample, _)| !begun(&sample.id));
        let added: u64 = added.map(|(_, class)| class.layer_bytes()).sum::<u64>()
            + probes.iter().map(|probes| probes.bytes()).sum::<u64>();
        let begun: u64 = self.uploads.values().map(|upload| self.layer_bytes(upload.pool)).sum();
        let pyramids: u64 = self.pools.iter().flatten().map(|pool| pool.pyramid_bytes(false)).sum();
        within_memory((self.bytes + begun + added + pyramids).saturating_sub(replaced), context.settings)?;
        for (sample, probes) in of_probes.into_iter().zip(probes) {
            self.release(&[sample.id]);
            self.bytes += probes.bytes();
            self.probes.insert(sample.id, (Arc::downgrade(sample), probes));
        }
        for sample in frames {
            self.hold_in_memory(info, sample)?;
        }
        for (sample, class) in of_rig.iter().zip(classes) {
            if self.uploads.get(&sample.id).is_some_and(|upload| upload.is_of(info, sample)) {
                continue;
            }
            self.abandon(&[sample.id]);
            let index = self.pool_of(class);
            let Some(pool) = &mut self.pools[index] else { continue };
            while !pool.prepare_layer(context.gpu)? {
                if is_over() {
                    return Ok(false);
                }
            }
            let layer = pool.take_layer()?;
            let upload = SampleUpload::new(info, sample, pool, index, layer)?;
            self.uploads.insert(sample.id, upload);
        }
        self.take_steps(context, &of_rig, is_over)
    }

    /// Holds a frame without a copy on the device.
    fn hold_in_memory(&mut self, info: &Arc<SampleSetInfo>, sample: &Arc<Sample>) -> Result<(), RenderError> {
        class_of(sample)?;
        self.release(&[sample.id]);
        let (camera, faces) = (sample.camera, sample.camera.faces());
        let frame = HostFrame::new(sample, info.lighting.exposure).map(Arc::new);
        let tiles = frame.iter().flat_map(|frame| faces.iter().map(|face| frame.tiles(face))).collect();
        if frame.is_none() {
            let reason = "a frame has other planes than colour and range, or none in memory";
            return Err(InvalidField::new("sample.planes", reason).into());
        }
        let held = HeldSample {
            sample: Arc::downgrade(sample),
            info: info.clone(),
            camera,
            mask: sample.faces,
            faces,
            tiles,
            pool: NO_POOL,
            layer: 0,
            host: OnceLock::from(frame),
        };
        self.held.insert(sample.id, Arc::new(held));
        Ok(())
    }

    /// Copies frames that are in memory alone to the device, for a search that runs there.
    ///
    /// # Errors
    /// The errors of [`Self::hold`].
    pub(crate) fn hold_on_device(
        &mut self,
        context: &UploadContext<'_>,
        ids: &[SampleId],
    ) -> Result<(), RenderError> {
        for id in ids {
            let Some(held) = self.held.get(id).filter(|held| held.pool == NO_POOL).cloned() else { continue };
            let Some(sample) = held.sample.upgrade() else { continue };
            self.hold_missing(context, &held.info, &BTreeMap::from([(*id, &sample)]), true, &|| false)?;
        }
        Ok(())
    }

    /// Runs upload steps.
    fn take_steps(
        &mut self,
        context: &UploadContext<'_>,
        samples: &[&Arc<Sample>],
        is_over: &dyn Fn() -> bool,
    ) -> Result<bool, RenderError> {
        let mut submission = Submission::new(context.gpu);
        for sample in samples {
            while let Some(upload) = self.uploads.get_mut(&sample.id).filter(|upload| !upload.is_recorded()) {
                let Some(pool) = &mut self.pools[upload.pool] else { break };
                let program = upload.record(context, pool, sample, &mut submission)?;
                // A step with a new program ends the submission: quirk `compiled-at-first-use`.
                let is_new = program.is_some_and(|program| self.used.insert(program));
                if is_new || submission.weight >= WORTH_SUBMITTING {
                    self.settle(std::mem::replace(&mut submission, Submission::new(context.gpu)))?;
                    if is_over() && self.uploads.contains_key(&sample.id) {
                        return Ok(false);
                    }
                }
            }
        }
        self.settle(submission)?;
        Ok(true)
    }

    /// Completes a submission. Samples without remaining steps become held.
    fn settle(&mut self, submission: Submission) -> Result<(), RenderError> {
        if submission.weight == 0 {
            return Ok(());
        }
        for (id, face, bytes) in submission.finish()? {
            if let Some(upload) = self.uploads.get_mut(&id) {
                upload.bound(face, &bytes);
            }
        }
        let done = self.uploads.iter().filter(|(_, upload)| upload.is_recorded());
        let done: Vec<SampleId> = done.map(|(id, _)| *id).collect();
        for id in done {
            let Some(SampleUpload { info, sample, pool, layer, faces, tiles, .. }) = self.uploads.remove(&id)
            else {
                continue;
            };
            self.release(&[id]);
            if let Some((camera, mask)) = sample.upgrade().map(|sample| (sample.camera, sample.faces)) {
                let host = OnceLock::new();
                let held = HeldSample { sample, info, camera, mask, faces, tiles, pool, layer, host };
                self.held.insert(id, Arc::new(held));
                self.bytes += self.bytes_of(id);
            } else {
                self.free([(pool, layer)]);
            }
        }
        Ok(())
    }

    /// Whether this sample is held as part of this set.
    fn is_held(&self, info: &Arc<SampleSetInfo>, sample: &Arc<Sample>) -> bool {
        let is_it = |from: &Weak<Sample>| std::ptr::eq(from.as_ptr(), Arc::as_ptr(sample));
        let held = self.held.get(&sample.id).is_some_and(|held| is_it(&held.sample) && held.info == *info);
        held || self.probes.get(&sample.id).is_some_and(|(from, _)| is_it(from))
    }

    /// Index of the pool of a class.
    fn pool_of(&mut self, class: PoolClass) -> usize {
        let index = self.pools.iter().position(|p| p.as_ref().is_some_and(|p| p.class == class));
        let index = index.or_else(|| self.pools.iter().position(Option::is_none)).unwrap_or(self.pools.len());
        if index == self.pools.len() {
            self.pools.push(None);
        }
        self.pools[index].get_or_insert_with(|| Pool::new(class));
        index
    }

    /// Abandons the upload of samples.
    fn abandon(&mut self, ids: &[SampleId]) {
        for id in ids {
            if let Some(upload) = self.uploads.remove(id) {
                self.free([(upload.pool, upload.layer)]);
            }
        }
    }

    /// Builds the missing pyramids of the samples of one plan.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the pyramids of all samples of their pool would not fit.
    pub(crate) fn make_pyramids(
        &mut self,
        gpu: &Arc<Gpu>,
        pass: &BuildPyramidPass,
        settings: &CompositorSettings,
        samples: &[Arc<HeldSample>],
    ) -> Result<(), RenderError> {
        let Some(first) = samples.first() else { return Ok(()) };
        let pools = self.pools.iter().enumerate();
        let bytes = |(i, pool): (usize, &Option<Pool>)| {
            pool.as_ref().map_or(0, |pool| pool.pyramid_bytes(i == first.pool))
        };
        within_memory(self.bytes + pools.map(bytes).sum::<u64>(), settings)?;
        let layers = samples.iter().map(|held| held.layer);
        match self.pools.get_mut(first.pool) {
            Some(Some(pool)) => pass.make(gpu, pool, layers),
            _ => Err(RenderError::Internal("a held sample has no pool".to_owned())),
        }
    }

    /// Releases samples, also those that are being uploaded.
    pub(crate) fn release(&mut self, ids: &[SampleId]) {
        self.abandon(ids);
        for id in ids {
            self.bytes -= self.bytes_of(*id);
            self.probes.remove(id);
            if let Some(held) = self.held.remove(id) {
                self.free([(held.pool, held.layer)]);
            }
        }
    }

    fn bytes_of(&self, id: SampleId) -> u64 {
        let of_probes = self.probes.get(&id).map_or(0, |(_, probes)| probes.bytes());
        self.held.get(&id).map_or(of_probes, |held| self.layer_bytes(held.pool))
    }

    /// Bytes of one sample of a pool.
    fn layer_bytes(&self, pool: usize) -> u64 {
        self.pools.get(pool).and_then(Option::as_ref).map_or(0, |pool| pool.class.layer_bytes())
    }

    fn free(&mut self, layers: impl IntoIterator<Item = (usize, u32)>) {
        for (index, layer) in layers {
            let Some(Some(pool)) = self.pools.get_mut(index) else { continue };
            pool.free_layer(layer);
        }
    }

    /// Frees the memory of empty pools, and of environment maps that no sample was shaded with.
    pub(crate) fn trim(&mut self) {
        let infos = self.held.values().map(|held| &held.info);
        let infos = infos.chain(self.uploads.values().map(|upload| &upload.info));
        let used: BTreeSet<_> =
            infos.filter_map(|info| Some(info.lighting.sky.map.as_ref()?.hash())).collect();
        self.environments.retain(|hash, _| used.contains(hash));
        for pool in &mut self.pools {
            if pool.as_ref().is_some_and(Pool::is_empty) {
                *pool = None;
            }
        }
    }

    /// Number of samples, reflection probes included.
    pub(crate) fn len(&self) -> usize {
        self.held.len() + self.probes.len()
    }
}
