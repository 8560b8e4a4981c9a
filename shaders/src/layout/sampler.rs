//! Mirrors of structs of `shaders/sampler/*.wgsl`, and of the modules of a scene's data that they import.

use super::Mirror;

/// All mirrors of this file.
pub(super) const MIRRORS: &[Mirror] = &[
    TextureSlot::MIRROR,
    MeshLayout::MIRROR,
    InstanceTransform::MIRROR,
    MaterialData::MIRROR,
    Rays::MIRROR,
    Draw::MIRROR,
    Child::MIRROR,
    PlacedTree::MIRROR,
    ResolveSample::MIRROR,
    ResolveView::MIRROR,
    Blend::MIRROR,
    LeafChunk::MIRROR,
    ProbeLevel::MIRROR,
    ProbePoint::MIRROR,
    ScatteredQuery::MIRROR,
    ScatteredRay::MIRROR,
    ScatteredHit::MIRROR,
    TracedObject::MIRROR,
    SurfaceMask::MIRROR,
    MaskTriangle::MIRROR,
    LitTile::MIRROR,
    ShadowLight::MIRROR,
    SkyQuery::MIRROR,
    ArrivingQuery::MIRROR,
];

/// Roles of a texture in [`TextureSlot::usage`]. Equal to those of `shared/texture.wgsl`.
pub mod role {
    /// Base colour and alpha.
    pub const BASE_COLOR: u32 = 0;
    /// Emission.
    pub const EMISSIVE: u32 = 1;
    /// Green: roughness, blue: metallic.
    pub const METALLIC_ROUGHNESS: u32 = 2;
    /// Tangent-space normals.
    pub const NORMAL: u32 = 3;
    /// Red: share of light that passes.
    pub const TRANSMISSION: u32 = 4;
    /// Alpha: strength of a dielectric's reflection.
    pub const SPECULAR: u32 = 5;
    /// Colour of a dielectric's reflection.
    pub const SPECULAR_COLOR: u32 = 6;
}

/// Bits of the last word of [`TextureSlot::usage`]. Equal to those of `shared/texture.wgsl`.
pub mod reads {
    /// Level 0 shows the texel that a point lies in.
    pub const NEAREST: u32 = 1;
    /// The mesh's second set of texture coordinates is transformed.
    pub const SECOND_UVS: u32 = 2;
}

/// Bits of the first word of [`MeshLayout::has`]. Equal to those of `shared/geometry.wgsl`.
pub mod has {
    /// Texture coordinates.
    pub const UVS: u32 = 1;
    /// A second set of them.
    pub const SECOND_UVS: u32 = 2;
    /// The alpha test reads the second set.
    pub const TESTS_SECOND_UVS: u32 = 4;
}

/// Bits of [`ScatteredRay::flags`]. Equal to those of `shared/scattered/ray.wgsl`.
pub mod ray_flags {
    /// A ray of sight, which passes through the backs of single-sided triangles, and ends at glass. Other rays are of light,
    /// which meet both faces and pass through glass.
    pub const OF_SIGHT: u32 = 1;
}

/// Bits of [`ShadowLight::flags`]. Equal to those of `sampler/shadow_rays.wgsl`.
pub mod shadow_flags {
    /// Texels look at points of the light's disc, and not at its centre.
    pub const SOFT: u32 = 1;
    /// Nothing blocks the light.
    pub const UNBLOCKED: u32 = 2;
}

/// Bits of [`SurfaceMask::kind`] above the addressing. Equal to those of `shared/scattered/mask.wgsl`.
pub mod mask {
    /// The texel in which a point lies is read.
    pub const NEAREST: u32 = 16;
    /// Below the cutoff the surface hides as much as its alpha says.
    pub const BLENDS: u32 = 32;
    /// The texture says how much light passes.
    pub const OF_LIGHT: u32 = 64;
}

mirror! {
    /// A material's reference to a texture: `shared/texture.wgsl`.
    pub struct TextureSlot {
        /// Rows of the linear part of the transform from a mesh's uv to the texture's.
        pub texture_from_uv: [f32; 4],
        /// Translation of that transform.
        pub offset: [f32; 4],
        /// Width and height of level 0, index of level 0 among the levels' addresses, number of levels.
        pub extent: [u32; 4],
        /// Addressing of u and v (0 repeat, 1 clamp, 2 mirror), role in the material ([`role`]), bits of [`reads`].
        pub usage: [u32; 4],
    }
}

mirror! {
    /// Offsets of a mesh's data, and its vertex attributes: `shared/geometry.wgsl`.
    pub struct MeshLayout {
        /// First index, first vertex, first record of attributes, records of attributes per vertex.
        pub first: [u32; 4],
        /// Bits of [`has`]; 1 if its vertices have colours, tangents; index of its material.
        pub has: [u32; 4],
    }
}

mirror! {
    /// The transform of an instance relative to the eye: `shared/geometry.wgsl`.
    pub struct InstanceTransform {
        /// First row of the transform from world axes relative to the eye to mesh space.
        pub mesh_from_eye_x: [f32; 4],
        /// The second row.
        pub mesh_from_eye_y: [f32; 4],
        /// The third row.
        pub mesh_from_eye_z: [f32; 4],
        /// Index of its mesh.
        pub mesh: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 3],
    }
}

mirror! {
    /// A material: `shared/geometry.wgsl`.
    pub struct MaterialData {
        /// Linear base colour, and alpha.
        pub base_color: [f32; 4],
        /// Emitted radiance, linear.
        pub emissive: [f32; 3],
        /// Metallic factor.
        pub metallic: f32,
        /// Roughness, scale of the normal map, transmitted share of light, alpha cutoff.
        pub factors: [f32; 4],
        /// Reflectance of the dielectric at normal incidence before it is bounded by 1, and the factor after that.
        pub f0: [f32; 4],
        /// Its textures among all slots: first and number of those encoded as sRGB, first and number of the others.
        pub textures: [u32; 4],
        /// 1 if it has a specular lobe; 1 + the slot of its base colour texture, 0 without one; unused; 1 if it is unlit.
        pub traits: [u32; 4],
    }
}

mirror! {
    /// The rays of a tile of a pinhole image: `shared/rays.wgsl`.
    pub struct Rays {
        /// Vector from the eye to the tile's top left corner at unit depth, world axes.
        pub top_left: [f32; 3],
        /// Sub-samples along each side of a texel.
        pub side: u32,
        /// Step from one sub-sample to the next in its row.
        pub right: [f32; 3],
        /// Columns of the tile, sub-samples.
        pub width: u32,
        /// Step from one row of sub-samples to the next.
        pub down: [f32; 3],
        /// Rows.
        pub height: u32,
    }
}

mirror! {
    /// A run of an instance's triangles, with its transform to a tile: `sampler/visibility.wgsl`.
    pub struct Draw {
        /// First row of the transform from mesh space to clip space.
        pub clip_from_mesh_x: [f32; 4],
        /// The second row.
        pub clip_from_mesh_y: [f32; 4],
        /// The fourth row. The third row is (0, 0, 0, `near`).
        pub clip_from_mesh_w: [f32; 4],
        /// Distance of the near plane, metres.
        pub near: f32,
        /// Index of the instance.
        pub instance: u32,
        /// First triangle of the run, within the mesh.
        pub first_triangle: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// A child of a node of a wide tree: `shared/trace/trees.wgsl`.
    pub struct Child {
        /// Smallest coordinates.
        pub min: [f32; 3],
        /// Its children or triangles. From the highest bits: their number - 1 (3 bits), 1 for triangles (1 bit), index of
        /// the first (28 bits).
        pub reference: u32,
        /// Largest coordinates.
        pub max: [f32; 3],
        /// Kinds of triangles below it, bits: 1 opaque, 2 with an alpha test.
        pub kinds: u32,
    }
}

mirror! {
    /// A tree of triangles with its transform from the eye: `shared/trace/trees.wgsl`.
    pub struct PlacedTree {
        /// First row of the transform from world axes relative to the eye to the tree's space.
        pub tree_from_eye_x: [f32; 4],
        /// The second row.
        pub tree_from_eye_y: [f32; 4],
        /// The third row.
        pub tree_from_eye_z: [f32; 4],
        /// Reference to its root.
        pub root: u32,
        /// Index of the instance; all ones if each triangle has its own.
        pub instance: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 2],
    }
}

mirror! {
    /// Uniform of `sampler/resolve_sample.wgsl`.
    pub struct ResolveSample {
        /// Texels of the tile.
        pub size: [u32; 2],
        /// Position of the tile's first texel in the planes.
        pub offset: [u32; 2],
        /// Texels from one row of the planes to the next.
        pub stride: u32,
        /// Mantissa bits of a stored inverse range.
        pub range_bits: u32,
        /// 1: radiance is stored as Rgba16Float rather than Rgb9e5Ufloat.
        pub half_float: u32,
        /// Elements of the shaded buffer from one row to the next.
        pub shaded_stride: u32,
    }
}

mirror! {
    /// Uniform of `sampler/resolve_view.wgsl`.
    pub struct ResolveView {
        /// Pixels of the tile.
        pub size: [u32; 2],
        /// Sub-samples along each side of a pixel.
        pub side: u32,
        /// Factor from radiance to display-linear.
        pub exposure: f32,
    }
}

mirror! {
    /// Uniform of `sampler/blend.wgsl`.
    pub struct Blend {
        /// Columns and rows of the layer's image.
        pub size: [u32; 2],
        /// Its first element in the image that it is blended over.
        pub offset: [u32; 2],
        /// Columns of that image.
        pub stride: u32,
        /// Fills the struct's size up.
        pub _pad: u32,
    }
}

mirror! {
    /// Uniform of `sampler/add_direct.wgsl`.
    pub struct AddDirect {
        /// Sub-samples of the tile.
        pub size: [u32; 2],
    }
}

mirror! {
    /// Leaves of an octree that are shaded in one submission: `shared/chunk.wgsl`.
    pub struct LeafChunk {
        /// Least corner of the octree's root relative to the eye, metres.
        pub root_about_eye: [f32; 3],
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Columns and rows of the image that the leaves are shaded in: multiples of [`LEAF_BLOCK`].
        pub size: [u32; 2],
        /// First leaf.
        pub first: u32,
        /// Number of leaves of the octree.
        pub leaves: u32,
        /// Edge of a leaf's cell, metres.
        pub cell: f32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 3],
    }
}

/// Texels on a side of a square of consecutive leaves in that image. Equal to that of `shared/chunk.wgsl`.
pub const LEAF_BLOCK: u32 = 16;

mirror! {
    /// A level of reflection probes: `shared/probe_planes.wgsl`.
    pub struct ProbeLevel {
        /// Texels on a side of the finest level.
        pub side: u32,
        /// Columns of a probe.
        pub columns: u32,
        /// Rows of a probe.
        pub rows: u32,
        /// Texels on a side of this level.
        pub level_side: u32,
        /// First row of this level in the probe.
        pub level_row: u32,
        /// Roughness of the surfaces that this level is for.
        pub roughness: f32,
    }
}

mirror! {
    /// A point of a triangle that fills reflection probes: `sampler/shade_points.wgsl`.
    pub struct ProbePoint {
        /// Index of the instance.
        pub instance: u32,
        /// Index of the triangle in its mesh.
        pub primitive: u32,
        /// Side of the square that it stands for, metres.
        pub width: f32,
        /// 1 if its front is seen, 0 if its back is.
        pub front: u32,
        /// Relative to the eye, metres.
        pub position: [f32; 3],
        /// Mean side of the area that it stands for on its surface, metres. Light cells are chosen by it.
        pub across: f32,
    }
}

mirror! {
    /// The rays of a dispatch: `shared/scattered/ray.wgsl`.
    pub struct ScatteredQuery {
        /// Smallest coordinates of the box around all placed objects, relative to the eye.
        pub min: [f32; 3],
        /// Index of the first ray.
        pub first: u32,
        /// Largest coordinates.
        pub max: [f32; 3],
        /// Index behind the last ray.
        pub end: u32,
    }
}

mirror! {
    /// A scattered ray: `shared/scattered/ray.wgsl`.
    pub struct ScatteredRay {
        /// Where it starts, relative to the eye.
        pub origin: [f32; 3],
        /// Where it ends, in units of its direction; may be infinite. There is no ray if it is not above 0.
        pub most: f32,
        /// Its direction.
        pub direction: [f32; 3],
        /// Bits of [`ray_flags`].
        pub flags: u32,
    }
}

mirror! {
    /// The nearest surface along a ray: `sampler/scattered_rays.wgsl`.
    pub struct ScatteredHit {
        /// 1 + its instance; 0 if there is none.
        pub instance: u32,
        /// Index of the triangle in its mesh, and 1 in the highest bit if its front is hit.
        pub primitive: u32,
        /// Distance in units of the direction.
        pub t: f32,
        /// Zero.
        pub unused: u32,
        /// Weights of the mesh's second and third corner.
        pub weights: [f32; 2],
    }
}

mirror! {
    /// A placed object with its transform from the eye: `shared/scattered/trees.wgsl`.
    pub struct TracedObject {
        /// First row of the transform of directions from world axes to the tree's space; the eye there, rounded.
        pub tree_from_eye_x: [f32; 4],
        /// The second row.
        pub tree_from_eye_y: [f32; 4],
        /// The third row.
        pub tree_from_eye_z: [f32; 4],
        /// What rounding took from the eye.
        pub eye_rest: [f32; 3],
        /// Index of its tree's root.
        pub root: u32,
        /// Smallest coordinates of its triangles.
        pub min: [f32; 3],
        /// Index of its instance; all ones if each triangle has its own.
        pub instance: u32,
        /// Largest coordinates of its triangles.
        pub max: [f32; 3],
        /// 1 if it is not turned or scaled.
        pub is_shifted: u32,
    }
}

mirror! {
    /// How much a surface hides, by its texture: `shared/scattered/mask.wgsl`.
    pub struct SurfaceMask {
        /// Rows of the linear part of the transform from a mesh's uv to the texture's.
        pub texture_from_uv: [f32; 4],
        /// Translation of that transform.
        pub offset: [f32; 2],
        /// Factor of the texture.
        pub factor: f32,
        /// Alpha below which the surface does not hide all.
        pub cutoff: f32,
        /// Width and height of the texture; no texture if they are 0.
        pub size: [u32; 2],
        /// Its first texel.
        pub first: u32,
        /// Addressing of u and v (0 repeat, 1 clamp, 2 mirror; two bits each), and bits of [`mask`].
        pub kind: u32,
    }
}

mirror! {
    /// The corners of a triangle whose surface has a mask: `shared/scattered/mask.wgsl`.
    pub struct MaskTriangle {
        /// Texture coordinates of the mesh's first corner.
        pub uv_a: [f32; 2],
        /// Those of the second.
        pub uv_b: [f32; 2],
        /// Those of the third.
        pub uv_c: [f32; 2],
        /// Index of its mask.
        pub mask: u32,
        /// 1 if the next record is of the same triangle.
        pub has_more: u32,
        /// Alpha of the corners.
        pub alpha: [f32; 3],
        /// 1 if the corners have an alpha.
        pub has_alpha: u32,
    }
}

mirror! {
    /// A tile of an image that is lit: `shared/lit_texel.wgsl`.
    pub struct LitTile {
        /// The eye in the space of the merged object.
        pub merged_eye: [f32; 3],
        /// WGSL aligns vectors of two to 8 bytes.
        pub _pad: f32,
        /// Sub-samples.
        pub size: [u32; 2],
        /// Coordinates of the first in its image.
        pub first: [u32; 2],
    }
}

mirror! {
    /// The light that rays go to: `sampler/shadow_rays.wgsl`.
    pub struct ShadowLight {
        /// Its index among the lights.
        pub light: u32,
        /// Radius of a point or spot light; tangent of the angular radius of a directional light.
        pub radius: f32,
        /// Bits of [`shadow_flags`].
        pub flags: u32,
        /// First texel in a penumbra of a dispatch.
        pub first: u32,
    }
}

mirror! {
    /// Which rays to the sky are traced: `sampler/sky_rays.wgsl`.
    pub struct SkyQuery {
        /// Number of the ray of each texel.
        pub ray: u32,
        /// Metres at which rays end.
        pub reach: f32,
    }
}

mirror! {
    /// Where the light of the sky comes from: `sampler/arriving_light.wgsl`.
    pub struct ArrivingQuery {
        /// Directions around of the table of the open sky.
        pub columns: u32,
    }
}
