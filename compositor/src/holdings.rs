//! The samples that a compositor holds.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Weak};

use argus_gpu::{Gpu, Surroundings};
use argus_scene::camera::Face;
use argus_scene::{InvalidField, RenderError, Sample, SampleCamera, SampleId, SampleSet, SampleSetInfo};

use crate::arrays::PoolClass;
use crate::cull::FaceTiles;
use crate::intake::{Intake, Submission, Tools};
use crate::knobs::CompositorKnobs;
use crate::passes::halve::HalvePass;
use crate::pool::Pool;
use crate::validate::class_of;

/// One sample as it is held.
#[derive(Debug)]
pub(crate) struct Held {
    /// What it was taken in from.
    sample: Weak<Sample>,
    pub(crate) info: Arc<SampleSetInfo>,
    pub(crate) camera: SampleCamera,
    pub(crate) faces: Vec<Face>,
    /// One a face.
    pub(crate) tiles: Vec<FaceTiles>,
    /// Index of its pool.
    pub(crate) pool: usize,
    pub(crate) layer: u32,
}

fn within_memory(bytes: u64, knobs: &CompositorKnobs) -> Result<(), RenderError> {
    if bytes <= knobs.max_sample_bytes {
        return Ok(());
    }
    let (mib, most) = (bytes >> 20, knobs.max_sample_bytes >> 20);
    let reason = format!("samples would fill {mib} MiB of the device, {most} are allowed");
    Err(RenderError::OutOfMemory(reason))
}

/// Work after which a submission is waited for, in units of a copied texel: some 5 ms on the software driver.
const WORTH_SUBMITTING: u64 = 1 << 21;

/// Samples by id, and the texture arrays that they lie in.
#[derive(Debug, Default)]
pub(crate) struct Holdings {
    held: BTreeMap<SampleId, Arc<Held>>,
    /// Samples on their way in.
    intakes: BTreeMap<SampleId, Intake>,
    /// Maps that samples' surfaces look up, and what they were taken in from.
    surroundings: BTreeMap<SampleId, (Weak<Sample>, Arc<Surroundings>)>,
    /// `None` where a pool was emptied and its memory given back, so that indices stay.
    pools: Vec<Option<Pool>>,
    bytes: u64,
    /// Programs that samples have been taken in with.
    used: BTreeSet<&'static str>,
}

impl Holdings {
    /// Surroundings that are held.
    ///
    /// # Errors
    /// [`RenderError::MissingSample`] for others.
    pub(crate) fn surroundings(&self, id: SampleId) -> Result<Arc<Surroundings>, RenderError> {
        self.surroundings.get(&id).map(|(_, maps)| maps.clone()).ok_or(RenderError::MissingSample(id))
    }

    /// The samples of a plan, all of one set.
    ///
    /// # Errors
    /// [`RenderError::MissingSample`] for the first that is not held; [`RenderError::Invalid`] if they were
    /// not taken together: of another scene, time or placement, or of another size or format.
    pub(crate) fn of_plan(&self, ids: &[SampleId]) -> Result<Vec<Arc<Held>>, RenderError> {
        let find = |id: &SampleId| self.held.get(id).cloned().ok_or(RenderError::MissingSample(*id));
        let samples = ids.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        if let Some((first, rest)) = samples.split_first() {
            let together = |other: &Arc<Held>| {
                other.pool == first.pool
                    && (Arc::ptr_eq(&other.info, &first.info) || other.info == first.info)
            };
            if !rest.iter().all(together) {
                let reason = "samples of one plan must be of one scene, version, size and format";
                return Err(InvalidField::new("plan.samples", reason).into());
            }
        }
        Ok(samples)
    }

    /// The pool of a held sample.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if there is none, which only a bug can cause.
    pub(crate) fn pool(&self, index: usize) -> Result<&Pool, RenderError> {
        let pool = self.pools.get(index).and_then(Option::as_ref);
        pool.ok_or_else(|| RenderError::Internal("a held sample has no pool".to_owned()))
    }

    /// Takes samples in, all of them unless `is_over` says so between two steps; returns whether all are held. What was done of
    /// them is kept.
    ///
    /// # Errors
    /// Those of [`argus_scene::Compositor::hold`]. None is held then but those that were, and surroundings.
    pub(crate) fn hold(
        &mut self,
        tools: &Tools<'_>,
        set: &SampleSet,
        is_over: &dyn Fn() -> bool,
    ) -> Result<bool, RenderError> {
        let gone = self.intakes.iter().filter(|(_, intake)| intake.sample.strong_count() == 0);
        let gone: Vec<SampleId> = gone.map(|(id, _)| *id).collect();
        self.abandon(&gone);
        // Of several with one id the last one counts.
        let missing: BTreeMap<SampleId, &Arc<Sample>> =
            set.samples.iter().filter(|sample| !self.is_held(&set.info, sample)).map(|s| (s.id, s)).collect();
        let done = self.hold_missing(tools, &set.info, &missing, is_over);
        if done.is_err() {
            self.abandon(&missing.keys().copied().collect::<Vec<_>>());
        }
        done
    }

    fn hold_missing(
        &mut self,
        tools: &Tools<'_>,
        info: &Arc<SampleSetInfo>,
        missing: &BTreeMap<SampleId, &Arc<Sample>>,
        is_over: &dyn Fn() -> bool,
    ) -> Result<bool, RenderError> {
        let (around, of_rig): (Vec<&Arc<Sample>>, Vec<&Arc<Sample>>) =
            missing.values().partition(|sample| sample.id.is_surroundings());
        let classes = of_rig.iter().map(|sample| class_of(sample)).collect::<Result<Vec<_>, _>>()?;
        let maps = around
            .iter()
            .map(|sample| Ok(Arc::new(Surroundings::new(tools.gpu, sample)?)))
            .collect::<Result<Vec<_>, RenderError>>()?;
        let replaced: u64 = missing.keys().map(|id| self.bytes_of(*id)).sum();
        let begun = |id: &SampleId| self.intakes.contains_key(id);
        let added = of_rig.iter().zip(&classes).filter(|(sample, _)| !begun(&sample.id));
        let added: u64 = added.map(|(_, class)| class.layer_bytes()).sum::<u64>()
            + maps.iter().map(|maps| maps.bytes()).sum::<u64>();
        let begun: u64 = self.intakes.values().map(|intake| self.layer_bytes(intake.pool)).sum();
        let pyramids: u64 = self.pools.iter().flatten().map(|pool| pool.pyramid_bytes(false)).sum();
        within_memory((self.bytes + begun + added + pyramids).saturating_sub(replaced), tools.knobs)?;
        for (sample, maps) in around.into_iter().zip(maps) {
            self.release(&[sample.id]);
            self.bytes += maps.bytes();
            self.surroundings.insert(sample.id, (Arc::downgrade(sample), maps));
        }
        for (sample, class) in of_rig.iter().zip(classes) {
            if self.intakes.get(&sample.id).is_some_and(|intake| intake.is_of(info, sample)) {
                continue;
            }
            self.abandon(&[sample.id]);
            let index = self.pool_of(class);
            let Some(pool) = &mut self.pools[index] else { continue };
            while !pool.prepare_layer(tools.gpu)? {
                if is_over() {
                    return Ok(false);
                }
            }
            let layer = pool.take_layer()?;
            let intake = Intake::new(info, sample, pool, index, layer)?;
            self.intakes.insert(sample.id, intake);
        }
        self.take_steps(tools, &of_rig, is_over)
    }

    /// Does the steps of samples that are on their way in.
    fn take_steps(
        &mut self,
        tools: &Tools<'_>,
        samples: &[&Arc<Sample>],
        is_over: &dyn Fn() -> bool,
    ) -> Result<bool, RenderError> {
        let mut submission = Submission::new(tools.gpu);
        for sample in samples {
            while let Some(intake) = self.intakes.get_mut(&sample.id).filter(|intake| !intake.is_recorded()) {
                let Some(pool) = &mut self.pools[intake.pool] else { break };
                let program = intake.record(tools, pool, sample, &mut submission)?;
                // A driver makes machine code where a program is first used: not of several ones at once.
                let is_new = program.is_some_and(|program| self.used.insert(program));
                if is_new || submission.weight >= WORTH_SUBMITTING {
                    self.settle(std::mem::replace(&mut submission, Submission::new(tools.gpu)))?;
                    if is_over() && self.intakes.contains_key(&sample.id) {
                        return Ok(false);
                    }
                }
            }
        }
        self.settle(submission)?;
        Ok(true)
    }

    /// Does what was recorded. Samples of which no step is left are held from then on.
    fn settle(&mut self, submission: Submission) -> Result<(), RenderError> {
        if submission.weight == 0 {
            return Ok(());
        }
        for (id, face, bytes) in submission.finish()? {
            if let Some(intake) = self.intakes.get_mut(&id) {
                intake.bound(face, &bytes);
            }
        }
        let done = self.intakes.iter().filter(|(_, intake)| intake.is_recorded());
        let done: Vec<SampleId> = done.map(|(id, _)| *id).collect();
        for id in done {
            let Some(Intake { info, sample, pool, layer, faces, tiles, .. }) = self.intakes.remove(&id)
            else {
                continue;
            };
            self.release(&[id]);
            if let Some(camera) = sample.upgrade().map(|sample| sample.camera) {
                self.held.insert(id, Arc::new(Held { sample, info, camera, faces, tiles, pool, layer }));
                self.bytes += self.bytes_of(id);
            } else {
                self.free([(pool, layer)]);
            }
        }
        Ok(())
    }

    /// Whether that very sample is held, in that set.
    fn is_held(&self, info: &Arc<SampleSetInfo>, sample: &Arc<Sample>) -> bool {
        let is_it = |from: &Weak<Sample>| std::ptr::eq(from.as_ptr(), Arc::as_ptr(sample));
        let held = self.held.get(&sample.id).is_some_and(|held| is_it(&held.sample) && held.info == *info);
        held || self.surroundings.get(&sample.id).is_some_and(|(from, _)| is_it(from))
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

    /// Gives samples up that are on their way in.
    fn abandon(&mut self, ids: &[SampleId]) {
        for id in ids {
            if let Some(intake) = self.intakes.remove(id) {
                self.free([(intake.pool, intake.layer)]);
            }
        }
    }

    /// Makes the pyramids of samples of one plan that have none yet.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the pyramids of all samples of their pool would not fit.
    pub(crate) fn make_pyramids(
        &mut self,
        gpu: &Arc<Gpu>,
        pass: &HalvePass,
        knobs: &CompositorKnobs,
        samples: &[Arc<Held>],
    ) -> Result<(), RenderError> {
        let Some(first) = samples.first() else { return Ok(()) };
        let pools = self.pools.iter().enumerate();
        let bytes = |(i, pool): (usize, &Option<Pool>)| {
            pool.as_ref().map_or(0, |pool| pool.pyramid_bytes(i == first.pool))
        };
        within_memory(self.bytes + pools.map(bytes).sum::<u64>(), knobs)?;
        let layers = samples.iter().map(|held| held.layer);
        match self.pools.get_mut(first.pool) {
            Some(Some(pool)) => pool.make_pyramids(gpu, pass, layers),
            _ => Err(RenderError::Internal("a held sample has no pool".to_owned())),
        }
    }

    /// Forgets samples, also those that are on their way in.
    pub(crate) fn release(&mut self, ids: &[SampleId]) {
        self.abandon(ids);
        for id in ids {
            self.bytes -= self.bytes_of(*id);
            self.surroundings.remove(id);
            if let Some(held) = self.held.remove(id) {
                self.free([(held.pool, held.layer)]);
            }
        }
    }

    fn bytes_of(&self, id: SampleId) -> u64 {
        let around = self.surroundings.get(&id).map_or(0, |(_, maps)| maps.bytes());
        self.held.get(&id).map_or(around, |held| self.layer_bytes(held.pool))
    }

    /// Bytes of a sample of the pool of that index.
    fn layer_bytes(&self, pool: usize) -> u64 {
        self.pools[pool].as_ref().map_or(0, |pool| pool.class.layer_bytes())
    }

    fn free(&mut self, layers: impl IntoIterator<Item = (usize, u32)>) {
        for (index, layer) in layers {
            let Some(pool) = &mut self.pools[index] else { continue };
            pool.free_layer(layer);
        }
    }

    /// Gives the memory of pools back that hold nothing.
    pub(crate) fn trim(&mut self) {
        for pool in &mut self.pools {
            if pool.as_ref().is_some_and(Pool::is_empty) {
                *pool = None;
            }
        }
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.held.len() + self.surroundings.len()
    }
}
