//! Points and maps on the GPU.
//!
//! Triangles are cut into pieces by [`Cutter`](super::facets::Cutter) on the CPU, which uploads them; `on_device.rs` cuts them on
//! the device. Counting rows and cells,
//! making points and splatting them run on the device ([`crate::device`]). Maps and points are read back, since lookups and
//! shading run on the CPU. Cut-out triangles are splatted by the CPU into the maps that were read back, because the device has no
//! textures here; so are culled triangles that stand alone.
//!
//! The device computes in f32, with positions in two parts. Its cells touch their triangles up to 1/1024 of a cell, so that
//! there are slightly more of them than on the CPU, and indices of points differ. The points that texels name are the same but
//! where rounding decides.

use std::fmt;
use std::sync::Arc;

use crate::device::{
    CountedCells, DeviceFacet, MapAround, PointFacets, PointPasses, PointsError, in_two_parts,
};
use crate::layout::PointPiece;
use argus_gpu::Gpu;
use glam::DVec3;
use rayon::prelude::*;

use super::{
    Eye, EyePointSettings, EyePoints, Facet, IndexMaps, MappedReflector, Piece, Pieces, Point, PointScene,
    Splatting, Stages,
};

/// Cells that are nearer to a piece of the CPU than this, in cells, count as touching: rounding moves a texel's place by less.
const SLACK: f32 = 1.0 / 1024.0;

/// A device with the triangles of a scene.
pub struct PointDevice {
    pub(crate) passes: Arc<PointPasses>,
    pub(crate) facets: PointFacets,
    /// What positions are relative to, metres, world space.
    pub(crate) origin: DVec3,
}

impl fmt::Debug for PointDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PointDevice").field("origin", &self.origin).finish_non_exhaustive()
    }
}

impl PointDevice {
    /// Uploads the triangles of a scene.
    pub fn new(gpu: &Arc<Gpu>, scene: &PointScene) -> Self {
        Self::with_passes(Arc::new(PointPasses::new(gpu)), scene)
    }

    /// Uploads the triangles of a scene for pipelines that exist.
    pub(super) fn with_passes(passes: Arc<PointPasses>, scene: &PointScene) -> Self {
        let origin = scene.facets.first().map_or(DVec3::ZERO, |facet| facet.corners[0]);
        let on_device = |facet: &Facet| DeviceFacet {
            corners: facet.corners,
            instance: facet.instance,
            both_sides: facet.both_sides,
            cutout: facet.cutout,
            chance: facet.chance() as f32,
        };
        let facets = passes.facets(scene.facets.iter().map(on_device), origin);
        Self { passes, facets, origin }
    }

    /// Most points that the device can hold: larger budgets may end in an error.
    pub fn most_points(&self) -> u32 {
        self.passes.most_points()
    }

    fn piece(&self, (number, piece): (usize, &Piece)) -> PointPiece {
        let grid = &piece.grid;
        let [origin, origin_low] = in_two_parts(grid.origin - self.origin);
        PointPiece {
            origin,
            origin_low,
            density: grid.density as f32,
            facet: piece.facet,
            right: grid.right.as_vec3().to_array(),
            up: grid.up.as_vec3().to_array(),
            flags: u32::from(piece.whole_cell),
            seen: number as u32,
            slack: SLACK,
            places: piece.rows().places.map(|place| place.as_vec2().to_array()),
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// Counts the cells of pieces. `None` for more than 32 bits can count.
    fn count(&self, pieces: &Pieces) -> Result<Option<CountedCells>, PointsError> {
        let most: u64 = pieces.all.par_iter().map(|piece| piece.rows().most_cells()).sum();
        if most > u64::from(u32::MAX) {
            return Ok(None);
        }
        let on_device: Vec<PointPiece> =
            pieces.all.par_iter().enumerate().map(|piece| self.piece(piece)).collect();
        self.passes.count(&on_device).map(Some)
    }

    pub(crate) fn map(&self, reflector: &MappedReflector) -> MapAround {
        let front =
            reflector.front.map(|front| (front.normal, (front.point - reflector.center).dot(front.normal)));
        MapAround { center: reflector.center - self.origin, side: reflector.side, front }
    }
}

impl PointScene {
    /// Makes points for reflectors that an eye sees, and fills their maps, on a device that has this scene's triangles. Times of
    /// passes are those of a clock, with uploads and readback.
    ///
    /// # Errors
    /// [`PointsError::TooLarge`] if pieces, points or one map exceed an array of the device, or the device failed.
    pub fn points_on(
        &self,
        device: &PointDevice,
        eye: &Eye,
        reflectors: &[MappedReflector],
        settings: &EyePointSettings,
    ) -> Result<EyePoints, PointsError> {
        device.facets.whole()?;
        let mut stages = Stages::new();
        let mut counted = None;
        let count = |pieces: &Pieces| {
            counted = device.count(pieces)?;
            let cells = || pieces.all.par_iter().map(|piece| piece.rows().cells()).sum();
            Ok::<u64, PointsError>(counted.as_ref().map_or_else(cells, |counted| u64::from(counted.cells())))
        };
        let ([mut pieces, culled], budget) = self.pieces_within(eye, reflectors, settings, count)?;
        let Some(counted) = counted else {
            return Err(PointsError::TooLarge {
                what: "points",
                needed: 8 * (u64::from(u32::MAX) + 1),
                limit: 8 * u64::from(device.most_points()),
            });
        };
        stages.end("density");
        let (on_device, bytes) = device.passes.points(&counted)?;
        let points: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes[..]);
        let mut points: Vec<Point> = points.into_iter().map(Point).collect();
        let first = |piece: usize| points.partition_point(|point| (point.piece() as usize) < piece) as u32;
        let mut first: Vec<u32> = (0..=pieces.all.len()).into_par_iter().map(first).collect();
        stages.end("points");
        let around: Vec<MapAround> = reflectors.iter().map(|reflector| device.map(reflector)).collect();
        let bits = device.passes.splat(&device.facets, &counted, &on_device, &pieces.visible, &around)?;
        let maps = IndexMaps::with_bits(reflectors, bits);
        let mut stored = first.clone();
        self.splats(&pieces, (&points, &stored), &first, reflectors).splat_cutouts(&maps);
        let buffer = (Splatting::Buffered, &mut points, &mut stored);
        self.add_alone(&culled, &mut pieces, &mut first, buffer, &maps, (reflectors, settings));
        stages.end("splat");
        Ok(EyePoints { pieces, points, first, stored, maps, budget, stages: stages.all() })
    }
}
