// Program of papers/eye-points/src/device/cut.rs: cuts triangles into pieces of one density each (EPR, sections 3.1 and 3.2). Defined
// in f64 by `papers/eye-points/src/facets.rs`.
//
// An invocation is a triangle, then a part of a triangle that is seen from one side. A round quarters those that are too large
// for one density. Parts are always in the order of triangles, sides and quarters, so that pieces have the CPU's order.

import package::eye_points::shared::eye_points::{BACK, BOTH_SIDES, PointFacet, PointPiece, WHOLE_CELL};
import package::eye_points::shared::density::{CutStep, PointReflector, density_for, distance_from};
import package::shared::linear::linear_index;

var<immediate> step: CutStep;

@group(0) @binding(0) var<storage, read> facets: array<PointFacet>;
@group(0) @binding(1) var<storage, read> reflectors: array<PointReflector>;
// For each triangle the number of sides that reflectors see, which is scanned to `first_side`.
@group(0) @binding(2) var<storage, read_write> side_counts: array<u32>;
@group(0) @binding(3) var<storage, read> first_side: array<u32>;
// For each seen side a bit for every reflector that sees it.
@group(0) @binding(4) var<storage, read_write> seen_by: array<u32>;
@group(0) @binding(5) var<storage, read> visible: array<u32>;
// Parts: triangle and side; quarters, their number and flags; density, f32 bits; seen side.
@group(0) @binding(6) var<storage, read_write> parts: array<vec4u>;
@group(0) @binding(7) var<storage, read_write> part_counts: array<u32>;
@group(0) @binding(8) var<storage, read> parts_before: array<vec4u>;
@group(0) @binding(9) var<storage, read> first_part: array<u32>;
@group(0) @binding(10) var<storage, read> lengths: array<vec2u>;
@group(0) @binding(11) var<storage, read_write> pieces: array<PointPiece>;
// The part of each piece.
@group(0) @binding(12) var<storage, read_write> kept_parts: array<vec4u>;

// Of a part's second word: two bits for each quartering, the first lowest; their number; and flags.
const QUARTERS_SHIFT: u32 = 12u;
const DONE: u32 = 0x10000u;
const CULLED: u32 = 0x20000u;
const WHOLE: u32 = 0x40000u;

// Triangles smaller than this, in cells, may be culled.
const CULLED_BELOW: f32 = 0.1;
// A part with an edge longer than its distance from a reflector's middle is quartered.
const LONGEST: f32 = 1.0;
// Parts with fewer cells than this are not quartered.
const FEWEST: f32 = 64.0;
// Most times that a triangle is quartered.
const DEEPEST: u32 = 6u;
// Rows and columns that 16 bits can say.
const MOST_CELLS: f32 = 65000.0;
// Distance of the grid's corner from the piece, cells.
const MARGIN: f32 = 1.0 / 1024.0;
// Rounding of a place in the plane, a share of the triangle's longest edge.
const ROUNDING: f32 = 2.4e-7;

// Edges of a triangle from its first corner.
fn edge_ab(f: PointFacet) -> vec3f {
    return (f.b - f.a) + (f.b_low - f.a_low);
}

fn edge_ac(f: PointFacet) -> vec3f {
    return (f.c - f.a) + (f.c_low - f.a_low);
}

// Bits of the reflectors of a word that see a triangle's front, and its back.
fn seen_sides(facet: u32, word: u32) -> vec2u {
    let f = facets[facet];
    let ab = edge_ab(f);
    let ac = edge_ac(f);
    let end = min(32u * word + 32u, min(step.reflectors, arrayLength(&reflectors)));
    var bits = vec2u(0u);
    for (var number = 32u * word; number < end; number++) {
        let r = reflectors[number];
        if r.instance == f.instance {
            continue;
        }
        let a = (f.a - r.center) + (f.a_low - r.center_low);
        let ahead = vec3f(dot(a, r.front.xyz), dot(a + ab, r.front.xyz), dot(a + ac, r.front.xyz));
        if all(ahead <= vec3f(r.front.w)) {
            continue;
        }
        let height = -dot(f.normal, a);
        let back = height < 0.0 && (f.flags & BOTH_SIDES) != 0u;
        let bit = 1u << (number % 32u);
        bits |= vec2u(select(0u, bit, height > 0.0), select(0u, bit, back));
    }
    return bits;
}

// Counts the sides of each triangle that some reflector sees.
@compute @workgroup_size(64)
fn count_sides(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let words = min(step.words, arrayLength(&reflectors));
    var seen = vec2u(0u);
    for (var word = 0u; word < words; word++) {
        seen |= seen_sides(step.first + at, word);
    }
    side_counts[at] = select(0u, 1u, seen.x != 0u) + select(0u, 1u, seen.y != 0u);
}

// Writes the bits of seen sides, and their whole triangles as the first parts.
@compute @workgroup_size(64)
fn write_sides(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= step.count {
        return;
    }
    let facet = step.first + at;
    let words = min(step.words, arrayLength(&reflectors));
    var seen = vec2u(0u);
    for (var word = 0u; word < words; word++) {
        seen |= seen_sides(facet, word);
    }
    var side = first_side[at];
    for (var back = 0u; back < 2u; back++) {
        if seen[back] == 0u {
            continue;
        }
        for (var word = 0u; word < words; word++) {
            seen_by[side * step.words + word] = seen_sides(facet, word)[back];
        }
        parts[side] = vec4u(facet | (back * BACK), 0u, 0u, side);
        side++;
    }
}

// Corners of a part: weights of the triangle's second and third corner. They are exact.
struct Corners {
    a: vec2f,
    b: vec2f,
    c: vec2f,
}

fn corners_of(quarters: u32) -> Corners {
    var p = Corners(vec2f(0.0), vec2f(1.0, 0.0), vec2f(0.0, 1.0));
    let depth = (quarters >> QUARTERS_SHIFT) & 15u;
    for (var level = 0u; level < depth; level++) {
        let quarter = (quarters >> (2u * level)) & 3u;
        let ab = (p.a + p.b) * 0.5;
        let bc = (p.b + p.c) * 0.5;
        let ca = (p.c + p.a) * 0.5;
        if quarter == 0u {
            p = Corners(p.a, ab, ca);
        } else if quarter == 1u {
            p = Corners(ab, p.b, bc);
        } else if quarter == 2u {
            p = Corners(ca, bc, p.c);
        } else {
            p = Corners(ab, bc, ca);
        }
    }
    return p;
}

// A part in the plane of its triangle: its first corner from the triangle's, and its other two from there.
struct PartShape {
    first: vec3f,
    to_second: vec3f,
    to_third: vec3f,
}

fn shape_of(f: PointFacet, quarters: u32) -> PartShape {
    let ab = edge_ab(f);
    let ac = edge_ac(f);
    let corners = corners_of(quarters);
    let second = corners.b - corners.a;
    let third = corners.c - corners.a;
    return PartShape(
        ab * corners.a.x + ac * corners.a.y, ab * second.x + ac * second.y, ab * third.x + ac * third.y,
    );
}

// Decides about each part: its density if it is a piece, or that it is quartered. Counts what the part becomes.
@compute @workgroup_size(64)
fn judge(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= lengths[step.list].x {
        return;
    }
    let part = parts[at];
    if (part.y & DONE) != 0u {
        part_counts[at] = 1u;
        return;
    }
    let f = facets[part.x & ~BACK];
    let shape = shape_of(f, part.y);
    let first = shape.first;
    let to_second = shape.to_second;
    let to_third = shape.to_third;
    var density = 0.0;
    var nearest = 3e38;
    let words = min(step.words, arrayLength(&visible));
    for (var word = 0u; word < words; word++) {
        var bits = visible[part.w * step.words + word];
        while bits != 0u {
            let r = reflectors[32u * word + firstTrailingBit(bits)];
            bits &= bits - 1u;
            let p = (f.a - r.center) + (f.a_low - r.center_low) + first;
            let distance = distance_from(p, p + to_second, p + to_third, f.normal);
            density = max(density, density_for(step, r, p, p + to_second, p + to_third, distance));
            nearest = min(nearest, distance);
        }
    }
    let depth = (part.y >> QUARTERS_SHIFT) & 15u;
    let cells = f.area * exp2(-2.0 * f32(depth)) * density * density;
    let longest = max(length(to_second), max(length(to_third), length(to_third - to_second)));
    if depth < DEEPEST && longest > LONGEST * nearest && cells > FEWEST {
        part_counts[at] = 4u;
        return;
    }
    let small = step.culls != 0u && depth == 0u && cells < CULLED_BELOW;
    let is_culled = small && f.chance >= cells / CULLED_BELOW;
    let flags = DONE | select(0u, CULLED, is_culled) | select(0u, WHOLE, small && !is_culled);
    // A part without an area has no grid.
    let exists = density > 0.0 && dot(f.normal, f.normal) > 0.0 && longest > 0.0;
    parts[at] = vec4u(part.x, part.y | flags, select(0u, bitcast<u32>(density), exists), part.w);
    part_counts[at] = select(0u, 1u, exists);
}

// Writes the parts of the next round.
@compute @workgroup_size(64)
fn divide(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= lengths[step.list].x {
        return;
    }
    let part = parts_before[at];
    let first = first_part[at];
    if (part.y & DONE) != 0u {
        if part.z != 0u && first < arrayLength(&parts) {
            parts[first] = part;
        }
        return;
    }
    // A list that does not fit is not used.
    if first + 4u > arrayLength(&parts) {
        return;
    }
    let depth = (part.y >> QUARTERS_SHIFT) & 15u;
    let quarters = (part.y & ((1u << QUARTERS_SHIFT) - 1u)) | ((depth + 1u) << QUARTERS_SHIFT);
    for (var i = 0u; i < 4u; i++) {
        parts[first + i] = vec4u(part.x, quarters | (i << (2u * depth)), 0u, part.w);
    }
}

// Counts the parts that are culled, or all others.
@compute @workgroup_size(64)
fn count_kept(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at < lengths[step.list].x {
        let is_culled = (parts[at].y & CULLED) != 0u;
        part_counts[at] = select(0u, 1u, is_culled == (step.culls == 2u));
    }
}

// Makes a grid of cells for each kept part.
@compute @workgroup_size(64)
fn make_pieces(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= lengths[step.list].x {
        return;
    }
    let part = parts_before[at];
    if ((part.y & CULLED) != 0u) != (step.culls == 2u) {
        return;
    }
    let f = facets[part.x & ~BACK];
    let shape = shape_of(f, part.y);
    let first = shape.first;
    let to_second = shape.to_second;
    let to_third = shape.to_third;
    let right = normalize(to_second);
    let up = normalize(cross(f.normal, right));
    let along = vec2f(length(to_second), dot(to_third, right));
    let above = max(dot(to_third, up), 0.0);
    let least = min(0.0, along.y);
    let extent = max(max(along.x, along.y) - least, above);
    let density = min(bitcast<f32>(part.z), MOST_CELLS / extent);
    var piece: PointPiece;
    // The grid's corner, from the part's first corner.
    var corner = right * (least - MARGIN / density) - up * (MARGIN / density);
    let start = vec2f(MARGIN - least * density, MARGIN);
    piece.places[0] = start;
    piece.places[1] = start + vec2f(along.x * density, 0.0);
    piece.places[2] = start + vec2f(along.y, above) * density;
    if (part.y & WHOLE) != 0u {
        corner = (to_second + to_third) / 3.0 - (right + up) * (0.5 / density);
        piece.flags = WHOLE_CELL;
        piece.places = array<vec2f, 3>(vec2f(0.5), vec2f(0.5), vec2f(0.5));
    }
    piece.origin = f.a;
    piece.origin_low = f.a_low + (first + corner);
    piece.density = density;
    piece.facet = part.x & ~BACK;
    piece.right = right;
    piece.up = up;
    piece.seen = part.w;
    piece.slack = MARGIN + ROUNDING * max(length(edge_ab(f)), length(edge_ac(f))) * density;
    pieces[first_part[at]] = piece;
    kept_parts[first_part[at]] = part;
}
