//! Eye-based points on the GPU (Gavane and Watson, 2022): points of pieces of triangles, splatted into maps around reflectors.
//!
//! 1. [`PointPasses::cut`]: an invocation a triangle, then one a part of a triangle: pieces of one density each, and the maps
//!    that see them. The CPU does the same in f64 ([`crate::PointScene`]), and may hand over its pieces;
//! 2. [`PointPasses::count`]: an invocation a piece, then one a row of cells; prefix sums of both;
//! 3. [`PointPasses::points`]: an invocation a point of 8 bytes;
//! 4. [`PointPasses::splat`]: an invocation a point writes the texels that it covers by 64-bit atomic maxima, at most 32 × 32 of
//!    each face. Larger rectangles are divided into tiles, which have invocations of their own;
//! 5. [`PointPasses::request`]: an invocation a ray looks it up in the maps, and marks the point that it meets; marked points are
//!    listed, and [`PointPasses::mirror`] averages their radiance.
//!
//! Every device that [`Gpu::new`] opens has 64-bit atomic maxima, so there is no program without them. No array exceeds what a
//! program may bind: triangles are cut in ranges, and maps are filled and looked up in turns. Results are equal in each run,
//! since a maximum does not depend on order.

mod cells;
mod cut;
mod facets;
mod lookup;
mod pipelines;
mod splat;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::programs::{POINTS_CELLS, POINTS_SPLAT};
use argus_gpu::wgpu::{Buffer, BufferUsages};
use glam::DVec3;

use argus_gpu::{ComputePipeline, Gpu, GpuError, ListScan, Scan};
use pipelines::{Cutting, LookupPipelines};

pub use cells::{CellCount, CountedCells, Points};
pub use cut::{CutParts, CutRule, DeviceReflectors, SeenSides};
pub use facets::{DeviceFacet, FacetRange, PointFacets};
pub use lookup::{DeviceRays, ListPart, ListedPoint, Requested};
pub use splat::{MapAround, MapTurn, SplatPart};

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
    lists: ListScan,
    cutting: Cutting,
    lookups: LookupPipelines,
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
            lists: ListScan::new(gpu),
            cutting: Cutting::new(gpu),
            lookups: LookupPipelines::new(gpu),
            gpu: Arc::clone(gpu),
        }
    }

    /// Most points of one array, 8 bytes each.
    pub fn most_points(&self) -> u32 {
        u32::try_from(self.largest / 8).unwrap_or(u32::MAX)
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
