//! Lit leaves on a device, as passes of light read them: `shaders/shared/lit_leaves.wgsl`.

use std::sync::Arc;

use argus_gpu::{ComputeCall, Gpu, wgpu};
use argus_scene::RenderError;
use argus_shaders::layout::surface_light::LeafGrid;
use glam::DVec3;

use crate::resident::upload;

/// Leaves in the program's layout.
pub(crate) struct PackedLeaves {
    /// World space position of the grid's centre.
    pub(crate) center: DVec3,
    /// The grid, for an eye at its centre.
    pub(crate) grid: LeafGrid,
    pub(crate) table: Vec<[u32; 4]>,
    pub(crate) sides: Vec<[f32; 4]>,
    pub(crate) fronts: Vec<u32>,
    pub(crate) first_of_instance: Vec<u32>,
}

/// Lit leaves on a device.
pub(crate) struct DeviceLeaves {
    center: DVec3,
    grid: LeafGrid,
    table: wgpu::Buffer,
    sides: wgpu::Buffer,
    fronts: wgpu::Buffer,
    first: wgpu::Buffer,
}

impl DeviceLeaves {
    /// Uploads leaves.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if they are larger than the device can bind.
    pub(crate) fn new(gpu: &Arc<Gpu>, leaves: &PackedLeaves) -> Result<Self, RenderError> {
        let storage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            center: leaves.center,
            grid: leaves.grid,
            table: upload(gpu, "lit leaves", &leaves.table, storage)?,
            sides: upload(gpu, "sides of lit leaves", &leaves.sides, storage)?,
            fronts: upload(gpu, "fronts of triangles", &leaves.fronts, storage)?,
            first: upload(gpu, "first triangles of instances", &leaves.first_of_instance, storage)?,
        })
    }

    /// The leaves about an eye.
    pub(crate) fn about(&self, gpu: &Gpu, eye: DVec3) -> LeavesAbout<'_> {
        let grid = LeafGrid { eye: (eye - self.center).as_vec3().to_array(), ..self.grid };
        LeavesAbout {
            leaves: self,
            grid: gpu.upload("grid of lit leaves", &[grid], wgpu::BufferUsages::UNIFORM),
        }
    }
}

/// Lit leaves about an eye.
pub(crate) struct LeavesAbout<'a> {
    leaves: &'a DeviceLeaves,
    grid: wgpu::Buffer,
}

impl LeavesAbout<'_> {
    /// Binds what a program reads to find the radiance along rays.
    pub(crate) fn bind<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        call.read("leaf_grid", &self.grid)
            .read("leaf_table", &self.leaves.table)
            .read("leaf_sides", &self.leaves.sides)
            .read("leaf_fronts", &self.leaves.fronts)
            .read("leaf_first", &self.leaves.first)
    }
}
