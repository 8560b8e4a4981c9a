// Program of papers/eye-points/src/device/splat.rs: writes points into the maps that see them (EPR, section 3.5). Defined in f64 by
// `papers/eye-points/src/splat.rs`.
//
// A texel is written where its ray meets the triangle within the point's cell, at the range there. All points of a piece compute
// the same place for a texel, so that exactly one of them has it. All pieces of a triangle compute the same range, so that the
// last of those whose cells overlap has it. Two triangles that share an edge compute the same volume there, of opposite sign, so
// that a ray meets one of them.

import package::shared::cube_faces::{face_of, from_face, in_face};
import package::eye_points::shared::eye_points::{ABSENT, CUTOUT, PointFacet, PointMap, PointPiece, WHOLE_CELL};
import package::shared::linear::linear_index;

struct SplatStep {
    // First point, or tile, of this dispatch.
    first: u32,
    // Number of points of this dispatch, or of all further tiles.
    count: u32,
    // 32-bit words of visibility bits of a piece.
    words: u32,
    // Number of all points.
    points: u32,
    // What is added to a point's index for its id.
    base: u32,
}

var<immediate> step: SplatStep;

@group(0) @binding(0) var<storage, read> pieces: array<PointPiece>;
@group(0) @binding(1) var<storage, read> facets: array<PointFacet>;
@group(0) @binding(2) var<storage, read> maps: array<PointMap>;
// For each entry that pieces name a bit for every map that sees them.
@group(0) @binding(3) var<storage, read> visible: array<u32>;
@group(0) @binding(4) var<storage, read> points: array<vec2u>;
// Bits of the inverse range, f32, above the index of the point.
@group(0) @binding(5) var<storage, read_write> texels: array<atomic<u64>>;
// Tiles of each point beyond the first of each rectangle, which are scanned to `first_tile`.
@group(0) @binding(6) var<storage, read_write> tile_counts: array<u32>;
@group(0) @binding(7) var<storage, read> first_tile: array<u32>;

const FACES: u32 = 6u;
// Texels on an edge of the part of a rectangle that one invocation visits.
const TILE: u32 = 32u;
// A cell's outline is widened by this on each side, cells, against rounding.
const WIDENED: f32 = 1.0 / 64.0;
// A rectangle is widened by this on each side, edges of a face, against rounding.
const SLACK: f32 = 1e-6;
// Stands for no tile beyond the first of each rectangle.
const FIRST_TILES: u32 = 0xffffffffu;
// Corners of a quadrangle that is cut off at a face's four sides.
const MOST_CORNERS: u32 = 8u;
// The least normal f32.
const LEAST_INVERSE: f32 = 1.17549435e-38;

fn is_before(a: vec3f, b: vec3f) -> bool {
    return a.x < b.x || (a.x == b.x && (a.y < b.y || (a.y == b.y && a.z < b.z)));
}

// The cross product of two corners; `along` is the way from the first to the second. It is made of the earlier corner in either
// direction, and so the other direction's is its exact negative.
fn edge(a: vec3f, b: vec3f, along: vec3f) -> vec3f {
    if is_before(b, a) {
        return -cross(b, -along);
    }
    return cross(a, along);
}

// A point's cell, as a map sees it; positions are relative to the map's middle.
struct SeenCell {
    // The point.
    id: u32,
    // Its column and row.
    cell: vec2f,
    whole_cell: bool,
    density: f32,
    // Places before the grid's first row or column that count as within it, cells: no piece begins there, but for rounding.
    border: f32,
    // Corner of row 0, column 0.
    origin: vec3f,
    right: vec3f,
    up: vec3f,
    edges: array<vec3f, 3>,
    // The triangle's unit normal, and the distance of its plane along that.
    normal: vec3f,
    height: f32,
    first: u32,
    side: u32,
    front: vec4f,
    corners: array<vec3f, 4>,
}

fn seen_cell(id: u32, map: u32) -> SeenCell {
    let point = points[id];
    let piece = pieces[point.y];
    let facet = facets[piece.facet];
    let around = maps[map];
    var s: SeenCell;
    s.id = id;
    s.cell = vec2f(f32(point.x & 0xffffu), f32(point.x >> 16u));
    s.whole_cell = (piece.flags & WHOLE_CELL) != 0u;
    s.density = piece.density;
    s.border = 2.0 * piece.slack;
    s.origin = (piece.origin - around.center) + (piece.origin_low - around.center_low);
    s.right = piece.right;
    s.up = piece.up;
    let a = (facet.a - around.center) + (facet.a_low - around.center_low);
    let b = (facet.b - around.center) + (facet.b_low - around.center_low);
    let c = (facet.c - around.center) + (facet.c_low - around.center_low);
    s.edges[0] = edge(a, b, (facet.b - facet.a) + (facet.b_low - facet.a_low));
    s.edges[1] = edge(b, c, (facet.c - facet.b) + (facet.c_low - facet.b_low));
    s.edges[2] = edge(c, a, (facet.a - facet.c) + (facet.a_low - facet.c_low));
    s.normal = facet.normal;
    s.height = dot(a, facet.normal);
    s.first = around.first;
    s.side = around.side;
    s.front = around.front;
    // The outline: the cell, or the piece's own corners where it is smaller than its only cell.
    let before = id > 0u && points[max(id, 1u) - 1u].y == point.y;
    let after = id + 1u < step.points && points[min(id + 1u, step.points - 1u)].y == point.y;
    let single = !(before || after || s.whole_cell);
    let low = s.cell - WIDENED - s.border;
    let high = s.cell + 1.0 + WIDENED + s.border;
    var places = array<vec2f, 4>(low, vec2f(high.x, low.y), high, vec2f(low.x, high.y));
    if single {
        places = array<vec2f, 4>(piece.places[0], piece.places[1], piece.places[2], piece.places[2]);
    }
    for (var i = 0u; i < 4u; i++) {
        s.corners[i] = s.origin + (s.right * places[i].x + s.up * places[i].y) / s.density;
    }
    return s;
}

// The texels of a face whose middles an outline may cover: first column and row, and those after the last. Empty if there are
// none. The outline is cut off at the face's sides (Sutherland and Hodgman, 1974).
fn rectangle(corners: array<vec3f, 4>, face: u32, side: u32) -> vec4u {
    var polygon: array<vec3f, 8>;
    var count = 4u;
    var outside = 0u;
    var all_outside = 15u;
    let given = corners;
    for (var i = 0u; i < 4u; i++) {
        let p = in_face(face, given[i]);
        polygon[i] = p;
        let out = select(0u, 1u, p.x < -p.z) | select(0u, 2u, p.x > p.z) | select(0u, 4u, p.y < -p.z)
            | select(0u, 8u, p.y > p.z);
        outside |= out;
        all_outside &= out;
    }
    if all_outside != 0u {
        return vec4u(0u);
    }
    for (var cut = 0u; cut < 4u; cut++) {
        if (outside & (1u << cut)) == 0u {
            continue;
        }
        let sign = select(1.0, -1.0, (cut & 1u) == 1u);
        let normal = select(vec3f(0.0, sign, 1.0), vec3f(sign, 0.0, 1.0), cut < 2u);
        let whole = polygon;
        let whole_count = count;
        count = 0u;
        for (var i = 0u; i < whole_count; i++) {
            let p = whole[i];
            let q = whole[select(i + 1u, 0u, i + 1u == whole_count)];
            let inside = dot(p, normal);
            let next = dot(q, normal);
            if inside >= 0.0 {
                polygon[min(count, MOST_CORNERS - 1u)] = p;
                count++;
            }
            if (inside > 0.0 && next < 0.0) || (inside < 0.0 && next > 0.0) {
                polygon[min(count, MOST_CORNERS - 1u)] = p + (q - p) * (inside / (inside - next));
                count++;
            }
        }
        count = min(count, MOST_CORNERS);
    }
    var low = vec2f(3e38);
    var high = vec2f(-3e38);
    for (var i = 0u; i < count; i++) {
        let p = polygon[i];
        if p.z > 0.0 {
            let at = (clamp(p.xy / p.z, vec2f(-2.0), vec2f(2.0)) + 1.0) * 0.5 * f32(side) - 0.5;
            low = min(low, at);
            high = max(high, at);
        }
    }
    if low.x > high.x {
        return vec4u(0u);
    }
    let last = vec2f(f32(side));
    let slack = SLACK * f32(side);
    let first = vec2u(clamp(ceil(low - slack), vec2f(0.0), last));
    let end = vec2u(clamp(floor(high + slack) + 1.0, vec2f(0.0), last));
    return vec4u(first, max(end, first));
}

fn write_texel(s: SeenCell, face: u32, column: u32, row: u32) {
    let across = (vec2f(f32(column), f32(row)) + 0.5) / f32(s.side) * 2.0 - 1.0;
    let direction = from_face(face, vec3f(across, 1.0));
    let volumes = vec3f(dot(s.edges[0], direction), dot(s.edges[1], direction), dot(s.edges[2], direction));
    if !(s.whole_cell || all(volumes >= vec3f(0.0)) || all(volumes <= vec3f(0.0))) {
        return;
    }
    let slope = dot(direction, s.normal);
    let t = s.height / select(slope, 1.0, slope == 0.0);
    // The ray runs in the plane, or away from it.
    if slope == 0.0 || !(t > 0.0) {
        return;
    }
    let met = direction * t;
    let from_origin = met - s.origin;
    let place = vec2f(dot(from_origin, s.right), dot(from_origin, s.up)) * s.density;
    if any(floor(select(place, place + s.border, place < vec2f(0.0))) != s.cell) || dot(met, s.front.xyz) <= s.front.w {
        return;
    }
    let inverse = max(1.0 / length(met), LEAST_INVERSE);
    let key = (u64(bitcast<u32>(inverse)) << 32u) | u64(step.base + s.id);
    atomicMax(&texels[s.first + (face * s.side + row) * s.side + column], key);
}

fn write_tile(s: SeenCell, face: u32, area: vec4u, tile: u32) {
    let across = (area.z - area.x + TILE - 1u) / TILE;
    let first = area.xy + vec2u(tile % across, tile / across) * TILE;
    let end = min(first + TILE, area.zw);
    for (var row = first.y; row < end.y; row++) {
        for (var column = first.x; column < end.x; column++) {
            write_texel(s, face, column, row);
        }
    }
}

// Visits the rectangles of texels that a point may cover, map by map and face by face. Writes the first tile of each, or one
// further tile of all. Returns the number of further tiles.
fn visit(id: u32, wanted: u32) -> u32 {
    let piece = points[id].y;
    let seen = pieces[piece].seen;
    // What is cut out is known on the CPU only.
    let words = select(min(step.words, arrayLength(&visible)), 0u, (facets[pieces[piece].facet].flags & CUTOUT) != 0u);
    var further = 0u;
    for (var word = 0u; word < words; word++) {
        var bits = visible[seen * step.words + word];
        while bits != 0u {
            let map = 32u * word + firstTrailingBit(bits);
            bits &= bits - 1u;
            if maps[map].first == ABSENT {
                continue;
            }
            let s = seen_cell(id, map);
            var face = face_of(s.corners[0]);
            var end = face + 1u;
            if face_of(s.corners[1]) != face || face_of(s.corners[2]) != face || face_of(s.corners[3]) != face {
                face = 0u;
                end = FACES;
            }
            for (; face < end; face++) {
                let area = rectangle(s.corners, face, s.side);
                let size = (area.zw - area.xy + TILE - 1u) / TILE;
                let tiles = size.x * size.y;
                if tiles == 0u {
                    continue;
                }
                if wanted == FIRST_TILES {
                    write_tile(s, face, area, 0u);
                } else if wanted >= further && wanted < further + tiles - 1u {
                    write_tile(s, face, area, wanted - further + 1u);
                    return 0u;
                }
                further += tiles - 1u;
            }
        }
    }
    return further;
}

@compute @workgroup_size(64)
fn splat(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < step.count {
        tile_counts[step.first + at] = visit(step.first + at, FIRST_TILES);
    }
}

// An invocation is a tile.
@compute @workgroup_size(64)
fn splat_further(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = step.first + linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    // The last point whose first tile is not after this one: one that has tiles.
    var low = 0u;
    var high = min(step.points, arrayLength(&first_tile));
    while low + 1u < high {
        let middle = (low + high) / 2u;
        if first_tile[middle] <= at {
            low = middle;
        } else {
            high = middle;
        }
    }
    visit(low, at - first_tile[low]);
}
