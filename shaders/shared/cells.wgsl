// How a view's cells hold depth: what splat, fill, warp and mend agree on.

// A cell before gaps are closed is 32 bits of which the greatest is kept: the bits of the inverse depth (1/metres, along
// the view's axis), which order as it does, less a handicap; the last three replaced by the sample that it is from, since
// 20 bits of mantissa are more than a sample stores. (64 bits, depth over sample, took half as long again to splat and fill.)
//
// The handicap is the sample's position in the plan's list times 2^19, 3 to 6 per cent of depth: where two
// samples have the same surface, the first of the list, whose camera is nearest, serves it, rather than whichever
// texel happened to lie nearer.
const HANDICAP: u32 = 0x80000u;

// A cell afterwards that no texel came near, and through which the samples see past everything: a zero with a sign.
const SKY: u32 = 0x80000000u;

// A cell afterwards is 32 bits: the inverse depth, its last three bits replaced by the sample; 0 for none. With
// the sign it is a neighbour's, and on trial.
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

// The cell for a positive inverse depth.
fn cell_of(q: f32, source: u32) -> u32 {
    // A surface at 10^-36 of its depth from the handicap is not one.
    let high = max(bitcast<u32>(q), source * HANDICAP + 8u) - source * HANDICAP;
    return (high & ~7u) | source;
}

// The content of a cell before gaps are closed.
fn depth_of_cell(cell: u32) -> Depth {
    let source = cell & 7u;
    return Depth(bitcast<f32>(select(0u, (cell & ~7u) + source * HANDICAP, cell >= 8u)), source);
}

// Relative difference of inverse depth below which two neighbours are taken for one surface.
const CONTINUES: f32 = 0.1;

// Whether two positive inverse depths are of one surface.
fn continues(a: f32, b: f32) -> bool {
    return abs(a - b) <= CONTINUES * min(a, b);
}
