//! Mirrors of structs of `shaders/`.

#[cfg(test)]
use argus_shaders::layout::Mirror;
use argus_shaders::mirror;

/// All mirrors of this crate, for the test.
#[cfg(test)]
pub(crate) const MIRRORS: &[Mirror] =
    &[PointPiece::MIRROR, PointFacet::MIRROR, PointMap::MIRROR, PointStep::MIRROR, SplatStep::MIRROR];

mirror! {
    /// A piece of a triangle with points: `shaders/shared/eye_points.wgsl`. Positions have a second part, which the first rounds away.
    pub struct PointPiece {
        /// Corner of row 0, column 0 of its grid, metres.
        pub origin: [f32; 3],
        /// Cells for each metre.
        pub density: f32,
        /// Second part of the corner.
        pub origin_low: [f32; 3],
        /// Index of its triangle.
        pub facet: u32,
        /// Unit vector along rows.
        pub right: [f32; 3],
        /// Bits. 1: its one cell is not cut off at the triangle's edges.
        pub flags: u32,
        /// Unit vector from row to row.
        pub up: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad: f32,
        /// Column and row of each corner, with fractions.
        pub places: [[f32; 2]; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _end: [f32; 2],
    }
}

mirror! {
    /// A triangle: `shaders/shared/eye_points.wgsl`. Positions have a second part, which the first rounds away.
    pub struct PointFacet {
        /// First corner, metres.
        pub a: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_a: f32,
        /// Second corner, metres.
        pub b: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_b: f32,
        /// Third corner, metres.
        pub c: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_c: f32,
        /// Second part of the first corner.
        pub a_low: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_a_low: f32,
        /// Second part of the second corner.
        pub b_low: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_b_low: f32,
        /// Second part of the third corner.
        pub c_low: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_c_low: f32,
        /// Unit normal.
        pub normal: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad_normal: f32,
    }
}

mirror! {
    /// A map of six faces around a point: `shaders/shared/eye_points.wgsl`.
    pub struct PointMap {
        /// Its middle, metres.
        pub center: [f32; 3],
        /// Index of its first texel; `u32::MAX` for a map that is not filled now.
        pub first: u32,
        /// Second part of the middle.
        pub center_low: [f32; 3],
        /// Texels on an edge of a face.
        pub side: u32,
        /// Unit normal, and distance of the border from the middle, metres, of the half-space that the map sees. Zero and -1:
        /// all of space.
        pub front: [f32; 4],
    }
}

mirror! {
    /// One pass that makes points: `shaders/points_cells.wgsl`.
    pub struct PointStep {
        /// Number of pieces, rows or points.
        pub count: u32,
        /// Number of pieces.
        pub pieces: u32,
        /// Number of rows.
        pub rows: u32,
    }
}

mirror! {
    /// One pass that splats points: `shaders/points_splat.wgsl`.
    pub struct SplatStep {
        /// First point, or tile, of this dispatch.
        pub first: u32,
        /// Number of points of this dispatch, or of all further tiles.
        pub count: u32,
        /// 32-bit words of visibility bits of a piece.
        pub words: u32,
        /// Number of all points.
        pub points: u32,
    }
}
