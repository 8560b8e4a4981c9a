// Faces of the cube maps around reflectors, as `sampler/src/index_maps/mod.rs`: pairs for x, y and z, the positive one first.

// A direction within a face: coordinates along its two axes, and along its own axis.
fn in_face(face: u32, d: vec3f) -> vec3f {
    let turned = select(select(d, d.zxy, face / 2u == 1u), d.yzx, face / 2u == 0u);
    return vec3f(turned.xy, select(turned.z, -turned.z, (face & 1u) == 1u));
}

// The direction of coordinates within a face.
fn from_face(face: u32, at: vec3f) -> vec3f {
    let d = vec3f(at.xy, select(at.z, -at.z, (face & 1u) == 1u));
    return select(select(d, d.yzx, face / 2u == 1u), d.zxy, face / 2u == 0u);
}

// The face of a direction: that of its longest coordinate.
fn face_of(d: vec3f) -> u32 {
    let size = abs(d);
    if size.x >= size.y && size.x >= size.z {
        return select(0u, 1u, d.x < 0.0);
    }
    if size.y >= size.z {
        return select(2u, 3u, d.y < 0.0);
    }
    return select(4u, 5u, d.z < 0.0);
}
