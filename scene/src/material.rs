//! Materials: metallic-roughness surfaces and their textures.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

use crate::shading::dielectric_f0;

/// Alpha from which a surface hides all that is behind it: the rest is below one step of an 8-bit alpha.
pub const OPAQUE: f32 = 254.0 / 255.0;

/// The meaning of a material's alpha.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// A surface point exists if alpha ≥ the cutoff.
    Mask(f32),
    /// A surface point hides the share alpha of what is behind it: [`crate::transparency`].
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
    /// The mesh's texture coordinates that are transformed: 0 for [`crate::Mesh::uvs`], 1 for [`crate::Mesh::uvs2`].
    pub uv_set: u8,
}

impl TextureRef {
    /// The texture without a transform, by the first set of texture coordinates.
    pub fn new(texture: u32) -> Self {
        Self { texture, offset: Vec2::ZERO, scale: Vec2::ONE, rotation: 0.0, uv_set: 0 }
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
    /// Red: share of light that passes through; linear.
    pub transmission_texture: Option<TextureRef>,
    /// Index of refraction; sets a dielectric's F0.
    pub ior: f32,
    /// KHR_materials_specular: strength of a dielectric's reflection.
    pub specular: f32,
    /// Alpha: strength of a dielectric's reflection; linear.
    pub specular_texture: Option<TextureRef>,
    /// KHR_materials_specular: multiplies a dielectric's F0; linear, may exceed 1.
    pub specular_color: Vec3,
    /// sRGB colour of a dielectric's F0.
    pub specular_color_texture: Option<TextureRef>,
    /// KHR_materials_unlit: a display shows the base colour as it is, at any exposure. The surface neither reflects light nor
    /// sends it to other surfaces. Emission, gloss and transmission are not read.
    pub unlit: bool,
    /// An unlit surface around the rest of its scene, such as a sky dome. It is seen, but light passes through it.
    pub backdrop: bool,
}

/// The property of a material that a texture multiplies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TextureUse {
    /// [`Material::base_color_texture`].
    BaseColor,
    /// [`Material::metallic_roughness_texture`].
    MetallicRoughness,
    /// [`Material::normal_texture`].
    Normal,
    /// [`Material::emissive_texture`].
    Emissive,
    /// [`Material::transmission_texture`].
    Transmission,
    /// [`Material::specular_texture`].
    Specular,
    /// [`Material::specular_color_texture`].
    SpecularColor,
}

impl TextureUse {
    /// Every use.
    pub const ALL: [Self; 7] = [
        Self::BaseColor,
        Self::MetallicRoughness,
        Self::Normal,
        Self::Emissive,
        Self::Transmission,
        Self::Specular,
        Self::SpecularColor,
    ];

    /// How a material is shown without a texture of this use: see [`Material::lose`].
    pub fn lost(self) -> &'static str {
        match self {
            Self::BaseColor => "in its plain colour",
            Self::MetallicRoughness => "without metal",
            Self::Normal => "without bumps",
            Self::Emissive => "without glow",
            Self::Transmission => "opaque",
            Self::Specular | Self::SpecularColor => "with an even gloss",
        }
    }
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
            transmission_texture: None,
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            unlit: false,
            backdrop: false,
        }
    }
}

impl Material {
    /// Its texture of a use.
    pub fn texture(&self, of: TextureUse) -> Option<TextureRef> {
        match of {
            TextureUse::BaseColor => self.base_color_texture,
            TextureUse::MetallicRoughness => self.metallic_roughness_texture,
            TextureUse::Normal => self.normal_texture,
            TextureUse::Emissive => self.emissive_texture,
            TextureUse::Transmission => self.transmission_texture,
            TextureUse::Specular => self.specular_texture,
            TextureUse::SpecularColor => self.specular_color_texture,
        }
    }

    /// The place of its texture of a use.
    pub fn texture_mut(&mut self, of: TextureUse) -> &mut Option<TextureRef> {
        match of {
            TextureUse::BaseColor => &mut self.base_color_texture,
            TextureUse::MetallicRoughness => &mut self.metallic_roughness_texture,
            TextureUse::Normal => &mut self.normal_texture,
            TextureUse::Emissive => &mut self.emissive_texture,
            TextureUse::Transmission => &mut self.transmission_texture,
            TextureUse::Specular => &mut self.specular_texture,
            TextureUse::SpecularColor => &mut self.specular_color_texture,
        }
    }

    /// Takes away a texture that cannot be had. Factors are often 1 only for the texture to multiply them: without it the
    /// surface must not glow, be metal, or be glass all over.
    pub fn lose(&mut self, lost: TextureUse) {
        *self.texture_mut(lost) = None;
        match lost {
            TextureUse::MetallicRoughness => self.metallic = 0.0,
            TextureUse::Emissive => self.emissive = Vec3::ZERO,
            TextureUse::Transmission => self.transmission = 0.0,
            TextureUse::SpecularColor => self.specular_color = self.specular_color.min(Vec3::ONE),
            TextureUse::BaseColor | TextureUse::Normal | TextureUse::Specular => {}
        }
    }

    /// Whether the material has a specular lobe, so that its samples need the specular planes: a metal, or a
    /// roughness below 0.9 with a reflectance above 0, anywhere that its textures allow.
    ///
    /// Every renderer uses this function.
    pub fn is_glossy(&self) -> bool {
        let textured = self.metallic_roughness_texture.is_some();
        let reflects = self.metallic > 0.0 || self.dielectric_f0() != Vec3::ZERO;
        !self.unlit
            && reflects
            && (self.roughness < 0.9 || self.metallic > 0.0 || (textured && self.roughness > 0.0))
    }

    /// Reflectance of its dielectric at normal incidence, without textures: F0 of its index of refraction times the specular
    /// colour, at most 1, times the specular factor.
    pub fn dielectric_f0(&self) -> Vec3 {
        (self.specular_color * dielectric_f0(self.ior)).min(Vec3::ONE) * self.specular
    }

    /// Whether light from lights, sky, emitters and other surfaces passes straight through all of the surface, as through a
    /// pane or a lamp's glass: at least half of it is transmitted, or it is a backdrop. Otherwise the surface blocks all of it,
    /// unless it
    /// [passes in parts](Self::passes_light_in_parts).
    pub fn passes_light(&self) -> bool {
        match self.unlit {
            true => self.backdrop,
            false => self.transmission >= 0.5 && self.transmission_texture.is_none(),
        }
    }

    /// Whether the transmission texture decides where light passes: where [`crate::texture::MipChain::red`] times the factor
    /// is at least half.
    pub fn passes_light_in_parts(&self) -> bool {
        !self.unlit && self.transmission >= 0.5 && self.transmission_texture.is_some()
    }

    /// Linear radiance at which a display with this exposure shows an unlit surface's base colour.
    pub fn unlit_radiance(base_color: Vec3, exposure: f32) -> Vec3 {
        base_color / exposure.max(f32::MIN_POSITIVE)
    }

    /// The alpha below which a surface point does not hide all that is behind it; `None` if alpha is ignored. A cut-out does
    /// not exist below it; a blended surface is transparent there.
    pub fn alpha_cutoff(&self) -> Option<f32> {
        match self.alpha {
            AlphaMode::Opaque => None,
            AlphaMode::Mask(cutoff) => Some(cutoff),
            AlphaMode::Blend => Some(OPAQUE),
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

/// How a texture is read where its texels are larger than pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Filter {
    /// Blends the four texels around a point.
    #[default]
    Linear,
    /// Shows the texel that a point lies in, with sharp edges.
    Nearest,
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
    /// Magnification.
    pub filter: Filter,
}
