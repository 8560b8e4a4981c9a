//! Lights of a view, relative to its eye.

use argus_scene::shading::nearest_lit;
use argus_scene::{Light, Lighting};
use argus_shaders::layout::shared;
use glam::DVec3;

/// The uniform of sky, exposure and number of lights.
pub(crate) fn lighting_uniform(lighting: &Lighting) -> shared::Lighting {
    shared::Lighting {
        sky_zenith: lighting.sky.zenith.to_array(),
        light_count: lighting.lights.len() as u32,
        sky_horizon: lighting.sky.horizon.to_array(),
        exposure: lighting.exposure,
        sky_ground: lighting.sky.ground.to_array(),
        _pad: 0.0,
        sky_harmonics: lighting.sky.harmonics(),
    }
}

/// A light relative to an eye. `visibility_byte` is its byte in a LightVisibility plane.
pub(crate) fn light_about(light: &Light, visibility_byte: u32, eye: DVec3) -> shared::Light {
    let mut data = shared::Light {
        position: [0.0; 3],
        kind: 0,
        direction: [0.0; 3],
        range: 0.0,
        color: [0.0; 3],
        cos_inner: 1.0,
        cos_outer: 0.0,
        visibility_byte,
        nearest: 0.0,
        _pad: 0.0,
    };
    match *light {
        Light::Directional { direction, irradiance, .. } => {
            data.direction = direction.as_vec3().to_array();
            data.color = irradiance.to_array();
        }
        Light::Point { position, intensity, range, radius } => {
            data.kind = 1;
            data.nearest = nearest_lit(radius) as f32;
            data.position = (position - eye).as_vec3().to_array();
            data.range = cut_off(range);
            data.color = intensity.to_array();
        }
        Light::Spot { position, direction, intensity, range, inner_cone, outer_cone, radius } => {
            data.kind = 2;
            data.nearest = nearest_lit(radius) as f32;
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

/// Cut-off distance in metres; 0 for none. A cut-off distance of 0 m becomes the smallest positive number.
fn cut_off(range: Option<f64>) -> f32 {
    range.map_or(0.0, |range| (range as f32).max(f32::MIN_POSITIVE))
}
