//! Lights as a view's highlights need them: relative to its eye.

use argus_scene::{Light, Lighting};
use argus_shaders::layout::shared;
use glam::DVec3;

/// Sky, exposure and the number of lights.
pub(crate) fn lighting_uniform(lighting: &Lighting) -> shared::Lighting {
    shared::Lighting {
        sky_zenith: lighting.sky.zenith.to_array(),
        light_count: lighting.lights.len() as u32,
        sky_horizon: lighting.sky.horizon.to_array(),
        exposure: lighting.exposure,
        sky_ground: lighting.sky.ground.to_array(),
        _pad: 0.0,
    }
}

/// A light about an eye.
pub(crate) fn light_about(light: &Light, eye: DVec3) -> shared::Light {
    let mut data = shared::Light {
        position: [0.0; 3],
        kind: 0,
        direction: [0.0; 3],
        range: 0.0,
        color: [0.0; 3],
        cos_inner: 1.0,
        cos_outer: 0.0,
        _pad: [0.0; 3],
    };
    match *light {
        Light::Directional { direction, irradiance } => {
            data.direction = direction.as_vec3().to_array();
            data.color = irradiance.to_array();
        }
        Light::Point { position, intensity, range } => {
            data.kind = 1;
            data.position = (position - eye).as_vec3().to_array();
            data.range = cut_off(range);
            data.color = intensity.to_array();
        }
        Light::Spot { position, direction, intensity, range, inner_cone, outer_cone } => {
            data.kind = 2;
            data.position = (position - eye).as_vec3().to_array();
            data.direction = direction.as_vec3().to_array();
            data.range = cut_off(range);
            data.color = intensity.to_array();
            data.cos_inner = inner_cone.cos() as f32;
            data.cos_outer = outer_cone.cos() as f32;
        }
    }
    data
}

/// 0 says that a light reaches everywhere, so one that reaches nowhere is given the least reach there is.
fn cut_off(range: Option<f64>) -> f32 {
    range.map_or(0.0, |range| (range as f32).max(f32::MIN_POSITIVE))
}
