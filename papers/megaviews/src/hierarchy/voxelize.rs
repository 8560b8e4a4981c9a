//! Finds the octree cells that triangles overlap. Program: `shaders/voxelize.wgsl`.

use std::sync::Arc;

use crate::layout::Split;
use crate::programs::VOXELIZE;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use super::HierarchyError;
use argus_gpu::{ComputePipeline, Gpu, Scan, ScanSums};

/// The pipelines.
#[derive(Debug)]
pub(super) struct Voxelize {
    mark: ComputePipeline,
    divide: ComputePipeline,
}

/// Pairs of triangle (lower half) and Morton code of an overlapped cell (upper half).
pub(super) struct Pieces {
    pub(super) buffer: Buffer,
    pub(super) count: u32,
}

impl Voxelize {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&VOXELIZE, entry);
        Self { mark: pipeline("mark"), divide: pipeline("divide") }
    }

    /// Subdivides the root `depth` times where there are triangles. Pairs are in the order of the triangles, so the
    /// result is deterministic.
    pub(super) fn run(
        &self,
        gpu: &Arc<Gpu>,
        scan: &Scan,
        triangles: &Buffer,
        count: u32,
        depth: u32,
    ) -> Result<Pieces, HierarchyError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let first: Vec<[u32; 2]> = (0..count).map(|triangle| [triangle, 0]).collect();
        let mut pieces = Pieces { buffer: gpu.upload("triangles in the root", &first, usage), count };
        for level in 0..depth {
            let count = pieces.count;
            let step = Split { count, cells: (1u32 << (level + 1)) as f32 };
            let masks = gpu.buffer("masks of children", u64::from(count) * 4, BufferUsages::STORAGE);
            let offsets = gpu.buffer("offsets of children", u64::from(count) * 4, BufferUsages::STORAGE);
            let sums = ScanSums::new(gpu, u64::from(count));
            let mut commands = gpu.commands("mark cells");
            commands
                .compute("voxelise", &self.mark)
                .read("triangles", triangles)
                .read("pieces", &pieces.buffer)
                .write("masks", &masks)
                .write("offsets", &offsets)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(count));
            scan.run(&mut commands, "voxelise", &offsets, count, &sums);
            let total = commands.read_buffer(sums.total(), 0..4);
            let total = first_u32(&commands.submit().wait()?.take(total));
            super::fits(gpu, "pieces of triangles", u64::from(total) * 8)?;
            let children = gpu.buffer("pieces of triangles", u64::from(total) * 8, usage);
            let mut commands = gpu.commands("divide cells");
            commands
                .compute("voxelise", &self.divide)
                .read("pieces", &pieces.buffer)
                .write("masks", &masks)
                .write("offsets", &offsets)
                .write("children", &children)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(count));
            commands.submit();
            pieces = Pieces { buffer: children, count: total };
        }
        Ok(pieces)
    }
}

/// The first word of a readback; 0 if it is empty.
pub(super) fn first_u32(bytes: &[u8]) -> u32 {
    bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}
