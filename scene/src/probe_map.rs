//! The layout of a reflection probe's map.

/// Texels on a side of a probe's coarsest level, for surfaces of roughness 1. This and `RING` equal those in
/// `shaders/shared/reflection_probes.wgsl`.
const COARSEST: u32 = 4;
/// Texels around a level, so that a bilinear fetch never leaves it.
const RING: u32 = 1;

/// Texels on a side of each level of a probe, finest first. Each level has half as many, for rougher surfaces.
pub fn level_sides(side: u32) -> impl Iterator<Item = u32> {
    std::iter::successors(Some(side), |side| (*side / 2 >= COARSEST).then_some(*side / 2))
}

/// Columns and rows of a probe's map: its levels below one another, each with a ring around it.
pub fn map_size(side: u32) -> [u32; 2] {
    [side + 2 * RING, level_sides(side).map(|side| side + 2 * RING).sum()]
}
