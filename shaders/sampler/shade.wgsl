// Program of `sampler/src/passes/shade.rs`: the radiance that each sub-sample sees, where triangles are known.

import package::shared::encode::{octahedral_from_unit};
import package::shared::finite::{finite_or_zero};
import package::shared::geometry::{
    MaterialData, MeshLayout, Placed, Triangle, attributes, blend2, blend3, blend4, color_at, instances, materials,
    mesh_from_world, meshes, normal_from_mesh, normal_from_word, triangle_about_eye, uv_at,
};
import package::shared::ray_triangle::{cross_triangle};
import package::shared::rays::{Rays, central_ray, ray_through};
import package::shared::shading::{
    Light, Lighting, Surface, diffuse_light, sky_ambient, sky_radiance, specular_light, specular_sky,
};
import package::shared::texture::{sample_texture};

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(1) var<uniform> lighting: Lighting;
@group(0) @binding(2) var<storage, read> lights: array<Light>;
@group(0) @binding(3) var visibility: texture_2d<u32>;
// Radiance; in w the inverse range of a sample's surface on its texel's central ray, 0 for sky.
@group(0) @binding(4) var<storage, read_write> shaded: array<vec4f>;
// Octahedral normal (2x16snorm), F0 and roughness (4x8unorm).
@group(0) @binding(5) var<storage, read_write> gloss: array<vec2u>;

struct Seen {
    surface: Surface,
    // 1/metres on the sub-sample's own ray, and on the central one as far as the triangle's plane tells.
    inverse_range: f32,
    central_inverse_range: f32,
}

// The surface of a triangle along a ray, textures looked up.
fn see(ids: vec2u, sub_sample: vec2u) -> Seen {
    let instance = instances[ids.x - 1u];
    let mesh = meshes[instance.mesh];
    let along = ray_through(rays, vec2f(sub_sample) + 0.5);
    let scale = 1.0 / length(along);
    let direction = along * scale;
    let in_mesh = mesh_from_world(instance, direction);
    let triangle = triangle_about_eye(instance, mesh, ids.y);
    let crossing = cross_triangle(in_mesh, triangle.a, triangle.e1, triangle.e2);
    let weights = vec3f(1.0 - crossing.barycentric.x - crossing.barycentric.y, crossing.barycentric);
    let geometric = cross(triangle.e1, triangle.e2);

    // The range is bounded so that its inverse is finite, and so is everything that follows.
    let range = clamp(crossing.t, 1e-18, 1e18);
    let inverse = 1.0 / range;
    let central = normalize(central_ray(rays, sub_sample));
    let plane = dot(geometric, mesh_from_world(instance, central)) / dot(geometric, in_mesh);
    // A plane seen edge-on may leave the texel anywhere; nothing is farther off than a few texels' slope.
    let slope = select(1.0, clamp(plane, 0.75, 1.25), abs(plane) < 1e9);

    var surface: Surface;
    surface.position = direction * range;
    let record = mesh.first_attribute + triangle.corners * mesh.stride;
    let dx = mesh_from_world(instance, rays.right) * scale;
    let dy = mesh_from_world(instance, rays.down) * scale;
    shade_inputs(&surface, instance, mesh, triangle, record, weights, geometric, in_mesh, dx, dy, range);
    surface.normal *= select(-1.0, 1.0, crossing.front);
    return Seen(surface, inverse, inverse * slope);
}

// How far the hit moves on its triangle, in barycentric coordinates, as its ray's direction changes by
// `difference` (Igehy, "Tracing Ray Differentials", 1999, section 3.1.1).
fn barycentric_step(
    triangle: Triangle, geometric: vec3f, direction: vec3f, difference: vec3f, range: f32,
) -> vec2f {
    let along = -range * dot(difference, geometric) / dot(direction, geometric);
    let moved = difference * range + direction * along;
    let area = dot(geometric, geometric);
    return vec2f(
        dot(cross(moved, triangle.e2), geometric), dot(cross(triangle.e1, moved), geometric),
    ) / area;
}

fn shade_inputs(
    surface: ptr<function, Surface>, instance: Placed, mesh: MeshLayout, triangle: Triangle, record: vec3u,
    weights: vec3f, geometric: vec3f, direction: vec3f, dx: vec3f, dy: vec3f, range: f32,
) {
    let material = mesh.material;
    var uv = vec2f(0.0);
    var duv_dx = vec2f(0.0);
    var duv_dy = vec2f(0.0);
    if mesh.uv != 0u {
        let a = uv_at(record.x + mesh.uv);
        let b = uv_at(record.y + mesh.uv);
        let c = uv_at(record.z + mesh.uv);
        uv = blend2(a, b, c, weights);
        let x = barycentric_step(triangle, geometric, direction, dx, range);
        let y = barycentric_step(triangle, geometric, direction, dy, range);
        duv_dx = (b - a) * x.x + (c - a) * x.y;
        duv_dy = (b - a) * y.x + (c - a) * y.y;
    }
    var base = materials[material].base_color
        * sample_texture(materials[material].base_color_texture, uv, duv_dx, duv_dy);
    if mesh.color != 0u {
        base *= blend4(
            color_at(record.x + mesh.color), color_at(record.y + mesh.color), color_at(record.z + mesh.color),
            weights,
        );
    }
    let metallic_roughness =
        sample_texture(materials[material].metallic_roughness_texture, uv, duv_dx, duv_dy);
    let metallic = saturate(materials[material].metallic * metallic_roughness.b);
    (*surface).albedo = base.rgb * (1.0 - metallic);
    (*surface).roughness = saturate(materials[material].roughness * metallic_roughness.g);
    (*surface).f0 = vec3f(0.0);
    if materials[material].glossy != 0u {
        (*surface).f0 = mix(vec3f(materials[material].dielectric_f0), base.rgb, metallic);
    }
    (*surface).emissive = vec3f(0.0);
    if any(materials[material].emissive > vec3f(0.0)) {
        (*surface).emissive = materials[material].emissive
            * sample_texture(materials[material].emissive_texture, uv, duv_dx, duv_dy).rgb;
    }

    let normal = blend3(
        normal_from_word(attributes[record.x]), normal_from_word(attributes[record.y]),
        normal_from_word(attributes[record.z]), weights,
    );
    var in_mesh = unit_or(normal, geometric);
    if materials[material].normal_texture.levels != 0u && mesh.tangent != 0u && dot(normal, normal) > 0.0 {
        let word = attributes[record.x + mesh.tangent];
        // The bitangent's sign lies in the lowest bit, which is within the tangent's rounding.
        let handedness = select(-1.0, 1.0, (word & 1u) != 0u);
        let tangent = blend3(
            normal_from_word(word), normal_from_word(attributes[record.y + mesh.tangent]),
            normal_from_word(attributes[record.z + mesh.tangent]), weights,
        );
        if dot(tangent, tangent) > 1e-12 {
            let t = normalize(tangent);
            let b = cross(in_mesh, t) * handedness;
            let texel = sample_texture(materials[material].normal_texture, uv, duv_dx, duv_dy).xyz * 2.0 - 1.0;
            let local = texel * vec3f(vec2f(materials[material].normal_scale), 1.0);
            in_mesh = unit_or(t * local.x + b * local.y + in_mesh * local.z, in_mesh);
        }
    }
    (*surface).normal = unit_or(normal_from_mesh(instance, in_mesh), vec3f(0.0, 1.0, 0.0));
}

// A vector's direction; another vector, as it is, where it has none.
fn unit_or(v: vec3f, other: vec3f) -> vec3f {
    // Scaled first: squares of small triangles' normals underflow.
    let most = max(max(abs(v.x), abs(v.y)), abs(v.z));
    if !(most > 0.0 && most < 1e38) {
        return other;
    }
    return normalize(v / most);
}

fn diffuse(surface: Surface) -> vec3f {
    var irradiance_by_pi = sky_ambient(lighting, surface.normal);
    for (var i = 0u; i < lighting.light_count; i++) {
        irradiance_by_pi += diffuse_light(lights[i], surface.position, surface.normal);
    }
    return surface.emissive + surface.albedo * irradiance_by_pi;
}

fn specular(surface: Surface) -> vec3f {
    if all(surface.f0 == vec3f(0.0)) {
        return vec3f(0.0);
    }
    let to_eye = -normalize(surface.position);
    var radiance = specular_sky(surface, to_eye, lighting);
    for (var i = 0u; i < lighting.light_count; i++) {
        radiance += specular_light(surface, to_eye, lights[i]);
    }
    return radiance;
}

fn sky_along(sub_sample: vec2u) -> vec3f {
    return finite_or_zero(sky_radiance(lighting, normalize(ray_through(rays, vec2f(sub_sample) + 0.5))));
}

// For a direct view: everything that reaches its eye.
@compute @workgroup_size(8, 8)
fn shade_view(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let ids = textureLoad(visibility, id.xy, 0).xy;
    if ids.x == 0u {
        shaded[at] = vec4f(sky_along(id.xy), 0.0);
        return;
    }
    let seen = see(ids, id.xy);
    shaded[at] = vec4f(finite_or_zero(diffuse(seen.surface) + specular(seen.surface)), seen.inverse_range);
}

// For a sample: what does not depend on the viewer.
@compute @workgroup_size(8, 8)
fn shade_sample(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let ids = textureLoad(visibility, id.xy, 0).xy;
    if ids.x == 0u {
        shaded[at] = vec4f(sky_along(id.xy), 0.0);
        return;
    }
    let seen = see(ids, id.xy);
    shaded[at] = vec4f(finite_or_zero(diffuse(seen.surface)), seen.central_inverse_range);
}

// For a sample of a scene with glossy materials: also what specular reflection will need.
@compute @workgroup_size(8, 8)
fn shade_glossy_sample(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= rays.width || id.y >= rays.height {
        return;
    }
    let at = id.y * rays.width + id.x;
    let ids = textureLoad(visibility, id.xy, 0).xy;
    if ids.x == 0u {
        shaded[at] = vec4f(sky_along(id.xy), 0.0);
        gloss[at] = vec2u(0u);
        return;
    }
    let seen = see(ids, id.xy);
    shaded[at] = vec4f(finite_or_zero(diffuse(seen.surface)), seen.central_inverse_range);
    let specular = vec4f(seen.surface.f0, seen.surface.roughness);
    gloss[at] = vec2u(pack2x16snorm(octahedral_from_unit(seen.surface.normal)), pack4x8unorm(specular));
}
