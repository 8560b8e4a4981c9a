//! The samples that a compositor holds.

use std::collections::BTreeMap;
use std::sync::Arc;

use argus_gpu::{Gpu, Surroundings};
use argus_scene::camera::Face;
use argus_scene::{InvalidField, RenderError, Sample, SampleCamera, SampleId, SampleSet, SampleSetInfo};

use crate::cull::FaceTiles;
use crate::knobs::CompositorKnobs;
use crate::passes::bounds::BoundsPass;
use crate::passes::halve::HalvePass;
use crate::passes::mips::MipsPass;
use crate::pool::Pool;
use crate::validate::class_of;

/// One sample as it is held.
#[derive(Debug)]
pub(crate) struct Held {
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

/// Samples by id, and the texture arrays that they lie in.
#[derive(Debug, Default)]
pub(crate) struct Holdings {
    held: BTreeMap<SampleId, Arc<Held>>,
    /// Maps that samples' surfaces look up.
    surroundings: BTreeMap<SampleId, Arc<Surroundings>>,
    /// `None` where a pool was emptied and its memory given back, so that indices stay.
    pools: Vec<Option<Pool>>,
    bytes: u64,
}

impl Holdings {
    /// Surroundings that are held.
    ///
    /// # Errors
    /// [`RenderError::MissingSample`] for others.
    pub(crate) fn surroundings(&self, id: SampleId) -> Result<Arc<Surroundings>, RenderError> {
        self.surroundings.get(&id).cloned().ok_or(RenderError::MissingSample(id))
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
                let reason = "samples of one plan must be of one scene, epoch, generation, size and format";
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

    /// Takes samples in; none of them if one cannot be.
    pub(crate) fn hold(
        &mut self,
        gpu: &Arc<Gpu>,
        bounds: &BoundsPass,
        mips: &MipsPass,
        knobs: &CompositorKnobs,
        set: &SampleSet,
    ) -> Result<(), RenderError> {
        let (around, of_rig): (Vec<&Arc<Sample>>, Vec<_>) =
            set.samples.iter().partition(|sample| sample.id.is_surroundings());
        let classes = of_rig.iter().map(|s| class_of(s)).collect::<Result<Vec<_>, _>>()?;
        let around = around
            .into_iter()
            .map(|sample| Ok((sample.id, Arc::new(Surroundings::new(gpu, sample)?))))
            .collect::<Result<Vec<_>, RenderError>>()?;
        let replaced: u64 = set.samples.iter().map(|s| self.bytes_of(s.id)).sum();
        let added: u64 = classes.iter().map(|class| class.layer_bytes()).sum::<u64>()
            + around.iter().map(|(_, maps)| maps.bytes()).sum::<u64>();
        let pyramids: u64 = self.pools.iter().flatten().map(|pool| pool.pyramid_bytes(false)).sum();
        within_memory((self.bytes + added + pyramids).saturating_sub(replaced), knobs)?;
        let mut placed: Vec<(&Sample, usize, u32)> = Vec::with_capacity(of_rig.len());
        for (sample, class) in of_rig.into_iter().zip(classes) {
            let index = self.pools.iter().position(|p| p.as_ref().is_some_and(|p| p.class == class));
            let index = index.unwrap_or_else(|| {
                let vacant = self.pools.iter().position(Option::is_none);
                vacant.unwrap_or_else(|| {
                    self.pools.push(None);
                    self.pools.len() - 1
                })
            });
            self.pools[index].get_or_insert_with(|| Pool::new(class));
            let layer = self.pools[index].as_mut().map(|pool| pool.take_layer(gpu));
            match layer {
                Some(Ok(layer)) => placed.push((sample, index, layer)),
                failed => {
                    self.free(placed.into_iter().map(|(_, pool, layer)| (pool, layer)));
                    let bug = || RenderError::Internal("a pool vanished".to_owned());
                    return Err(failed.and_then(Result::err).unwrap_or_else(bug));
                }
            }
        }
        match self.write(gpu, bounds, mips, &set.info, &placed) {
            Ok(tiles) => {
                for (id, maps) in around {
                    self.release(&[id]);
                    self.bytes += maps.bytes();
                    self.surroundings.insert(id, maps);
                }
                for ((sample, pool, layer), tiles) in placed.into_iter().zip(tiles) {
                    self.release(&[sample.id]);
                    self.insert(Arc::clone(&set.info), sample, tiles, pool, layer);
                }
                Ok(())
            }
            Err(error) => {
                self.free(placed.into_iter().map(|(_, pool, layer)| (pool, layer)));
                Err(error)
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

    /// Forgets samples.
    pub(crate) fn release(&mut self, ids: &[SampleId]) {
        for id in ids {
            self.bytes -= self.bytes_of(*id);
            self.surroundings.remove(id);
            if let Some(held) = self.held.remove(id) {
                self.free([(held.pool, held.layer)]);
            }
        }
    }

    /// Copies samples into their layers, makes what is derived from them and finds their tiles' ranges.
    fn write(
        &mut self,
        gpu: &Arc<Gpu>,
        bounds: &BoundsPass,
        mips: &MipsPass,
        info: &SampleSetInfo,
        placed: &[(&Sample, usize, u32)],
    ) -> Result<Vec<Vec<FaceTiles>>, RenderError> {
        let mut all = Vec::with_capacity(placed.len());
        for &(sample, pool, layer) in placed {
            if let Some(pool) = &mut self.pools[pool] {
                pool.write(gpu, sample, layer)?;
            }
        }
        for &(sample, pool, layer) in placed {
            all.push((self.pool(pool)?, layer, sample.camera.faces()));
        }
        for index in 0..self.pools.len() {
            let layers: Vec<u32> =
                placed.iter().filter(|(_, pool, _)| *pool == index).map(|(_, _, layer)| *layer).collect();
            if !layers.is_empty() {
                mips.run(gpu, self.pool(index)?, &layers, info.lighting.exposure)?;
            }
        }
        bounds.run(gpu, &all)
    }

    fn insert(
        &mut self,
        info: Arc<SampleSetInfo>,
        sample: &Sample,
        tiles: Vec<FaceTiles>,
        pool: usize,
        layer: u32,
    ) {
        let (camera, faces) = (sample.camera, sample.camera.faces());
        self.held.insert(sample.id, Arc::new(Held { info, camera, faces, tiles, pool, layer }));
        self.bytes += self.bytes_of(sample.id);
    }

    fn bytes_of(&self, id: SampleId) -> u64 {
        let around = self.surroundings.get(&id).map_or(0, |maps| maps.bytes());
        let pool = self.held.get(&id).and_then(|held| self.pools[held.pool].as_ref());
        pool.map_or(around, |pool| pool.class.layer_bytes())
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
