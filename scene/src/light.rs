//! Lights of a scene: directional, point and spot lights, and the sky.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::EnvironmentMap;

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
}

impl Sky {
    /// A black sky.
    pub const BLACK: Self = Self { zenith: Vec3::ZERO, horizon: Vec3::ZERO, ground: Vec3::ZERO, map: None };

    /// A clear afternoon: the sky of a scene without lights of its own, together with [`Light::sun`].
    pub const DAYLIGHT: Self = Self {
        zenith: Vec3::new(0.25, 0.45, 0.85),
        horizon: Vec3::new(0.75, 0.85, 0.95),
        ground: Vec3::new(0.30, 0.27, 0.22),
        map: None,
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

    /// Half the angle that the sun has in the sky of the earth, radians (0.265°).
    pub const SUN_RADIUS: f64 = 0.004_625;

    /// Radius of a light bulb, metres: of a file's point and spot lights, whose extent no format tells.
    pub const BULB_RADIUS: f64 = 0.03;
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
