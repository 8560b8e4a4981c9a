// Pieces of triangles that have points, and the maps that points are splatted into. Mirrored in `layout.rs`.
//
// Positions have two parts, of which the second is what the first rounds away. So the difference of two positions is as exact
// as an f32 can be, however far both are from the origin.

// A piece of a triangle: a grid of square cells in the triangle's plane, and the cells that the piece touches.
struct PointPiece {
    // Corner of row 0, column 0, metres.
    origin: vec3f,
    // Cells for each metre.
    density: f32,
    origin_low: vec3f,
    // Index of its triangle.
    facet: u32,
    // Unit vector along rows.
    right: vec3f,
    // Bits. 1: its one cell is not cut off at the triangle's edges.
    flags: u32,
    // Unit vector from row to row.
    up: vec3f,
    // Its index in the list of visibility bits.
    seen: u32,
    // Column and row of each corner, with fractions.
    places: array<vec2f, 3>,
    // Cells that are nearer to the piece than this, in cells, count as touching: rounding moves a texel's place by less.
    slack: f32,
}

const WHOLE_CELL: u32 = 1u;

// A triangle.
struct PointFacet {
    // Corners, metres.
    a: vec3f,
    // Index of its instance.
    instance: u32,
    b: vec3f,
    // Bits: `BOTH_SIDES`, `CUTOUT`.
    flags: u32,
    c: vec3f,
    // A number in 0..1 that decides whether it is culled.
    chance: f32,
    a_low: vec3f,
    // Square metres.
    area: f32,
    b_low: vec3f,
    c_low: vec3f,
    // Unit normal.
    normal: vec3f,
}

// The back is seen, too.
const BOTH_SIDES: u32 = 1u;
// Parts of it are cut out.
const CUTOUT: u32 = 2u;

// Of the word that names a part's triangle: the part is its back.
const BACK: u32 = 0x80000000u;

// A map of six faces around a point.
struct PointMap {
    // Its middle, metres.
    center: vec3f,
    // Index of its first texel; `ABSENT` for a map that is not filled now.
    first: u32,
    center_low: vec3f,
    // Texels on an edge of a face.
    side: u32,
    // Unit normal, and distance of the border from the middle, metres, of the half-space that the map sees. Zero and -1: all.
    front: vec4f,
}

const ABSENT: u32 = 0xffffffffu;
