// Surfels: the appearance of octree nodes in maps.

// A node's appearance: a two-sided piece of a plane.
struct Surfel {
    // Radiance of the side that the axis points to; UNSEEN if that is the back of a single-sided surface.
    front: vec3f,
    // Unit axis, octahedral (2x16snorm).
    axis: u32,
    // Radiance of the other side.
    back: vec3f,
    // Metres along the axis from the node's mean position to the plane.
    offset: f32,
}

// Radiance of a side that cannot be seen.
const UNSEEN: vec3f = vec3f(-1.0);

fn is_seen(radiance: vec3f) -> bool {
    return radiance.x >= 0.0;
}

// Cosine between ray and axis below which a node that is hit from behind shows its front all the same.
const RIM: f32 = 0.5;

// Radiance of a surfel along a unit ray that hits it; UNSEEN if it shows nothing. `axis` is its decoded axis.
fn radiance_towards(surfel: Surfel, axis: vec3f, ray: vec3f) -> vec3f {
    let behind = dot(axis, ray);
    let near_side = select(surfel.back, surfel.front, behind < 0.0);
    // A node that turns away only slightly is on the rim of a round object, whose other leaves face the eye.
    let rim = !is_seen(near_side) && behind < RIM;
    return select(near_side, surfel.front, rim);
}
