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

/// Maps that are filled together: their texels fit in one array.
#[derive(Debug)]
pub struct MapTurn {
    /// All maps. Those of other turns say so.
    pub(super) maps: Buffer,
    /// Bits of the inverse range (f32, 1/metres) above the index of the point, or 0 for sky.
    pub(super) texels: Buffer,
    /// Number of texels.
    pub(super) count: u64,
}

/// Points that are splatted together.
#[derive(Debug, Clone, Copy)]
pub struct SplatPart<'a> {
    /// Their triangles.
    pub facets: &'a Buffer,
    /// Their pieces.
    pub cells: &'a CountedCells,
    /// The points.
    pub points: &'a Points,
    /// The same number of 64-bit words for each entry that pieces name; bit i of word w says that map 64·w + i sees them.
    pub visible: &'a Buffer,
    /// Id of the first point.
    pub base: u32,
}

impl SplatPart<'_> {
    /// Binds what both programs read and write.
    fn bound<'a>(&'a self, call: ComputeCall<'a>, turn: &'a MapTurn) -> ComputeCall<'a> {
        call.read("pieces", &self.cells.pieces)
            .read("facets", self.facets)
            .read("maps", &turn.maps)
            .read("visible", self.visible)
            .read("points", &self.points.buffer)
            .write("texels", &turn.texels)
    }
}

impl PointPasses {
    /// Splats points into maps, and reads them back: the texels of all maps, as [`Self::fill`] fills them. `visible` has the same
    /// number of 64-bit words for each piece.
    ///
    /// # Errors
    /// Triangles, bits or a map exceed an array, or the device failed.
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
        let facets = facets.whole()?;
        let turns = self.fill(&[SplatPart { facets, cells, points, visible: &visible, base: 0 }], maps)?;
        self.read_maps(&turns)
    }

    /// Splats points into maps: bits of the inverse range (f32, 1/metres) above the id of the point, or 0 for sky. A map has
    /// six faces (+x, −x, +y, −y, +z, −z) of rows.
    ///
    /// # Errors
    /// A map exceeds an array, or the device failed.
    pub fn fill(&self, parts: &[SplatPart<'_>], maps: &[MapAround]) -> Result<Vec<MapTurn>, PointsError> {
        let turns = self.turns(maps, None)?;
        for turn in &turns {
            for part in parts.iter().filter(|part| part.points.count > 0) {
                self.fill_turn(part, turn, 2 * maps.len().div_ceil(64) as u32)?;
            }
        }
        Ok(turns)
    }

    /// Uploads texels of all maps, as [`Self::read_maps`] gives them.
    ///
    /// # Errors
    /// A map exceeds an array.
    pub fn upload_maps(&self, maps: &[MapAround], texels: &[u64]) -> Result<Vec<MapTurn>, PointsError> {
        self.turns(maps, Some(texels))
    }

    /// Reads back the texels of all maps.
    ///
    /// # Errors
    /// The device failed.
    pub fn read_maps(&self, turns: &[MapTurn]) -> Result<Vec<u64>, PointsError> {
        let mut texels = Vec::new();
        for turn in turns {
            let mut commands = self.gpu.commands("read maps");
            let read = commands.read_buffer(&turn.texels, 0..8 * turn.count);
            let bytes = commands.submit().wait()?.take(read);
            texels.extend(bytemuck::pod_collect_to_vec::<u8, u64>(&bytes[..8 * turn.count as usize]));
        }
        Ok(texels)
    }

    /// Divides maps among arrays, which are empty or have texels.
    fn turns(&self, maps: &[MapAround], texels: Option<&[u64]>) -> Result<Vec<MapTurn>, PointsError> {
        let (mut turns, mut begin, mut first) = (Vec::new(), 0, 0);
        while begin < maps.len() {
            let mut on_device: Vec<PointMap> = maps.iter().map(MapAround::on_device).collect();
            let (mut count, mut end) = (0, begin);
            while end < maps.len() && (end == begin || 8 * (count + maps[end].texels()) <= self.largest) {
                on_device[end].first = count as u32;
                count += maps[end].texels();
                end += 1;
            }
            let array = self.array("texels of maps", 8 * count)?;
            if let Some(texels) = texels {
                self.gpu.write(&array, &texels[first as usize..(first + count) as usize]);
            }
            let maps = self.gpu.upload("maps around reflectors", &on_device, BufferUsages::STORAGE);
            turns.push(MapTurn { maps, texels: array, count });
            first += count;
            begin = end;
        }
        Ok(turns)
    }

    /// Splats points into the maps of a turn. `words` are of 32 bits.
    fn fill_turn(&self, part: &SplatPart<'_>, turn: &MapTurn, words: u32) -> Result<(), PointsError> {
        let points = part.points.count;
        let tiles = self.array("first tiles of points", 4 * u64::from(points))?;
        let sums = ScanSums::new(&self.gpu, u64::from(points));
        let mut commands = self.gpu.commands("splat points");
        let each = (2 * EACH / words).max(64);
        let mut first = 0;
        while first < points {
            let step = SplatStep { first, count: each.min(points - first), words, points, base: part.base };
            part.bound(commands.compute("splat", &self.splat), turn)
                .write("tile_counts", &tiles)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(step.count));
            first += step.count;
        }
        self.scan.run(&mut commands, "splat", &tiles, points, &sums);
        let further = commands.read_buffer(sums.total(), 0..4);
        let further: u32 = bytemuck::pod_read_unaligned(&commands.submit().wait()?.take(further));
        if further == 0 {
            return Ok(());
        }
        let mut commands = self.gpu.commands("splat further tiles");
        let mut first = 0;
        while first < further {
            let count = further.min(first.saturating_add(EACH));
            let step = SplatStep { first, count, words, points, base: part.base };
            part.bound(commands.compute("splat", &self.splat_further), turn)
                .read("first_tile", &tiles)
                .immediates(bytemuck::bytes_of(&step))
                .dispatch_linear(u64::from(count - first));
            first = count;
        }
        commands.submit();
        Ok(())
    }
}
