//! Materials in the layout of the shaders.

use argus_scene::material::{Filter, Wrap};
use argus_scene::shading::dielectric_f0;
use argus_scene::texture::transform_duv;
use argus_scene::{Material, Scene, TextureRef};
use argus_shaders::layout::sampler::{MaterialData, TextureSlot, reads, role};
use glam::Vec2;

use super::texels::InstanceTransform;

/// Contents of the buffers.
#[derive(Default)]
pub(super) struct Materials {
    /// One entry a material.
    pub(super) data: Vec<MaterialData>,
    /// One entry a texture of a material.
    pub(super) slots: Vec<TextureSlot>,
}

impl Materials {
    /// The materials of a scene whose textures are uploaded.
    pub(super) fn new(scene: &Scene, textures: &[InstanceTransform]) -> Self {
        let mut materials = Self::default();
        for material in &scene.materials {
            materials.push(material, textures);
        }
        materials
    }

    fn push(&mut self, material: &Material, textures: &[InstanceTransform]) {
        // Only glossy materials look up probes, through which light passes.
        let transmission = if material.is_glossy() { material.transmission } else { 0.0 };
        let gloss = |texture: Option<TextureRef>| texture.filter(|_| material.is_glossy());
        let uses = [
            (role::BASE_COLOR, material.base_color_texture),
            (role::EMISSIVE, material.emissive_texture.filter(|_| material.emissive.max_element() > 0.0)),
            (role::METALLIC_ROUGHNESS, material.metallic_roughness_texture),
            (role::NORMAL, material.normal_texture),
            (role::TRANSMISSION, material.transmission_texture.filter(|_| transmission > 0.0)),
            (role::SPECULAR, gloss(material.specular_texture)),
            (role::SPECULAR_COLOR, gloss(material.specular_color_texture)),
        ];
        // A reference to a missing texture counts as none.
        let used = uses.map(|(role, reference)| {
            let reference = reference?;
            Some((role, reference, textures.get(reference.texture as usize)?))
        });
        let mut take = |srgb: bool| {
            let first = self.slots.len() as u32;
            let taken = used.iter().flatten().filter(|(_, _, placed)| placed.srgb == srgb);
            self.slots.extend(taken.map(|(role, reference, placed)| slot(*role, reference, placed)));
            (first, self.slots.len() as u32 - first)
        };
        let (first_srgb, srgb_count) = take(true);
        let (first_linear, linear_count) = take(false);
        let mine = first_srgb..first_linear + linear_count;
        let alpha = mine.into_iter().find(|&i| self.slots[i as usize].usage[2] == role::BASE_COLOR);
        let [r, g, b] = (material.specular_color * dielectric_f0(material.ior)).to_array();
        self.data.push(MaterialData {
            base_color: material.base_color.to_array(),
            emissive: material.emissive.to_array(),
            metallic: material.metallic,
            factors: [
                material.roughness,
                material.normal_scale,
                transmission,
                material.alpha_cutoff().unwrap_or(0.0),
            ],
            f0: [r, g, b, material.specular],
            textures: [first_srgb, srgb_count, first_linear, linear_count],
            traits: [
                u32::from(material.is_glossy()),
                alpha.map_or(0, |i| i + 1),
                0,
                u32::from(material.unlit),
            ],
        });
    }
}

fn slot(role: u32, reference: &TextureRef, placed: &InstanceTransform) -> TextureSlot {
    let (u, v) = (transform_duv(reference, Vec2::X), transform_duv(reference, Vec2::Y));
    let wrap = |wrap: Wrap| match wrap {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    };
    let nearest = if placed.filter == Filter::Nearest { reads::NEAREST } else { 0 };
    let second = if reference.uv_set == 1 { reads::SECOND_UVS } else { 0 };
    let [width, height] = placed.size;
    TextureSlot {
        texture_from_uv: [u.x, v.x, u.y, v.y],
        offset: [reference.offset.x, reference.offset.y, 0.0, 0.0],
        extent: [width, height, placed.first_level, placed.levels],
        usage: [wrap(placed.wrap[0]), wrap(placed.wrap[1]), role, nearest | second],
    }
}
