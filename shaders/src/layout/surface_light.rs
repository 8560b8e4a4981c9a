//! Mirrors of structs of the passes that find light of cells, emitters and surfaces: `shaders/sampler/*.wgsl`.

use super::Mirror;

/// All mirrors of this file.
pub(super) const MIRRORS: &[Mirror] = &[
    LeafGrid::MIRROR,
    CellQuery::MIRROR,
    CellEye::MIRROR,
    AloneQuery::MIRROR,
    SmoothQuery::MIRROR,
    EmitterPoint::MIRROR,
    EmitterQuery::MIRROR,
    GatherQuery::MIRROR,
];

mirror! {
    /// The grid of lit leaves: `shared/lit_leaves.wgsl`. Positions are metres about its centre.
    pub struct LeafGrid {
        /// The lowest corner of the inner cube.
        pub low: [f32; 3],
        /// Edge of a cell of the inner cube.
        pub cell: f32,
        /// The eye.
        pub eye: [f32; 3],
        /// Ratio of the edges of two cells that follow one another outside of the inner cube.
        pub growth: f32,
        /// Cells on a side of the inner cube.
        pub inner: i32,
        /// Cells before it and behind it along each axis.
        pub outer: i32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 2],
    }
}

mirror! {
    /// What is asked of light cells: `shared/light_cells.wgsl`.
    pub struct CellQuery {
        /// Edge of a cell of level 0, metres.
        pub edge: f32,
        /// Edge of a cell by the distance at which it is seen.
        pub edge_by_distance: f32,
        /// Edge of a cell by the side of the area that a texel stands for.
        pub edge_by_side: f32,
        /// The best tier that is asked for.
        pub tier: u32,
        /// The number of tiers that all cells must have.
        pub needed: u32,
    }
}

mirror! {
    /// The eye in the cells of a level: `shared/light_cells.wgsl`.
    pub struct CellEye {
        /// Its cell.
        pub cell: [i32; 3],
        /// 1 if it is near enough to the lattice.
        pub exists: u32,
        /// Its place within the cell, in edges of it.
        pub within: [f32; 3],
        /// The cell's edge, metres.
        pub spacing: f32,
    }
}

mirror! {
    /// Which rays of texels without cells are traced: `sampler/alone_rays.wgsl`.
    pub struct AloneQuery {
        /// Number of the ray of each texel.
        pub ray: u32,
        /// Metres beyond which a ray reaches the sky.
        pub reach: f32,
    }
}

mirror! {
    /// An image whose points are texels of a tile: `sampler/smooth_texels.wgsl`.
    pub struct SmoothQuery {
        /// Columns and rows.
        pub size: [u32; 2],
    }
}

mirror! {
    /// A point of an emitting triangle: `sampler/emitter_rays.wgsl`.
    pub struct EmitterPoint {
        /// Relative to the eye, metres.
        pub position: [f32; 3],
        /// 1 if both sides of the triangle emit.
        pub both_sides: u32,
        /// Front normal times the area.
        pub area: [f32; 3],
        /// Square of the distance from the triangle's middle, metres, below which a ray stands for all of it.
        pub near: f32,
        /// Radiance / π, divided by the probability of the triangle and the number of rays of a texel.
        pub radiance: [f32; 3],
        /// WGSL aligns vectors of three to 16 bytes.
        pub _pad: f32,
        /// Its corners, relative to the eye, metres.
        pub first: [f32; 3],
        /// Likewise.
        pub _pad_first: f32,
        /// The second.
        pub second: [f32; 3],
        /// Likewise.
        pub _pad_second: f32,
        /// The third.
        pub third: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _rest: f32,
    }
}

mirror! {
    /// Which rays to emitters are traced: `sampler/emitter_rays.wgsl`.
    pub struct EmitterQuery {
        /// Number of the ray of each texel.
        pub ray: u32,
    }
}

mirror! {
    /// Images of half a tile's size, whose points gather: `sampler/gather_rays.wgsl`.
    pub struct GatherQuery {
        /// Columns and rows.
        pub size: [u32; 2],
        /// Coordinates of the first block in the whole image.
        pub first: [u32; 2],
        /// Slots by which the image's points are ahead.
        pub slot: u32,
        /// Number of the ray of each point.
        pub ray: u32,
        /// By which what a ray brings is multiplied.
        pub share: f32,
        /// WGSL rounds the struct up to 8 bytes.
        pub _pad: u32,
    }
}
