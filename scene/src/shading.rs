//! The definition of shading, shared by the reference, direct views and warped views.
//!
//! `shaders/shared/shading.wgsl` is the same on the GPU; tests compare the two. Radiance leaving a surface is
//!
//! - **diffuse** ([`diffuse_radiance`]), which does not depend on the viewer and is stored in samples: emission, Lambert
//!   reflection of every light, and Lambert reflection of the sky as [`sky_ambient`];
//! - plus, only for glossy materials ([`crate::Material::is_glossy`]), **specular** ([`specular_radiance`]), which
//!   depends on the viewer and is added per view: GGX with Smith's height-correlated visibility and Schlick's Fresnel
//!   for every light, and the sky's reflection with an analytic environment BRDF.
//!
//! Limits of the model:
//! - Nothing in this module blocks light. With effects of light ([`crate::LightEffects`]) rays find what does: then the
//!   sky's irradiance is an integral over the directions that are open, in place of [`sky_ambient`], and emitting surfaces
//!   light others. [`crate::effects`] chooses the effects.
//! - Indirect light is optional (`--indirect`). It has shadows from the lights and between surfaces, but lacks the sky's
//!   share.
//! - Glossy surfaces reflect only lights and the sky, and transmission keeps the diffuse lobe: glass looks like its base
//!   colour with a sheen. With `--reflections`, smooth surfaces reflect the scene, and light through them is refracted
//!   once, where it enters ([`crate::reflection`]); surfaces seen in them are diffuse.
//! - Albedo is base colour · (1 − metallic), without Fresnel's attenuation, which would depend on the viewer.
//! - A dielectric reflects all light at grazing angles. KHR_materials_specular weakens only its F0, to which 0 is an
//!   exception: such a surface reflects nothing.
//!
//! Normals face the visible side: a surface seen from behind has both normals flipped.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{DVec3, Vec3};

use crate::{Light, Lighting, Sky};

/// A visible point of a surface, with its textures applied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// World space, metres.
    pub position: DVec3,
    /// Unit shading normal, world space, on the visible side.
    pub normal: Vec3,
    /// Linear diffuse albedo: base colour · (1 − metallic).
    pub albedo: Vec3,
    /// Linear emitted radiance.
    pub emissive: Vec3,
    /// Reflectance at normal incidence; zero where the material is not glossy.
    pub f0: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Share of the diffuse light that passes through, where the scene is reflected and refracted.
    pub transmission: f32,
}

/// Radiance of the sky in direction `d` (unit).
pub fn sky_radiance(sky: &Sky, d: Vec3) -> Vec3 {
    if let Some(map) = &sky.map {
        return map.radiance(d);
    }
    if d.y >= 0.0 {
        sky.horizon.lerp(sky.zenith, d.y.min(1.0))
    } else {
        // The ground begins within a quarter of the unit vector below the horizon.
        sky.horizon.lerp(sky.ground, (-4.0 * d.y).min(1.0))
    }
}

/// Irradiance of the sky on a surface with unit normal `n`, divided by π. It approximates a cosine-weighted mean of
/// [`sky_radiance`] by a blend of its upper and lower halves, or that of an environment map by its spherical harmonics up to
/// degree 2.
pub fn sky_ambient(sky: &Sky, n: Vec3) -> Vec3 {
    if let Some(map) = &sky.map {
        return map.ambient(n);
    }
    let upper = (sky.zenith + sky.horizon) * 0.5;
    sky.ground.lerp(upper, (0.5 * n.y + 0.5).clamp(0.0, 1.0))
}

/// F0 of a dielectric with index of refraction `ior` against air; 0.04 for 1.5.
pub fn dielectric_f0(ior: f32) -> f32 {
    let r = (ior - 1.0) / (ior + 1.0);
    r * r
}

/// Unit direction from `position` towards a light, and irradiance on a surface that faces it. Zero irradiance, with some
/// direction, at the light itself.
pub fn incident(light: &Light, position: DVec3) -> (Vec3, Vec3) {
    match *light {
        Light::Directional { direction, irradiance, .. } => (-direction.as_vec3(), irradiance),
        Light::Point { position: p, intensity, range, radius } => {
            let (l, falloff) = towards(p, radius, position, range);
            (l, intensity * falloff)
        }
        Light::Spot { position: p, direction, intensity, range, inner_cone, outer_cone, radius } => {
            let (l, falloff) = towards(p, radius, position, range);
            // KHR_lights_punctual, reference code: squared ramp between the cones' cosines.
            let (inner, outer) = (inner_cone.cos() as f32, outer_cone.cos() as f32);
            let ramp = ((-l.dot(direction.as_vec3()) - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
            (l, intensity * (falloff * ramp * ramp))
        }
    }
}

/// Unit direction from `position` to `light`, and its [`falloff`].
fn towards(light: DVec3, radius: f64, position: DVec3, range: Option<f64>) -> (Vec3, f32) {
    let to_light = light - position;
    let distance = to_light.length();
    if !(distance > 0.0) {
        return (Vec3::Y, 0.0);
    }
    ((to_light / distance).as_vec3(), falloff(distance, radius, range))
}

/// Distance in metres within which no light grows, so that none is infinite in single precision. It is no length of a scene:
/// the light of a sphere ends to grow at its surface.
const LEAST_DISTANCE: f64 = 1e-9;

/// Distance in metres within which surfaces are lit as from that distance, for a light of this radius: irradiance at the
/// surface of a sphere that shines is radiance · π, and there is no surface further in.
pub fn nearest_lit(radius: f64) -> f64 {
    radius.max(LEAST_DISTANCE)
}

/// Irradiance at a distance from a light of unit intensity and this radius, on a surface that faces it, per square metre:
/// 1/d² with KHR_lights_punctual's smooth cut-off at `range`.
pub fn falloff(distance: f64, radius: f64, range: Option<f64>) -> f32 {
    let d = distance.max(nearest_lit(radius));
    let window = range.map_or(1.0, |range| (1.0 - (d / range).powi(4)).clamp(0.0, 1.0));
    (window / (d * d)) as f32
}

/// Radiance of `surface`, equal in all directions.
pub fn diffuse_radiance(surface: &Surface, lighting: &Lighting) -> Vec3 {
    let mut irradiance_over_pi = sky_ambient(&lighting.sky, surface.normal);
    for light in &lighting.lights {
        let (l, irradiance) = incident(light, surface.position);
        irradiance_over_pi += irradiance * (surface.normal.dot(l).max(0.0) * FRAC_1_PI);
    }
    surface.emissive + surface.albedo * irradiance_over_pi
}

/// Radiance of `surface` towards the unit direction `to_eye` beyond [`diffuse_radiance`]; zero if F0 is zero.
pub fn specular_radiance(surface: &Surface, to_eye: Vec3, lighting: &Lighting) -> Vec3 {
    if surface.f0 == Vec3::ZERO {
        return Vec3::ZERO;
    }
    reflected_sky(surface, to_eye, lighting) + reflected_lights(surface, to_eye, lighting)
}

/// The sky's part of [`specular_radiance`], for a surface that reflects only the sky.
pub fn reflected_sky(surface: &Surface, to_eye: Vec3, lighting: &Lighting) -> Vec3 {
    let reflected = 2.0 * surface.normal.dot(to_eye) * surface.normal - to_eye;
    let sky = sky_radiance(&lighting.sky, reflected)
        .lerp(sky_ambient(&lighting.sky, reflected), surface.roughness.clamp(0.0, 1.0));
    reflected_around(surface, to_eye, sky)
}

/// Radiance of a glossy surface towards the unit direction `to_eye`, reflected from an environment of radiance
/// `around`, which is blurred for the surface's roughness.
pub fn reflected_around(surface: &Surface, to_eye: Vec3, around: Vec3) -> Vec3 {
    around * environment_brdf(surface.f0, surface.roughness, surface.normal.dot(to_eye).max(1e-3))
}

/// The lights' part of [`specular_radiance`].
pub fn reflected_lights(surface: &Surface, to_eye: Vec3, lighting: &Lighting) -> Vec3 {
    lighting.lights.iter().map(|light| reflected_light(surface, to_eye, light)).sum()
}

/// One light's part of [`specular_radiance`].
pub fn reflected_light(surface: &Surface, to_eye: Vec3, light: &Light) -> Vec3 {
    let n = surface.normal;
    let n_v = n.dot(to_eye).max(1e-3);
    // Rougher than a perfect mirror, so that a point light's reflection has an extent.
    let alpha = (surface.roughness * surface.roughness).max(2e-3);
    let (l, irradiance) = incident(light, surface.position);
    let n_l = n.dot(l);
    if !(n_l > 0.0) {
        return Vec3::ZERO;
    }
    // Opposite directions have no half vector; they also have n·l or n·v ≤ 0.
    let h = (l + to_eye).normalize_or(n);
    let fresnel = schlick(surface.f0, l.dot(h).clamp(0.0, 1.0));
    irradiance * n_l * ggx(alpha, n.dot(h).clamp(0.0, 1.0)) * smith(alpha, n_v, n_l) * fresnel
}

/// Schlick's Fresnel.
fn schlick(f0: Vec3, cosine: f32) -> Vec3 {
    f0 + (Vec3::ONE - f0) * (1.0 - cosine).powi(5)
}

/// GGX normal distribution.
fn ggx(alpha: f32, n_h: f32) -> f32 {
    let a2 = alpha * alpha;
    let d = (n_h * a2 - n_h) * n_h + 1.0;
    a2 / (PI * d * d).max(1e-12)
}

/// Smith's height-correlated visibility for GGX, the 4·n·l·n·v of the denominator included.
fn smith(alpha: f32, n_v: f32, n_l: f32) -> f32 {
    let a2 = alpha * alpha;
    let v = n_l * ((n_v - n_v * a2) * n_v + a2).sqrt();
    let l = n_v * ((n_l - n_l * a2) * n_l + a2).sqrt();
    0.5 / (v + l).max(1e-6)
}

/// Reflectance of a glossy surface under uniform light: Karis' fit of the split-sum table ("Physically Based Shading on
/// Mobile", 2014).
fn environment_brdf(f0: Vec3, roughness: f32, n_v: f32) -> Vec3 {
    let r = roughness.clamp(0.0, 1.0);
    let x = 1.0 - r;
    let y = -0.0275 * r + 0.0425;
    let z = -0.572 * r + 1.04;
    let w = 0.022 * r - 0.04;
    let a004 = (x * x).min((-9.28 * n_v).exp2()) * x + y;
    f0 * (-1.04 * a004 + z) + Vec3::splat(1.04 * a004 + w)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(normal: Vec3) -> Surface {
        Surface {
            position: DVec3::ZERO,
            normal,
            albedo: Vec3::ONE,
            emissive: Vec3::ZERO,
            f0: Vec3::ZERO,
            roughness: 1.0,
            transmission: 0.0,
        }
    }

    #[test]
    fn a_white_surface_under_a_white_sky_has_radiance_one() {
        let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, ground: Vec3::ONE, map: None, reach: None };
        let lighting = Lighting { lights: Vec::new(), sky, exposure: 1.0 };
        for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::ONE.normalize()] {
            assert!((diffuse_radiance(&grey(normal), &lighting) - Vec3::ONE).length() < 1e-6);
        }
    }

    #[test]
    fn a_white_surface_that_faces_irradiance_pi_has_radiance_one() {
        let light =
            Light::Directional { direction: DVec3::NEG_Y, irradiance: Vec3::splat(PI), angular_radius: 0.0 };
        let lighting = Lighting { lights: vec![light], sky: Sky::BLACK, exposure: 1.0 };
        assert!((diffuse_radiance(&grey(Vec3::Y), &lighting) - Vec3::ONE).length() < 1e-6);
        assert_eq!(diffuse_radiance(&grey(Vec3::NEG_Y), &lighting), Vec3::ZERO);
    }

    #[test]
    fn degenerate_geometry_never_makes_a_radiance_that_is_not_finite() {
        let at = |position| Light::Point { position, intensity: Vec3::ONE, range: Some(2.0), radius: 0.0 };
        let lights = vec![at(DVec3::ZERO), at(DVec3::Y * 1e-9), at(DVec3::splat(1e6)), Light::sun()];
        let lighting = Lighting { lights, sky: Sky::DAYLIGHT, exposure: 1.0 };
        let mirror = Surface { f0: Vec3::ONE, roughness: 0.0, ..grey(Vec3::Y) };
        for to_eye in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::new(0.45, 0.8, 0.4).normalize()] {
            assert!(specular_radiance(&mirror, to_eye, &lighting).is_finite(), "{to_eye}");
        }
        assert!(diffuse_radiance(&mirror, &lighting).is_finite());
    }

    #[test]
    fn lamps_light_scenes_of_any_unit_alike() {
        let at = |distance: f64, unit: f64| {
            let (d, radius, range) = (distance * unit, 0.03 * unit, Some(9.0 * unit));
            f64::from(falloff(d, radius, range)) * unit * unit
        };
        for distance in [0.0, 1e-3, 0.03, 0.5, 3.0, 8.9] {
            let metres = at(distance, 1.0);
            for unit in [1e-6, 1e-3, 1e3, 1e6] {
                assert!((at(distance, unit) / metres - 1.0).abs() < 1e-5, "{distance}, {unit}");
            }
        }
    }

    #[test]
    fn a_matt_surface_has_no_specular_lobe() {
        let lighting = Lighting::default();
        assert_eq!(specular_radiance(&grey(Vec3::Y), Vec3::Y, &lighting), Vec3::ZERO);
    }
}
