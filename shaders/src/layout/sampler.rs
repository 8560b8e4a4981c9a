//! `shaders/sampler/*.wgsl` and what they import of a scene: what the sampler hands to the GPU.

use super::Mirror;

/// All of this file's.
pub(super) const MIRRORS: &[Mirror] = &[
    TextureSlot::MIRROR,
    MeshLayout::MIRROR,
    Placed::MIRROR,
    MaterialData::MIRROR,
    Rays::MIRROR,
    Draw::MIRROR,
    ResolveSample::MIRROR,
    ResolveView::MIRROR,
];

/// Values of [`TextureSlot::role`], as `shared/texture.wgsl` has them.
pub mod role {
    /// Base colour and alpha.
    pub const BASE_COLOR: u32 = 0;
    /// Emission.
    pub const EMISSIVE: u32 = 1;
    /// Green: roughness, blue: metallic.
    pub const METALLIC_ROUGHNESS: u32 = 2;
    /// Tangent-space normals.
    pub const NORMAL: u32 = 3;
}

mirror! {
    /// A material's reference to a texture: `shared/texture.wgsl`.
    pub struct TextureSlot {
        /// Row of the linear part of the transform from a mesh's uv to the texture's.
        pub u_from_uv: [f32; 2],
        /// The other row.
        pub v_from_uv: [f32; 2],
        /// Added last.
        pub offset: [f32; 2],
        /// Texels of level 0.
        pub size: [u32; 2],
        /// Where the addresses of its levels begin.
        pub first_level: u32,
        /// Number of levels.
        pub levels: u32,
        /// Addressing of u and v: 0 repeat, 1 clamp, 2 mirror.
        pub wrap: [u32; 2],
        /// What its material uses it for: [`role`].
        pub role: u32,
        /// WGSL rounds the struct up to 8 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// Where a mesh's data begin, and which attributes its vertices have: `shared/geometry.wgsl`.
    #[derive(Default)]
    pub struct MeshLayout {
        /// First of its indices.
        pub first_index: u32,
        /// First of its vertices; indices count from it.
        pub first_vertex: u32,
        /// Word at which its first vertex's record of attributes begins.
        pub first_attribute: u32,
        /// Words of a record; the normal is the first.
        pub stride: u32,
        /// Word of a record at which texture coordinates begin; 0: none.
        pub uv: u32,
        /// The same of the colour.
        pub color: u32,
        /// The same of the tangent.
        pub tangent: u32,
        /// Index of its material.
        pub material: u32,
    }
}

mirror! {
    /// An instance as one sample camera sees it: `shared/geometry.wgsl`.
    pub struct Placed {
        /// Row of the transform from world axes about the eye to the mesh's vertices.
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
        /// Linear, with alpha.
        pub base_color: [f32; 4],
        /// Linear radiance.
        pub emissive: [f32; 3],
        /// Factor.
        pub metallic: f32,
        /// Factor.
        pub roughness: f32,
        /// Scales x and y of the normal map.
        pub normal_scale: f32,
        /// Reflectance of the dielectric at normal incidence.
        pub dielectric_f0: f32,
        /// 1 where the material has a specular lobe.
        pub glossy: u32,
        /// Alpha below which there is no surface.
        pub alpha_cutoff: f32,
        /// 1 + the index of the base colour's slot; 0: it has no texture.
        pub alpha_slot: u32,
        /// First of its sRGB-encoded textures among all slots.
        pub first_srgb: u32,
        /// How many.
        pub srgb_count: u32,
        /// First of its other textures.
        pub first_linear: u32,
        /// How many.
        pub linear_count: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 2],
    }
}

mirror! {
    /// The rays of a tile of a pinhole image: `shared/rays.wgsl`.
    pub struct Rays {
        /// From the eye to the tile's top left corner at unit depth, world axes.
        pub top_left: [f32; 3],
        /// Sub-samples along each side of a texel.
        pub side: u32,
        /// From one sub-sample to the next.
        pub right: [f32; 3],
        /// Sub-samples of the tile: columns.
        pub width: u32,
        /// From one row of sub-samples to the next.
        pub down: [f32; 3],
        /// Rows.
        pub height: u32,
    }
}

mirror! {
    /// A run of an instance's triangles, placed before a tile: `sampler/visibility.wgsl`.
    pub struct Draw {
        /// Row of the transform from the mesh's vertices to clip space.
        pub clip_from_mesh_x: [f32; 4],
        /// The second row.
        pub clip_from_mesh_y: [f32; 4],
        /// The fourth row; the third is `near` everywhere.
        pub clip_from_mesh_w: [f32; 4],
        /// Distance of the near plane, metres.
        pub near: f32,
        /// Index of the instance.
        pub instance: u32,
        /// Triangle of the mesh that the run begins with.
        pub first_triangle: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// What `sampler/resolve_sample.wgsl` is told.
    pub struct ResolveSample {
        /// Texels of the tile.
        pub size: [u32; 2],
        /// Where the tile's first texel lies in the planes.
        pub offset: [u32; 2],
        /// Texels from row to row of the planes.
        pub stride: u32,
        /// Sub-samples along each side of a texel.
        pub side: u32,
        /// Mantissa bits that an inverse range keeps.
        pub range_bits: u32,
        /// 1: radiance is stored as Rgba16Float rather than Rgb9e5Ufloat.
        pub half_float: u32,
    }
}

mirror! {
    /// What `sampler/resolve_view.wgsl` is told.
    pub struct ResolveView {
        /// Pixels of the tile.
        pub size: [u32; 2],
        /// Sub-samples along each side of a pixel.
        pub side: u32,
        /// Radiance to display-linear.
        pub exposure: f32,
    }
}
