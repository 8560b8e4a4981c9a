// Program of gpu/src/hierarchy/voxelize.rs: which cells a triangle meets, one level of the octree after the other.
//
// Coordinates are in edges of the root cube, 0..1. The test is that of Schwarz and Seidel ("Fast Parallel Surface and
// Solid Voxelization on GPUs", 2010, section 3.1), a separating axis test, with cells that are larger than they are by
// more than f32 rounds: a triangle is never lost, and a cell that it all but touches may be kept.

import package::shared::corners::corner;
import package::shared::linear::linear_index;
import package::shared::morton::{morton_cell, octant_corner};

struct Split {
    // Pairs of a triangle and a cell that it meets.
    count: u32,
    // Cells along an edge of the root, one level further down.
    cells: f32,
}

var<immediate> split: Split;

// Triangle and Morton code of a cell: as one 64-bit number, ordered by cell.
@group(0) @binding(1) var<storage, read> pieces: array<vec2u>;
@group(0) @binding(2) var<storage, read_write> masks: array<u32>;
// Bits in each mask, and after a scan, where its children go.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> children: array<vec2u>;

// More than all that the test rounds, and a thousandth of the smallest cell.
const MARGIN: f32 = 1e-6;

// An edge's line in one plane of projection, against squares of `side` whose least corner is p: dot(xy, p) + z is
// not negative where the square reaches the inner side of the line.
fn edge(from_: vec2f, along: vec2f, turn: f32, side: f32) -> vec3f {
    let inner = vec2f(-along.y, along.x) * turn;
    let reach = max(inner.x * side, 0.0) + max(inner.y * side, 0.0);
    // What the products round, which is relative to the edge's length and not to the square's.
    return vec3f(inner, reach - dot(inner, from_) + 4e-7 * (abs(inner.x) + abs(inner.y)));
}

fn meets(line: vec3f, p: vec2f) -> bool {
    return dot(line.xy, p) + line.z >= 0.0;
}

@compute @workgroup_size(64)
fn mark(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= split.count {
        return;
    }
    let piece = pieces[at];
    let a = corner(piece.x, 0u);
    let ab = corner(piece.x, 1u) - a;
    let ac = corner(piece.x, 2u) - a;
    let normal = cross(ab, ac);
    let side = 1.0 / split.cells + 2.0 * MARGIN;
    // All relative to the first corner, so that small triangles keep their precision.
    let least = min(min(ab, ac), vec3f(0.0));
    let most = max(max(ab, ac), vec3f(0.0));
    let toward = select(vec3f(0.0), vec3f(side), normal > vec3f(0.0));
    let extent = most - least + side;
    let slack = 1e-6 * length(ab) * length(ac) * (extent.x + extent.y + extent.z);
    let turn = select(vec3f(-1.0), vec3f(1.0), normal >= vec3f(0.0));
    let bc = ac - ab;
    let xy0 = edge(vec2f(0.0), ab.xy, turn.z, side);
    let xy1 = edge(ab.xy, bc.xy, turn.z, side);
    let xy2 = edge(ac.xy, -ac.xy, turn.z, side);
    let yz0 = edge(vec2f(0.0), ab.yz, turn.x, side);
    let yz1 = edge(ab.yz, bc.yz, turn.x, side);
    let yz2 = edge(ac.yz, -ac.yz, turn.x, side);
    let zx0 = edge(vec2f(0.0), ab.zx, turn.y, side);
    let zx1 = edge(ab.zx, bc.zx, turn.y, side);
    let zx2 = edge(ac.zx, -ac.zx, turn.y, side);
    let cell = morton_cell(piece.y) * 2u;
    var mask = 0u;
    for (var octant = 0u; octant < 8u; octant++) {
        let p = vec3f(cell + octant_corner(octant)) / split.cells - MARGIN - a;
        let in_box = all(p <= most) && all(p + side >= least);
        let across = dot(normal, p + toward) + slack >= 0.0 && dot(normal, p + side - toward) - slack <= 0.0;
        let in_xy = meets(xy0, p.xy) && meets(xy1, p.xy) && meets(xy2, p.xy);
        let in_yz = meets(yz0, p.yz) && meets(yz1, p.yz) && meets(yz2, p.yz);
        let in_zx = meets(zx0, p.zx) && meets(zx1, p.zx) && meets(zx2, p.zx);
        if in_box && across && in_xy && in_yz && in_zx {
            mask |= 1u << octant;
        }
    }
    masks[at] = mask;
    places[at] = countOneBits(mask);
}

@compute @workgroup_size(64)
fn divide(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= split.count {
        return;
    }
    let piece = pieces[at];
    var rest = masks[at];
    var to = places[at];
    while rest != 0u {
        children[to] = vec2u(piece.x, piece.y * 8u + countTrailingZeros(rest));
        rest &= rest - 1u;
        to += 1u;
    }
}
