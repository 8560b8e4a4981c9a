//! Alpha and transmission of triangles in the layout of `shaders/shared/scattered/mask.wgsl`.

use std::collections::BTreeMap;

use argus_scene::material::{Filter, Wrap};
use argus_scene::texture::{MipChain, transform_duv};
use argus_scene::{AlphaMode, Material, Mesh, Scene, TextureRef};
use argus_shaders::layout::sampler::{MaskTriangle, SurfaceMask, mask};
use glam::Vec2;

use crate::packets::cutouts::Cutouts;

/// Masks of a scene's surfaces, and the corners of triangles that have some.
#[derive(Default)]
pub(super) struct Masks {
    pub(super) masks: Vec<SurfaceMask>,
    pub(super) triangles: Vec<MaskTriangle>,
    /// A byte a texel.
    pub(super) texels: Vec<u8>,
    /// Index of each mask, by material and by whether it is of light.
    of_material: BTreeMap<(u32, bool), u32>,
    /// First texel of each texture, by whether it is read for light.
    of_texture: BTreeMap<(u32, bool), u32>,
}

impl Masks {
    /// Takes in a triangle of a mesh. Returns the index of its first record, or `None` if its surface has no mask.
    pub(super) fn take(&mut self, cutouts: &Cutouts, mesh: u32, primitive: u32) -> Option<u32> {
        let scene = cutouts.scene();
        let shape = scene.meshes.get(mesh as usize)?;
        let material = scene.materials.get(shape.material as usize)?;
        let first = self.triangles.len() as u32;
        for of_light in [false, true] {
            let has =
                if of_light { material.passes_light_in_parts() } else { material.alpha_cutoff().is_some() };
            if has {
                let index = self.mask(cutouts, scene, shape.material, of_light);
                let texture = texture_of(material, of_light);
                self.triangles.push(corners(shape, primitive, index, texture, of_light));
            }
        }
        let count = self.triangles.len() as u32 - first;
        if count > 1 {
            self.triangles[first as usize].has_more = 1;
        }
        (count > 0).then_some(first)
    }

    fn mask(&mut self, cutouts: &Cutouts, scene: &Scene, material: u32, of_light: bool) -> u32 {
        if let Some(&index) = self.of_material.get(&(material, of_light)) {
            return index;
        }
        let surface = &scene.materials[material as usize];
        let read = texture_of(surface, of_light).and_then(|r| Some((r, cutouts.texture(r)?)));
        let mut mask = SurfaceMask {
            texture_from_uv: [0.0; 4],
            offset: [0.0; 2],
            factor: if of_light { surface.transmission } else { surface.base_color.w },
            cutoff: surface.alpha_cutoff().unwrap_or(0.0),
            size: [0; 2],
            first: 0,
            kind: kind_of(surface, of_light),
        };
        if let Some((reference, texture)) = read {
            let (u, v) = (transform_duv(&reference, Vec2::X), transform_duv(&reference, Vec2::Y));
            mask.texture_from_uv = [u.x, v.x, u.y, v.y];
            mask.offset = reference.offset.to_array();
            mask.size = [texture.levels[0].width, texture.levels[0].height];
            mask.kind |= addressing(texture);
            mask.first = self.texels(reference.texture, texture, of_light);
        }
        self.masks.push(mask);
        let index = self.masks.len() as u32 - 1;
        self.of_material.insert((material, of_light), index);
        index
    }

    /// The first texel of a texture's alpha, or of its red channel for light.
    fn texels(&mut self, index: u32, texture: &MipChain, of_light: bool) -> u32 {
        if let Some(&first) = self.of_texture.get(&(index, of_light)) {
            return first;
        }
        let first = self.texels.len() as u32;
        let channel = if of_light { 0 } else { 3 };
        self.texels.extend(texture.levels[0].rgba.as_chunks::<4>().0.iter().map(|texel| texel[channel]));
        self.of_texture.insert((index, of_light), first);
        first
    }
}

fn texture_of(material: &Material, of_light: bool) -> Option<TextureRef> {
    if of_light { material.transmission_texture } else { material.base_color_texture }
}

fn kind_of(material: &Material, of_light: bool) -> u32 {
    match (of_light, material.alpha) {
        (true, _) => mask::OF_LIGHT,
        (false, AlphaMode::Blend) => mask::BLENDS,
        _ => 0,
    }
}

/// Bits of [`SurfaceMask::kind`] that say how a texture is read.
fn addressing(texture: &MipChain) -> u32 {
    let [u, v] = texture.wrap.map(|wrap| match wrap {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    });
    u | v << 2 | if texture.filter == Filter::Nearest { mask::NEAREST } else { 0 }
}

/// The record of a triangle. Corners that the mesh lacks are zero.
fn corners(
    mesh: &Mesh,
    primitive: u32,
    mask: u32,
    texture: Option<TextureRef>,
    of_light: bool,
) -> MaskTriangle {
    let corners = mesh.indices.as_chunks::<3>().0.get(primitive as usize).copied().unwrap_or_default();
    let uvs = texture.map_or(&[][..], |reference| mesh.uvs_of(reference.uv_set));
    let uvs = if uvs.len() >= mesh.positions.len() { uvs } else { &[] };
    let uv = corners.map(|corner| uvs.get(corner as usize).copied().unwrap_or_default().to_array());
    let has_alpha = !of_light && mesh.colors.len() >= mesh.positions.len();
    let alpha = corners.map(|corner| mesh.colors.get(corner as usize).map_or(1.0, |color| color.w));
    MaskTriangle {
        uv_a: uv[0],
        uv_b: uv[1],
        uv_c: uv[2],
        mask,
        has_more: 0,
        alpha,
        has_alpha: u32::from(has_alpha),
    }
}
