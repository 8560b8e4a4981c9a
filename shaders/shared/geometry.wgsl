// A scene's triangles as they lie in storage, and what is known of them at a point.

// Where a mesh's data begin, and which attributes its vertices have.
struct MeshLayout {
    // First of its `indices`; first of its `vertices`, from which indices count; first of its `attributes`;
    // records of attributes to a vertex.
    first: vec4u,
    // Whether its vertices have texture coordinates, colours, tangents; its material.
    has: vec4u,
}

// An instance as one sample camera sees it.
struct InstanceTransform {
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
    // Roughness; scale of the normal map; the dielectric's reflectance at normal incidence; alpha below which
    // there is no surface.
    factors: vec4f,
    // Its textures in `slots`: the first that is sRGB-encoded and how many, the first of the others and how many.
    textures: vec4u,
    // Whether it has a specular lobe at all; 1 + the index of the base colour's slot, 0 if it has no texture; the share of
    // light that passes through, f32 bits.
    traits: vec4u,
}

// Bits of the position, and the normal as `normal_from_word` reads it.
@group(1) @binding(0) var<storage, read> vertices: array<vec4u>;
// Texture coordinates and colour (4x16float); in meshes with tangents another record follows, whose first word
// is the tangent.
@group(1) @binding(1) var<storage, read> attributes: array<vec4u>;
@group(1) @binding(2) var<storage, read> indices: array<u32>;
@group(1) @binding(3) var<storage, read> meshes: array<MeshLayout>;
@group(1) @binding(4) var<storage, read> instances: array<InstanceTransform>;
@group(1) @binding(5) var<storage, read> materials: array<MaterialData>;

// A triangle in mesh space, about the eye.
struct Triangle {
    corners: vec3u,
    a: vec3f,
    e1: vec3f,
    e2: vec3f,
    // Of each corner, as a vertex holds it.
    normals: vec3u,
}

fn eye_in_mesh(instance: InstanceTransform) -> vec3f {
    return vec3f(instance.mesh_from_eye_x.w, instance.mesh_from_eye_y.w, instance.mesh_from_eye_z.w);
}

// A direction of the world in mesh space.
fn mesh_from_world(instance: InstanceTransform, d: vec3f) -> vec3f {
    return vec3f(
        dot(instance.mesh_from_eye_x.xyz, d), dot(instance.mesh_from_eye_y.xyz, d),
        dot(instance.mesh_from_eye_z.xyz, d),
    );
}

// A normal of mesh space in the world, not a unit vector: by the inverse transpose.
fn normal_from_mesh(instance: InstanceTransform, n: vec3f) -> vec3f {
    return instance.mesh_from_eye_x.xyz * n.x + instance.mesh_from_eye_y.xyz * n.y
        + instance.mesh_from_eye_z.xyz * n.z;
}

// The corners about the eye: differences of nearby numbers, exact even where the numbers are large.
fn triangle_about_eye(instance: InstanceTransform, mesh: MeshLayout, primitive: u32) -> Triangle {
    let first = mesh.first.x + 3u * primitive;
    let corners = vec3u(indices[first], indices[first + 1u], indices[first + 2u]);
    let a = vertices[mesh.first.y + corners.x];
    let b = vertices[mesh.first.y + corners.y];
    let c = vertices[mesh.first.y + corners.z];
    let first_corner = bitcast<vec3f>(a.xyz);
    return Triangle(
        corners, first_corner - eye_in_mesh(instance), bitcast<vec3f>(b.xyz) - first_corner,
        bitcast<vec3f>(c.xyz) - first_corner, vec3u(a.w, b.w, c.w),
    );
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

fn uv_of(record: vec4u) -> vec2f {
    return bitcast<vec2f>(record.xy);
}

fn color_of(record: vec4u) -> vec4f {
    return vec4f(unpack2x16float(record.z), unpack2x16float(record.w));
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
