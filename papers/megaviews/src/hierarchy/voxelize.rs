//! Finds the octree cells that triangles overlap. Program: `shaders/voxelize.wgsl`.
//!
//! All levels are recorded at once, as lists whose lengths only the device knows. There is room for somewhat more pieces than
//! expected; if a level has more, the levels are run again with room for twice as many.

use std::sync::Arc;

use crate::layout::Split;
use crate::programs::VOXELIZE;
use argus_gpu::wgpu::{Buffer, BufferUsages};
use glam::Vec3;

use super::{HierarchyError, fits};
use argus_gpu::{ComputePipeline, Gpu, LengthAt, ListScan, Lists};

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

/// Room for pieces beside those that are expected, a share of them.
const ROOM: f64 = 0.25;
/// Least room for pieces.
const LEAST_ROOM: u64 = 4096;

impl Voxelize {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&VOXELIZE, entry);
        Self { mark: pipeline("mark"), divide: pipeline("divide") }
    }

    /// Subdivides the root `depth` times where there are triangles, `count` of them. About `expected` pieces are found. Pairs are
    /// in the order of the triangles, so the result is deterministic.
    pub(super) fn run(
        &self,
        gpu: &Arc<Gpu>,
        scan: &ListScan,
        triangles: &Buffer,
        [count, depth]: [u32; 2],
        expected: f64,
    ) -> Result<Pieces, HierarchyError> {
        let what = "pieces of triangles";
        let most = (gpu.largest_array() / 8).min(u64::from(u32::MAX));
        let room = (expected * (1.0 + ROOM)) as u64;
        let mut capacity = room.max(LEAST_ROOM).max(u64::from(count)).min(most);
        fits(gpu, what, u64::from(count) * 8)?;
        loop {
            match self.try_run(gpu, scan, triangles, [count, depth], capacity as u32)? {
                Ok(pieces) => return Ok(pieces),
                Err(wanted) => {
                    fits(gpu, what, u64::from(wanted) * 8)?;
                    capacity = (2 * u64::from(wanted)).max(capacity).min(most);
                }
            }
        }
    }

    /// Subdivides the root with room for `capacity` pieces, or says how many a level should have had.
    fn try_run(
        &self,
        gpu: &Arc<Gpu>,
        scan: &ListScan,
        triangles: &Buffer,
        [count, depth]: [u32; 2],
        capacity: u32,
    ) -> Result<Result<Pieces, u32>, HierarchyError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let [a, b] = [(); 2].map(|()| gpu.buffer("pieces of triangles", u64::from(capacity) * 8, usage));
        let first: Vec<[u32; 2]> = (0..count).map(|triangle| [triangle, 0]).collect();
        gpu.write(&a, &first);
        let [masks, offsets] = ["masks of children", "offsets of children"]
            .map(|name| gpu.buffer(name, u64::from(capacity) * 4, BufferUsages::STORAGE));
        let lists = Lists::new(gpu, depth + 1, capacity);
        let total = gpu.upload("number of triangles", &[count], BufferUsages::STORAGE);
        let name = "voxelise";
        let (mut from, mut to) = (a, b);
        let mut commands = gpu.commands("voxelise");
        scan.advance(&mut commands, name, &lists, 0, LengthAt::first(&total));
        for level in 0..depth {
            let step = Split { list: level, cells: (1u32 << (level + 1)) as f32 };
            lists.dispatch(
                commands
                    .compute(name, &self.mark)
                    .read("triangles", triangles)
                    .read("pieces", &from)
                    .read("lengths", &lists.lengths)
                    .write("masks", &masks)
                    .write("offsets", &offsets)
                    .immediates(bytemuck::bytes_of(&step)),
            );
            scan.run(&mut commands, name, &lists, level, &offsets);
            lists.dispatch(
                commands
                    .compute(name, &self.divide)
                    .read("pieces", &from)
                    .read("lengths", &lists.lengths)
                    .write("masks", &masks)
                    .write("offsets", &offsets)
                    .write("children", &to)
                    .immediates(bytemuck::bytes_of(&step)),
            );
            scan.advance(&mut commands, name, &lists, level + 1, LengthAt::first(lists.total()));
            std::mem::swap(&mut from, &mut to);
        }
        let bytes = 8 * (depth as usize + 1);
        let lengths = commands.read_buffer(&lists.lengths, 0..bytes as u64);
        let lengths = commands.submit().wait()?.take(lengths);
        let lengths: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&lengths[..bytes]);
        Ok(match lengths.iter().find(|[length, wanted]| length != wanted) {
            Some([_, wanted]) => Err(*wanted),
            None => Ok(Pieces { buffer: from, count: lengths[depth as usize][0] }),
        })
    }
}

/// Number of cells that a triangle of the unit cube overlaps on a level of `cells` cells an edge, at the mean of all places of
/// the grid: the volume of its Minkowski sum with a cell, in cells.
pub(super) fn expected_cells(corners: &[[f32; 3]; 3], cells: f64) -> f64 {
    let [a, b, c] = corners.map(|corner| Vec3::from_array(corner).as_dvec3() * cells);
    let width = a.max(b).max(c) - a.min(b).min(c);
    let projected = (b - a).cross(c - a).abs() * 0.5;
    1.0 + width.element_sum() + projected.element_sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_number_of_cells_is_one_more_for_each_border_that_is_crossed_on_average() {
        let point = [[0.3; 3]; 3];
        assert!((expected_cells(&point, 64.0) - 1.0).abs() < 1e-12);
        // A square of four by four cells, as two triangles that share a diagonal of ten cells.
        let [a, b, c, d] = [[0.0, 0.0, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.5], [0.0, 0.5, 0.5]];
        let both = expected_cells(&[a, b, c], 8.0) + expected_cells(&[a, c, d], 8.0);
        assert!((both - 34.0).abs() < 1e-9, "{both}");
    }
}
