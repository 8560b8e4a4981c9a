// A scene's triangles as they lie in storage, and what is known of them at a point.

// Where a mesh's data begin, and which attributes its vertices have.
struct MeshLayout {
    // In `indices`; their values count from `first_vertex`.
    first_index: u32,
    // In `positions`, three floats each.
    first_vertex: u32,
    // In `attributes`: the first vertex's record, and the words of a record.
    first_attribute: u32,
    stride: u32,
    // Words into a record; 0: the mesh has none. Word 0 is the normal.
    uv: u32,
    color: u32,
    tangent: u32,
    material: u32,
}

// An instance as one sample camera sees it.
struct Placed {
    // Rows of the transform from world axes about the eye to the mesh's vertices.
    mesh_from_eye_x: vec4f,
    mesh_from_eye_y: vec4f,
    mesh_from_eye_z: vec4f,
    mesh: u32,
}

struct MaterialData {
    base_color: vec4f,
    emissive: vec3f,
    metallic: f32,
    roughness: f32,
    normal_scale: f32,
    // Reflectance of the dielectric at normal incidence.
    dielectric_f0: f32,
    // Whether it has a specular lobe at all.
    glossy: u32,
    // Alpha below which there is no surface; 0 or less if alpha is ignored.
    alpha_cutoff: f32,
    // 1 + the index of the base colour's slot; 0: it has no texture.
    alpha_slot: u32,
    // Its textures in `slots`, those that are sRGB-encoded apart from the others.
    first_srgb: u32,
    srgb_count: u32,
    first_linear: u32,
    linear_count: u32,
}

@group(1) @binding(0) var<storage, read> positions: array<f32>;
@group(1) @binding(1) var<storage, read> attributes: array<u32>;
@group(1) @binding(2) var<storage, read> indices: array<u32>;
@group(1) @binding(3) var<storage, read> meshes: array<MeshLayout>;
@group(1) @binding(4) var<storage, read> instances: array<Placed>;
@group(1) @binding(5) var<storage, read> materials: array<MaterialData>;

// A triangle in mesh space, about the eye.
struct Triangle {
    corners: vec3u,
    a: vec3f,
    e1: vec3f,
    e2: vec3f,
}

fn position(vertex: u32) -> vec3f {
    return vec3f(positions[3u * vertex], positions[3u * vertex + 1u], positions[3u * vertex + 2u]);
}

fn eye_in_mesh(instance: Placed) -> vec3f {
    return vec3f(instance.mesh_from_eye_x.w, instance.mesh_from_eye_y.w, instance.mesh_from_eye_z.w);
}

// A direction of the world in mesh space.
fn mesh_from_world(instance: Placed, d: vec3f) -> vec3f {
    return vec3f(
        dot(instance.mesh_from_eye_x.xyz, d), dot(instance.mesh_from_eye_y.xyz, d),
        dot(instance.mesh_from_eye_z.xyz, d),
    );
}

// A normal of mesh space in the world, not a unit vector: by the inverse transpose.
fn normal_from_mesh(instance: Placed, n: vec3f) -> vec3f {
    return instance.mesh_from_eye_x.xyz * n.x + instance.mesh_from_eye_y.xyz * n.y
        + instance.mesh_from_eye_z.xyz * n.z;
}

// The corners about the eye: differences of nearby numbers, exact even where the numbers are large.
fn triangle_about_eye(instance: Placed, mesh: MeshLayout, primitive: u32) -> Triangle {
    let first = mesh.first_index + 3u * primitive;
    let corners = vec3u(indices[first], indices[first + 1u], indices[first + 2u]);
    let a = position(mesh.first_vertex + corners.x);
    let b = position(mesh.first_vertex + corners.y);
    let c = position(mesh.first_vertex + corners.z);
    return Triangle(corners, a - eye_in_mesh(instance), b - a, c - a);
}

// Octahedral normal; zero where the vertex has none.
fn normal_from_word(word: u32) -> vec3f {
    if word == 0x80008000u {
        return vec3f(0.0);
    }
    let e = unpack2x16snorm(word);
    var n = vec3f(e, 1.0 - abs(e.x) - abs(e.y));
    if n.z < 0.0 {
        n = vec3f((1.0 - abs(n.yx)) * select(vec2f(-1.0), vec2f(1.0), n.xy >= vec2f(0.0)), n.z);
    }
    return normalize(n);
}

fn uv_at(record: u32) -> vec2f {
    return bitcast<vec2f>(vec2u(attributes[record], attributes[record + 1u]));
}

fn color_at(record: u32) -> vec4f {
    return vec4f(unpack2x16float(attributes[record]), unpack2x16float(attributes[record + 1u]));
}

fn blend2(a: vec2f, b: vec2f, c: vec2f, weights: vec3f) -> vec2f {
    return a * weights.x + b * weights.y + c * weights.z;
}

fn blend3(a: vec3f, b: vec3f, c: vec3f, weights: vec3f) -> vec3f {
    return a * weights.x + b * weights.y + c * weights.z;
}

fn blend4(a: vec4f, b: vec4f, c: vec4f, weights: vec3f) -> vec4f {
    return a * weights.x + b * weights.y + c * weights.z;
}
