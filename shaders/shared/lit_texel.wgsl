// The surfaces of a tile's texels, as rays to lights see them: `sampler/src/light/shading_points.rs`.

import package::shared::encode::unit_from_octahedral;

// A tile of an image.
struct LitTile {
    // The eye in the space of the merged object, by which rounding of triangles grows.
    merged_eye: vec3f,
    // Sub-samples, and the coordinates of the first in its image.
    size: vec2u,
    first: vec2u,
}

@group(0) @binding(0) var<uniform> tile: LitTile;
@group(0) @binding(1) var<storage, read> g_surfaces: array<vec4u>;
@group(0) @binding(2) var<storage, read> g_materials: array<vec4u>;

// A visible surface. Positions are relative to the eye.
struct LitTexel {
    exists: bool,
    position: vec3f,
    // Unit shading normal; unit normal of the triangle, on the visible side.
    normal: vec3f,
    side: vec3f,
    // Where rays begin.
    start: vec3f,
    // Whether that is so high above the triangle that rays may go below its plane.
    is_lifted: bool,
}

// Distance off a surface at which a ray starts, as a share of its coordinates: `OFF_SURFACE` of `light_rays`.
const OFF_SURFACE: f32 = 5e-7;

fn texel_at(at: u32) -> LitTexel {
    let surface = g_surfaces[at];
    let material = g_materials[at];
    let position = bitcast<vec3f>(surface.xyz);
    let exists = any(position != vec3f(0.0)) && all((surface.xyz & vec3u(0x7f800000u)) != vec3u(0x7f800000u));
    let range = length(position);
    let off = (range + length(position + tile.merged_eye) + range) * OFF_SURFACE;
    let side = unit_from_octahedral(unpack2x16snorm(material.y));
    // The sign says whether a reflection probe is looked up.
    let lift = bitcast<f32>(material.z & 0x7fffffffu);
    return LitTexel(
        exists, position, unit_from_octahedral(unpack2x16snorm(surface.w)), side, position + side * max(off, lift),
        lift > 4.0 * off,
    );
}

// Whether a ray of a texel begins on the visible side.
fn may_leave(texel: LitTexel, direction: vec3f) -> bool {
    return texel.exists && (texel.is_lifted || dot(direction, texel.side) > 0.0);
}

// Whether another texel shows the same surface, so that the two see the same light.
fn agrees(texel: LitTexel, other: LitTexel) -> bool {
    let off = abs(dot(texel.side, other.position - texel.position));
    return other.exists && dot(texel.side, other.side) > 0.95 && off < 0.01 * length(texel.position);
}

// The slot of a texel by its place in its image: `sampler/src/light/pattern.rs`.
fn slot_of(at: u32) -> u32 {
    return slot_of_place(tile.first + vec2u(at % tile.size.x, at / tile.size.x));
}

fn slot_of_place(place: vec2u) -> u32 {
    let digits = ((((vec3u(place.x) >> vec3u(0u, 1u, 2u)) & vec3u(1u)) * 2u))
        ^ (((vec3u(place.y) >> vec3u(0u, 1u, 2u)) & vec3u(1u)) * 3u);
    return digits.x * 16u + digits.y * 4u + digits.z;
}

// Sums over the rays of a texel to the sky: radiance of the sky that they reach, and of the sky in all of their directions.
struct SkySums {
    seen: vec4f,
    whole: vec4f,
}

// Two unit vectors at right angles to a unit vector (Duff et al., "Building an Orthonormal Basis, Revisited", 2017).
struct Pair {
    first: vec3f,
    second: vec3f,
}

fn orthonormal_pair(n: vec3f) -> Pair {
    let s = select(1.0, -1.0, (bitcast<u32>(n.z) >> 31u) == 1u);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return Pair(vec3f(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3f(b, s + n.y * n.y * a, -n.y));
}

// The unit vector over a point of the unit disc around a unit normal.
fn above(normal: vec3f, disc: vec2f) -> vec3f {
    let pair = orthonormal_pair(normal);
    return pair.first * disc.x + pair.second * disc.y + normal * sqrt(max(1.0 - dot(disc, disc), 0.0));
}

// Index of an invocation's texel in the tile.
fn index_of(group: vec3u, groups: vec3u, lane: u32) -> u32 {
    return (group.y * groups.x + group.x) * 64u + lane;
}

fn texel_count() -> u32 {
    return min(tile.size.x * tile.size.y, arrayLength(&g_surfaces));
}
