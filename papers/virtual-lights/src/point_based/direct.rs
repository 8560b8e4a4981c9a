//! Direct light of punctual lights on the octree's leaves, with a shadow ray a light.

use argus_scene::shading::incident;
use argus_scene::{Light, Lighting};
use glam::{DVec3, Vec3};

use argus_sampler::plug::PacketTracer;

/// Irradiance / π of the lights at `position` with a unit `normal`, world space. Shadow rays start `off` metres off the
/// surface.
pub(super) fn direct_by_pi(
    tracer: &PacketTracer,
    lighting: &Lighting,
    off: f64,
    position: DVec3,
    normal: Vec3,
) -> Vec3 {
    let origin = position + normal.as_dvec3() * off;
    let mut sum = Vec3::ZERO;
    for light in &lighting.lights {
        let (inputs, irradiance) = incident(light, position);
        let cosine = normal.dot(inputs);
        // NaN fails.
        if !(cosine > 0.0 && irradiance.max_element() > 0.0) {
            continue;
        }
        let (towards, most) = match *light {
            Light::Directional { direction, .. } => (-direction, f64::INFINITY),
            Light::Point { position: light, .. } | Light::Spot { position: light, .. } => {
                (light - origin, 1.0)
            }
        };
        if tracer.nearest(origin, towards, most).is_none() {
            sum += irradiance * (cosine * std::f32::consts::FRAC_1_PI);
        }
    }
    sum
}
