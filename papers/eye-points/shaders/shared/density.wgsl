// How densely a part of a triangle needs points (EPR, section 4.1.1). Defined in f64 by `papers/eye-points/src/density.rs`.

// A reflector that an eye sees. Mirrored in `layout.rs`.
struct PointReflector {
    // The middle of its map, metres, in two parts.
    center: vec3f,
    // Distance of its farthest vertex from the middle, metres.
    radius: f32,
    center_low: vec3f,
    // Texels on an edge of a face.
    side: f32,
    // Unit normal, and distance of the border from the middle, metres, of the half-space that the map sees. Zero and -1: all.
    front: vec4f,
    // The eye's middle, from the map's.
    to_eye: vec3f,
    // 1/metres.
    curvature: f32,
    // Distance of the nearest viewpoint from the reflector's sphere, metres.
    from_eye: f32,
    // Index of its instance.
    instance: u32,
    // Bits. 1: a planar mirror, whose map is seen from the eye's mirror image.
    flags: u32,
}

const PLANAR_MIRROR: u32 = 1u;

// One pass that cuts triangles.
struct CutStep {
    // First triangle, and number of triangles.
    first: u32,
    count: u32,
    // Number of reflectors, and 32-bit words of their bits.
    reflectors: u32,
    words: u32,
    // Index of the list of parts.
    list: u32,
    // 1: small triangles may be culled. Passes over all parts: 2 for those that were culled, else those that were not.
    culls: u32,
    // The rule of density: 0 the eye, 1 the eye by planar reflectors, 2 the map, 3 shadows.
    rule: u32,
    // The eye's pixels at unit distance.
    pixels: f32,
    // Distances below this count as this, metres.
    near: f32,
    // Square root of the points for each pixel.
    scale: f32,
    // Factor on the density by which a budget lowers it.
    reduction: f32,
}

const BY_PLANAR: u32 = 1u;
const BY_MAP: u32 = 2u;
const BY_SHADOW: u32 = 3u;
// Most texels that a cell is wide.
const WIDEST_CELL: f32 = 16.0;
const HALF_PI: f32 = 1.5707964;

// Squared distance of the origin from a segment.
fn from_segment(p: vec3f, q: vec3f) -> f32 {
    let along = q - p;
    let t = clamp(-dot(p, along) / max(dot(along, along), 1e-37), 0.0, 1.0);
    let nearest = p + along * t;
    return dot(nearest, nearest);
}

// Distance of the origin from a triangle with a unit normal.
fn distance_from(a: vec3f, b: vec3f, c: vec3f, normal: vec3f) -> f32 {
    let inside = vec3f(
        dot(cross(normal, b - a), a),
        dot(cross(normal, c - b), b),
        dot(cross(normal, a - c), c),
    );
    let edges = sqrt(min(from_segment(a, b), min(from_segment(b, c), from_segment(c, a))));
    return select(edges, min(abs(dot(a, normal)), edges), all(inside <= vec3f(0.0)));
}

// Cells for each metre for the shadow of a triangle, seen from a point of a light: `papers/eye-points/src/shadows.rs`.
fn shadow_density(step: CutStep, r: PointReflector, a: vec3f, b: vec3f, c: vec3f, distance: f32) -> f32 {
    let between = length(r.to_eye);
    let middle = (a + b + c) / 3.0;
    let squared = max(dot(a - middle, a - middle), max(dot(b - middle, b - middle), dot(c - middle, c - middle)));
    let away = length(middle);
    let half = select(HALF_PI, atan2(sqrt(squared), sqrt(max(away * away - squared, 0.0))), squared < away * away);
    let angle = atan2(length(cross(middle, r.to_eye)), dot(middle, r.to_eye));
    let beside = select(0.0, between * sin(min(angle - half, HALF_PI)), angle > half && between > 0.0);
    let from_volume = max(max(beside, distance - between), step.near);
    return step.pixels / distance * (1.0 + between / from_volume);
}

// Cells for each metre that a part needs for a reflector. Its corners are relative to the middle of the reflector's map, and
// `distance` is its own from there.
fn density_for(step: CutStep, r: PointReflector, a: vec3f, b: vec3f, c: vec3f, distance: f32) -> f32 {
    let from_center = max(distance, step.near);
    let to_part = max(from_center - r.radius, step.near);
    let of_map = r.side / (2.0 * from_center);
    if step.rule == BY_MAP {
        return max(of_map, of_map / WIDEST_CELL) * step.reduction;
    }
    let curvature = select(r.curvature, 0.0, step.rule == BY_PLANAR);
    var by_eye = step.pixels / (r.from_eye + to_part * (1.0 + 2.0 * r.from_eye * curvature));
    if (r.flags & PLANAR_MIRROR) != 0u {
        by_eye = step.pixels / from_center;
    }
    if step.rule == BY_SHADOW {
        by_eye = shadow_density(step, r, a, b, c, from_center);
    }
    return max(min(by_eye, of_map) * step.scale, of_map / WIDEST_CELL) * step.reduction;
}
