//! Lights of a scene: directional, point and spot lights, and the sky.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::{Bounds, EnvironmentMap};

/// A light that is no triangle. Positions are world space, metres; colours are linear Rec. 709. What a light's extent changes
/// is its shadows alone: irradiance is that of a point or a direction ([`crate::shading::incident`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Light {
    /// Light from infinitely far away, such as the sun.
    Directional {
        /// Unit direction that the light travels in.
        direction: DVec3,
        /// Irradiance on a surface that faces the light (glTF: lux).
        irradiance: Vec3,
        /// Half angle of the disc in the sky, radians, below π/2; 0 casts hard shadows.
        angular_radius: f64,
    },
    /// Light from a point in every direction.
    Point {
        /// Position.
        position: DVec3,
        /// Radiant intensity (glTF: candela).
        intensity: Vec3,
        /// Distance at which it is cut off smoothly (KHR_lights_punctual), or infinity as `None`.
        range: Option<f64>,
        /// Radius of the sphere that shines, metres; 0 casts hard shadows.
        radius: f64,
    },
    /// Light from a point into a cone.
    Spot {
        /// Position.
        position: DVec3,
        /// Unit direction of the cone's axis, along which light travels.
        direction: DVec3,
        /// Radiant intensity on the axis.
        intensity: Vec3,
        /// Distance at which it is cut off smoothly, or infinity as `None`.
        range: Option<f64>,
        /// Half angle within which the intensity is full, radians.
        inner_cone: f64,
        /// Half angle beyond which it is zero, radians; greater than `inner_cone`.
        outer_cone: f64,
        /// Radius of the sphere that shines, metres; 0 casts hard shadows.
        radius: f64,
    },
}

/// Radiance by direction: a vertical gradient, or a map in its place. It shows where there is no surface, and lights every
/// surface from all around.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sky {
    /// Linear radiance straight up.
    pub zenith: Vec3,
    /// Linear radiance at the horizon.
    pub horizon: Vec3,
    /// Linear radiance straight down.
    pub ground: Vec3,
    /// What is seen in place of the gradient. It stays in the process: as a part of the scene, which its hash covers, each
    /// process has it from the scene's files.
    #[serde(skip)]
    pub map: Option<Arc<EnvironmentMap>>,
    /// Distance in metres beyond which nothing blocks the sky's light; `None`: whatever the distance. What is seen in the
    /// sky's place does not depend on it. It stays in the process, as a map does.
    #[serde(skip)]
    pub reach: Option<f64>,
}

impl Sky {
    /// A black sky.
    pub const BLACK: Self =
        Self { zenith: Vec3::ZERO, horizon: Vec3::ZERO, ground: Vec3::ZERO, map: None, reach: None };

    /// A clear afternoon: the sky of a scene without lights of its own, together with [`Light::sun`].
    pub const DAYLIGHT: Self = Self {
        zenith: Vec3::new(0.25, 0.45, 0.85),
        horizon: Vec3::new(0.75, 0.85, 0.95),
        ground: Vec3::new(0.30, 0.27, 0.22),
        map: None,
        reach: None,
    };
}

impl Light {
    /// The sun of a scene that has no lights: high, from the south-west, slightly warm.
    pub fn sun() -> Self {
        Self::Directional {
            direction: DVec3::new(-0.45, -0.8, -0.4).normalize(),
            irradiance: Vec3::new(2.6, 2.45, 2.2),
            angular_radius: Self::SUN_RADIUS,
        }
    }

    /// Whether the light has an extent, and so its shadows penumbras.
    pub fn is_extended(&self) -> bool {
        match *self {
            Self::Directional { angular_radius, .. } => angular_radius > 0.0,
            Self::Point { radius, .. } | Self::Spot { radius, .. } => radius > 0.0,
        }
    }

    /// Whether the light may arrive in a box: `false` only if the box is empty, beyond the range, or outside of the cone.
    /// Light is that of a point or a direction ([`crate::shading::incident`]), so a light's extent does not count.
    pub fn reaches(&self, at: &Bounds) -> bool {
        if at.is_empty() {
            return false;
        }
        match *self {
            Self::Directional { .. } => true,
            Self::Point { position, range, .. } => is_in_range(position, range, at),
            Self::Spot { position, direction, range, outer_cone, .. } => {
                is_in_range(position, range, at) && !is_outside_cone(position, direction, outer_cone, at)
            }
        }
    }

    /// Half the angle that the sun has in the sky of the earth, radians (0.265°).
    pub const SUN_RADIUS: f64 = 0.004_625;
}

/// Whether a point of a box is nearer to a light than its range. What is not a number is in range.
fn is_in_range(light: DVec3, range: Option<f64>, at: &Bounds) -> bool {
    let off = (at.min - light).max(light - at.max).max(DVec3::ZERO).length();
    range.is_none_or(|range| !(off >= range))
}

/// Whether a box lies outside of a cone. `false` proves nothing: tested are the sphere around the box, and planes that touch
/// the cone.
fn is_outside_cone(apex: DVec3, axis: DVec3, half_angle: f64, at: &Bounds) -> bool {
    /// Radians: more than the rounding of the cone's cosines in single precision.
    const SLACK: f64 = 2e-3;
    /// Planes around the cone.
    const PLANES: u32 = 8;
    let (to, half) = (at.center() - apex, at.size() * 0.5);
    let (distance, radius) = (to.length(), half.length());
    // Written so that what is not a number is not outside.
    if distance > radius {
        let angle = to.cross(axis).length().atan2(to.dot(axis));
        if angle > half_angle + (radius / distance).asin() + SLACK {
            return true;
        }
    }
    // A wider cone is on both sides of such planes.
    let widest = half_angle + SLACK;
    if !(widest < std::f64::consts::FRAC_PI_2) {
        return false;
    }
    let is_beyond = |normal: DVec3| normal.dot(to) - normal.abs().dot(half) > 1e-9 * (distance + radius);
    let aside = (to - axis * to.dot(axis)).normalize_or(axis.any_orthonormal_vector());
    let across = axis.cross(aside);
    let (sine, cosine) = widest.sin_cos();
    let touches = |number: u32| {
        let (y, x) = (f64::from(number) / f64::from(PLANES) * std::f64::consts::TAU).sin_cos();
        (aside * x + across * y) * cosine - axis * sine
    };
    is_beyond(-axis) || (0..PLANES).any(|number| is_beyond(touches(number)))
}

/// Everything that shading needs besides the surface. It travels with every sample set, so that a compositor can add the
/// part that depends on the viewer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lighting {
    /// The lights, world space.
    pub lights: Vec<Light>,
    /// The sky.
    pub sky: Sky,
    /// Factor from linear radiance to display-linear values, applied once per view before sRGB.
    pub exposure: f32,
}

/// Lights whose visibility has a byte of its own in a sample's [`crate::PlaneKind::LightVisibility`]; the rest share one.
pub const SEPARATE_LIGHTS: usize = 2;

impl Lighting {
    /// For each light, the byte of a [`crate::PlaneKind::LightVisibility`] texel that says which share of it is seen: the
    /// strongest two lights have bytes 0 and 1, the rest share byte 2. Byte 3 is the sky's.
    pub fn visibility_bytes(&self) -> Vec<u32> {
        let strength = |light: &Light| match *light {
            // As strong as a lamp of 1 cd at a distance of 1 m is where it shines.
            Light::Directional { irradiance, .. } => irradiance.element_sum(),
            Light::Point { intensity, .. } | Light::Spot { intensity, .. } => intensity.element_sum(),
        };
        let mut order: Vec<usize> = (0..self.lights.len()).collect();
        order.sort_by(|&a, &b| strength(&self.lights[b]).total_cmp(&strength(&self.lights[a])));
        let mut bytes = vec![SEPARATE_LIGHTS as u32; self.lights.len()];
        for (byte, &light) in (0..SEPARATE_LIGHTS as u32).zip(&order) {
            bytes[light] = byte;
        }
        bytes
    }
}

impl Default for Lighting {
    /// Sun and sky, for a scene without lights of its own.
    fn default() -> Self {
        Self { lights: vec![Light::sun()], sky: Sky::DAYLIGHT, exposure: 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shading::incident;

    fn spot(axis: DVec3, outer_cone: f64, range: Option<f64>) -> Light {
        let intensity = Vec3::splat(8.0);
        let (position, direction) = (DVec3::new(0.3, -0.2, 0.1), axis.normalize());
        Light::Spot { position, direction, intensity, range, inner_cone: 0.0, outer_cone, radius: 0.0 }
    }

    fn at(center: DVec3, half: DVec3) -> Bounds {
        Bounds { min: center - half, max: center + half }
    }

    #[test]
    fn no_box_that_a_light_reaches_is_left_out_and_most_of_the_others_are() {
        let (mut lit, mut dark, mut left_out) = (0, 0, 0);
        for axis in [DVec3::NEG_Y, DVec3::X, DVec3::new(0.4, -1.0, 0.7)] {
            for (cone, range) in [(0.1, None), (0.5, Some(6.0)), (1.2, None), (1.57, Some(20.0)), (2.5, None)]
            {
                let light = spot(axis, cone, range);
                for number in 0..343 {
                    let place =
                        DVec3::new(f64::from(number % 7), f64::from(number / 7 % 7), f64::from(number / 49));
                    let shape =
                        [DVec3::ONE, DVec3::new(2.0, 0.0, 2.0), DVec3::splat(0.05)][number as usize % 3];
                    let bounds = at((place - 3.0) * 1.4, shape);
                    let points = (0..1000).map(|i| {
                        let step = DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100));
                        bounds.min + bounds.size() * step / 9.0
                    });
                    let is_lit = points.into_iter().any(|point| incident(&light, point).1 != Vec3::ZERO);
                    let reaches = light.reaches(&bounds);
                    assert!(reaches || !is_lit, "{light:?} {bounds:?}");
                    lit += u32::from(is_lit);
                    dark += u32::from(!is_lit);
                    left_out += u32::from(!reaches);
                }
            }
        }
        assert!(lit > 100 && dark > 100 && left_out > dark * 9 / 10, "{lit} {dark} {left_out}");
    }

    #[test]
    fn a_flat_floor_beside_the_cone_is_left_out() {
        // Its sphere meets the cone.
        let light = spot(DVec3::NEG_Y, 0.3, None);
        assert!(!light.reaches(&at(DVec3::new(8.0, -2.0, 0.0), DVec3::new(6.0, 0.0, 6.0))));
        assert!(light.reaches(&at(DVec3::new(5.0, -2.0, 0.0), DVec3::new(6.0, 0.0, 6.0))));
    }

    #[test]
    fn degenerate_boxes_and_lights_are_reached_unless_they_are_empty() {
        let light = spot(DVec3::NEG_Y, 0.3, Some(5.0));
        let apex = DVec3::new(0.3, -0.2, 0.1);
        for half in [DVec3::ZERO, DVec3::splat(1e-12), DVec3::splat(1e6), DVec3::new(0.0, 1.0, 0.0)] {
            assert!(light.reaches(&at(apex, half)), "the light is in the box of {half}");
        }
        assert!(light.reaches(&at(apex - DVec3::Y, DVec3::ZERO)), "a point on the axis");
        assert!(!light.reaches(&at(apex + DVec3::Y, DVec3::ZERO)), "a point behind");
        assert!(!light.reaches(&at(apex - DVec3::Y * 5.0, DVec3::ZERO)), "where the light ends");
        assert!(!light.reaches(&Bounds::EMPTY) && !Light::sun().reaches(&Bounds::EMPTY));
        assert!(Light::sun().reaches(&at(DVec3::splat(1e6), DVec3::ZERO)));
        // Far from zero, along the cone's edge.
        let far = DVec3::splat(1e6);
        let mut moved = light;
        if let Light::Spot { position, range, .. } = &mut moved {
            (*position, *range) = (far, None);
        }
        let (sine, cosine) = 0.299f64.sin_cos();
        assert!(moved.reaches(&at(far + DVec3::new(sine, -cosine, 0.0) * 100.0, DVec3::ZERO)));
        let (sine, cosine) = 0.31f64.sin_cos();
        assert!(!moved.reaches(&at(far + DVec3::new(sine, -cosine, 0.0) * 100.0, DVec3::ZERO)));
        for broken in [spot(DVec3::NEG_Y, f64::NAN, None), spot(DVec3::NEG_Y, 0.3, Some(f64::NAN))] {
            assert!(broken.reaches(&at(apex - DVec3::Y, DVec3::ONE)));
        }
        let nowhere =
            Light::Point { position: DVec3::NAN, intensity: Vec3::ONE, range: Some(1.0), radius: 0.0 };
        assert!(nowhere.reaches(&at(DVec3::ZERO, DVec3::ONE)));
    }
}
