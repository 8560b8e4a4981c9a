// Program of papers/megaviews/src/hierarchy/voxelize.rs: finds the cells that each triangle overlaps, one level of the octree at a time.
//
// Coordinates are in edges of the root cube, 0..1. The separating axis test is from Schwarz and Seidel ("Fast Parallel
// Surface and Solid Voxelization on GPUs", 2010, section 3.1). Cells are padded by more than the rounding of f32: no overlap
// is missed, but a cell that a triangle nearly touches may be kept.

import package::megaviews::shared::corners::corner;
import package::shared::linear::linear_index;
import package::megaviews::shared::morton::{morton_cell, octant_corner};

struct Split {
    // Index of the list of pieces: pairs of a triangle and a cell that it overlaps.
    list: u32,
    // Cells along an edge of the root, on the next level.
    cells: f32,
}

var<immediate> split: Split;

// Triangle, and Morton code of the cell. As 64-bit numbers, pieces sort by cell.
@group(0) @binding(1) var<storage, read> pieces: array<vec2u>;
// Overlapped octants of each piece's cell, one bit each.
@group(0) @binding(2) var<storage, read_write> masks: array<u32>;
// Number of bits of each mask. After a scan: index of the piece's first child.
@group(0) @binding(3) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(4) var<storage, read_write> children: array<vec2u>;

// For each list of pieces, first its length.
@group(0) @binding(5) var<storage, read> lengths: array<vec2u>;

// Padding of a cell: more than the rounding of the test, and a thousandth of the smallest cell.
const MARGIN: f32 = 1e-6;

// Edge function in one projection plane, for squares of `side` with the least corner p. dot(xy, p) + z is at least 0 if the
// square overlaps the inner side of the edge.
fn edge(from_: vec2f, along: vec2f, turn: f32, side: f32) -> vec3f {
    let inner = vec2f(-along.y, along.x) * turn;
    let reach = max(inner.x * side, 0.0) + max(inner.y * side, 0.0);
    // Rounding of the products, which is relative to the edge's length.
    return vec3f(inner, reach - dot(inner, from_) + 4e-7 * (abs(inner.x) + abs(inner.y)));
}

fn meets(line: vec3f, p: vec2f) -> bool {
    return dot(line.xy, p) + line.z >= 0.0;
}

// Finds the octants that each piece overlaps.
@compute @workgroup_size(64)
fn mark(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= lengths[split.list].x {
        return;
    }
    let piece = pieces[at];
    let a = corner(piece.x, 0u);
    let ab = corner(piece.x, 1u) - a;
    let ac = corner(piece.x, 2u) - a;
    let normal = cross(ab, ac);
    let side = 1.0 / split.cells + 2.0 * MARGIN;
    // Coordinates are relative to the first corner, which keeps the precision of small triangles.
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
    offsets[at] = countOneBits(mask);
}

// Writes the pieces of the next level.
@compute @workgroup_size(64)
fn divide(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_index(group, groups, local);
    if at >= lengths[split.list].x {
        return;
    }
    let piece = pieces[at];
    var rest = masks[at];
    var to = offsets[at];
    while rest != 0u {
        if to < arrayLength(&children) {
            children[to] = vec2u(piece.x, piece.y * 8u + countTrailingZeros(rest));
        }
        rest &= rest - 1u;
        to += 1u;
    }
}
