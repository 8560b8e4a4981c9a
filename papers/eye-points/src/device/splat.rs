//! Splats points into maps. Program: `shaders/points_splat.wgsl`.

use crate::layout::{PointMap, SplatStep};
use argus_gpu::wgpu::{Buffer, BufferUsages};
use glam::DVec3;

use super::{CountedCells, PointFacets, PointPasses, Points, PointsError, in_two_parts};
use argus_gpu::{ComputeCall, ScanSums};

/// Pairs of a point and 64 maps, or tiles, of a dispatch: it ends in less than a second.
const EACH: u32 = 1 << 18;

/// A map of six square faces, seen from a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapAround {
    /// Where it is seen from, metres, relative to the origin of the triangles.
    pub center: DVec3,
    /// Texels on an edge of a face.
    pub side: u32,
    /// Unit normal, and distance of the border from the middle, metres, of the half-space that the map sees; `None` for all
    /// of space.
    pub front: Option<(DVec3, f64)>,
}

impl MapAround {
    fn texels(&self) -> u64 {
        6 * u64::from(self.side).pow(2)
    }

    fn on_device(&self) -> PointMap {
        let [center, center_low] = in_two_parts(self.center);
        let (normal, border) = self.front.unwrap_or((DVec3::ZERO, -1.0));
        let front = normal.extend(border).as_vec4().to_array();
        PointMap { center, first: u32::MAX, center_low, side: self.side, front }
    }
}

/// What does not differ between the turns in which maps are filled.
struct Turns<'a> {
    facets: &'a PointFacets,
    cells: &'a CountedCells,
    points: &'a Points,
    visible: Buffer,
    /// 64-bit words of a piece.
    words: u32,
}

impl Turns<'_> {
    /// Binds what both programs read and write.
    fn bound<'a>(&'a self, call: ComputeCall<'a>, maps: &'a Buffer, texels: &'a Buffer) -> ComputeCall<'a> {
        call.read("pieces", &self.cells.pieces)
            .read("facets", &self.facets.buffer)
            .read("maps", maps)
            .read("visible", &self.visible)
            .read("points", &self.points.buffer)
            .write("texels", texels)
    }
}

impl PointPasses {
    /// Splats points into maps. `visible` has the same number of 64-bit words for each piece; bit i of word w says that map
    /// 64·w + i sees the piece. Returns the texels of all maps: bits of the inverse range (f32, 1/metres) above the index of the
    /// point, or 0 for sky. A map has six faces (+x, −x, +y, −y, +z, −z) of rows.
    ///
    /// # Errors
    /// A map exceeds an array, or the device failed.
    pub fn splat(
        &self,
        facets: &PointFacets,
        cells: &CountedCells,
        points: &Points,
        visible: &[u64],
        maps: &[MapAround],
    ) -> Result<Vec<u64>, PointsError> {
        self.fits("visibility bits of pieces", size_of_val(visible) as u64)?;
        let visible = self.gpu.upload("visibility bits of pieces", visible, BufferUsages::STORAGE);
        let turns = Turns { facets, cells, points, visible, words: maps.len().div_ceil(64) as u32 };
        let tiles = self.array("first tiles of points", 4 * u64::from(points.count))?;
        let mut texels = Vec::new();
        let mut begin = 0;
        while begin < maps.len() {
            let mut on_device: Vec<PointMap> = maps.iter().map(MapAround::on_device).collect();
            let (mut count, mut end) = (0, begin);
            while end < maps.len() && (end == begin || 8 * (count + maps[end].texels()) <= self.largest) {
                on_device[end].first = count as u32;
                count += maps[end].texels();
                end += 1;
            }
            let array = self.array("texels of maps", 8 * count)?;
            texels.extend(self.turn(&turns, &tiles, &on_device, &array, count)?);
            begin = end;
        }
        Ok(texels)
    }

    /// Fills maps that fit in one array.
    fn turn(
        &self,
        turns: &Turns<'_>,
        tiles: &Buffer,
        maps: &[PointMap],
        texels: &Buffer,
        count: u64,
    ) -> Result<Vec<u64>, PointsError> {
        let maps = self.gpu.upload("maps around reflectors", maps, BufferUsages::STORAGE);
        let points = turns.points.count;
        let sums = ScanSums::new(&self.gpu, u64::from(points));
        let mut commands = self.gpu.commands("splat points");
        let each = (EACH / turns.words).max(64);
        let mut first = 0;
        while first < points {
            let step = SplatStep { first, count: each.min(points - first), words: 2 * turns.words, points };
            turns
                .bound(commands.compute("splat", &self.splat), &maps, texels)
                .write("tile_counts", tiles)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(step.count));
            first += step.count;
        }
        self.scan.run(&mut commands, "splat", tiles, points, &sums);
        let further = commands.read_buffer(sums.total(), 0..4);
        let read = commands.read_buffer(texels, 0..8 * count);
        let mut finished = commands.submit().wait()?;
        let further: u32 = bytemuck::pod_read_unaligned(&finished.take(further));
        if further == 0 {
            return Ok(bytemuck::pod_collect_to_vec(&finished.take(read)));
        }
        let mut commands = self.gpu.commands("splat further tiles");
        let mut first = 0;
        while first < further {
            let count = further.min(first.saturating_add(EACH));
            let step = SplatStep { first, count, words: 2 * turns.words, points };
            turns
                .bound(commands.compute("splat", &self.splat_further), &maps, texels)
                .read("first_tile", tiles)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(count - first));
            first = count;
        }
        let read = commands.read_buffer(texels, 0..8 * count);
        Ok(bytemuck::pod_collect_to_vec(&commands.submit().wait()?.take(read)))
    }
}
