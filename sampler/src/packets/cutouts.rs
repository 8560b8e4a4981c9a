//! Alpha and transmission on the CPU, as in `scene/src/texture.rs`: level 0.

use std::sync::Arc;

use argus_scene::texture::{MipChain, transform_uv};
use argus_scene::transparency::{is_met, transparent_meshes};
use argus_scene::{Material, Mesh, Scene, TextureRef};
use glam::{Vec2, Vec4};

/// Textures and coordinates for alpha and transmission.
pub struct Cutouts {
    scene: Arc<Scene>,
    /// One entry a texture that is the base colour of a cut-out or a blended surface, or the transmission of glass.
    textures: Vec<Option<MipChain>>,
    /// Whether some surface hides only a part of what is behind it.
    pub(crate) has_transparent: bool,
    /// The share of what is behind it that a surface must hide for packets to meet it: all, or anything.
    pub(super) least: f32,
}

/// A point of a triangle: the mesh's vertices and their weights.
#[derive(Clone, Copy)]
struct At<'a> {
    mesh: &'a Mesh,
    corners: [usize; 3],
    weights: [f32; 3],
}

impl Cutouts {
    /// The textures of a scene's surfaces with alpha or transmission.
    pub fn new(scene: &Arc<Scene>) -> Self {
        let mut textures: Vec<Option<MipChain>> = scene.textures.iter().map(|_| None).collect();
        let tested = scene.materials.iter().flat_map(|material| {
            let alpha = material.base_color_texture.filter(|_| material.alpha_cutoff().is_some());
            let transmission = material.transmission_texture.filter(|_| material.passes_light_in_parts());
            [alpha, transmission].into_iter().flatten()
        });
        for index in tested.map(|reference| reference.texture as usize) {
            if let (Some(slot @ None), Some(texture)) = (textures.get_mut(index), scene.textures.get(index)) {
                *slot = Some(MipChain::first_level(texture));
            }
        }
        let has_transparent = transparent_meshes(scene).contains(&true);
        Self { scene: Arc::clone(scene), textures, has_transparent, least: 1.0 }
    }

    /// Whether a ray that brings one surface passes through a triangle, by instance and index, at the weights of its second
    /// and third corner.
    pub fn let_through(&self, ids: [u32; 2], beta: f32, gamma: f32) -> bool {
        !is_met(self.coverage(ids, beta, gamma), ids, [beta, gamma])
    }

    /// The share of what is behind a triangle that it hides, by instance and index, at the weights of its second and third
    /// corner.
    pub(crate) fn coverage(&self, ids: [u32; 2], beta: f32, gamma: f32) -> f32 {
        let (at, material) = self.at(ids, beta, gamma);
        if material.alpha_cutoff().is_none() {
            return 1.0;
        }
        let At { mesh, corners, weights } = at;
        let mut alpha = material.base_color.w;
        if mesh.colors.len() >= mesh.positions.len() {
            let blended: Vec4 = (0..3).map(|i| mesh.colors[corners[i]] * weights[i]).sum();
            alpha *= blended.w;
        }
        alpha *= self.read(material.base_color_texture, at, MipChain::alpha);
        material.coverage(alpha)
    }

    /// Whether light passes through a triangle whose transmission texture decides it, at the weights of its second and third
    /// corner.
    pub(crate) fn let_light_through(&self, ids: [u32; 2], beta: f32, gamma: f32) -> bool {
        let (at, material) = self.at(ids, beta, gamma);
        material.passes_light_in_parts()
            && material.transmission * self.read(material.transmission_texture, at, MipChain::red) >= 0.5
    }

    /// The scene.
    pub(crate) fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Level 0 of a texture that decides alpha or transmission.
    pub(crate) fn texture(&self, reference: TextureRef) -> Option<&MipChain> {
        self.textures.get(reference.texture as usize)?.as_ref()
    }

    fn at(&self, [instance, primitive]: [u32; 2], beta: f32, gamma: f32) -> (At<'_>, &Material) {
        let mesh = &self.scene.meshes[self.scene.instances[instance as usize].mesh as usize];
        let first = 3 * primitive as usize;
        let corners = [0, 1, 2].map(|i| mesh.indices[first + i] as usize);
        let at = At { mesh, corners, weights: [1.0 - beta - gamma, beta, gamma] };
        (at, &self.scene.materials[mesh.material as usize])
    }

    /// A channel of a texture's level 0; 1 without a texture.
    fn read(&self, reference: Option<TextureRef>, at: At<'_>, channel: fn(&MipChain, Vec2) -> f32) -> f32 {
        let found = reference.and_then(|r| Some((r, self.textures.get(r.texture as usize)?.as_ref()?)));
        let Some((reference, texture)) = found else { return 1.0 };
        let uvs = at.mesh.uvs_of(reference.uv_set);
        let uv = if uvs.len() >= at.mesh.positions.len() {
            (0..3).map(|i| uvs[at.corners[i]] * at.weights[i]).sum()
        } else {
            Vec2::ZERO
        };
        channel(texture, transform_uv(&reference, uv))
    }
}
