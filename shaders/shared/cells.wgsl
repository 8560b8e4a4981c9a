// How a view's cells hold depth: what splat, fill, warp and mend agree on.

// A cell before gaps are closed is 64 bits of which the greatest is kept: above, the bits of the inverse depth
// (1/metres, along the view's axis), which order as it does, less a handicap; below, which sample it is from.
//
// The handicap is the sample's position in the plan's list times 2^19, 3 to 6 per cent of depth: where two
// samples have the same surface, the first of the list, whose camera is nearest, serves it, rather than whichever
// texel happened to lie nearer.
const HANDICAP: u32 = 0x80000u;

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

// The content of a cell before gaps are closed, as its low and its high word.
fn depth_of_cell(cell: vec2u) -> Depth {
    return Depth(bitcast<f32>(select(0u, cell.y + cell.x * HANDICAP, cell.y > 0u)), cell.x & 7u);
}
