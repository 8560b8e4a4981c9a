// Scattered rays: as programs hand them over, and in the space of a tree.

import package::shared::scattered::trees::TracedObject;

// A ray relative to the eye. It has no direction, or is not finite, if there is none.
struct ScatteredRay {
    origin: vec3f,
    // Where it ends, in units of its direction; may be infinite.
    most: f32,
    direction: vec3f,
    // RAY_OF_SIGHT, or 0 for a ray of light.
    flags: u32,
}

// The rays of a dispatch, and the box around all placed objects, relative to the eye.
struct ScatteredQuery {
    min: vec3f,
    first: u32,
    max: vec3f,
    // Index behind the last ray.
    end: u32,
}

@group(0) @binding(0) var<uniform> query: ScatteredQuery;
@group(0) @binding(1) var<storage, read> rays: array<ScatteredRay>;

// A ray of sight passes through the backs of single-sided triangles, and ends at glass. A ray of light meets both faces,
// and passes through glass.
const RAY_OF_SIGHT: u32 = 1;

// A ray in the space of a tree. Its direction is divided by `unit_of`.
struct TreeRay {
    origin: vec3f,
    inverse: vec3f,
    // By which boxes are widened on each side, for rounding.
    slack: f32,
    // Bit a for an ascending coordinate a, in each of four bytes.
    ascends: u32,
    // Shear of the triangle test; the axis along which the ray is longest.
    shear: vec2f,
    axis: u32,
}

// Rounding of corners in the ray's frame and of distances to boxes, as a share of the distance, and of the origin's
// coordinates: 24 and 4 times 2⁻²⁴.
const ROUNDING: f32 = 1.430511474609375e-6;
const LAST_PLACE: f32 = 2.384185791015625e-7;
// The smallest component of a direction that counts, as a share of the largest: 2⁻⁴⁰. The difference is far below `slack`.
const LEAST_COMPONENT: f32 = 9.094947017729282e-13;

fn largest(v: vec3f) -> f32 {
    return max(v.x, max(v.y, v.z));
}

fn is_finite(v: vec3f) -> bool {
    return all((bitcast<vec3u>(v) & vec3u(0x7f800000u)) != vec3u(0x7f800000u));
}

// Whether there is a ray, by bits. Quirk: folded-nan.
fn is_ray(ray: ScatteredRay) -> bool {
    let most = bitcast<u32>(ray.most);
    let has_length = most > 0u && most <= 0x7f800000u;
    return has_length && is_finite(ray.origin) && is_finite(ray.direction) && largest(abs(ray.direction)) > 0.0;
}

// The power of two below the largest component of a direction, as biased exponent.
fn exponent_of(direction: vec3f) -> u32 {
    return clamp(bitcast<u32>(largest(abs(direction))) >> 23u, 1u, 253u);
}

// The unit in which distances along a direction are larger than in units of the direction.
fn unit_of(exponent: u32) -> f32 {
    return bitcast<f32>(exponent << 23u);
}

// A direction whose largest component is 1 to 2, but for the largest floats.
fn scaled_direction(direction: vec3f, exponent: u32) -> vec3f {
    return direction * bitcast<f32>((254u - exponent) << 23u);
}

// A ray in the space of a tree with this box.
fn tree_ray(origin: vec3f, direction: vec3f, least_corner: vec3f, most_corner: vec3f) -> TreeRay {
    let size = abs(direction);
    let length = largest(size);
    let least = length * LEAST_COMPONENT;
    let signs = bitcast<vec3u>(direction) & vec3u(0x80000000u);
    let safe = select(direction, bitcast<vec3f>(vec3u(bitcast<u32>(least)) | signs), size < vec3f(least));
    let inverse = 1.0 / safe;
    let reach = largest(max(abs(least_corner - origin), abs(most_corner - origin)));
    let slack = reach * ROUNDING + largest(abs(origin)) * LAST_PLACE;
    let bits = select(vec3u(0u), vec3u(1u, 2u, 4u), signs == vec3u(0u));
    var axis = 2u;
    if size.x >= size.y && size.x >= size.z {
        axis = 0u;
    } else if size.y >= size.z {
        axis = 1u;
    }
    let turned = turned_to(axis, direction);
    return TreeRay(
        origin, inverse, slack, (bits.x | bits.y | bits.z) * 0x01010101u, turned.xy / turned.z, axis,
    );
}

// Components in cyclic order, so that the given axis is the third.
fn turned_to(axis: u32, v: vec3f) -> vec3f {
    return select(select(v, v.zxy, axis == 1u), v.yzx, axis == 0u);
}

// A ray relative to the eye in the space of a placed object's tree. `direction`: as `scaled_direction` gives it.
fn ray_in_object(object: TracedObject, origin: vec3f, direction: vec3f) -> TreeRay {
    let eye = vec3f(object.tree_from_eye_x.w, object.tree_from_eye_y.w, object.tree_from_eye_z.w);
    if object.is_shifted == 1u {
        return tree_ray((origin + object.eye_rest) + eye, direction, object.min, object.max);
    }
    let start = turned_by(object, origin);
    let along = turned_by(object, direction);
    return tree_ray((start + object.eye_rest) + eye, along, object.min, object.max);
}

fn turned_by(object: TracedObject, v: vec3f) -> vec3f {
    return vec3f(
        dot(object.tree_from_eye_x.xyz, v), dot(object.tree_from_eye_y.xyz, v), dot(object.tree_from_eye_z.xyz, v),
    );
}
