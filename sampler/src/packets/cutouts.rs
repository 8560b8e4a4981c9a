//! Alpha on the CPU, as in `scene/src/texture.rs`: level 0, bilinear.

use std::sync::Arc;

use argus_scene::texture::{MipChain, transform_uv};
use argus_scene::transparency::{is_met, transparent_meshes};
use argus_scene::{Scene, TextureRef};
use glam::{Vec2, Vec4};

/// Textures and coordinates for alpha.
pub(crate) struct Cutouts {
    scene: Arc<Scene>,
    /// One entry a texture that is the base colour of a cut-out or a blended surface.
    textures: Vec<Option<MipChain>>,
    /// Whether some surface hides only a part of what is behind it.
    pub(crate) has_transparent: bool,
    /// The share of what is behind it that a surface must hide for packets to meet it: all, or anything.
    pub(super) least: f32,
}

impl Cutouts {
    pub(crate) fn new(scene: &Arc<Scene>) -> Self {
        let mut textures: Vec<Option<MipChain>> = scene.textures.iter().map(|_| None).collect();
        for material in scene.materials.iter().filter(|m| m.alpha_cutoff().is_some()) {
            let Some(index) = material.base_color_texture.map(|r| r.texture as usize) else { continue };
            if let (Some(slot @ None), Some(texture)) = (textures.get_mut(index), scene.textures.get(index)) {
                *slot = Some(MipChain::first_level(texture));
            }
        }
        let has_transparent = transparent_meshes(scene).contains(&true);
        Self { scene: Arc::clone(scene), textures, has_transparent, least: 1.0 }
    }

    /// Whether a ray that brings one surface passes through a triangle, by instance and index, at the weights of its second
    /// and third corner.
    pub(crate) fn let_through(&self, ids: [u32; 2], beta: f32, gamma: f32) -> bool {
        !is_met(self.coverage(ids, beta, gamma), ids, [beta, gamma])
    }

    /// The share of what is behind a triangle that it hides, by instance and index, at the weights of its second and third
    /// corner.
    pub(crate) fn coverage(&self, [instance, primitive]: [u32; 2], beta: f32, gamma: f32) -> f32 {
        let mesh = &self.scene.meshes[self.scene.instances[instance as usize].mesh as usize];
        let material = &self.scene.materials[mesh.material as usize];
        if material.alpha_cutoff().is_none() {
            return 1.0;
        }
        let first = 3 * primitive as usize;
        let corners = [0, 1, 2].map(|i| mesh.indices[first + i] as usize);
        let weights = [1.0 - beta - gamma, beta, gamma];
        let mut alpha = material.base_color.w;
        if mesh.colors.len() >= mesh.positions.len() {
            let blended: Vec4 = (0..3).map(|i| mesh.colors[corners[i]] * weights[i]).sum();
            alpha *= blended.w;
        }
        if let Some((reference, texture)) = self.texture(material.base_color_texture) {
            let uv = if mesh.uvs.len() >= mesh.positions.len() {
                (0..3).map(|i| mesh.uvs[corners[i]] * weights[i]).sum()
            } else {
                Vec2::ZERO
            };
            alpha *= texture.alpha(transform_uv(&reference, uv));
        }
        material.coverage(alpha)
    }

    fn texture(&self, reference: Option<TextureRef>) -> Option<(TextureRef, &MipChain)> {
        let reference = reference?;
        Some((reference, self.textures.get(reference.texture as usize)?.as_ref()?))
    }
}
