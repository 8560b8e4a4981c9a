//! Transparency: what a surface with [`AlphaMode::Blend`] hides, and what it lets through.
//!
//! # The rule of every renderer
//!
//! A surface point of alpha a hides the share a of what is behind it ([`Material::coverage`]). At [`OPAQUE`] or above it
//! hides all. At 0 it does not exist. Alpha is read as for alpha tests: at level 0, bilinearly (`texture`, rule 6).
//!
//! 1. **Rays of sight** (direct views, lists of pixels, samples). The transparent surfaces in front of the first opaque one
//!    are the ray's *layers*, with those that lie on it (decals). All of them are shaded and blended, front to back. This is
//!    the mean of stochastic transparency (Enderton et al., "Stochastic Transparency", 2010) over all thresholds, so that no
//!    picture shows a dither, at any number of samples a pixel. It does not depend on the visibility backend: backends find
//!    the opaque surface alone.
//! 2. **The surface that a ray shows**, for range and ids, is the first at which accumulated alpha reaches
//!    [`SHOWN_FROM`] ([`shown`]).
//! 3. **A long row of layers** is cut. Of all surfaces from the [`MOST_LAYERS`]th on a ray sees one, which is chosen by 5.
//! 4. **Rays to lights, sky and emitters** arrive in part: the product of 1 − a over the surfaces that they cross.
//!    Shadows have no colour.
//! 5. **Rays that bring one surface** (bounces of light, reflections) meet a surface if a exceeds a hash of the surface and
//!    the place where it is met ([`is_met`]). The hash is of integers, so that it is the same on every thread, in every
//!    batch and at every rendering. Surfaces behind one another have independent hashes, so that their alphas multiply.
//!
//! A texel of a sample has the blended radiance, and range, normal and gloss of the surface that its central ray shows.

use std::collections::BTreeMap;

pub use crate::material::OPAQUE;
use crate::{AlphaMode, Material, Mesh, Scene};

/// Accumulated alpha from which a ray shows a surface.
pub const SHOWN_FROM: f32 = 0.5;

/// Most layers of a ray.
pub const MOST_LAYERS: usize = 8;

impl Material {
    /// The share of what is behind a surface point that the point hides, 0 to 1, by its alpha. NaN hides nothing.
    pub fn coverage(&self, alpha: f32) -> f32 {
        match self.alpha {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f32::from(u8::from(alpha >= cutoff)),
            AlphaMode::Blend if alpha >= OPAQUE => 1.0,
            AlphaMode::Blend if alpha > 0.0 => alpha,
            AlphaMode::Blend => 0.0,
        }
    }
}

/// Whether a ray that brings one surface meets this one: rule 5. `surface`: instance and triangle; `weights`: of the
/// triangle's second and third corner, where it is met.
pub fn is_met(coverage: f32, surface: [u32; 2], weights: [f32; 2]) -> bool {
    coverage >= 1.0 || threshold(surface, weights) < coverage
}

/// A number from 0 to below 1 for a place on a surface, evenly distributed. Mixes as PCG does (Jarzynski and Olano, "Hash
/// Functions for GPU Rendering", 2020).
fn threshold([instance, triangle]: [u32; 2], weights: [f32; 2]) -> f32 {
    let mut hash = 0u32;
    for word in [instance, triangle, weights[0].to_bits(), weights[1].to_bits()] {
        let state = (hash ^ word).wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
        hash = (word >> 22) ^ word;
    }
    (hash >> 8) as f32 / (1u32 << 24) as f32
}

/// A transparent surface on a ray of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer<S> {
    /// The surface.
    pub surface: S,
    /// The share of what is behind it that it hides, above 0.
    pub alpha: f32,
}

/// Cuts a ray's layers, front to back, at the first that hides all (with those before it), and to [`MOST_LAYERS`].
/// `is_met`: rule 5 for a layer.
pub fn cut<S: Copy>(layers: &mut Vec<Layer<S>>, is_met: impl Fn(&Layer<S>) -> bool) {
    let mut through = 1.0;
    let last = layers.iter().position(|layer| {
        through *= 1.0 - layer.alpha;
        through <= 1.0 - OPAQUE
    });
    if let Some(last) = last {
        layers.truncate(last + 1);
        layers[last].alpha = 1.0;
    }
    if layers.len() > MOST_LAYERS {
        let met = layers[MOST_LAYERS - 1..].iter().find(|layer| is_met(layer)).copied();
        layers.truncate(MOST_LAYERS - 1);
        layers.extend(met.map(|layer| Layer { alpha: 1.0, ..layer }));
    }
}

/// The layer that a ray shows: rule 2. `None` if it shows what is behind them all.
pub fn shown<S>(layers: &[Layer<S>]) -> Option<usize> {
    let mut through = 1.0;
    layers.iter().position(|layer| {
        through *= 1.0 - layer.alpha;
        through <= 1.0 - SHOWN_FROM
    })
}

/// For each mesh, whether some of its surface may be transparent: alpha is between 0 and [`OPAQUE`] for some texel,
/// vertex and factor.
pub fn transparent_meshes(scene: &Scene) -> Vec<bool> {
    let mut textures = BTreeMap::new();
    scene.meshes.iter().map(|mesh| is_transparent(scene, mesh, &mut textures)).collect()
}

/// `textures`: smallest and largest alpha of textures, as far as they are known.
fn is_transparent(scene: &Scene, mesh: &Mesh, textures: &mut BTreeMap<u32, [f32; 2]>) -> bool {
    let material = &scene.materials[mesh.material as usize];
    if material.alpha != AlphaMode::Blend || mesh.triangles() == 0 {
        return false;
    }
    let texels = material.base_color_texture.map_or([1.0; 2], |reference| {
        *textures.entry(reference.texture).or_insert_with(|| texels_alpha(scene, reference.texture))
    });
    let wider = |[least, most]: [f32; 2], alpha: f32| [least.min(alpha), most.max(alpha)];
    let colors = match mesh.colors.is_empty() {
        true => [1.0; 2],
        false => mesh.colors.iter().fold([f32::INFINITY, 0.0], |range, color| wider(range, color.w)),
    };
    let [least, most] = [0, 1].map(|i| texels[i] * colors[i] * material.base_color.w);
    most > 0.0 && least < OPAQUE
}

/// Smallest and largest alpha of a texture. A texture that is missing or damaged counts as white, as in `texture`.
fn texels_alpha(scene: &Scene, texture: u32) -> [f32; 2] {
    let Some(texture) = scene.textures.get(texture as usize) else { return [1.0; 2] };
    let texels = texture.rgba.as_chunks::<4>().0;
    let whole = u64::from(texture.width) * u64::from(texture.height);
    if texels.is_empty() || texels.len() as u64 != whole {
        return [1.0; 2];
    }
    let (mut least, mut most) = (u8::MAX, 0);
    for texel in texels {
        (least, most) = (least.min(texel[3]), most.max(texel[3]));
    }
    [least, most].map(|byte| f32::from(byte) / 255.0)
}

#[cfg(test)]
mod tests {
    use glam::{Vec3, Vec4};

    use super::*;
    use crate::material::{Filter, Wrap};
    use crate::{Texture, TextureRef};

    fn layers(alphas: &[f32]) -> Vec<Layer<usize>> {
        alphas.iter().enumerate().map(|(surface, &alpha)| Layer { surface, alpha }).collect()
    }

    #[test]
    fn a_ray_shows_the_first_surface_at_which_half_is_hidden() {
        let cases: [(&[f32], Option<usize>); 6] = [
            (&[], None),
            (&[0.49], None),
            (&[0.5], Some(0)),
            (&[0.3, 0.3], Some(1)),
            (&[0.2, 0.2, 0.1], None),
            (&[0.2, 0.9, 0.9], Some(1)),
        ];
        for (alphas, expected) in cases {
            assert_eq!(shown(&layers(alphas)), expected, "{alphas:?}");
        }
    }

    #[test]
    fn layers_behind_an_opaque_one_are_cut_and_a_long_row_ends_in_one_surface() {
        let cut_of = |alphas: &[f32], met: usize| {
            let mut layers = layers(alphas);
            cut(&mut layers, |layer| layer.surface == met);
            layers.iter().map(|layer| (layer.surface, layer.alpha)).collect::<Vec<_>>()
        };
        assert_eq!(cut_of(&[0.5, 1.0, 0.5], 9), [(0, 0.5), (1, 1.0)]);
        assert_eq!(cut_of(&[0.95, 0.95, 0.5], 9), [(0, 0.95), (1, 1.0)], "together they hide all");
        let long = cut_of(&[0.1; 12], 10);
        assert_eq!((long.len(), long[7]), (8, (10, 1.0)));
        assert_eq!(cut_of(&[0.1; 12], 99).len(), 7, "none of the rest is met");
    }

    #[test]
    fn thresholds_are_even_and_independent_of_one_another() {
        let mut shares = [[0u32; 10]; 2];
        let (mut both, count) = (0, 40_000u32);
        for i in 0..count {
            let weights = [i as f32 / count as f32, 0.25];
            let [a, b] = [0, 1].map(|instance| threshold([instance, 0], weights));
            shares[0][(a * 10.0) as usize] += 1;
            shares[1][(b * 10.0) as usize] += 1;
            both += u32::from(a < 0.5 && b < 0.5);
        }
        // Six standard deviations of a share.
        let near = |found: u32, share: f64| {
            let off = f64::from(found) / f64::from(count) - share;
            assert!(off.abs() < 6.0 * (share * (1.0 - share) / f64::from(count)).sqrt(), "{off}");
        };
        shares.as_flattened().iter().for_each(|&found| near(found, 0.1));
        near(both, 0.25);
        assert!(is_met(1.0, [7, 7], [0.1, 0.2]) && !is_met(0.0, [7, 7], [0.1, 0.2]));
    }

    #[test]
    fn only_alpha_strictly_between_makes_a_mesh_transparent() {
        let texture = |alphas: [u8; 2]| Texture {
            name: String::new(),
            width: 2,
            height: 1,
            rgba: alphas.iter().flat_map(|&alpha| [9, 9, 9, alpha]).collect::<Vec<u8>>().into(),
            srgb: true,
            wrap: [Wrap::Clamp; 2],
            filter: Filter::Linear,
        };
        let blend = Material { alpha: AlphaMode::Blend, ..Material::default() };
        let cases = [
            (1.0, None, None, false),
            (0.5, None, None, true),
            (0.0, None, None, false),
            (1.0, Some([255, 255]), None, false),
            (1.0, Some([254, 255]), None, false),
            // Filtering blends between them.
            (1.0, Some([0, 255]), None, true),
            (1.0, Some([0, 0]), None, false),
            (1.0, Some([255, 255]), Some(0.4), true),
        ];
        for (factor, texels, color, expected) in cases {
            let base_color_texture = texels.map(|_| TextureRef::new(0));
            let base_color = Vec4::new(1.0, 1.0, 1.0, factor);
            let mesh = Mesh {
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                indices: vec![0, 1, 2],
                colors: color.map_or(Vec::new(), |alpha| vec![Vec4::new(1.0, 1.0, 1.0, alpha); 3]),
                ..Mesh::default()
            };
            let mut scene = Scene {
                meshes: vec![mesh],
                materials: vec![Material { base_color, base_color_texture, ..blend.clone() }],
                textures: texels.map(texture).into_iter().collect(),
                ..Scene::default()
            };
            assert_eq!(transparent_meshes(&scene), [expected], "{factor} {texels:?} {color:?}");
            scene.materials[0].alpha = AlphaMode::Mask(0.5);
            assert_eq!(transparent_meshes(&scene), [false], "cut-outs are not transparent");
        }
    }
}
