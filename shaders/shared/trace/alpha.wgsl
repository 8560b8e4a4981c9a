// Alpha test of cut-outs. Equals the rasteriser's: `identify_cutout` of `visibility.wgsl`.

import package::shared::geometry::{
    HAS_UVS, TESTS_SECOND_UVS, attributes, color_of, indices, instances, materials, meshes, second_uv_of, uv_of,
};
import package::shared::texture::{has_second_uvs, sample_alpha, slots};
import package::shared::trace::trees::MIRRORED;
import package::shared::trace::triangle::Leaf;

// A triangle's vertex attributes for the alpha test: texture coordinates and alpha of each corner.
struct Corners {
    a: vec3f,
    b: vec3f,
    c: vec3f,
    material: u32,
}

// Texture coordinates and vertex alpha of a corner. `has`: as in `MeshLayout`.
fn corner_at(record: u32, has: vec4u) -> vec3f {
    let held = attributes[record];
    var uv = select(vec2f(0.0), uv_of(held), (has.x & HAS_UVS) != 0u);
    if has_second_uvs {
        let second = (has.x & TESTS_SECOND_UVS) != 0u;
        uv = select(uv, second_uv_of(attributes[record + select(0u, 1u, second)]), second);
    }
    return vec3f(uv, select(1.0, color_of(held).a, has.y != 0u));
}

fn corners_of(leaf: Leaf, instance: u32) -> Corners {
    let mesh = meshes[instances[instance].mesh];
    let first = mesh.first.x + 3u * leaf.primitive;
    let exchanged = (leaf.flags & MIRRORED) != 0u;
    let a = corner_at(mesh.first.z + indices[first] * mesh.first.w, mesh.has);
    let b = corner_at(mesh.first.z + indices[first + select(1u, 2u, exchanged)] * mesh.first.w, mesh.has);
    let c = corner_at(mesh.first.z + indices[first + select(2u, 1u, exchanged)] * mesh.first.w, mesh.has);
    return Corners(a, b, c, mesh.has.w);
}

// Tests alpha at the barycentric weights u / inverse and v / inverse.
fn passes_alpha_test(corners: Corners, u: f32, v: f32, inverse: f32) -> bool {
    let weights = saturate(vec2f(u, v) / inverse);
    let at = corners.a * (1.0 - weights.x - weights.y) + corners.b * weights.x + corners.c * weights.y;
    let material = materials[corners.material];
    var alpha = material.base_color.a * at.z;
    if material.traits.y != 0u {
        alpha *= sample_alpha(slots[material.traits.y - 1u], at.xy);
    }
    return alpha >= material.factors.w;
}
