// Program of `sampler/src/passes/visibility.rs`: rasterises the visibility buffer: instance and triangle of each
// sub-sample.

import package::shared::geometry::{instances, materials, meshes};
import package::shared::texture::{sample_alpha, slots};
import package::shared::trace::alpha::{corner_at};
enable primitive_index;

// A range of an instance's triangles, with its transform to the tile.
struct Draw {
    // Rows x, y, w of the transform from mesh to clip space; z is constant.
    clip_from_mesh_x: vec4f,
    clip_from_mesh_y: vec4f,
    clip_from_mesh_w: vec4f,
    near: f32,
    instance: u32,
    first_triangle: u32,
}

@group(0) @binding(0) var<storage, read> draws: array<Draw>;

// Reversed Z with an infinite far plane: depth is near / distance.
fn clip_from_mesh(draw: Draw, position: vec3f) -> vec4f {
    let p = vec4f(position, 1.0);
    return vec4f(
        dot(draw.clip_from_mesh_x, p), dot(draw.clip_from_mesh_y, p), draw.near, dot(draw.clip_from_mesh_w, p),
    );
}

struct Opaque {
    @builtin(position) clip: vec4f,
    @location(0) @interpolate(flat) instance_and_first: vec2u,
}

@vertex
fn place(@location(0) position: vec3f, @builtin(instance_index) index: u32) -> Opaque {
    let draw = draws[index];
    return Opaque(clip_from_mesh(draw, position), vec2u(draw.instance + 1u, draw.first_triangle));
}

@fragment
fn identify(in: Opaque, @builtin(primitive_index) primitive: u32) -> @location(0) vec2u {
    return in.instance_and_first + vec2u(0u, primitive);
}

struct Cutout {
    @builtin(position) clip: vec4f,
    @location(0) @interpolate(flat) instance_and_first: vec2u,
    @location(1) uv: vec2f,
    // Alpha of the vertex colour.
    @location(2) alpha: f32,
}

@vertex
fn place_cutout(
    @location(0) position: vec3f, @builtin(vertex_index) vertex: u32, @builtin(instance_index) index: u32,
) -> Cutout {
    let draw = draws[index];
    let mesh = meshes[instances[draw.instance].mesh];
    let at = corner_at(mesh.first.z + (vertex - mesh.first.y) * mesh.first.w, mesh.has);
    let ids = vec2u(draw.instance + 1u, draw.first_triangle);
    return Cutout(clip_from_mesh(draw, position), ids, at.xy, at.z);
}

@fragment
fn identify_cutout(in: Cutout, @builtin(primitive_index) primitive: u32) -> @location(0) vec2u {
    let material = materials[meshes[instances[in.instance_and_first.x - 1u].mesh].has.w];
    var alpha = material.base_color.a * in.alpha;
    if material.traits.y != 0u {
        alpha *= sample_alpha(slots[material.traits.y - 1u], in.uv);
    }
    if !(alpha >= material.factors.w) {
        discard;
    }
    return in.instance_and_first + vec2u(0u, primitive);
}
