// Surface properties at a point of a triangle from its material's factors and textures, and its shading.

import package::shared::geometry::{
    HAS_SECOND_UVS, HAS_UVS, MaterialData, MeshLayout, InstanceTransform, Triangle, attributes, blend2, blend3, blend4,
    color_of, materials, mesh_from_world, normal_from_mesh, normal_from_word, second_uv_of, uv_of,
};
import package::shared::shading::{
    Light, Lighting, Surface, diffuse_light, sky_ambient, specular_light,
};
import package::shared::texture::{
    READS_SECOND_UVS, ROLE_BASE_COLOR, ROLE_EMISSIVE, ROLE_METALLIC_ROUGHNESS, ROLE_NONE, ROLE_NORMAL, ROLE_SPECULAR,
    ROLE_SPECULAR_COLOR, ROLE_TRANSMISSION, TextureSlot, has_second_uvs, sample_texture, slots, texels, texels_srgb,
};

@group(0) @binding(1) var<uniform> lighting: Lighting;
@group(0) @binding(2) var<storage, read> lights: array<Light>;

// Features of the scene. Quirk: both-sides.
override has_srgb_textures: bool = true;
override has_linear_textures: bool = true;
override has_normal_maps: bool = true;
override has_vertex_colors: bool = true;
override has_specular: bool = true;
override has_specular_textures: bool = true;
override has_transmission_textures: bool = true;
// Glossy and transparent surfaces look up reflection probes.
override reflects: bool = false;
// Lights and sky are added by a later pass, as far as nothing blocks them: `add_direct.wgsl`.
override lit_by_rays: bool = false;

// A hit of a ray on a triangle.
struct Hit {
    instance: InstanceTransform,
    mesh: MeshLayout,
    triangle: Triangle,
    // Of the three corners, in the attributes, and their first records.
    records: vec3u,
    a: vec4u,
    b: vec4u,
    c: vec4u,
    // Of the three corners.
    weights: vec3f,
    // The triangle's normal and the ray's unit direction, in mesh space.
    geometric: vec3f,
    in_mesh: vec3f,
    // Unit direction in the world, and what scaled the ray to it.
    direction: vec3f,
    scale: f32,
    // Metres.
    range: f32,
    front: bool,
    // How the ray, before it was scaled, changes from one sub-sample to the next: across and down.
    right: vec3f,
    down: vec3f,
}

// Change of the hit's barycentric coordinates when the ray's direction changes by `difference` (Igehy, "Tracing Ray
// Differentials", 1999, section 3.1.1).
fn barycentric_step(hit: Hit, difference: vec3f) -> vec2f {
    let d = mesh_from_world(hit.instance, difference) * hit.scale;
    let along = -hit.range * dot(d, hit.geometric) / dot(hit.in_mesh, hit.geometric);
    let moved = d * hit.range + hit.in_mesh * along;
    let area = dot(hit.geometric, hit.geometric);
    return vec2f(
        dot(cross(moved, hit.triangle.e2), hit.geometric), dot(cross(hit.triangle.e1, moved), hit.geometric),
    ) / area;
}

// A material's textures at a hit; neutral where it has none.
struct Looked {
    base_color: vec4f,
    emissive: vec3f,
    metallic_roughness: vec4f,
    // Tangent space, -1..1.
    normal: vec3f,
    has_normal: bool,
    transmission: f32,
    specular: f32,
    specular_color: vec3f,
}

// A point on a mesh's textures, and its differences to neighbouring sub-samples.
struct Footprint {
    uv: vec2f,
    dx: vec2f,
    dy: vec2f,
}

fn take(looked: ptr<function, Looked>, role: u32, value: vec4f) {
    (*looked).base_color = select((*looked).base_color, value, role == ROLE_BASE_COLOR);
    (*looked).emissive = select((*looked).emissive, value.rgb, role == ROLE_EMISSIVE);
    (*looked).metallic_roughness =
        select((*looked).metallic_roughness, value, role == ROLE_METALLIC_ROUGHNESS);
    (*looked).normal = select((*looked).normal, value.xyz * 2.0 - 1.0, role == ROLE_NORMAL);
    (*looked).has_normal = (*looked).has_normal || role == ROLE_NORMAL;
    if has_transmission_textures {
        (*looked).transmission = select((*looked).transmission, value.r, role == ROLE_TRANSMISSION);
    }
    if has_specular_textures {
        (*looked).specular = select((*looked).specular, value.a, role == ROLE_SPECULAR);
        (*looked).specular_color = select((*looked).specular_color, value.rgb, role == ROLE_SPECULAR_COLOR);
    }
}

// The footprint of a hit by the texture coordinates of its corners and the steps of its barycentric coordinates; zero if the
// mesh does not have them.
fn footprint(has: u32, a: vec2f, b: vec2f, c: vec2f, weights: vec3f, x: vec2f, y: vec2f) -> Footprint {
    if has == 0u {
        return Footprint(vec2f(0.0), vec2f(0.0), vec2f(0.0));
    }
    let to_b = b - a;
    let to_c = c - a;
    return Footprint(blend2(a, b, c, weights), to_b * x.x + to_c * x.y, to_b * y.x + to_c * y.y);
}

// The footprint by the set of texture coordinates that a texture reads.
fn chosen(slot: TextureSlot, first: Footprint, second: Footprint) -> Footprint {
    if !has_second_uvs {
        return first;
    }
    let takes = (slot.usage.w & READS_SECOND_UVS) != 0u;
    return Footprint(
        select(first.uv, second.uv, takes), select(first.dx, second.dx, takes), select(first.dy, second.dy, takes),
    );
}

fn look_up(hit: Hit, material: MaterialData) -> Looked {
    let up = vec3f(0.0, 0.0, 1.0);
    var looked = Looked(vec4f(1.0), vec3f(1.0), vec4f(1.0), up, false, 1.0, 1.0, vec3f(1.0));
    if !(has_srgb_textures || has_linear_textures) {
        return looked;
    }
    let x = barycentric_step(hit, hit.right);
    let y = barycentric_step(hit, hit.down);
    let has = hit.mesh.has.x;
    let first = footprint(has & HAS_UVS, uv_of(hit.a), uv_of(hit.b), uv_of(hit.c), hit.weights, x, y);
    var second = first;
    if has_second_uvs {
        // A mesh without a second record reads its first one, and ignores it.
        let records = hit.records + select(0u, 1u, (has & HAS_SECOND_UVS) != 0u);
        let a = second_uv_of(attributes[records.x]);
        let b = second_uv_of(attributes[records.y]);
        let c = second_uv_of(attributes[records.z]);
        second = footprint(has & HAS_SECOND_UVS, a, b, c, hit.weights, x, y);
    }
    // One loop body for all textures of a material, because each further body would run for every surface. The test is at
    // the loop's end, because a loop with its test at the head runs once more under a mask.
    // A surface without textures reads an arbitrary texture and ignores it.
    let last = arrayLength(&slots) - 1u;
    if has_srgb_textures {
        var i = 0u;
        loop {
            let slot = slots[min(material.textures.x + i, last)];
            let role = select(ROLE_NONE, slot.usage.z, i < material.textures.y);
            let at = chosen(slot, first, second);
            take(&looked, role, sample_texture(texels_srgb, slot, at.uv, at.dx, at.dy));
            i += 1u;
            if i >= material.textures.y {
                break;
            }
        }
    }
    if has_linear_textures {
        var i = 0u;
        loop {
            let slot = slots[min(material.textures.z + i, last)];
            let role = select(ROLE_NONE, slot.usage.z, i < material.textures.w);
            let at = chosen(slot, first, second);
            take(&looked, role, sample_texture(texels, slot, at.uv, at.dx, at.dy));
            i += 1u;
            if i >= material.textures.w {
                break;
            }
        }
    }
    return looked;
}

// The visible point of a surface, viewed from its front.
fn surface_at(hit: Hit) -> Surface {
    let material = materials[hit.mesh.has.w];
    let looked = look_up(hit, material);
    var base = material.base_color * looked.base_color;
    if has_vertex_colors && hit.mesh.has.y != 0u {
        base *= blend4(color_of(hit.a), color_of(hit.b), color_of(hit.c), hit.weights);
    }
    let metallic = saturate(material.metallic * looked.metallic_roughness.b);
    var surface: Surface;
    surface.position = hit.direction * hit.range;
    surface.albedo = base.rgb * (1.0 - metallic);
    surface.transmitted = vec3f(0.0);
    if reflects {
        surface.transmitted = surface.albedo * (material.factors.z * looked.transmission);
        surface.albedo -= surface.transmitted;
    }
    surface.emissive = material.emissive * looked.emissive;
    if material.traits.w != 0u {
        // Unlit: the display shows the base colour, whatever the exposure.
        surface.albedo = vec3f(0.0);
        surface.emissive = base.rgb / lighting.exposure;
    }
    surface.f0 = vec3f(0.0);
    if has_specular && material.traits.x != 0u {
        let dielectric = min(material.f0.rgb * looked.specular_color, vec3f(1.0)) * (material.f0.w * looked.specular);
        surface.f0 = mix(dielectric, base.rgb, metallic);
    }
    surface.roughness = saturate(material.factors.x * looked.metallic_roughness.g);
    let normal = normal_from_mesh(hit.instance, normal_at(hit, material, looked));
    let facing = select(-1.0, 1.0, hit.front);
    surface.normal = unit_or(normal, -hit.direction) * facing;
    surface.side = vec3f(0.0);
    surface.lift = 0.0;
    if lit_by_rays {
        surface.side = unit_or(normal_from_mesh(hit.instance, hit.geometric), -hit.direction) * facing;
        surface.lift = terminator_lift(hit, surface.side);
    }
    return surface;
}

// Height above a triangle at which rays to lights begin: as in `scene/src/light_sampling.rs`.
fn terminator_lift(hit: Hit, side: vec3f) -> f32 {
    let at = hit.triangle.e1 * hit.weights.y + hit.triangle.e2 * hit.weights.z;
    var corners = array<vec3f, 3>(vec3f(0.0), hit.triangle.e1, hit.triangle.e2);
    var lift = 0.0;
    for (var i = 0u; i < 3u; i++) {
        let in_mesh = normal_from_word(hit.triangle.normals[i]);
        // A product of a normal and an offset is the same in mesh space and in the world.
        let in_world = normal_from_mesh(hit.instance, in_mesh);
        let size = length(in_world);
        let facing = dot(in_world, side);
        let above = max(dot(in_mesh, corners[i] - at) * sign(facing), 0.0);
        lift += select(0.0, hit.weights[i] * above * abs(facing) / (size * size), size > 1e-18);
    }
    return select(0.0, lift, lift < 1e18);
}

// Shading normal in mesh space, not normalised.
fn normal_at(hit: Hit, material: MaterialData, looked: Looked) -> vec3f {
    let normals = hit.triangle.normals;
    let vertex = blend3(
        normal_from_word(normals.x), normal_from_word(normals.y), normal_from_word(normals.z), hit.weights,
    );
    let normal = unit_or(vertex, hit.geometric);
    if !(has_normal_maps && looked.has_normal && hit.mesh.has.z != 0u && any(vertex != vec3f(0.0))) {
        return normal;
    }
    let at = hit.records + 1u;
    let word = attributes[at.x].x;
    // The bitangent's sign is the lowest bit, within the tangent's rounding error.
    let handedness = select(-1.0, 1.0, (word & 1u) != 0u);
    let tangent = blend3(
        normal_from_word(word), normal_from_word(attributes[at.y].x), normal_from_word(attributes[at.z].x),
        hit.weights,
    );
    if !(dot(tangent, tangent) > 1e-12) {
        return normal;
    }
    let t = normalize(tangent);
    let b = cross(normal, t) * handedness;
    let local = looked.normal * vec3f(material.factors.yy, 1.0);
    return unit_or(t * local.x + b * local.y + normal * local.z, normal);
}

// Normalises a vector; returns the other vector if it has no direction.
fn unit_or(v: vec3f, other: vec3f) -> vec3f {
    // Scaled first, because squares of small triangles' normals underflow.
    let most = max(max(abs(v.x), abs(v.y)), abs(v.z));
    let some = most > 0.0 && most < 1e38;
    return select(other, normalize(v / select(1.0, most, some)), some);
}

// Diffuse radiance of a surface and, if `seen`, specular reflection of lights towards the eye. Emission alone where a later
// pass adds the rest.
fn radiance(surface: Surface, seen: bool) -> vec3f {
    if lit_by_rays {
        return surface.emissive;
    }
    let shines = has_specular && seen;
    let to_eye = -normalize(surface.position);
    var irradiance_by_pi = sky_ambient(lighting, surface.normal);
    var reflected = vec3f(0.0);
    // The body comes first, as above. Without lights the array has one black light.
    var i = 0u;
    loop {
        let light = lights[i];
        irradiance_by_pi += diffuse_light(light, surface.position, surface.normal);
        if shines {
            reflected += specular_light(surface, to_eye, light);
        }
        i += 1u;
        // The bound is no bare uniform: see resolve_view.wgsl.
        if i >= min(lighting.light_count, arrayLength(&lights)) {
            break;
        }
    }
    let glossy = any(surface.f0 != vec3f(0.0));
    return surface.emissive + surface.albedo * irradiance_by_pi + select(vec3f(0.0), reflected, glossy);
}
