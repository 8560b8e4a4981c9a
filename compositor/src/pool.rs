//! Layers for samples of one size and format, in texture arrays that grow as they are needed.
//!
//! Binding arrays are not available everywhere, so all samples that a view may be made of must lie in one
//! array per plane. Samples of a rig share a size, so in practice there is one pool.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{PlaneKind, RenderError};

use crate::arrays::{Array, Arrays, PoolClass};
use crate::passes::build_pyramid::BuildPyramidPass;
use crate::pyramid::{self, Pyramids};

/// Samples of one class.
#[derive(Debug)]
pub(crate) struct Pool {
    pub(crate) class: PoolClass,
    arrays: Option<Arrays>,
    capacity: u32,
    free: Vec<u32>,
    growth: Option<Growth>,
    pyramids: Option<Pyramids>,
}

/// Larger arrays that will take the place of a pool's. They are made ready a few layers at a time, with each sample that comes
/// in, since all at once keeps the views of a batch waiting: 233 ms for the step from 64 to 128 layers (`argus study soak`).
#[derive(Debug)]
struct Growth {
    arrays: Arrays,
    capacity: u32,
    /// Layers and planes that are not yet as the pool's are.
    left: BTreeSet<(u32, usize)>,
    /// How many of them are done before the next layer is given out; `None` until one is asked for.
    due: Option<usize>,
}

/// Layers that a pool begins with: the samples of one tile or the nearest of one cell.
const FIRST_LAYERS: u32 = 4;

/// A pool grows from when no more than one of so many of its layers is free.
const FREE_SHARE: u32 = 4;

impl Pool {
    /// An empty pool; memory is taken with the first sample.
    pub(crate) fn new(class: PoolClass) -> Self {
        Self { class, arrays: None, capacity: 0, free: Vec::new(), growth: None, pyramids: None }
    }

    /// The array of a plane that the class has.
    ///
    /// # Errors
    /// [`RenderError::Internal`] for one that it has not.
    pub(crate) fn array(&self, kind: PlaneKind) -> Result<&Array, RenderError> {
        let planes = self.arrays.iter().flat_map(|arrays| &arrays.planes);
        let array = planes.into_iter().find(|(of, _)| *of == kind).map(|(_, array)| array);
        array.ok_or_else(|| RenderError::Internal(format!("no samples have a {kind:?} plane")))
    }

    /// All levels of a plane that the class has.
    ///
    /// # Errors
    /// As [`Pool::array`].
    pub(crate) fn view(&self, kind: PlaneKind) -> Result<&wgpu::TextureView, RenderError> {
        Ok(&self.array(kind)?.view)
    }

    /// What views show of the samples.
    ///
    /// # Errors
    /// [`RenderError::Internal`] where no sample was ever held.
    pub(crate) fn display(&self) -> Result<&Array, RenderError> {
        let missing = || RenderError::Internal("a pool without samples has no display plane".to_owned());
        self.arrays.as_ref().map(|arrays| &arrays.display).ok_or_else(missing)
    }

    /// The array of a plane, or that of radiance where the class has none: programs name what only glossy samples have, and
    /// look at it only there.
    ///
    /// # Errors
    /// As [`Pool::view`].
    pub(crate) fn view_or_radiance(&self, kind: PlaneKind) -> Result<&wgpu::TextureView, RenderError> {
        self.view(kind).or_else(|_| self.view(PlaneKind::Radiance))
    }

    /// Does a step of what must be done before a layer can be taken, and returns whether all of it is done. Where few are
    /// free, the pool is on the way to arrays of twice the layers.
    ///
    /// # Errors
    /// Whatever the device fails with.
    pub(crate) fn prepare_layer(&mut self, gpu: &Arc<Gpu>) -> Result<bool, RenderError> {
        let most = gpu.device.limits().max_texture_array_layers;
        if self.growth.is_none()
            && self.capacity < most
            && self.free.len() as u32 <= self.capacity / FREE_SHARE
        {
            let capacity = (2 * self.capacity).clamp(FIRST_LAYERS, most);
            let arrays = Arrays::new(gpu, &self.class, capacity);
            let planes = 0..arrays.count();
            let left = (0..capacity).flat_map(|layer| planes.clone().map(move |plane| (layer, plane)));
            let left = left.collect();
            self.growth = Some(Growth { arrays, capacity, left, due: None });
        }
        let Some(growth) = &mut self.growth else { return Ok(true) };
        // It ends no later than the free layers.
        let due = growth.due.get_or_insert(growth.left.len().div_ceil(self.free.len() + 1));
        if *due == 0 && !self.free.is_empty() {
            growth.due = None;
            return Ok(true);
        }
        if let Some((layer, plane)) = growth.left.pop_first() {
            *due = due.saturating_sub(1);
            let mut commands = gpu.commands("grow sample pool");
            match &self.arrays {
                // New ones are a copy of any: wgpu would set to zero, all at once, what nothing was ever written to.
                Some(arrays) => {
                    let from = arrays.array(plane);
                    growth.arrays.array(plane).copy_layer(
                        layer,
                        from,
                        layer % self.capacity,
                        commands.encoder(),
                    );
                }
                None => growth.arrays.array(plane).clear_layer(gpu, layer, commands.encoder()),
            }
            commands.submit().wait()?;
        }
        if growth.left.is_empty() {
            self.end_growth();
        }
        Ok(false)
    }

    fn end_growth(&mut self) {
        let Some(grown) = self.growth.take() else { return };
        self.free.extend((self.capacity..grown.capacity).rev());
        self.capacity = grown.capacity;
        self.arrays = Some(grown.arrays);
        // Made again, in a larger array, by the next search that asks.
        self.pyramids = None;
        tracing::debug!(layers = self.capacity, ?self.class, "sample pool grown");
    }

    /// A layer for one more sample, after [`Self::prepare_layer`].
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] beyond the layers that the device can address.
    pub(crate) fn take_layer(&mut self) -> Result<u32, RenderError> {
        self.free.pop().ok_or_else(|| {
            let held = self.capacity;
            let reason =
                format!("{held} samples of one size are held, and a texture array has no more layers");
            RenderError::OutOfMemory(reason)
        })
    }

    /// Gives a layer back.
    pub(crate) fn free_layer(&mut self, layer: u32) {
        self.free.push(layer);
        if let Some(pyramids) = &mut self.pyramids {
            pyramids.forget(layer);
        }
    }

    /// Makes the pyramids of samples that have none yet.
    ///
    /// # Errors
    /// Whatever the device fails with.
    pub(crate) fn make_pyramids(
        &mut self,
        gpu: &Arc<Gpu>,
        pass: &BuildPyramidPass,
        layers: impl Iterator<Item = u32>,
    ) -> Result<(), RenderError> {
        let mut pyramids = match self.pyramids.take() {
            Some(pyramids) => pyramids,
            None => Pyramids::new(gpu, self.class.size, self.capacity)?,
        };
        let made =
            self.view(PlaneKind::InverseRange).and_then(|plane| pyramids.make(gpu, pass, plane, layers));
        self.pyramids = Some(pyramids);
        made
    }

    /// What a pyramid search reads, once [`Pool::make_pyramids`] made it.
    ///
    /// # Errors
    /// [`RenderError::Internal`] before.
    pub(crate) fn pyramids(&self) -> Result<&wgpu::TextureView, RenderError> {
        let missing = || RenderError::Internal("pyramids are searched that were never made".to_owned());
        self.pyramids.as_ref().map(|pyramids| &pyramids.view).ok_or_else(missing)
    }

    /// Device memory that pyramids take, or would take if `wanted`.
    pub(crate) fn pyramid_bytes(&self, wanted: bool) -> u64 {
        if wanted || self.pyramids.is_some() { pyramid::bytes(self.class.size, self.capacity) } else { 0 }
    }

    /// Whether no sample is in it.
    pub(crate) fn is_empty(&self) -> bool {
        self.free.len() as u32 == self.capacity
    }

    /// Says that something of a layer is about to change: a growth copies it once more.
    pub(crate) fn mark_dirty(&mut self, layer: u32) {
        if let Some(growth) = &mut self.growth {
            growth.left.extend((0..growth.arrays.count()).map(|plane| (layer, plane)));
        }
    }
}
