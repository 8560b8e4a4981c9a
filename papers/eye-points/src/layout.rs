//! Mirrors of structs of `shaders/`.

#[cfg(test)]
use argus_shaders::layout::Mirror;
use argus_shaders::mirror;

/// All mirrors of this crate, for the test.
#[cfg(test)]
pub(crate) const MIRRORS: &[Mirror] = &[
    PointPiece::MIRROR,
    PointFacet::MIRROR,
    PointMap::MIRROR,
    PointReflector::MIRROR,
    PointStep::MIRROR,
    SplatStep::MIRROR,
    CutStep::MIRROR,
    PointPixel::MIRROR,
    PointRay::MIRROR,
    LookupStep::MIRROR,
];

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
        /// Its index in the list of visibility bits.
        pub seen: u32,
        /// Column and row of each corner, with fractions.
        pub places: [[f32; 2]; 3],
        /// Cells that are nearer to the piece than this, in cells, count as touching.
        pub slack: f32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _end: f32,
    }
}

mirror! {
    /// A triangle: `shaders/shared/eye_points.wgsl`. Positions have a second part, which the first rounds away.
    pub struct PointFacet {
        /// First corner, metres.
        pub a: [f32; 3],
        /// Index of its instance.
        pub instance: u32,
        /// Second corner, metres.
        pub b: [f32; 3],
        /// Bits. 1: the back is seen, too; 2: parts of it are cut out.
        pub flags: u32,
        /// Third corner, metres.
        pub c: [f32; 3],
        /// A number in 0..1 that decides whether it is culled.
        pub chance: f32,
        /// Second part of the first corner.
        pub a_low: [f32; 3],
        /// Square metres.
        pub area: f32,
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
        /// What is added to a point's index for its id.
        pub base: u32,
    }
}

mirror! {
    /// A reflector that an eye sees: `shaders/shared/density.wgsl`.
    pub struct PointReflector {
        /// The middle of its map, metres.
        pub center: [f32; 3],
        /// Distance of its farthest vertex from the middle, metres.
        pub radius: f32,
        /// Second part of the middle.
        pub center_low: [f32; 3],
        /// Texels on an edge of a face.
        pub side: f32,
        /// Unit normal, and distance of the border from the middle, metres, of the half-space that the map sees. Zero and -1:
        /// all of space.
        pub front: [f32; 4],
        /// The eye's middle, from the map's.
        pub to_eye: [f32; 3],
        /// 1/metres.
        pub curvature: f32,
        /// Distance of the nearest viewpoint from the reflector's sphere, metres.
        pub from_eye: f32,
        /// Index of its instance.
        pub instance: u32,
        /// Bits. 1: a planar mirror, whose map is seen from the eye's mirror image.
        pub flags: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _end: f32,
    }
}

mirror! {
    /// One pass that cuts triangles: `shaders/shared/density.wgsl`.
    pub struct CutStep {
        /// First triangle.
        pub first: u32,
        /// Number of triangles.
        pub count: u32,
        /// Number of reflectors.
        pub reflectors: u32,
        /// 32-bit words of a bit for each reflector.
        pub words: u32,
        /// Index of the list of parts.
        pub list: u32,
        /// 1: small triangles may be culled. Passes over all parts: 2 for those that were culled, else those that were not.
        pub culls: u32,
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
    }
}

mirror! {
    /// A pixel of the eye in which a reflector is seen: `shaders/points_lookup.wgsl`.
    pub struct PointPixel {
        /// What its central ray meets, from the middle of the reflector's map, metres.
        pub about: [f32; 3],
        /// Index of the reflector's map.
        pub map: u32,
        /// The same place from the eye.
        pub from_eye: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_from_eye: f32,
        /// Unit normal.
        pub normal: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_normal: f32,
        /// Change of the place to the next pixel on the right.
        pub right: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_right: f32,
        /// Change of the place to the next pixel below.
        pub down: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_down: f32,
        /// Change of the normal to the next pixel on the right.
        pub normal_right: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_normal_right: f32,
        /// Change of the normal to the next pixel below.
        pub normal_down: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad_normal_down: f32,
    }
}

mirror! {
    /// A reflected ray: `shaders/points_lookup.wgsl`.
    pub struct PointRay {
        /// Its start, from the middle of the reflector's map, metres.
        pub start: [f32; 3],
        /// Index of the reflector's map; `u32::MAX` for a reflector without one.
        pub map: u32,
        /// Unit vector.
        pub direction: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _end: f32,
    }
}

mirror! {
    /// One pass of lookups: `shaders/points_lookup.wgsl`.
    pub struct LookupStep {
        /// The sky's radiance above.
        pub zenith: [f32; 3],
        /// Number of rays, words, requested points or pixels.
        pub count: u32,
        /// The sky's radiance at the horizon.
        pub horizon: [f32; 3],
        /// Rays of a pixel.
        pub taps: u32,
        /// The sky's radiance below.
        pub ground: [f32; 3],
        /// Impostor steps.
        pub steps: u32,
        /// First requested point of this dispatch.
        pub first: u32,
        /// Id of the first point of a part.
        pub base: u32,
        /// Number of points of a part.
        pub points: u32,
        /// What is added to the triangles of a part.
        pub facet_base: u32,
    }
}
