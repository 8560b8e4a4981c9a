//! Points and maps on the GPU.
//!
//! Triangles are cut into pieces by [`Cutter`](super::facets::Cutter) on the CPU, which uploads them. Counting rows and cells,
//! making points and splatting them run on the device ([`crate::device`]). Maps and points are read back, since lookups and
//! shading run on the CPU. Cut-out triangles are splatted by the CPU into the maps that were read back, because the device has no
//! textures here; so are culled triangles that stand alone.
//!
//! The device computes in f32, with positions in two parts. Its cells touch their triangles up to 1/1024 of a cell, so that
//! there are slightly more of them than on the CPU, and indices of points differ. The points that texels name are the same but
//! where rounding decides.

use std::fmt;
use std::sync::Arc;

use crate::device::{CountedCells, MapAround, PointFacets, PointPasses, PointsError, in_two_parts};
use crate::layout::PointPiece;
use argus_gpu::Gpu;
use glam::DVec3;
use rayon::prelude::*;

use super::{
    Eye, EyePointSettings, EyePoints, IndexMaps, MappedReflector, Piece, Pieces, Point, PointScene,
    Splatting, Stages,
};

/// A device with the triangles of a scene.
pub struct PointDevice {
    passes: PointPasses,
    facets: PointFacets,
    /// What positions are relative to, metres, world space.
    origin: DVec3,
}

impl fmt::Debug for PointDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PointDevice").field("origin", &self.origin).finish_non_exhaustive()
    }
}

impl PointDevice {
    /// Uploads the triangles of a scene.
    ///
    /// # Errors
    /// There are too many for one array of the device.
    pub fn new(gpu: &Arc<Gpu>, scene: &PointScene) -> Result<Self, PointsError> {
        Self::with_passes(PointPasses::new(gpu), scene)
    }

    pub(super) fn with_passes(passes: PointPasses, scene: &PointScene) -> Result<Self, PointsError> {
        let origin = scene.facets.first().map_or(DVec3::ZERO, |facet| facet.corners[0]);
        let facets = passes.facets(scene.facets.iter().map(|facet| facet.corners), origin)?;
        Ok(Self { passes, facets, origin })
    }

    /// Most points that the device can hold: larger budgets may end in an error.
    pub fn most_points(&self) -> u32 {
        self.passes.most_points()
    }

    fn piece(&self, piece: &Piece) -> PointPiece {
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
        let on_device: Vec<PointPiece> = pieces.all.par_iter().map(|piece| self.piece(piece)).collect();
        self.passes.count(&on_device).map(Some)
    }

    fn map(&self, reflector: &MappedReflector) -> MapAround {
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
        let mut visible = pieces.visible.clone();
        for (piece, bits) in pieces.all.iter().zip(visible.chunks_mut(pieces.words.max(1))) {
            if self.facets[piece.facet as usize].cutout {
                bits.fill(0);
            }
        }
        let around: Vec<MapAround> = reflectors.iter().map(|reflector| device.map(reflector)).collect();
        let bits = device.passes.splat(&device.facets, &counted, &on_device, &visible, &around)?;
        let maps = IndexMaps::with_bits(reflectors, bits);
        let mut stored = first.clone();
        self.splats(&pieces, (&points, &stored), &first, reflectors).splat_cutouts(&maps);
        let buffer = (Splatting::Buffered, &mut points, &mut stored);
        self.add_alone(&culled, &mut pieces, &mut first, buffer, &maps, (reflectors, settings));
        stages.end("splat");
        Ok(EyePoints { pieces, points, first, stored, maps, budget, stages: stages.all() })
    }
}
