// Directions and texels of sample cameras; `scene/src/camera.rs` (SampleCamera, Face) is the definition.
//
// Texture coordinates are 0..1 over the whole image of a sample, all of its faces; texel centres lie at half
// integers of texture coordinate times size. Directions may have any length.

// A pinhole sample camera: a direction in world axes to texture coordinates times w, and to w, the depth
// along the camera's axis.
struct Pinhole {
    u_from_world: vec3f,
    v_from_world: vec3f,
    w_from_world: vec3f,
}

// Texture coordinates of a direction, and whether the camera looks there at all.
struct Seen {
    uv: vec2f,
    inside: bool,
}

// A direction (world axes) in the camera's homogeneous texture coordinates; linear in it.
fn in_pinhole(camera: Pinhole, d: vec3f) -> vec3f {
    return vec3f(dot(camera.u_from_world, d), dot(camera.v_from_world, d), dot(camera.w_from_world, d));
}

// Where a pinhole camera has homogeneous texture coordinates.
fn seen_by_pinhole(h: vec3f) -> Seen {
    // Behind the camera and on its plane: a coordinate that is outside whatever the division gives.
    let uv = h.xy / max(h.z, 1e-30);
    return Seen(uv, h.z > 0.0 && all(uv >= vec2f(0.0)) && all(uv <= vec2f(1.0)));
}

// Where a cube of faces of `face` texels a side, ring included, has the direction d (world axes).
//
// Faces lie in three columns and two rows, +x -x +y over -y +z -z, and each covers a ring of one texel more
// than its sixth of the sphere, so that a bilinear fetch never leaves it.
fn seen_by_cube(face: f32, d: vec3f) -> Seen {
    let a = abs(d);
    var column = 2.0;
    var major = d.y;
    // Right and up of the face, as a person inside the cube sees it.
    var across = vec2f(d.x, d.z);
    if a.x >= a.y && a.x >= a.z {
        column = 0.0;
        major = d.x;
        across = vec2f(d.z, d.y);
    } else if a.z > a.y {
        column = 4.0;
        major = d.z;
        across = vec2f(-d.x, d.y);
    }
    let negative = major < 0.0;
    // The opposite face is seen turned about its up axis; +y and -y, about their right one.
    let flip = select(vec2f(-1.0, 1.0), vec2f(1.0, -1.0), column == 2.0);
    across = select(across, across * flip, negative);
    let index = column + select(0.0, 1.0, negative);
    let row = select(0.0, 1.0, index >= 3.0);
    let within = vec2f(across.x, -across.y) / max(abs(major), 1e-30) * ((face - 2.0) / face) * 0.5 + 0.5;
    let uv = (vec2f(index - 3.0 * row, row) + within) / vec2f(3.0, 2.0);
    return Seen(uv, max(a.x, max(a.y, a.z)) > 0.0);
}

// The face of a cube that has the direction d, in the order of `seen_by_cube`.
fn cube_face_of(d: vec3f) -> u32 {
    let a = abs(d);
    if a.x >= a.y && a.x >= a.z {
        return select(0u, 1u, d.x < 0.0);
    }
    if a.z > a.y {
        return select(4u, 5u, d.z < 0.0);
    }
    return select(2u, 3u, d.y < 0.0);
}

// The face of a cube that has texture coordinates which `seen_by_cube` returned; the ring keeps these off its border.
fn cube_face_at(uv: vec2f) -> u32 {
    let tile = vec2u(uv * vec2f(3.0, 2.0));
    return tile.y * 3u + tile.x;
}

// A direction in the axes of a face of a cube: right, up and forward; linear in it.
fn in_cube_face(index: u32, d: vec3f) -> vec3f {
    let sign = select(1.0, -1.0, (index & 1u) == 1u);
    if index < 2u {
        return vec3f(d.z * sign, d.y, d.x * sign);
    }
    if index < 4u {
        return vec3f(d.x, d.z * sign, d.y * sign);
    }
    return vec3f(-d.x * sign, d.y, d.z * sign);
}

// What is in the axes of a face of a cube, in texels of the whole image times w, and w; linear in it.
fn texel_of_cube_face(face: f32, index: u32, p: vec3f) -> vec3f {
    let tile = vec2f(f32(index % 3u), f32(index / 3u));
    return vec3f((tile + 0.5) * face * p.z + vec2f(p.x, -p.y) * (0.5 * (face - 2.0)), p.z);
}

// The direction, in a face's own axes (x right, y up, looking along -z, at depth 1), of a position in texels
// of that face: `scale` and `bias` are 2 h / size and -h, h the tangents of half the fields of view.
fn direction_in_face(scale: vec2f, bias: vec2f, texel: vec2f) -> vec3f {
    let p = texel * scale + bias;
    return vec3f(p.x, -p.y, -1.0);
}
