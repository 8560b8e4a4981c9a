// Encoding of depth in a view's cells, shared by splat, fill, warp and second pass.

// Before gaps are filled, a cell is a u32 that is updated by atomic maximum: the f32 bits of inverse depth (1/metres,
// along the view's axis) less a handicap. The last three bits are the sample; 20 bits of mantissa are more than a sample
// stores. (64-bit cells made splat and fill take half as long again.)
//
// The handicap is the sample's position in the plan's list times 2^19, which is 3 to 6% of depth. Of two samples of one
// surface, the first in the list (the nearest camera) then wins, rather than the one whose texel happens to be nearer.
const HANDICAP: u32 = 0x80000u;

// A filled cell that shows the sky: negative zero.
const SKY: u32 = 0x80000000u;

// After gaps are filled, a cell is the f32 bits of inverse depth, with the sample in the last three bits; Inverse depth,
// 1/metres; 0 for none. A
// negative depth is a guess: a neighbour's depth.
struct Depth {
    // 0 for none.
    q: f32,
    source: u32,
}

fn bits_of(depth: Depth) -> u32 {
    return select(0u, (bitcast<u32>(depth.q) & ~7u) | depth.source, depth.q != 0.0);
}

fn depth_of(bits: u32) -> Depth {
    return Depth(bitcast<f32>(bits & ~7u), bits & 7u);
}

// The unfilled cell of a positive inverse depth.
fn cell_of(q: f32, source: u32) -> u32 {
    // Clamps instead of wrapping around.
    let high = max(bitcast<u32>(q), source * HANDICAP + 8u) - source * HANDICAP;
    return (high & ~7u) | source;
}

// Decodes an unfilled cell.
fn depth_of_cell(cell: u32) -> Depth {
    let source = cell & 7u;
    return Depth(bitcast<f32>(select(0u, (cell & ~7u) + source * HANDICAP, cell >= 8u)), source);
}

// Relative difference of inverse depth up to which two neighbours belong to one surface.
const CONTINUES: f32 = 0.1;

// Whether two positive inverse depths belong to one surface.
fn continues(a: f32, b: f32) -> bool {
    return abs(a - b) <= CONTINUES * min(a, b);
}
