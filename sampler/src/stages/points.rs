//! Points on surfaces, on the device.

use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{Cancel, RenderError, Stage};

use crate::eye::Eye;
use crate::frame::{Frame, LightSharing};
use crate::indirect::Lights;
use crate::passes::{ShadePoints, TileContext};
use crate::point_shading::{PointChunk, Points};
use crate::resident::{Resident, upload};
use crate::scratch::{Extras, Scratch};

/// What shades points. Their positions are relative to the eye.
pub(crate) struct PointShading<'a> {
    pub(crate) gpu: &'a Arc<Gpu>,
    pub(crate) resident: &'a Resident,
    pub(crate) eye: &'a Eye,
    pub(crate) lights: &'a mut Lights,
    pub(crate) programs: &'a ShadePoints,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) cancel: &'a Cancel,
}

impl<'a> PointShading<'a> {
    /// The frame of a chunk of points.
    pub(super) fn begin<'b>(
        &mut self,
        chunk: &PointChunk,
        sharing: LightSharing,
        extras: Extras,
        stages: &'b mut Vec<Stage>,
    ) -> Frame<'b>
    where
        'a: 'b,
    {
        let context = TileContext::new(self.gpu, self.resident, self.eye, &chunk.tile, self.scratch, extras);
        Frame::new(context, sharing, "shade points", stages)
    }
}

/// Points on the device, and room for their radiance.
pub(super) struct PointsOnDevice {
    pub(super) points: wgpu::Buffer,
    pub(super) radiance: wgpu::Buffer,
}

impl PointsOnDevice {
    /// Uploads points.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for more points than the device can bind.
    pub(super) fn new(gpu: &Gpu, points: &Points) -> Result<Self, RenderError> {
        let storage = wgpu::BufferUsages::STORAGE;
        let bytes = points.all.len().max(1) as u64 * 4;
        let radiance = gpu.buffer("radiance of points", bytes, storage | wgpu::BufferUsages::COPY_SRC);
        let list = if points.all.is_empty() { &[Points::NOTHING][..] } else { &points.all };
        Ok(Self { points: upload(gpu, "points", list, storage)?, radiance })
    }
}
