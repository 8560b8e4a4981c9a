// Program of `papers/megaviews/src/passes/shade_leaves.rs`: shades both sides of an octree's leaves, independent of the viewer. A
// leaf shows its largest triangle at the projection of the leaf's mean position, with textures filtered to the cell.

import package::shared::encode::{octahedral_from_unit};
import package::shared::finite::{finite_or_zero};
import package::shared::g_buffer::{keep_surface};
import package::shared::projected::{projected_onto};
import package::shared::surface::{radiance, surface_at};
import package::shared::chunk::{LeafChunk, leaf_side};
import package::megaviews::shared::surfel::{Surfel};

@group(0) @binding(0) var<uniform> chunk: LeafChunk;
// Radiance; w is whether that side is visible.
@group(0) @binding(3) var<storage, read_write> shaded: array<vec4f>;
// Triangles that each leaf shows on its front and on its back.
@group(0) @binding(4) var<storage, read> facing: array<vec2u>;
// For each triangle of the octree its instance and its index in the mesh, with SINGLE_SIDED if its back is culled.
@group(0) @binding(5) var<storage, read> triangle_ids: array<vec2u>;
// Mean positions in edges of the root, f32 bits.
@group(0) @binding(6) var<storage, read> nodes: array<vec4u>;
@group(0) @binding(7) var<storage, read_write> surfels: array<Surfel>;

const SINGLE_SIDED: u32 = 0x80000000u;

@compute @workgroup_size(8, 8)
fn shade_leaves(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= chunk.size.x || id.y >= chunk.size.y {
        return;
    }
    let at = id.y * chunk.size.x + id.x;
    let side = leaf_side(chunk, id.xy);
    let leaf = chunk.first + side / 2u;
    if leaf >= min(chunk.leaves, arrayLength(&facing)) {
        shaded[at] = vec4f(0.0);
        return;
    }
    let is_back = (side & 1u) != 0u;
    let triangles = facing[leaf];
    let triangle = select(triangles.x, triangles.y, is_back);
    let position = bitcast<vec3f>(nodes[leaf].xyz) * chunk.edge + chunk.root_about_eye;
    let ids = triangle_ids[triangle];
    // Without a triangle that faces the other way, the back is the back of the front triangle, if it is double-sided.
    let front = !is_back || triangles.x != triangles.y;
    let seen = front || (ids.y & SINGLE_SIDED) == 0u;
    let found = projected_onto(vec2u(ids.x, ids.y & ~SINGLE_SIDED), position, chunk.cell, front);
    let surface = surface_at(found.hit);
    keep_surface(at, surface, 0u);
    shaded[at] = vec4f(finite_or_zero(radiance(surface, false)), select(0.0, 1.0, seen));
    if !is_back {
        surfels[leaf].axis = pack2x16snorm(octahedral_from_unit(found.normal));
        surfels[leaf].offset = found.offset;
    }
}
