// A ray against a triangle: the test of `sampler/src/light_rays/walk.rs` (Woop, Benthin and Wald, "Watertight Ray/Triangle
// Intersection", 2013).
//
// Corners are sheared into the ray's frame. The edge functions there have the right sign or are zero, which counts as
// inside. So a ray that passes between triangles which share corners always meets one of them.

import package::shared::scattered::ray::{TreeRay, turned_to};

// Where a ray meets a triangle's plane.
struct Met {
    // Distance in units of the scaled direction.
    t: f32,
    // Weights of the second and third stored corner.
    weights: vec2f,
    // Whether the stored corners appear counter-clockwise.
    front: bool,
    // Whether that is within the triangle.
    inside: bool,
}

// a·d - b·c with the right sign, whether `fma` rounds once or twice (Kahan's algorithm). A compiler that fused only one of
// the products would give an edge different signs in the two triangles that share it.
fn difference_of_products(a: f32, d: f32, b: f32, c: f32) -> f32 {
    let product = b * c;
    let lost = fma(-b, c, product);
    return fma(a, d, -product) + lost;
}

fn sheared(ray: TreeRay, corner: vec3f) -> vec3f {
    let p = turned_to(ray.axis, corner - ray.origin);
    return vec3f(fma(-ray.shear.x, p.z, p.x), fma(-ray.shear.y, p.z, p.y), p.z);
}

fn meet(ray: TreeRay, corner_a: vec3f, corner_b: vec3f, corner_c: vec3f) -> Met {
    let a = sheared(ray, corner_a);
    let b = sheared(ray, corner_b);
    let c = sheared(ray, corner_c);
    let u = difference_of_products(c.x, b.y, c.y, b.x);
    let v = difference_of_products(a.x, c.y, a.y, c.x);
    let w = difference_of_products(b.x, a.y, b.y, a.x);
    let is_left = u >= 0.0 && v >= 0.0 && w >= 0.0;
    let is_right = u <= 0.0 && v <= 0.0 && w <= 0.0;
    // Along an axis that the ray descends, the frame mirrors.
    let ascends = (ray.ascends >> ray.axis) & 1u;
    var met = Met(0.0, vec2f(0.0), is_left == (ascends == 1u), false);
    if is_left || is_right {
        let area = u + v + w;
        // Zero for a triangle that is seen edge-on, which is not met.
        met.inside = area != 0.0;
        let depth = (u * a.z + v * b.z + w * c.z) / area;
        met.t = depth * select(select(ray.inverse.z, ray.inverse.y, ray.axis == 1u), ray.inverse.x, ray.axis == 0u);
        met.weights = vec2f(v, w) / area;
    }
    return met;
}
