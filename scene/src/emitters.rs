//! Emitting triangles as lights.
//!
//! A triangle shines evenly, with the mean of its emission over its surface: the reference and all renderers light other
//! surfaces by this mean, whatever the texture. The triangle itself shows its texture.

use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::texture::{MipChain, transform_uv};
use crate::{AlphaMode, Instance, Scene, TextureRef};

/// A triangle that emits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Emitter {
    /// World space, metres. Counter-clockwise, seen from the front.
    pub corners: [DVec3; 3],
    /// Mean radiance.
    pub radiance: Vec3,
    /// Whether the back emits, too: of double-sided materials.
    pub both_sides: bool,
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
}

impl Emitter {
    /// Front normal, times twice the area in square metres.
    pub fn area_vector(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a)
    }

    /// Mean of the channels of its flux, watts.
    pub fn power(&self) -> f64 {
        let sides = if self.both_sides { 2.0 } else { 1.0 };
        let area = self.area_vector().length() * 0.5;
        f64::from(self.radiance.element_sum()) / 3.0 * area * sides * std::f64::consts::PI
    }

    /// A point by two numbers in 0..1, uniform over the area (Turk, "Generating Random Points in Triangles", 1990).
    pub fn point(&self, u: f64, v: f64) -> DVec3 {
        let [a, b, c] = self.corners;
        let root = u.sqrt();
        a + (b - a) * (root * (1.0 - v)) + (c - a) * (root * v)
    }
}

/// Emitters that are chosen with a probability proportional to their power.
#[derive(Debug, Clone, Default)]
pub struct EmittersByPower {
    all: Vec<Emitter>,
    /// Cumulative power; the last is the whole.
    up_to: Vec<f64>,
}

impl EmittersByPower {
    /// Prepares emitters to be chosen.
    pub fn new(all: Vec<Emitter>) -> Self {
        let up_to = all.iter().scan(0.0, |sum, emitter| {
            *sum += emitter.power();
            Some(*sum)
        });
        Self { up_to: up_to.collect(), all }
    }

    /// The emitters, in the order that they were given in.
    pub fn all(&self) -> &[Emitter] {
        &self.all
    }

    /// The index of the emitter at a place in 0..1 of all power; `None` if nothing emits.
    pub fn pick(&self, place: f64) -> Option<usize> {
        let last = self.all.len().checked_sub(1)?;
        let pick = place * self.power();
        Some(self.up_to.partition_point(|&up_to| up_to <= pick).min(last))
    }

    /// Power of all emitters together, watts.
    pub fn power(&self) -> f64 {
        self.up_to.last().copied().unwrap_or(0.0)
    }

    /// The probability density of an emitter's choice: its share of all power.
    pub fn probability(&self, emitter: &Emitter) -> f64 {
        emitter.power() / self.power()
    }
}

/// The smallest radiance that counts as emission, as a share of the scene's largest.
const LEAST: f32 = 1.0 / 1_048_576.0;

/// The triangles that emit, where instances stand as in `placed`. `textures` are the scene's, or empty for a scene whose
/// emission has no textures. Degenerate triangles are left out.
pub fn emitters(scene: &Scene, placed: &[Instance], textures: &[MipChain]) -> Vec<Emitter> {
    let mut found = Vec::new();
    let most = scene.materials.iter().map(|material| material.emissive.max_element()).fold(0.0, f32::max);
    let least = most * LEAST;
    for (index, instance) in (0u32..).zip(placed) {
        let mesh = &scene.meshes[instance.mesh as usize];
        let material = &scene.materials[mesh.material as usize];
        if !(material.emissive.max_element() > least) {
            continue;
        }
        let mirrored = instance.world_from_mesh.matrix3.determinant() < 0.0;
        for (primitive, indices) in (0u32..).zip(mesh.indices.as_chunks::<3>().0) {
            let corner = |i: u32| {
                let position = mesh.positions.get(i as usize).copied().unwrap_or(Vec3::NAN);
                instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3())
            };
            let [a, b, c] = indices.map(corner);
            let uvs_of = |texture: Option<TextureRef>| {
                let set = mesh.uvs_of(texture.map_or(0, |texture| texture.uv_set));
                indices.map(|i| set.get(i as usize).copied().unwrap_or(Vec2::ZERO))
            };
            let uvs = uvs_of(material.emissive_texture);
            // A blended surface emits as far as it is seen.
            let share = match material.alpha {
                AlphaMode::Blend => {
                    let colors = indices.map(|i| mesh.colors.get(i as usize).map_or(1.0, |color| color.w));
                    let texel = mean_texel(
                        material.base_color_texture,
                        textures,
                        uvs_of(material.base_color_texture),
                    )
                    .w;
                    material.coverage(material.base_color.w * texel * colors.iter().sum::<f32>() / 3.0)
                }
                AlphaMode::Opaque | AlphaMode::Mask(_) => 1.0,
            };
            let emitter = Emitter {
                corners: if mirrored { [a, c, b] } else { [a, b, c] },
                radiance: material.emissive
                    * mean_texel(material.emissive_texture, textures, uvs).truncate()
                    * share,
                both_sides: material.double_sided,
                instance: index,
                primitive,
            };
            let power = emitter.power();
            if power > 0.0 && power.is_finite() && emitter.radiance.max_element() > least {
                found.push(emitter);
            }
        }
    }
    found
}

/// Points along a side of the grid of a triangle at which its texture is read.
const GRID: u32 = 6;

/// Mean of a texture over a triangle; white without one.
fn mean_texel(reference: Option<TextureRef>, textures: &[MipChain], uvs: [Vec2; 3]) -> Vec4 {
    let found = reference.and_then(|r| Some((r, textures.get(r.texture as usize)?)));
    let Some((reference, chain)) = found else { return Vec4::ONE };
    let edges = [uvs[1] - uvs[0], uvs[2] - uvs[0]];
    // One texel of the level is as wide as the distance of two points of the grid.
    let texels = edges[0].abs().max(edges[1].abs()) * reference.scale.abs() * chain.size();
    let level = (texels.max_element() / GRID as f32).max(1.0).log2();
    let (mut sum, mut count) = (Vec4::ZERO, 0.0);
    for row in 0..GRID {
        for column in 0..GRID - row {
            let weight = |i: u32| (i as f32 + 1.0 / 3.0) / GRID as f32;
            let uv = uvs[0] + edges[0] * weight(column) + edges[1] * weight(row);
            sum += chain.sample(transform_uv(&reference, uv), level);
            count += 1.0;
        }
    }
    let mean = sum / count;
    if mean.is_finite() { mean.max(Vec4::ZERO) } else { Vec4::ZERO }
}
