//! Materials as shaders read them.

use argus_scene::material::Wrap;
use argus_scene::shading::dielectric_f0;
use argus_scene::texture::transform_duv;
use argus_scene::{Material, Scene, TextureRef};
use argus_shaders::layout::sampler::{MaterialData, TextureSlot};
use glam::Vec2;

use super::texels::Placed;

/// One a material of the scene.
pub(super) fn materials(scene: &Scene, textures: &[Placed]) -> Vec<MaterialData> {
    scene.materials.iter().map(|material| data(material, textures)).collect()
}

fn data(material: &Material, textures: &[Placed]) -> MaterialData {
    let slot = |reference: Option<TextureRef>| slot(reference, textures);
    MaterialData {
        base_color: material.base_color.to_array(),
        emissive: material.emissive.to_array(),
        metallic: material.metallic,
        roughness: material.roughness,
        normal_scale: material.normal_scale,
        dielectric_f0: dielectric_f0(material.ior),
        glossy: u32::from(material.is_glossy()),
        alpha_cutoff: material.alpha_cutoff().unwrap_or(0.0),
        _pad: 0,
        base_color_texture: slot(material.base_color_texture),
        metallic_roughness_texture: slot(material.metallic_roughness_texture),
        normal_texture: slot(material.normal_texture),
        emissive_texture: slot(material.emissive_texture),
        _pad_end: [0; 2],
    }
}

/// A reference to a texture; all zero, which is none, where the scene has no such texture.
fn slot(reference: Option<TextureRef>, textures: &[Placed]) -> TextureSlot {
    let placed = reference.and_then(|r| Some((r, textures.get(r.texture as usize)?)));
    let Some((reference, placed)) = placed else { return TextureSlot::default() };
    let (u, v) = (transform_duv(&reference, Vec2::X), transform_duv(&reference, Vec2::Y));
    let wrap = |wrap: Wrap| match wrap {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    };
    TextureSlot {
        u_from_uv: [u.x, v.x],
        v_from_uv: [u.y, v.y],
        offset: reference.offset.to_array(),
        size: placed.size,
        first_level: placed.first_level,
        levels: placed.levels,
        wrap: placed.wrap.map(wrap),
        srgb: u32::from(placed.srgb),
        _pad: 0,
    }
}
