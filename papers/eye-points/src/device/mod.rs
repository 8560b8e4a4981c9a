//! Eye-based points on the GPU (Gavane and Watson, 2022): points of pieces of triangles, splatted into maps around reflectors.
//!
//! The caller cuts triangles into pieces, and decides their density and which maps see them ([`crate::PointScene`]); so
//! far that runs on the CPU. The passes here:
//!
//! 1. [`PointPasses::count`]: an invocation a piece, then one a row of cells; prefix sums of both;
//! 2. [`PointPasses::points`]: an invocation a point of 8 bytes;
//! 3. [`PointPasses::splat`]: an invocation a point writes the texels that it covers by 64-bit atomic maxima, at most 32 × 32 of
//!    each face. Larger rectangles are divided into tiles, which have invocations of their own.
//!
//! Every device that [`Gpu::new`] opens has 64-bit atomic maxima, so there is no program without them. Maps that exceed one
//! array of the device are filled in turns. Results are equal in each run, since a maximum does not depend on order.

mod cells;
mod splat;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::layout::PointFacet;
use crate::programs::{POINTS_CELLS, POINTS_SPLAT};
use argus_gpu::wgpu::{Buffer, BufferUsages};
use glam::DVec3;

use argus_gpu::{ComputePipeline, Gpu, GpuError, Scan};

pub use cells::{CountedCells, Points};
pub use splat::MapAround;

/// Why points could not be made.
#[derive(Debug, Clone, thiserror::Error)]
pub enum PointsError {
    /// An array exceeds what a program may bind on this device.
    #[error(
        "{what} need {needed} bytes in one array, and this device binds at most {limit}; lower the budget of points or the size of maps"
    )]
    TooLarge {
        /// Content of the array.
        what: &'static str,
        /// Its size, bytes.
        needed: u64,
        /// The device's limit, bytes.
        limit: u64,
    },
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// The pipelines.
#[derive(Debug)]
pub struct PointPasses {
    gpu: Arc<Gpu>,
    largest: u64,
    scan: Scan,
    count_rows: ComputePipeline,
    count_cells: ComputePipeline,
    make_points: ComputePipeline,
    splat: ComputePipeline,
    splat_further: ComputePipeline,
}

/// Triangles on the device.
#[derive(Debug)]
pub struct PointFacets {
    buffer: Buffer,
}

/// A position as the sum of two f32: the second is what the first rounds away.
pub fn in_two_parts(position: DVec3) -> [[f32; 3]; 2] {
    let high = position.as_vec3();
    [high.to_array(), (position - high.as_dvec3()).as_vec3().to_array()]
}

impl PointPasses {
    /// Makes the pipelines.
    pub fn new(gpu: &Arc<Gpu>) -> Self {
        Self::with_arrays_of(gpu, u64::MAX)
    }

    /// Makes the pipelines. No array has more than `bytes`, or than the device binds.
    pub fn with_arrays_of(gpu: &Arc<Gpu>, bytes: u64) -> Self {
        Self {
            largest: bytes.min(gpu.largest_array()),
            scan: Scan::new(gpu),
            count_rows: gpu.compute_pipeline(&POINTS_CELLS, "count_rows"),
            count_cells: gpu.compute_pipeline(&POINTS_CELLS, "count_cells"),
            make_points: gpu.compute_pipeline(&POINTS_CELLS, "make_points"),
            splat: gpu.compute_pipeline(&POINTS_SPLAT, "splat"),
            splat_further: gpu.compute_pipeline(&POINTS_SPLAT, "splat_further"),
            gpu: Arc::clone(gpu),
        }
    }

    /// Most points of one array, 8 bytes each.
    pub fn most_points(&self) -> u32 {
        u32::try_from(self.largest / 8).unwrap_or(u32::MAX)
    }

    /// Uploads triangles. `origin` is near them: positions are relative to it.
    ///
    /// # Errors
    /// There are too many for one array.
    pub fn facets(
        &self,
        corners: impl ExactSizeIterator<Item = [DVec3; 3]>,
        origin: DVec3,
    ) -> Result<PointFacets, PointsError> {
        self.fits("triangles", corners.len() as u64 * size_of::<PointFacet>() as u64)?;
        let facet = |corners: [DVec3; 3]| {
            let [[a, a_low], [b, b_low], [c, c_low]] = corners.map(|corner| in_two_parts(corner - origin));
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let normal = normal.as_vec3().to_array();
            PointFacet { a, b, c, a_low, b_low, c_low, normal, ..bytemuck::Zeroable::zeroed() }
        };
        let facets: Vec<PointFacet> = corners.map(facet).collect();
        Ok(PointFacets { buffer: self.gpu.upload("point facets", &facets, BufferUsages::STORAGE) })
    }

    fn fits(&self, what: &'static str, needed: u64) -> Result<(), PointsError> {
        if needed > self.largest {
            return Err(PointsError::TooLarge { what, needed, limit: self.largest });
        }
        Ok(())
    }

    /// A zeroed array.
    fn array(&self, what: &'static str, bytes: u64) -> Result<Buffer, PointsError> {
        self.fits(what, bytes)?;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        Ok(self.gpu.buffer(what, bytes, usage))
    }
}
