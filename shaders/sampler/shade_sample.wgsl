// Program of `sampler/src/passes/shade_sample.rs`: shades the texels of a sample from the visibility buffer. `rays` has
// one ray a texel.
//
// A texel whose sub-samples all see one triangle is shaded once, at its centre. The other texels are shaded by a second
// dispatch, in which each invocation searches a run of texels. Quirk: lockstep.

import package::shared::dominant::{MOST_SUB_SAMPLES, dominant, same_surface};
import package::shared::encode::{octahedral_from_unit};
import package::shared::finite::{finite_or_zero};
import package::shared::geometry::{instances, mesh_from_world, meshes, triangle_about_eye};
import package::shared::g_buffer::{keep_surface, keeps_g_buffer};
import package::shared::shading::{Surface};
import package::shared::ray_triangle::{cross_triangle};
import package::shared::rays::{ray_through};
import package::shared::surface::{radiance, reflects};
import package::shared::reflection_probes::{reflector_word};
import package::shared::visible::{cast_through, hit_of, probe_of, rays, sky_along, surface_of};

// Sub-samples along a texel's side, at most four. Constant, so that loops are unrolled.
override side: u32 = 2u;
// Whether normals and F0 are written too.
override glossy: bool = false;

@group(0) @binding(3) var visibility: texture_2d<u32>;
// Radiance. w is the inverse range on the texel's central ray, 0 for sky, SPLIT for a texel that the second dispatch
// shades.
@group(0) @binding(4) var<storage, read_write> shaded: array<vec4f>;
// Octahedral normal (2x16snorm), F0 and roughness (4x8unorm).
@group(0) @binding(5) var<storage, read_write> gloss: array<vec2u>;
// Word of `PlaneKind::Reflector`.
@group(2) @binding(6) var<storage, read_write> reflectors: array<u32>;

const SPLIT: f32 = -1.0;

// Width of the texture filter in texels, for texels that are shaded once. Less than 1, because a trilinear fetch averages
// over twice the width: FLIP of Sponza 0.0571 with 1, 0.0544 with 0.7, 0.0543 with 0.5. With one sub-sample a texel
// equals a direct view's pixel.
const FILTER: f32 = 0.6;

// Largest difference of roughness between averaged lobes; beyond it the rougher one is taken. A mean roughness of lake
// and shore would shine where neither does.
const ALIKE: f32 = 0.25;

// Texels that an invocation searches for split texels.
const RUN: u32 = 64u;

// Sums over a texel's sub-samples.
struct Texel {
    // Radiance times sub-samples.
    radiance: vec3f,
    normal: vec3f,
    // F0 and roughness times sub-samples, and number of glossy sub-samples.
    lobe: vec4f,
    lobes: f32,
    // A surface has one probe; at edges of objects the greatest word is taken.
    word: u32,
    // What the G-buffer shows: the surface that was added last, and albedo times sub-samples.
    surface: Surface,
    albedo: vec3f,
    exists: bool,
}

fn nothing() -> Texel {
    var texel: Texel;
    return texel;
}

// Shades a point of the tile and adds it for `count` sub-samples. Returns its range; 0 for sky.
fn add(texel: ptr<function, Texel>, ids: vec2u, place: vec2f, width: f32, members: f32) -> f32 {
    if ids.x == 0u {
        (*texel).radiance += sky_along(ray_through(rays, place)) * members;
        return 0.0;
    }
    let hit = hit_of(ids, cast_through(place, width));
    let probe = probe_of(ids.x);
    let surface = surface_of(hit, probe);
    if keeps_g_buffer {
        (*texel).surface = surface;
        (*texel).albedo += surface.albedo * members;
        (*texel).exists = true;
    }
    (*texel).radiance += finite_or_zero(radiance(surface, false)) * members;
    if glossy {
        let rougher = surface.roughness - (*texel).lobe.a / max((*texel).lobes, 1.0);
        let replaces = (*texel).lobes == 0.0 || rougher > ALIKE;
        let kept = select(1.0, 0.0, replaces);
        let added = select(0.0, members, replaces || rougher >= -ALIKE);
        (*texel).normal = kept * (*texel).normal + added * surface.normal;
        (*texel).lobe = kept * (*texel).lobe + added * vec4f(surface.f0, surface.roughness);
        (*texel).lobes = kept * (*texel).lobes + added;
        if reflects {
            (*texel).word = max((*texel).word, reflector_word(probe, surface.transmitted));
        }
    }
    return hit.range;
}

fn keep(texel: Texel, at: u32, members: f32, inverse_range: f32) {
    shaded[at] = vec4f(texel.radiance / members, inverse_range);
    if keeps_g_buffer && texel.exists {
        var surface = texel.surface;
        surface.albedo = texel.albedo / members;
        keep_surface(at, surface, 0u);
    }
    if glossy {
        let normal = texel.normal / max(length(texel.normal), 1e-12);
        let lobe = pack4x8unorm(texel.lobe / max(texel.lobes, 1.0));
        let is_sky = texel.lobes == 0.0;
        gloss[at] = select(vec2u(pack2x16snorm(octahedral_from_unit(normal)), lobe), vec2u(0u), is_sky);
        if reflects {
            reflectors[at] = texel.word;
        }
    }
}

// Ids of sub-sample i of a texel.
fn ids_of(texel: vec2u, i: u32) -> vec2u {
    return textureLoad(visibility, texel * side + vec2u(i % side, i / side), 0).xy;
}

// Its centre, in texels of the tile.
fn place_of(texel: vec2u, i: u32) -> vec2f {
    return vec2f(texel) + (vec2f(vec2u(i % side, i / side)) + 0.5) / f32(side);
}

fn is_of_one_triangle(texel: vec2u, ids: vec2u) -> bool {
    var same = true;
    for (var i = 1u; i < side * side; i++) {
        same = same && all(ids_of(texel, i) == ids);
    }
    return same;
}

// Shades texels of one triangle and marks the others.
@compute @workgroup_size(8, 8)
fn shade_whole(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let ids = ids_of(id.xy, 0u);
    if !is_of_one_triangle(id.xy, ids) {
        shaded[at] = vec4f(0.0, 0.0, 0.0, SPLIT);
        return;
    }
    var texel = nothing();
    let range = add(&texel, ids, vec2f(id.xy) + 0.5, select(FILTER, 1.0, side == 1u), 1.0);
    keep(texel, at, 1.0, select(1.0 / range, 0.0, ids.x == 0u));
}

// Inverse range (1/metres) of the plane of a sub-sample's triangle on the texel's central ray; 0 for sky. Clamped to a
// slope of a few texels, because a plane seen edge-on may be hit anywhere.
fn central_inverse_range(texel: vec2u, i: u32) -> f32 {
    let ids = ids_of(texel, i);
    // Sky reads an arbitrary triangle and ignores it.
    let instance = instances[max(ids.x, 1u) - 1u];
    let triangle = triangle_about_eye(instance, meshes[instance.mesh], ids.y);
    let ray = normalize(ray_through(rays, place_of(texel, i)));
    let in_mesh = mesh_from_world(instance, ray);
    let crossing = cross_triangle(in_mesh, triangle.a, triangle.e1, triangle.e2);
    let normal = cross(triangle.e1, triangle.e2);
    let central = normalize(ray_through(rays, vec2f(texel) + 0.5));
    let slope = dot(normal, mesh_from_world(instance, central)) / dot(normal, in_mesh);
    let range = clamp(crossing.t, 1e-18, 1e18);
    let inverse = select(1.0, clamp(slope, 0.75, 1.25), abs(slope) < 1e9) / range;
    return select(inverse, 0.0, ids.x == 0u);
}

// Shades the dominant surface of a texel of several triangles, once for each triangle.
fn shade_parts(id: vec2u, at: u32) {
    var inverse: array<f32, MOST_SUB_SAMPLES>;
    for (var i = 0u; i < side * side; i++) {
        inverse[i] = central_inverse_range(id, i);
    }
    let chosen = dominant(&inverse, side * side);
    var left = 0u;
    var sum = 0.0;
    for (var i = 0u; i < side * side; i++) {
        let is_member = same_surface(chosen, inverse[i]);
        left |= select(0u, 1u << i, is_member);
        sum += select(0.0, inverse[i], is_member);
    }
    let members = f32(max(countOneBits(left), 1u));
    var texel = nothing();
    while left != 0u {
        let ids = ids_of(id, firstTrailingBit(left));
        var middle = vec2f(0.0);
        var of_triangle = 0.0;
        for (var i = 0u; i < side * side; i++) {
            let is_seen = ((left >> i) & 1u) != 0u && all(ids_of(id, i) == ids);
            middle += select(vec2f(0.0), place_of(id, i), is_seen);
            of_triangle += select(0.0, 1.0, is_seen);
            left &= ~select(0u, 1u << i, is_seen);
        }
        _ = add(&texel, ids, middle / max(of_triangle, 1.0), 1.0 / f32(side), of_triangle);
    }
    keep(texel, at, members, sum / members);
}

// Shades texels of several triangles.
@compute @workgroup_size(64)
fn shade_split(@builtin(global_invocation_id) id: vec3u) {
    let texels = min(rays.width * rays.height, arrayLength(&shaded));
    var at = id.x * RUN;
    let end = min(at + RUN, texels);
    while at < end {
        while at < end && shaded[at].w != SPLIT {
            at++;
        }
        if at < end {
            shade_parts(vec2u(at % rays.width, at / rays.width), at);
            at++;
        }
    }
}
