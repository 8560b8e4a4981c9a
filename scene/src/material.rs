//! Materials: metallic-roughness surfaces and their textures.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

/// The meaning of a material's alpha.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// A surface point exists if alpha ≥ the cutoff.
    Mask(f32),
    /// glTF's blending, which a visibility buffer cannot express. Treated as `Mask(0.5)`, with a warning from the loader.
    Blend,
}

/// A reference to a texture and its transform.
///
/// `uv_in_texture = scale · rotate(rotation, uv) + offset`, as in KHR_texture_transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TextureRef {
    /// Index into [`crate::Scene::textures`].
    pub texture: u32,
    /// Added last.
    pub offset: Vec2,
    /// Applied first.
    pub scale: Vec2,
    /// Counter-clockwise, radians.
    pub rotation: f32,
}

impl TextureRef {
    /// The texture without a transform.
    pub fn new(texture: u32) -> Self {
        Self { texture, offset: Vec2::ZERO, scale: Vec2::ONE, rotation: 0.0 }
    }
}

/// A metallic-roughness surface (glTF 2.0, appendix B), with the extensions that Argus supports.
///
/// Factors multiply their textures. Colours are linear; base colour and emission textures are sRGB.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// As the file names it, or empty.
    pub name: String,
    /// Linear base colour and alpha.
    pub base_color: Vec4,
    /// sRGB base colour, alpha.
    pub base_color_texture: Option<TextureRef>,
    /// 0 dielectric … 1 metal.
    pub metallic: f32,
    /// Perceptual roughness; GGX α is its square.
    pub roughness: f32,
    /// Green: roughness, blue: metallic; linear.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normal map.
    pub normal_texture: Option<TextureRef>,
    /// Scales x and y of the normal map.
    pub normal_scale: f32,
    /// Linear emitted radiance, KHR_materials_emissive_strength multiplied in.
    pub emissive: Vec3,
    /// sRGB emission.
    pub emissive_texture: Option<TextureRef>,
    /// The meaning of alpha.
    pub alpha: AlphaMode,
    /// Whether back faces are seen; otherwise every renderer culls them.
    pub double_sided: bool,
    /// KHR_materials_transmission: share of light that passes through; see [`crate::shading`] for its treatment.
    pub transmission: f32,
    /// Index of refraction; sets a dielectric's F0.
    pub ior: f32,
}

impl Default for Material {
    /// A matt light grey seen from both sides, for meshes without a material.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::new(0.8, 0.8, 0.8, 1.0),
            base_color_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha: AlphaMode::Opaque,
            double_sided: true,
            transmission: 0.0,
            ior: 1.5,
        }
    }
}

impl Material {
    /// Whether the material has a specular lobe, so that its samples need the specular planes: a metal, or a
    /// roughness below 0.9, anywhere that its textures allow.
    ///
    /// Every renderer uses this function.
    pub fn is_glossy(&self) -> bool {
        let textured = self.metallic_roughness_texture.is_some();
        self.roughness < 0.9 || self.metallic > 0.0 || (textured && self.roughness > 0.0)
    }

    /// Whether light from lights, sky, emitters and other surfaces passes straight through, as through a pane or a lamp's
    /// glass: at least half of it is transmitted. Otherwise the surface blocks all of it.
    pub fn passes_light(&self) -> bool {
        self.transmission >= 0.5
    }

    /// The alpha below which a surface point does not exist; `None` if alpha is ignored.
    pub fn alpha_cutoff(&self) -> Option<f32> {
        match self.alpha {
            AlphaMode::Opaque => None,
            AlphaMode::Mask(cutoff) => Some(cutoff),
            AlphaMode::Blend => Some(0.5),
        }
    }
}

/// Addressing of texture coordinates outside 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// Only the fraction counts.
    Repeat,
    /// The border texel is repeated.
    Clamp,
    /// Every second tile is mirrored.
    Mirror,
}

/// A decoded image with 8 bits per channel, and its addressing.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// As the file names it, for messages.
    pub name: String,
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGBA, row 0 first, `width * height * 4` bytes.
    pub rgba: Arc<[u8]>,
    /// Whether the colour channels are sRGB-encoded (base colour, emission) or linear (all others).
    pub srgb: bool,
    /// Addressing of u and v.
    pub wrap: [Wrap; 2],
}
