//! Cuts triangles into pieces of one density each. Program: `shaders/points_cut.wgsl`.
//!
//! All rounds of quartering are recorded at once, in lists whose lengths only the device knows; they are read back at the end.
//! A range of triangles with more pieces than an array holds is cut in two, so that no scene is too large for a binding.

use argus_gpu::wgpu::{Buffer, BufferUsages};
use argus_gpu::{Commands, LengthAt, Lists, ScanSums};

use super::{FacetRange, PointFacets, PointPasses, PointsError};
use crate::layout::{CutStep, PointPiece, PointReflector};

/// Rounds: a triangle is quartered six times at most, and the last round only decides.
const ROUNDS: u32 = 7;
/// Bytes of a part.
const PART_BYTES: u64 = 16;
/// Parts that there is room for at first, for each seen side and beside.
const PARTS_EACH: u64 = 2;
const PARTS_MORE: u64 = 8192;

/// How dense points are, and which reflectors there are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutRule {
    /// The rule of density: 0 the eye, 1 the eye by planar reflectors, 2 the map, 3 shadows.
    pub rule: u32,
    /// The eye's pixels at unit distance.
    pub pixels: f32,
    /// Distances below this count as this, metres.
    pub near: f32,
    /// Square root of the points for each pixel.
    pub scale: f32,
    /// Factor on the density by which a budget lowers it.
    pub reduction: f32,
    /// Whether most triangles below a tenth of a cell are left out.
    pub culling: bool,
}

/// Reflectors on the device.
#[derive(Debug)]
pub struct DeviceReflectors {
    buffer: Buffer,
    count: u32,
}

/// Sides of triangles that reflectors see.
#[derive(Debug)]
pub struct SeenSides {
    range: FacetRange,
    first_side: Buffer,
    count: u32,
    visible: Buffer,
}

/// Parts of triangles, with a density each.
#[derive(Debug)]
pub struct CutParts {
    /// Four u32 a part; see the program.
    parts: Buffer,
    count: u32,
    /// For each part the number of those before it that are kept.
    first_kept: Buffer,
    kept: u32,
    lists: Lists,
}

impl SeenSides {
    /// The triangles' range.
    pub fn range(&self) -> FacetRange {
        self.range
    }

    /// Visibility bits, for splatting.
    pub fn visible(&self) -> &Buffer {
        &self.visible
    }
}

impl CutParts {
    /// Number of pieces.
    pub fn kept(&self) -> u32 {
        self.kept
    }

    /// Number of parts that were culled.
    pub fn culled(&self) -> u32 {
        self.count - self.kept
    }
}

impl PointPasses {
    /// Uploads reflectors.
    ///
    /// # Errors
    /// There are too many for one array.
    pub fn reflectors(&self, reflectors: &[PointReflector]) -> Result<DeviceReflectors, PointsError> {
        self.fits("reflectors", size_of_val(reflectors) as u64)?;
        let buffer = self.gpu.upload("reflectors of points", reflectors, BufferUsages::STORAGE);
        Ok(DeviceReflectors { buffer, count: reflectors.len() as u32 })
    }

    fn cut_step(&self, range: FacetRange, reflectors: &DeviceReflectors) -> CutStep {
        CutStep {
            first: range.first,
            count: range.count,
            reflectors: reflectors.count,
            words: 2 * reflectors.count.div_ceil(64),
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// Finds the sides of triangles that reflectors see. They do not depend on the density.
    ///
    /// # Errors
    /// Bits exceed an array, or the device failed.
    pub fn sides(
        &self,
        facets: &PointFacets,
        range: FacetRange,
        reflectors: &DeviceReflectors,
    ) -> Result<SeenSides, PointsError> {
        let step = self.cut_step(range, reflectors);
        let first_side = self.array("seen sides of triangles", 4 * u64::from(range.count))?;
        let sums = ScanSums::new(&self.gpu, u64::from(range.count));
        let mut commands = self.gpu.commands("seen sides");
        commands
            .compute("sides", &self.cutting.count_sides)
            .read("facets", &facets.chunks[range.chunk])
            .read("reflectors", &reflectors.buffer)
            .write("side_counts", &first_side)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(range.count));
        self.scan.run(&mut commands, "sides", &first_side, range.count, &sums);
        let total = commands.read_buffer(sums.total(), 0..4);
        let count: u32 = bytemuck::pod_read_unaligned(&commands.submit().wait()?.take(total));
        let bits = 4 * u64::from(count) * u64::from(step.words);
        let visible = self.array("visibility bits of pieces", bits)?;
        Ok(SeenSides { range, first_side, count, visible })
    }

    /// Cuts the triangles of seen sides into parts of one density each, in the order of triangles, sides and quarters.
    ///
    /// # Errors
    /// Parts exceed an array, or the device failed.
    pub fn cut(
        &self,
        facets: &PointFacets,
        sides: &SeenSides,
        reflectors: &DeviceReflectors,
        rule: &CutRule,
    ) -> Result<CutParts, PointsError> {
        let what = "pieces of triangles";
        let most = (self.largest / PART_BYTES).min(u64::from(u32::MAX));
        let mut capacity = u64::from(sides.count);
        self.fits(what, capacity * PART_BYTES)?;
        capacity = (capacity * PARTS_EACH + PARTS_MORE).min(most);
        loop {
            let wanted = match self.try_cut(facets, sides, reflectors, rule, capacity as u32)? {
                Ok(found) => return Ok(found),
                Err(wanted) => u64::from(wanted),
            };
            self.fits(what, wanted * PART_BYTES)?;
            capacity = (2 * wanted.max(capacity)).min(most);
        }
    }

    /// Cuts triangles into at most `capacity` parts, or says how many a list should have had.
    fn try_cut(
        &self,
        facets: &PointFacets,
        sides: &SeenSides,
        reflectors: &DeviceReflectors,
        rule: &CutRule,
        capacity: u32,
    ) -> Result<Result<CutParts, u32>, PointsError> {
        let parts = [(); 2].map(|()| self.array("parts of triangles", PART_BYTES * u64::from(capacity)));
        let [a, b] = parts;
        let parts = [a?, b?];
        let counts = self.array("counts of parts", 4 * u64::from(capacity))?;
        let lists = Lists::new(&self.gpu, ROUNDS + 2, capacity);
        let step = CutStep {
            culls: u32::from(rule.culling),
            rule: rule.rule,
            pixels: rule.pixels,
            near: rule.near,
            scale: rule.scale,
            reduction: rule.reduction,
            ..self.cut_step(sides.range, reflectors)
        };
        let buffers = Buffers { facets: &facets.chunks[sides.range.chunk], sides, reflectors, parts: &parts };
        let sides_total = self.gpu.upload("number of sides", &[sides.count], BufferUsages::STORAGE);
        let mut commands = self.gpu.commands("cut triangles");
        commands
            .compute("sides", &self.cutting.write_sides)
            .read("facets", buffers.facets)
            .read("reflectors", &reflectors.buffer)
            .read("first_side", &sides.first_side)
            .write("seen_by", &sides.visible)
            .write("parts", &parts[0])
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(step.count));
        self.lists.advance(&mut commands, "cut", &lists, 0, LengthAt::first(&sides_total));
        for round in 0..ROUNDS {
            self.round(&mut commands, &buffers, &counts, &lists, CutStep { list: round, ..step });
        }
        let last = CutStep { list: ROUNDS, culls: 0, ..step };
        lists.dispatch(
            commands
                .compute("cut", &self.cutting.count_kept)
                .read("lengths", &lists.lengths)
                .write("parts", &parts[ROUNDS as usize % 2])
                .write("part_counts", &counts)
                .immediates(bytemuck::bytes_of(&last)),
        );
        self.lists.run(&mut commands, "cut", &lists, ROUNDS, &counts);
        self.lists.advance(&mut commands, "cut", &lists, ROUNDS + 1, LengthAt::first(lists.total()));
        let lengths = commands.read_buffer(&lists.lengths, 0..u64::from(ROUNDS + 2) * 8);
        let lengths = commands.submit().wait()?.take(lengths);
        let lengths: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&lengths[..8 * (ROUNDS as usize + 2)]);
        if let Some([_, wanted]) = lengths.iter().find(|[length, wanted]| length != wanted) {
            return Ok(Err(*wanted));
        }
        let [count, kept] = [0, 1].map(|i| lengths[(ROUNDS + i) as usize][0]);
        let [even, odd] = parts;
        let parts = if ROUNDS.is_multiple_of(2) { even } else { odd };
        Ok(Ok(CutParts { parts, count, first_kept: counts, kept, lists }))
    }

    /// Decides about the parts of a list, and makes those of the next one.
    fn round(
        &self,
        commands: &mut Commands,
        buffers: &Buffers<'_>,
        counts: &Buffer,
        lists: &Lists,
        step: CutStep,
    ) {
        let [from, to] = [step.list, step.list + 1].map(|list| &buffers.parts[list as usize % 2]);
        lists.dispatch(
            commands
                .compute("cut", &self.cutting.judge)
                .read("facets", buffers.facets)
                .read("reflectors", &buffers.reflectors.buffer)
                .read("visible", &buffers.sides.visible)
                .read("lengths", &lists.lengths)
                .write("parts", from)
                .write("part_counts", counts)
                .immediates(bytemuck::bytes_of(&step)),
        );
        self.lists.run(commands, "cut", lists, step.list, counts);
        lists.dispatch(
            commands
                .compute("cut", &self.cutting.divide)
                .read("lengths", &lists.lengths)
                .read("parts_before", from)
                .read("first_part", counts)
                .write("parts", to)
                .immediates(bytemuck::bytes_of(&step)),
        );
        self.lists.advance(commands, "cut", lists, step.list + 1, LengthAt::first(lists.total()));
    }

    /// Makes pieces of the parts that were not culled. Returns them, and four u32 of each one's part.
    ///
    /// # Errors
    /// They exceed an array.
    pub fn pieces(
        &self,
        facets: &PointFacets,
        range: FacetRange,
        cut: &CutParts,
    ) -> Result<[Buffer; 2], PointsError> {
        let kept = u64::from(cut.kept);
        let pieces = self.array("pieces of triangles", kept * size_of::<PointPiece>() as u64)?;
        let parts = self.array("parts of pieces", kept * PART_BYTES)?;
        let step = CutStep { list: ROUNDS, ..bytemuck::Zeroable::zeroed() };
        let mut commands = self.gpu.commands("make pieces");
        commands
            .compute("cut", &self.cutting.make_pieces)
            .read("facets", &facets.chunks[range.chunk])
            .read("lengths", &cut.lists.lengths)
            .read("parts_before", &cut.parts)
            .read("first_part", &cut.first_kept)
            .write("pieces", &pieces)
            .write("kept_parts", &parts)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(cut.count));
        commands.submit();
        Ok([pieces, parts])
    }

    /// Reads back all parts, four u32 each, and for each seen side its bits.
    ///
    /// # Errors
    /// The device failed.
    pub fn read_parts(
        &self,
        sides: &SeenSides,
        cut: &CutParts,
    ) -> Result<(Vec<[u32; 4]>, Vec<u64>), PointsError> {
        let mut commands = self.gpu.commands("read parts");
        let bits = commands.read_buffer(&sides.visible, 0..sides.visible.size());
        let parts = commands.read_buffer(&cut.parts, 0..PART_BYTES * u64::from(cut.count));
        let mut finished = commands.submit().wait()?;
        let (bits, parts) = (finished.take(bits), finished.take(parts));
        let parts = bytemuck::pod_collect_to_vec(&parts[..PART_BYTES as usize * cut.count as usize]);
        Ok((parts, bytemuck::pod_collect_to_vec(&bits[..bits.len() / 8 * 8])))
    }
}

/// What rounds read and write.
struct Buffers<'a> {
    facets: &'a Buffer,
    sides: &'a SeenSides,
    reflectors: &'a DeviceReflectors,
    parts: &'a [Buffer; 2],
}
