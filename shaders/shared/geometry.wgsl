// Buffers of a scene's triangles, and functions that read and interpolate them.

// Offsets of a mesh's data, and its vertex attributes.
struct MeshLayout {
    // Offset in `indices`; offset in `vertices`, to which indices are relative; offset in `attributes`; records of
    // attributes per vertex.
    first: vec4u,
    // Bits of the HAS constants below for texture coordinates; 1 if its vertices have colours, tangents; index of its material.
    has: vec4u,
}

// Vertices have texture coordinates, and a second set.
const HAS_UVS: u32 = 1;
const HAS_SECOND_UVS: u32 = 2;
// The alpha test reads the second set.
const TESTS_SECOND_UVS: u32 = 4;

// An instance's transform relative to a camera's eye.
struct InstanceTransform {
    // Rows of the transform from world axes relative to the eye to mesh space.
    mesh_from_eye_x: vec4f,
    mesh_from_eye_y: vec4f,
    mesh_from_eye_z: vec4f,
    mesh: u32,
}

// A material.
struct MaterialData {
    base_color: vec4f,
    emissive: vec3f,
    metallic: f32,
    // Roughness; scale of the normal map; transmitted share of light; alpha cutoff.
    factors: vec4f,
    // Reflectance of the dielectric at normal incidence before it is bounded by 1, and the factor after that.
    f0: vec4f,
    // Its textures in `slots`: first and number of those encoded as sRGB, first and number of the others.
    textures: vec4u,
    // 1 if it has a specular lobe; 1 + the slot of its base colour texture, 0 without one; unused; 1 if it is unlit.
    traits: vec4u,
}

// Position (f32 bits) and normal (see `normal_from_word`) of each vertex.
@group(1) @binding(0) var<storage, read> vertices: array<vec4u>;
// Records of attributes: texture coordinates (f32 bits) and colour (4x16float). In meshes with tangents or a second set of
// texture coordinates a second record follows: the tangent, and that set (f32 bits).
@group(1) @binding(1) var<storage, read> attributes: array<vec4u>;
@group(1) @binding(2) var<storage, read> indices: array<u32>;
@group(1) @binding(3) var<storage, read> meshes: array<MeshLayout>;
@group(1) @binding(4) var<storage, read> instances: array<InstanceTransform>;
@group(1) @binding(5) var<storage, read> materials: array<MaterialData>;

// A triangle in mesh space.
struct Triangle {
    // Indices of its vertices within the mesh.
    corners: vec3u,
    // First corner relative to the eye, and the edges to the others.
    a: vec3f,
    e1: vec3f,
    e2: vec3f,
    // Encoded normal of each corner.
    normals: vec3u,
}

// The eye's position in mesh space.
fn eye_in_mesh(instance: InstanceTransform) -> vec3f {
    return vec3f(instance.mesh_from_eye_x.w, instance.mesh_from_eye_y.w, instance.mesh_from_eye_z.w);
}

// Transforms a direction from world axes to mesh space.
fn mesh_from_world(instance: InstanceTransform, d: vec3f) -> vec3f {
    return vec3f(
        dot(instance.mesh_from_eye_x.xyz, d), dot(instance.mesh_from_eye_y.xyz, d),
        dot(instance.mesh_from_eye_z.xyz, d),
    );
}

// Transforms a normal from mesh space to world axes, by the inverse transpose. Not a unit vector.
fn normal_from_mesh(instance: InstanceTransform, n: vec3f) -> vec3f {
    return instance.mesh_from_eye_x.xyz * n.x + instance.mesh_from_eye_y.xyz * n.y
        + instance.mesh_from_eye_z.xyz * n.z;
}

// The triangle relative to the eye. Differences of nearby numbers are exact, even of large ones.
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

// Decodes an octahedral normal; zero if the vertex has none.
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

// The second set of texture coordinates, from the second record.
fn second_uv_of(record: vec4u) -> vec2f {
    return bitcast<vec2f>(record.yz);
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
