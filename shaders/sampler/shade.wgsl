// Program of `sampler/src/passes/shade.rs`: shades each sub-sample of a direct view from the visibility buffer.

import package::shared::finite::{finite_or_zero};
import package::shared::g_buffer::{keep_surface};
import package::shared::rays::{list_index, listed_sub_sample};
import package::shared::surface::{has_specular, lighting, lit_by_rays, radiance};
import package::shared::reflection_probes::{ProbeUniform, reflected_radiance, reflector_word};
import package::shared::visible::{CastRay, cast_through, hit_of, probe_of, rays, sky_along, surface_of};

@group(0) @binding(3) var visibility: texture_2d<u32>;
// Radiance.
@group(0) @binding(4) var<storage, read_write> shaded: array<vec4f>;
@group(2) @binding(5) var<uniform> probes: ProbeUniform;
// For a list of pixels, the position of each in the tile.
@group(0) @binding(6) var<storage, read> places: array<u32>;
// For rays that are listed, the unit direction of each sub-sample; zero for no ray.
@group(0) @binding(7) var<storage, read> directions: array<vec4f>;

// Word of the reflector that a sub-sample shows, 0 for none.
@group(2) @binding(6) var<storage, read_write> reflectors: array<u32>;

// Reflections of the scene are added by a later pass: `add_reflections.wgsl`.
override defers_reflection: bool = false;

// Radiance along a sub-sample's ray, view-dependent reflection included.
fn seen_along(ids: vec2u, ray: CastRay, at: u32) -> vec4f {
    if defers_reflection {
        reflectors[at] = 0u;
    }
    if ids.x == 0u {
        return vec4f(sky_along(ray.along), 0.0);
    }
    let hit = hit_of(ids, ray);
    let probe = probe_of(ids.x);
    let surface = surface_of(hit, probe);
    keep_surface(at, surface, probe);
    var seen = radiance(surface, true);
    // The sky's reflection is added with the light, where rays find what blocks it.
    let is_glossy = has_specular && any(surface.f0 != vec3f(0.0));
    if defers_reflection && is_glossy && probe != 0u {
        reflectors[at] = reflector_word(probe, surface.transmitted);
    } else if is_glossy && !(lit_by_rays && probe == 0u) {
        seen += reflected_radiance(surface, -normalize(surface.position), lighting, probes, probe);
    }
    return vec4f(finite_or_zero(seen), 1.0 / hit.range);
}

// Shades a tile of a direct view.
@compute @workgroup_size(8, 8)
fn shade_view(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    shaded[at] = seen_along(textureLoad(visibility, id.xy, 0).xy, cast_through(vec2f(id.xy) + 0.5, 1.0), at);
}

// Shades a list of a direct view's pixels.
@compute @workgroup_size(8, 8)
fn shade_pixels(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let place = places[min(list_index(rays, id.xy), arrayLength(&places) - 1u)];
    let sub_sample = listed_sub_sample(rays, place, id.xy);
    let at = id.y * rays.width + id.x;
    shaded[at] = seen_along(textureLoad(visibility, id.xy, 0).xy, cast_through(vec2f(sub_sample) + 0.5, 1.0), at);
}

// Change of a listed ray to the next one along an axis: by the neighbour after it, else by that before it.
fn ray_step(at: u32, after: u32, before: u32) -> vec3f {
    let along = directions[at].xyz;
    let next = directions[after].xyz;
    if after != at && any(next != vec3f(0.0)) {
        return next - along;
    }
    let last = directions[before].xyz;
    return select(vec3f(0.0), along - last, any(last != vec3f(0.0)));
}

// Shades a tile of listed rays. What has no ray is black.
@compute @workgroup_size(8, 8)
fn shade_rays(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let along = directions[at].xyz;
    if all(along == vec3f(0.0)) {
        if defers_reflection {
            reflectors[at] = 0u;
        }
        shaded[at] = vec4f(0.0);
        return;
    }
    let right = ray_step(at, at + u32(id.x + 1u < rays.width), at - u32(id.x > 0u));
    let down = ray_step(
        at, at + select(0u, rays.width, id.y + 1u < rays.height), at - select(0u, rays.width, id.y > 0u),
    );
    shaded[at] = seen_along(textureLoad(visibility, id.xy, 0).xy, CastRay(along, right, down), at);
}
