//! Points from triangles to maps on the GPU: density and cutting, cells, points, splats ([`crate::device`]).
//!
//! The definition is the CPU's, of which f32 differs where rounding decides: whether a part is quartered, and where its cells lie.
//! Only lengths of lists are read back, four a range of triangles and round of the budget. Maps and points stay on the device
//! for lookups (`reflect_on_device.rs`).
//!
//! Two things need the CPU, where a scene has them: texels that see through cut-outs, since the device has no textures here; and
//! culled triangles that stand alone. Then maps are read back, completed by the CPU, and uploaded.

use std::collections::VecDeque;
use std::fmt;

use argus_gpu::wgpu::Buffer;
use argus_sampler::plug::{IndexMaps, MappedReflector, Side};
use argus_scene::Stage;
use glam::DVec3;

use crate::cells::{Grid, Point};
use crate::compute::PointDevice;
use crate::device::{
    CellCount, CountedCells, CutParts, CutRule, DeviceReflectors, FacetRange, ListPart, ListedPoint, MapTurn,
    Points, PointsError, SeenSides, SplatPart, in_two_parts,
};
use crate::facets::{Piece, Pieces};
use crate::layout::PointReflector;
use crate::{
    BudgetReport, Density, DensityRule, Eye, EyePointSettings, EyePoints, PointScene, Splatting, Stages,
    within_budget,
};

/// Most times that ranges of triangles are cut in two. With more, dispatches would take longer than their work.
const MOST_SPLITS: usize = 4096;
/// Of a part's first word: it is the back of its triangle.
const BACK: u32 = 1 << 31;
/// Of a part's second word: two bits for each quartering, the first lowest; then their number, and flags.
const QUARTERS_SHIFT: u32 = 12;
const CULLED: u32 = 1 << 17;
const WHOLE_CELL: u32 = 1 << 18;

/// Points and maps on a device.
pub struct DevicePoints {
    pub(crate) parts: Vec<FilledPart>,
    pub(crate) turns: Vec<MapTurn>,
    /// What the CPU completed, if something needed that.
    pub(crate) completed: Option<Box<EyePoints>>,
    count: u32,
    /// How the budget was kept.
    pub budget: BudgetReport,
    /// Time of each pass, by a clock.
    pub stages: Vec<Stage>,
}

/// Points of a range of triangles.
pub(crate) struct FilledPart {
    cut: CountedPart,
    points: Points,
    base: u32,
}

/// Pieces of a range of triangles, with their cells counted.
struct CountedPart {
    sides: SeenSides,
    cut: CutParts,
    kept_parts: Buffer,
    cells: CellCount,
}

impl CountedPart {
    fn count(&self) -> u64 {
        match &self.cells {
            CellCount::Counted(cells) => u64::from(cells.cells()),
            CellCount::TooMany(most) => *most,
        }
    }

    fn counted(&self) -> Option<&CountedCells> {
        match &self.cells {
            CellCount::Counted(cells) => Some(cells),
            CellCount::TooMany(_) => None,
        }
    }
}

impl fmt::Debug for DevicePoints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DevicePoints").field("count", &self.count()).finish_non_exhaustive()
    }
}

impl DevicePoints {
    /// Number of points.
    pub fn count(&self) -> u32 {
        self.completed.as_ref().map_or(self.count, |completed| completed.count() as u32)
    }

    /// The parts, for listing.
    pub(crate) fn list_parts<'a>(&'a self, device: &'a PointDevice) -> Vec<ListPart<'a>> {
        let part = |part: &'a FilledPart| ListPart {
            facets: &device.facets,
            range: part.cut.sides.range(),
            points: &part.points,
            kept_parts: &part.cut.kept_parts,
            base: part.base,
        };
        self.parts.iter().map(part).collect()
    }
}

/// Cuts the triangles of a scene, range by range. A range that exceeds an array is cut in two.
struct RangeCutter<'a> {
    device: &'a PointDevice,
    reflectors: DeviceReflectors,
    eye: &'a Eye,
    culling: bool,
    /// Ranges that no array was too small for so far.
    ranges: Vec<FacetRange>,
    splits: usize,
}

impl RangeCutter<'_> {
    /// Cuts all ranges and counts their cells.
    fn cut(&mut self, density: &Density) -> Result<Vec<CountedPart>, PointsError> {
        let mut pending: VecDeque<FacetRange> = self.ranges.drain(..).collect();
        let mut parts = Vec::new();
        while let Some(range) = pending.pop_front() {
            match self.cut_range(range, density) {
                Ok(part) => {
                    self.ranges.push(range);
                    parts.push(part);
                }
                Err(error) => {
                    self.halves(range, error)?.into_iter().rev().for_each(|h| pending.push_front(h))
                }
            }
        }
        Ok(parts)
    }

    /// Makes the points of parts that were cut at a density.
    fn fill(&mut self, parts: Vec<CountedPart>, density: &Density) -> Result<Vec<FilledPart>, PointsError> {
        let mut pending: VecDeque<_> =
            parts.into_iter().map(|part| (part.sides.range(), Some(part))).collect();
        let (mut filled, mut base) = (Vec::new(), 0u64);
        while let Some((range, cut)) = pending.pop_front() {
            let cut = cut.map_or_else(|| self.cut_range(range, density), Ok);
            let made = cut.and_then(|cut| Ok((self.points(&cut)?, cut)));
            let (points, cut) = match made {
                Ok(made) => made,
                Err(error) => {
                    let halves = self.halves(range, error)?;
                    halves.into_iter().rev().for_each(|half| pending.push_front((half, None)));
                    continue;
                }
            };
            let Ok(first) = u32::try_from(base) else { return Err(self.too_many(base)) };
            base += cut.count();
            filled.push(FilledPart { cut, points, base: first });
        }
        if base > u64::from(u32::MAX) { Err(self.too_many(base)) } else { Ok(filled) }
    }

    fn cut_range(&self, range: FacetRange, density: &Density) -> Result<CountedPart, PointsError> {
        let PointDevice { passes, facets, .. } = self.device;
        let rule = rule(self.eye, density, self.culling);
        let sides = passes.sides(facets, range, &self.reflectors)?;
        let cut = passes.cut(facets, &sides, &self.reflectors, &rule)?;
        let [pieces, kept_parts] = passes.pieces(facets, range, &cut)?;
        let cells = passes.count_on_device(pieces, cut.kept())?;
        Ok(CountedPart { sides, cut, kept_parts, cells })
    }

    fn points(&self, cut: &CountedPart) -> Result<Points, PointsError> {
        match &cut.cells {
            CellCount::Counted(cells) => self.device.passes.points_on_device(cells),
            CellCount::TooMany(cells) => Err(self.too_many(*cells)),
        }
    }

    /// The halves of a range that exceeds an array, or its error.
    fn halves(&mut self, range: FacetRange, error: PointsError) -> Result<[FacetRange; 2], PointsError> {
        self.splits += 1;
        let can_split = matches!(error, PointsError::TooLarge { .. }) && self.splits < MOST_SPLITS;
        range.halves().filter(|_| can_split).ok_or(error)
    }

    fn too_many(&self, points: u64) -> PointsError {
        let limit = 8 * u64::from(self.device.most_points());
        PointsError::TooLarge { what: "points", needed: 8 * points, limit }
    }
}

/// The rule of density as the device knows it.
fn rule(eye: &Eye, density: &Density, culling: bool) -> CutRule {
    CutRule {
        rule: match density.rule {
            DensityRule::Eye => 0,
            DensityRule::Planar => 1,
            DensityRule::Map => 2,
            DensityRule::Shadow => 3,
        },
        pixels: eye.pixels as f32,
        near: eye.near as f32,
        scale: density.scale.sqrt() as f32,
        reduction: density.reduction as f32,
        culling,
    }
}

/// A reflector as the device knows it. Positions are relative to `origin`.
fn on_device(reflector: &MappedReflector, eye: &Eye, origin: DVec3) -> PointReflector {
    let [center, center_low] = in_two_parts(reflector.center - origin);
    let front = reflector.front.map_or(DVec3::ZERO.extend(-1.0), |front| {
        front.normal.extend((front.point - reflector.center).dot(front.normal))
    });
    PointReflector {
        center,
        radius: reflector.radius as f32,
        center_low,
        side: reflector.side as f32,
        front: front.as_vec4().to_array(),
        to_eye: (eye.position - reflector.center).as_vec3().to_array(),
        curvature: reflector.curvature as f32,
        from_eye: (eye.distance(reflector.center) - reflector.radius).max(eye.near) as f32,
        instance: reflector.instance,
        flags: u32::from(reflector.front.is_some()),
        _end: 0.0,
    }
}

impl PointScene {
    /// Makes points for reflectors that an eye sees, and fills their maps, on a device that has this scene's triangles. Nothing
    /// is read back but lengths, unless the scene has cut-outs or culled triangles, which the CPU completes.
    ///
    /// # Errors
    /// [`PointsError::TooLarge`] if one triangle or one map exceeds an array of the device, or there are more points than 32
    /// bits can number; or the device failed.
    pub fn fill_on(
        &self,
        device: &PointDevice,
        eye: &Eye,
        reflectors: &[MappedReflector],
        settings: &EyePointSettings,
    ) -> Result<DevicePoints, PointsError> {
        let mut stages = Stages::new();
        let on_device: Vec<PointReflector> =
            reflectors.iter().map(|reflector| on_device(reflector, eye, device.origin)).collect();
        let mut cutter = RangeCutter {
            device,
            reflectors: device.passes.reflectors(&on_device)?,
            eye,
            culling: settings.culling,
            ranges: if reflectors.is_empty() { Vec::new() } else { device.facets.ranges() },
            splits: 0,
        };
        let (parts, budget) = within_budget((settings.density, settings.budget), |density| {
            let parts = cutter.cut(&density)?;
            let pieces = parts.iter().map(|part| u64::from(part.cut.kept())).sum();
            let points = parts.iter().map(CountedPart::count).sum();
            Ok::<_, PointsError>((parts, [pieces, points]))
        })?;
        stages.end("density");
        let density = Density { reduction: budget.reduction, ..settings.density };
        let parts = cutter.fill(parts, &density)?;
        stages.end("points");
        let splats: Vec<SplatPart<'_>> = parts
            .iter()
            .filter_map(|part| {
                Some(SplatPart {
                    facets: device.facets.chunk(part.cut.sides.range()),
                    cells: part.cut.counted()?,
                    points: &part.points,
                    visible: part.cut.sides.visible(),
                    base: part.base,
                })
            })
            .collect();
        let around: Vec<_> = reflectors.iter().map(|reflector| device.map(reflector)).collect();
        let turns = device.passes.fill(&splats, &around)?;
        let count = parts.iter().map(|part| part.cut.count() as u32).sum();
        let mut found = DevicePoints { parts, turns, completed: None, count, budget, stages: Vec::new() };
        let has_culled = found.parts.iter().any(|part| part.cut.cut.culled() > 0);
        if has_culled || self.facets.iter().any(|facet| facet.cutout) {
            let completed = self.completed(device, &found, reflectors, settings)?;
            let texels: Vec<u64> = completed.maps.bits().collect();
            found.turns = device.passes.upload_maps(&around, &texels)?;
            found.completed = Some(Box::new(completed));
        }
        stages.end("splat");
        found.stages = stages.all();
        Ok(found)
    }

    /// Reads back points and maps.
    ///
    /// # Errors
    /// The device failed.
    pub fn read_points(
        &self,
        device: &PointDevice,
        found: DevicePoints,
        reflectors: &[MappedReflector],
    ) -> Result<EyePoints, PointsError> {
        let mut points = match found.completed {
            Some(completed) => *completed,
            None => self.read(device, &found, reflectors)?.0,
        };
        points.stages = found.stages;
        Ok(points)
    }

    /// Points and maps with what the device leaves out: cut-outs, and culled triangles that stand alone.
    fn completed(
        &self,
        device: &PointDevice,
        found: &DevicePoints,
        reflectors: &[MappedReflector],
        settings: &EyePointSettings,
    ) -> Result<EyePoints, PointsError> {
        let (mut points, culled) = self.read(device, found, reflectors)?;
        let EyePoints { pieces, points: made, first, stored, maps, .. } = &mut points;
        self.splats(pieces, (made, stored), first, reflectors).splat_cutouts(maps);
        let buffer = (Splatting::Buffered, made, stored);
        self.add_alone(&culled, pieces, first, buffer, maps, (reflectors, settings));
        Ok(points)
    }

    /// Reads back points and maps as the device left them, and culled pieces.
    fn read(
        &self,
        device: &PointDevice,
        found: &DevicePoints,
        reflectors: &[MappedReflector],
    ) -> Result<(EyePoints, Pieces), PointsError> {
        let words = reflectors.len().div_ceil(64);
        let [mut pieces, mut culled] = [(); 2].map(|()| Pieces { words, ..Pieces::default() });
        let mut points = Vec::new();
        for part in &found.parts {
            let (parts, bits) = device.passes.read_parts(&part.cut.sides, &part.cut.cut)?;
            let first_piece = pieces.all.len() as u64;
            let chunk = part.cut.sides.range().chunk;
            for [facet, quarters, density, side] in parts {
                let listed = [facet + device.facets.first_of(chunk), quarters, density, 0];
                let bits = &bits[words * side as usize..words * (side as usize + 1)];
                let is_culled = quarters & CULLED != 0;
                let to = if is_culled { &mut culled } else { &mut pieces };
                to.push(self.piece_of(&listed), bits);
            }
            let read = device.passes.read_points(&part.points)?;
            points.extend(read.into_iter().map(|point| Point(point + (first_piece << 32))));
        }
        let first = |piece: usize| points.partition_point(|point: &Point| (point.piece() as usize) < piece);
        let first: Vec<u32> = (0..=pieces.all.len()).map(|piece| first(piece) as u32).collect();
        let maps = IndexMaps::with_bits(reflectors, device.passes.read_maps(&found.turns)?);
        let (stored, budget) = (first.clone(), found.budget);
        Ok((EyePoints { pieces, points, first, stored, maps, budget, stages: Vec::new() }, culled))
    }

    /// The piece of a listed point, in f64: that of the CPU's definition at the density that the device found.
    pub(crate) fn piece_of(&self, [facet, quarters, density, _]: &ListedPoint) -> Piece {
        let side = if facet & BACK == 0 { Side::Front } else { Side::Back };
        let facet = facet & !BACK;
        let mut corners = self.facets[facet as usize].corners;
        for level in 0..quarters >> QUARTERS_SHIFT & 15 {
            let [a, b, c] = corners;
            let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
            corners = match quarters >> (2 * level) & 3 {
                0 => [a, ab, ca],
                1 => [ab, b, bc],
                2 => [ca, bc, c],
                _ => [ab, bc, ca],
            };
        }
        let density = f64::from(f32::from_bits(*density));
        let whole_cell = quarters & WHOLE_CELL != 0;
        let grid =
            if whole_cell { Grid::around_middle(corners, density) } else { Grid::new(corners, density) };
        // Every part of the device has a grid; one of no area would lie on its first corner.
        let grid = grid.unwrap_or(Grid { origin: corners[0], right: DVec3::X, up: DVec3::Y, density });
        Piece { facet, side, corners, grid, whole_cell }
    }
}
