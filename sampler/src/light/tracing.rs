//! What rays to lights, sky and emitters need of a scene, and the light of lights.

use argus_scene::texture::{MipChain, mip_chains};
use argus_scene::{AlphaMode, LightEffects, Lighting, Material, Scene, Stage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cells::FaceLights;
use super::emitters::Emitters;
use super::shading_points::ShadingPoints;
use super::shadows;
use super::sky::SkyIrradiance;
use crate::LightSettings;
use crate::light_rays::{LightRays, LightRaysAbout};

/// All that rays to lights, sky and emitters need. A thread that prepares indirect light shares it.
#[derive(Clone)]
pub(crate) struct LightTracing {
    pub(super) effects: LightEffects,
    pub(super) settings: LightSettings,
    pub(super) rays: LightRays,
    pub(super) emitters: Emitters,
    /// The scene's textures, if any is of emission.
    pub(super) emission: Vec<MipChain>,
    pub(super) sky: SkyIrradiance,
    pub(super) lighting: Lighting,
}

impl LightTracing {
    /// Whether light cells show what rays do. They hold the sky as far as surfaces leave it seen, so not where that is off.
    pub(super) fn may_use_cells(&self) -> bool {
        self.effects.sky_visibility || self.sky.is_black()
    }

    /// Lights and emitters: the light of a face depends on them beside what its rays meet.
    pub(super) fn face_lights(&self) -> FaceLights {
        FaceLights { lighting: self.lighting.clone(), emitters: self.emitters.all().to_vec() }
    }

    /// Irradiance / π of the lights at texels, as far as they are seen. `each` takes over every light's number, its
    /// irradiance / π if nothing blocked it, and the share that is seen. Times of shadow rays are added to `stages`.
    pub(super) fn of_lights(
        &self,
        points: &ShadingPoints,
        about: &LightRaysAbout<'_>,
        eye: DVec3,
        stages: &mut Vec<Stage>,
        mut each: impl FnMut(usize, &[Vec3], &[f32]),
    ) -> Vec<Vec3> {
        let effects = self.effects;
        let mut irradiance_over_pi = vec![Vec3::ZERO; points.all.len()];
        for (index, light) in self.lighting.lights.iter().enumerate() {
            if !shadows::reaches(light, points, eye) {
                continue;
            }
            let lit = shadows::incident_at(light, points, eye);
            let shares = match effects.shadows {
                true => {
                    let rays = shadows::ShadowRays { light, points, lit: &lit, about, eye };
                    rays.seen_shares(effects.soft_shadows, stages)
                }
                false => vec![1.0; points.all.len()],
            };
            irradiance_over_pi
                .par_iter_mut()
                .zip(&lit)
                .zip(&shares)
                .for_each(|((sum, lit), share)| *sum += *lit * *share);
            each(index, &lit, &shares);
        }
        irradiance_over_pi
    }
}

/// The textures that [`emitters_at`] reads.
pub(super) fn emission_textures(scene: &Scene, effects: LightEffects) -> Vec<MipChain> {
    if effects.emitters && reads_textures(scene) { mip_chains(scene) } else { Vec::new() }
}

/// Whether the light of emitters depends on textures.
pub(super) fn reads_textures(scene: &Scene) -> bool {
    let is_read = |m: &Material| m.emissive_texture.is_some() || m.alpha == AlphaMode::Blend;
    scene.materials.iter().any(|m| m.emissive != Vec3::ZERO && is_read(m))
}

/// The emitting triangles of a scene at a time.
pub(super) fn emitters_at(
    scene: &Scene,
    textures: &[MipChain],
    effects: LightEffects,
    time_secs: f64,
) -> Emitters {
    if !effects.emitters {
        return Emitters::new(Vec::new());
    }
    Emitters::new(argus_scene::emitters::emitters(scene, &scene.at(time_secs).instances, textures))
}
