//! The one definition of shading, which the reference, the direct path and the warp share.
//!
//! `shaders/shared/shading.wgsl` is its twin on the GPU, held to it by test. Radiance leaving a surface is
//!
//! - **diffuse** ([`diffuse_radiance`]), which does not depend on the viewer and is what samples store:
//!   emission, Lambert reflection of every light, and Lambert reflection of the sky as [`sky_ambient`];
//! - plus, for glossy materials alone ([`crate::Material::is_glossy`]), **specular**
//!   ([`specular_radiance`]), which does, and is added per view: GGX with Smith's height-correlated
//!   visibility and Schlick's Fresnel for every light, and the sky's reflection with an analytic
//!   environment BRDF.
//!
//! What is simulated and what is not, stated once:
//! - lights cast no shadows on what is seen, and the sky is not occluded;
//! - light that surfaces emit or reflect onto one another is added where a sampler is asked for it (`--indirect`): with
//!   shadows, both of the lights on the surfaces that reflect and of those surfaces, and without the sky's share;
//! - glossy surfaces reflect lights and the sky, and transmission keeps the diffuse lobe: glass looks like its base colour
//!   with a sheen; unless things are to show what is around them (`--reflections`): then smooth ones reflect the scene, and
//!   what passes through them is refracted once, where it enters ([`crate::reflection`]); what is seen so is diffuse;
//! - albedo is base colour · (1 − metallic), without Fresnel's attenuation, since that would depend on the
//!   viewer.
//!
//! Normals face the side that is seen: a surface seen from behind has both normals flipped.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{DVec3, Vec3};

use crate::{Light, Lighting, Sky};

/// A visible point of a surface, textures looked up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// World space, metres.
    pub position: DVec3,
    /// Unit shading normal, world space, on the side that is seen.
    pub normal: Vec3,
    /// Linear diffuse albedo: base colour · (1 − metallic).
    pub albedo: Vec3,
    /// Linear emitted radiance.
    pub emissive: Vec3,
    /// Reflectance at normal incidence; zero where the material is not glossy.
    pub f0: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
}

/// Radiance of the sky in direction `d` (unit).
pub fn sky_radiance(sky: &Sky, d: Vec3) -> Vec3 {
    if d.y >= 0.0 {
        sky.horizon.lerp(sky.zenith, d.y.min(1.0))
    } else {
        // The ground begins within a quarter of the unit vector below the horizon.
        sky.horizon.lerp(sky.ground, (-4.0 * d.y).min(1.0))
    }
}

/// Irradiance of the sky on a surface with unit normal `n`, divided by π: a cosine-weighted mean of
/// [`sky_radiance`], as the hemispherical blend of its upper and lower halves.
pub fn sky_ambient(sky: &Sky, n: Vec3) -> Vec3 {
    let upper = (sky.zenith + sky.horizon) * 0.5;
    sky.ground.lerp(upper, (0.5 * n.y + 0.5).clamp(0.0, 1.0))
}

/// F0 of a dielectric with index of refraction `ior` against air; 0.04 for 1.5.
pub fn dielectric_f0(ior: f32) -> f32 {
    let r = (ior - 1.0) / (ior + 1.0);
    r * r
}

/// What arrives from a light at `position`: unit direction towards the light, and irradiance on a surface
/// that faces it. Zero irradiance, with some direction, at the light itself.
pub fn incident(light: &Light, position: DVec3) -> (Vec3, Vec3) {
    match *light {
        Light::Directional { direction, irradiance } => (-direction.as_vec3(), irradiance),
        Light::Point { position: p, intensity, range } => {
            let (l, falloff) = towards(p, position, range);
            (l, intensity * falloff)
        }
        Light::Spot { position: p, direction, intensity, range, inner_cone, outer_cone } => {
            let (l, falloff) = towards(p, position, range);
            // KHR_lights_punctual, reference code: squared ramp between the cones' cosines.
            let (inner, outer) = (inner_cone.cos() as f32, outer_cone.cos() as f32);
            let ramp = ((-l.dot(direction.as_vec3()) - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
            (l, intensity * (falloff * ramp * ramp))
        }
    }
}

/// Unit direction from `position` to `light`, and 1/d² with KHR_lights_punctual's smooth cut-off.
fn towards(light: DVec3, position: DVec3, range: Option<f64>) -> (Vec3, f32) {
    let to_light = light - position;
    let distance = to_light.length();
    if !(distance > 0.0) {
        return (Vec3::Y, 0.0);
    }
    // A surface closer than a millimetre is lit as if it were a millimetre away, so that no pixel is infinite.
    let d = distance.max(1e-3);
    let window = range.map_or(1.0, |r| (1.0 - (d / r).powi(4)).clamp(0.0, 1.0));
    ((to_light / distance).as_vec3(), (window / (d * d)) as f32)
}

/// Radiance that leaves `surface` in every direction alike.
pub fn diffuse_radiance(surface: &Surface, lighting: &Lighting) -> Vec3 {
    let mut irradiance_by_pi = sky_ambient(&lighting.sky, surface.normal);
    for light in &lighting.lights {
        let (l, irradiance) = incident(light, surface.position);
        irradiance_by_pi += irradiance * (surface.normal.dot(l).max(0.0) * FRAC_1_PI);
    }
    surface.emissive + surface.albedo * irradiance_by_pi
}

/// Radiance that leaves `surface` towards the unit direction `to_eye` beyond [`diffuse_radiance`]; zero
/// where F0 is.
pub fn specular_radiance(surface: &Surface, to_eye: Vec3, lighting: &Lighting) -> Vec3 {
    if surface.f0 == Vec3::ZERO {
        return Vec3::ZERO;
    }
    reflected_sky(surface, to_eye, lighting) + reflected_lights(surface, to_eye, lighting)
}

/// The part of [`specular_radiance`] that is the sky's, as of a surface that nothing else is around.
pub fn reflected_sky(surface: &Surface, to_eye: Vec3, lighting: &Lighting) -> Vec3 {
    let reflected = 2.0 * surface.normal.dot(to_eye) * surface.normal - to_eye;
    let sky = sky_radiance(&lighting.sky, reflected)
        .lerp(sky_ambient(&lighting.sky, reflected), surface.roughness.clamp(0.0, 1.0));
    reflected_around(surface, to_eye, sky)
}

/// What a glossy surface reflects towards the unit direction `to_eye` of surroundings whose radiance, blurred as the surface
/// is rough, is `around`.
pub fn reflected_around(surface: &Surface, to_eye: Vec3, around: Vec3) -> Vec3 {
    around * environment_brdf(surface.f0, surface.roughness, surface.normal.dot(to_eye).max(1e-3))
}

/// The part of [`specular_radiance`] that is the lights'.
pub fn reflected_lights(surface: &Surface, to_eye: Vec3, lighting: &Lighting) -> Vec3 {
    let n = surface.normal;
    let n_v = n.dot(to_eye).max(1e-3);
    // Rougher than a perfect mirror, so that a point light's reflection has an extent.
    let alpha = (surface.roughness * surface.roughness).max(2e-3);
    let mut radiance = Vec3::ZERO;
    for light in &lighting.lights {
        let (l, irradiance) = incident(light, surface.position);
        let n_l = n.dot(l);
        if !(n_l > 0.0) {
            continue;
        }
        // Opposite directions have no half vector; they also have n·l or n·v ≤ 0.
        let h = (l + to_eye).normalize_or(n);
        let fresnel = schlick(surface.f0, l.dot(h).clamp(0.0, 1.0));
        radiance +=
            irradiance * n_l * ggx(alpha, n.dot(h).clamp(0.0, 1.0)) * smith(alpha, n_v, n_l) * fresnel;
    }
    radiance
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

/// Reflectance of a glossy surface under light from all around: Karis' fit of the split-sum table ("Physically
/// Based Shading on Mobile", 2014).
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
        }
    }

    #[test]
    fn a_white_surface_under_a_white_sky_has_radiance_one() {
        let sky = Sky { zenith: Vec3::ONE, horizon: Vec3::ONE, ground: Vec3::ONE };
        let lighting = Lighting { lights: Vec::new(), sky, exposure: 1.0 };
        for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::ONE.normalize()] {
            assert!((diffuse_radiance(&grey(normal), &lighting) - Vec3::ONE).length() < 1e-6);
        }
    }

    #[test]
    fn a_white_surface_that_faces_irradiance_pi_has_radiance_one() {
        let light = Light::Directional { direction: DVec3::NEG_Y, irradiance: Vec3::splat(PI) };
        let lighting = Lighting { lights: vec![light], sky: Sky::BLACK, exposure: 1.0 };
        assert!((diffuse_radiance(&grey(Vec3::Y), &lighting) - Vec3::ONE).length() < 1e-6);
        assert_eq!(diffuse_radiance(&grey(Vec3::NEG_Y), &lighting), Vec3::ZERO);
    }

    #[test]
    fn degenerate_geometry_never_makes_a_radiance_that_is_not_finite() {
        let at = |position| Light::Point { position, intensity: Vec3::ONE, range: Some(2.0) };
        let lights = vec![at(DVec3::ZERO), at(DVec3::Y * 1e-9), at(DVec3::splat(1e6)), Light::sun()];
        let lighting = Lighting { lights, sky: Sky::DAYLIGHT, exposure: 1.0 };
        let mirror = Surface { f0: Vec3::ONE, roughness: 0.0, ..grey(Vec3::Y) };
        for to_eye in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::new(0.45, 0.8, 0.4).normalize()] {
            assert!(specular_radiance(&mirror, to_eye, &lighting).is_finite(), "{to_eye}");
        }
        assert!(diffuse_radiance(&mirror, &lighting).is_finite());
    }

    #[test]
    fn a_matt_surface_has_no_specular_lobe() {
        let lighting = Lighting::default();
        assert_eq!(specular_radiance(&grey(Vec3::Y), Vec3::Y, &lighting), Vec3::ZERO);
    }
}
