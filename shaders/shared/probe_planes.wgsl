// Planes of reflection probes (`shared/reflection_probes.wgsl`) while a level of them is made.

import package::shared::encode::{rgb9e5_from_radiance, unit_from_octahedral};

// A level of probes.
struct ProbeLevel {
    // Texels on a side of the finest level; columns and rows of a probe.
    side: u32,
    columns: u32,
    rows: u32,
    // Texels on a side of this level, and its first row in the probe.
    level_side: u32,
    level_row: u32,
    // Roughness of the level.
    roughness: f32,
}

var<immediate> step: ProbeLevel;

// Finest levels of all probes, (side + 2)² texels each: radiance, and inverse range in w.
@group(3) @binding(0) var<storage, read_write> finest: array<vec4f>;
@group(3) @binding(1) var<storage, read_write> radiance_plane: array<u32>;
@group(3) @binding(2) var<storage, read_write> inverse_range_plane: array<u32>;

// Rays along a side of a texel of the finest level.
const SUB: u32 = 2u;

// Direction of a point of the octahedral square; beyond its border, of the adjoining face.
fn direction_of_place(place: vec2f) -> vec3f {
    var e = place;
    // Beyond a side, the square continues mirrored about the side's centre.
    if abs(e.x) > 1.0 {
        e = vec2f(sign(e.x) * 2.0 - e.x, -e.y);
    }
    if abs(e.y) > 1.0 {
        e = vec2f(-e.x, sign(e.y) * 2.0 - e.y);
    }
    return unit_from_octahedral(e);
}

// Position of a texel of the level (ring included) in the octahedral square.
fn place_of(texel: vec2f) -> vec2f {
    return (texel - 1.0) / f32(step.level_side) * 2.0 - 1.0;
}

// Stores a texel of a probe's level.
fn keep(texel: vec2u, map: u32, radiance: vec3f, inverse_range: f32) {
    let at = (map * step.rows + step.level_row + texel.y) * step.columns + texel.x;
    radiance_plane[at] = rgb9e5_from_radiance(radiance);
    // Lower bits are invisible; zeros compress better.
    inverse_range_plane[at] = bitcast<u32>(inverse_range) & 0xffffff80u;
}
