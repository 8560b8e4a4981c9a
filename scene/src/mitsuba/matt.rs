//! Scenes without gloss.

use crate::Scene;
use crate::texture::MipChain;

/// The scene without gloss, transmission and metal, so that every surface is Lambert's. Both sides of a comparison render
/// it, hence it need not be the scene that a viewer sees: a textured share of metal is replaced by its mean.
pub fn matt(mut scene: Scene) -> Scene {
    let Scene { materials, textures, .. } = &mut scene;
    for material in materials {
        let blue = material.metallic_roughness_texture.and_then(|r| textures.get(r.texture as usize));
        let share = blue.map_or(1.0, |texture| {
            let level = MipChain::first_level(texture).levels.swap_remove(0);
            let (texels, _) = level.rgba.as_chunks::<4>();
            let sum: u64 = texels.iter().map(|texel| u64::from(texel[2])).sum();
            sum as f32 / (texels.len().max(1) as f32 * 255.0)
        });
        let dimmed = material.base_color.truncate() * (1.0 - material.metallic * share);
        material.base_color = dimmed.extend(material.base_color.w);
        material.metallic = 0.0;
        material.roughness = 1.0;
        material.metallic_roughness_texture = None;
        (material.transmission, material.transmission_texture) = (0.0, None);
    }
    scene
}
