// Program of `sampler/src/passes/shade_points.rs`: shades points of reflection probes, each once, independent of the viewer.

import package::shared::encode::{rgb9e5_from_radiance};
import package::shared::finite::{finite_or_zero};
import package::shared::g_buffer::{keep_surface};
import package::shared::projected::{projected_onto};
import package::shared::surface::{radiance, surface_at};
import package::shared::chunk::{LeafChunk, leaf_side};

// A point of a triangle.
struct ProbePoint {
    // NOTHING where an image has no point.
    instance: u32,
    // Index of the triangle in its mesh.
    primitive: u32,
    // Side of the square that it stands for, metres.
    width: f32,
    // 1 if its front is seen, 0 if its back is.
    front: u32,
    // Relative to the eye, metres.
    position: vec3f,
    // Mean side of the area that it stands for on its surface, metres. Light cells are chosen by it.
    across: f32,
}

const NOTHING: u32 = 0xffffffffu;

// `first` and `leaves` count points.
@group(0) @binding(0) var<uniform> chunk: LeafChunk;
@group(0) @binding(3) var<storage, read_write> shaded: array<vec4f>;
@group(0) @binding(4) var<storage, read> points: array<ProbePoint>;
// Radiance of all points, rgb9e5.
@group(0) @binding(5) var<storage, read_write> radiance_of_points: array<u32>;

@compute @workgroup_size(8, 8)
fn shade_points(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= chunk.size.x || id.y >= chunk.size.y {
        return;
    }
    let at = id.y * chunk.size.x + id.x;
    let index = chunk.first + leaf_side(chunk, id.xy);
    if index >= min(chunk.leaves, arrayLength(&points)) {
        shaded[at] = vec4f(0.0);
        return;
    }
    let point = points[index];
    if point.instance == NOTHING {
        shaded[at] = vec4f(0.0);
        return;
    }
    let ids = vec2u(point.instance, point.primitive);
    let surface = surface_at(projected_onto(ids, point.position, point.width, point.front != 0u).hit);
    keep_surface(at, surface, 0u);
    shaded[at] = vec4f(finite_or_zero(radiance(surface, false)), 1.0);
}

// Stores the radiance of a chunk's points, once all light is added.
@compute @workgroup_size(8, 8)
fn keep_points(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= chunk.size.x || id.y >= chunk.size.y {
        return;
    }
    let index = chunk.first + leaf_side(chunk, id.xy);
    if index >= min(chunk.leaves, arrayLength(&radiance_of_points)) {
        return;
    }
    let seen = shaded[id.y * chunk.size.x + id.x].rgb;
    radiance_of_points[index] = rgb9e5_from_radiance(finite_or_zero(seen));
}
