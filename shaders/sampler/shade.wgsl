// Program of `sampler/src/passes/shade.rs`: shades each sub-sample of a direct view from the visibility buffer.

import package::shared::finite::{finite_or_zero};
import package::shared::g_buffer::{keep_surface};
import package::shared::rays::{list_index, listed_sub_sample};
import package::shared::surface::{has_specular, lighting, lit_by_rays, radiance};
import package::shared::reflection_probes::{ProbeUniform, reflected_radiance, reflector_word};
import package::shared::visible::{hit_at, probe_of, rays, sky_along, surface_of};

@group(0) @binding(3) var visibility: texture_2d<u32>;
// Radiance.
@group(0) @binding(4) var<storage, read_write> shaded: array<vec4f>;
@group(2) @binding(5) var<uniform> probes: ProbeUniform;
// For a list of pixels, the position of each in the tile.
@group(0) @binding(6) var<storage, read> places: array<u32>;

// Word of the reflector that a sub-sample shows, 0 for none.
@group(2) @binding(6) var<storage, read_write> reflectors: array<u32>;

// Reflections of the scene are added by a later pass: `add_reflections.wgsl`.
override defers_reflection: bool = false;

// Radiance along a sub-sample's ray, view-dependent reflection included.
fn seen_along(ids: vec2u, sub_sample: vec2u, at: u32) -> vec4f {
    let place = vec2f(sub_sample) + 0.5;
    if defers_reflection {
        reflectors[at] = 0u;
    }
    if ids.x == 0u {
        return vec4f(sky_along(place), 0.0);
    }
    let hit = hit_at(ids, place, 1.0);
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
    shaded[at] = seen_along(textureLoad(visibility, id.xy, 0).xy, id.xy, at);
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
    shaded[at] = seen_along(textureLoad(visibility, id.xy, 0).xy, sub_sample, at);
}
