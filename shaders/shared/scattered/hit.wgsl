// What a scattered ray meets, as `sampler/scattered_rays.wgsl` writes it.

// The nearest surface along a ray.
struct ScatteredHit {
    // 1 + its instance; 0 if there is none.
    instance: u32,
    // Index of the triangle in its mesh, and 1 in the highest bit if its front is hit.
    primitive: u32,
    // Distance in units of the direction.
    t: f32,
    unused: u32,
    // Weights of the mesh's second and third corner.
    weights: vec2f,
}

const FRONT: u32 = 0x80000000u;
