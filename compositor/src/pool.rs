//! Texture arrays for samples of one size and format. They grow with the number of samples.
//!
//! Binding arrays are not available on all devices, so all samples of a view must be layers of one array per plane.
//! Samples of a rig share a size, so there is usually one pool.

use std::collections::BTreeSet;
use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{PlaneKind, RenderError};

use crate::arrays::{Array, Arrays, PoolClass};
use crate::pyramid::{self, Pyramids};

/// The samples of one class.
#[derive(Debug)]
pub(crate) struct Pool {
    pub(crate) class: PoolClass,
    arrays: Option<Arrays>,
    capacity: u32,
    free: Vec<u32>,
    growth: Option<Growth>,
    pyramids: Option<Pyramids>,
}

/// Larger arrays that will replace a pool's. A few layers are copied with each upload: copying all at once delays views
/// by 233 ms when 64 layers become 128 (`argus-lab study load soak`).
#[derive(Debug)]
struct Growth {
    arrays: Arrays,
    capacity: u32,
    /// Layers and planes that are still to be copied.
    left: BTreeSet<(u32, usize)>,
    /// Copies that must be done before the next layer is taken; `None` until a layer is requested.
    due: Option<usize>,
}

/// Initial layers of a pool: the samples of one tile, or the nearest of one cell.
const FIRST_LAYERS: u32 = 4;

/// A pool starts to grow when at most one in this many layers is free.
const FREE_SHARE: u32 = 4;

impl Pool {
    /// An empty pool. Memory is allocated with the first sample.
    pub(crate) fn new(class: PoolClass) -> Self {
        Self { class, arrays: None, capacity: 0, free: Vec::new(), growth: None, pyramids: None }
    }

    /// The array of a plane.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the class has no such plane.
    pub(crate) fn array(&self, kind: PlaneKind) -> Result<&Array, RenderError> {
        let planes = self.arrays.iter().flat_map(|arrays| &arrays.planes);
        let array = planes.into_iter().find(|(of, _)| *of == kind).map(|(_, array)| array);
        array.ok_or_else(|| RenderError::Internal(format!("no samples have a {kind:?} plane")))
    }

    /// The view of all levels of a plane.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the class has no such plane.
    pub(crate) fn view(&self, kind: PlaneKind) -> Result<&wgpu::TextureView, RenderError> {
        Ok(&self.array(kind)?.view)
    }

    /// The display plane.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the pool never held a sample.
    pub(crate) fn display(&self) -> Result<&Array, RenderError> {
        let missing = || RenderError::Internal("a pool without samples has no display plane".to_owned());
        self.arrays.as_ref().map(|arrays| &arrays.display).ok_or_else(missing)
    }

    /// The view of a plane, or of radiance if the class has no such plane. Programs declare planes of glossy samples and
    /// read them only for glossy samples.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if the class has neither plane.
    pub(crate) fn view_or_radiance(&self, kind: PlaneKind) -> Result<&wgpu::TextureView, RenderError> {
        self.view(kind).or_else(|_| self.view(PlaneKind::Radiance))
    }

    /// Runs one step of growth if few layers are free. Returns whether a layer can be taken. Arrays double in layers.
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
        // Growth ends before the free layers are used up.
        let due = growth.due.get_or_insert(growth.left.len().div_ceil(self.free.len() + 1));
        if *due == 0 && !self.free.is_empty() {
            growth.due = None;
            return Ok(true);
        }
        if let Some((layer, plane)) = growth.left.pop_first() {
            *due = due.saturating_sub(1);
            let mut commands = gpu.commands("grow sample pool");
            match &self.arrays {
                // New layers copy any old layer: quirk `cleared-layers`.
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
        // The next pyramid search builds them again, in a larger array.
        self.pyramids = None;
        tracing::debug!(layers = self.capacity, ?self.class, "sample pool grown");
    }

    /// Takes a free layer, after [`Self::prepare_layer`] returned true.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the array has as many layers as the device allows.
    pub(crate) fn take_layer(&mut self) -> Result<u32, RenderError> {
        self.free.pop().ok_or_else(|| {
            let held = self.capacity;
            let reason =
                format!("{held} samples of one size are held, and a texture array has no more layers");
            RenderError::OutOfMemory(reason)
        })
    }

    /// Frees a layer.
    pub(crate) fn free_layer(&mut self, layer: u32) {
        self.free.push(layer);
        if let Some(pyramids) = &mut self.pyramids {
            pyramids.forget(layer);
        }
    }

    /// The pyramids, allocated at the first call. [`crate::passes::build_pyramid::BuildPyramidPass::make`] builds them.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] if the levels of a sample exceed the device's texture size.
    pub(crate) fn pyramids_mut(&mut self, gpu: &Gpu) -> Result<&mut Pyramids, RenderError> {
        let pyramids = match self.pyramids.take() {
            Some(pyramids) => pyramids,
            None => Pyramids::new(gpu, self.class.size, self.capacity)?,
        };
        Ok(self.pyramids.insert(pyramids))
    }

    /// The pyramids, once a pyramid search has built them.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if they were never built.
    pub(crate) fn pyramids(&self) -> Result<&wgpu::TextureView, RenderError> {
        let missing = || RenderError::Internal("pyramids are searched that were never made".to_owned());
        self.pyramids.as_ref().map(|pyramids| &pyramids.view).ok_or_else(missing)
    }

    /// Bytes of the pyramids. 0 if there are none and `wanted` is false.
    pub(crate) fn pyramid_bytes(&self, wanted: bool) -> u64 {
        if wanted || self.pyramids.is_some() { pyramid::bytes(self.class.size, self.capacity) } else { 0 }
    }

    /// Whether it holds no sample.
    pub(crate) fn is_empty(&self) -> bool {
        self.free.len() as u32 == self.capacity
    }

    /// Marks a layer as changed, so that growth copies it again.
    pub(crate) fn mark_dirty(&mut self, layer: u32) {
        if let Some(growth) = &mut self.growth {
            growth.left.extend((0..growth.arrays.count()).map(|plane| (layer, plane)));
        }
    }
}
