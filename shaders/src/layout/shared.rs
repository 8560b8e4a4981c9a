//! Mirrors of structs of `shaders/shared/*.wgsl` that both roles use.

use super::Mirror;

/// All mirrors of this file.
pub(super) const MIRRORS: &[Mirror] = &[Light::MIRROR, Lighting::MIRROR, ProbeUniform::MIRROR];

mirror! {
    /// A light, relative to the origin of the pass that shades: `shared/shading.wgsl`.
    pub struct Light {
        /// Position relative to the pass's origin; unused by directional lights.
        pub position: [f32; 3],
        /// 0 directional, 1 point, 2 spot.
        pub kind: u32,
        /// Unit direction in which light travels.
        pub direction: [f32; 3],
        /// Cut-off distance, metres; 0 for none.
        pub range: f32,
        /// Irradiance (directional) or intensity.
        pub color: [f32; 3],
        /// Cosine of a spot's inner half angle.
        pub cos_inner: f32,
        /// Cosine of a spot's outer half angle.
        pub cos_outer: f32,
        /// Byte of a light visibility word that says which share of the light is seen.
        pub visibility_byte: u32,
        /// Surfaces that are nearer to a point or spot light are lit as from this distance, metres.
        pub nearest: f32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: f32,
    }
}

mirror! {
    /// Reflection probes relative to the eye: `shared/reflection_probes.wgsl`.
    pub struct ProbeUniform {
        /// Centre of the scene's bounds relative to the eye, metres.
        pub middle: [f32; 3],
        /// Texels on a side of a probe's finest level.
        pub side: f32,
    }
}

mirror! {
    /// Sky, exposure and number of lights: `shared/shading.wgsl`.
    pub struct Lighting {
        /// Radiance of the sky straight up.
        pub sky_zenith: [f32; 3],
        /// Number of lights.
        pub light_count: u32,
        /// Radiance of the sky at the horizon.
        pub sky_horizon: [f32; 3],
        /// Factor from radiance to display-linear.
        pub exposure: f32,
        /// Radiance of the sky straight down.
        pub sky_ground: [f32; 3],
        /// WGSL aligns vectors of four to 16 bytes.
        pub _pad: f32,
        /// Factors of an environment map's irradiance; zeros without a map.
        pub sky_harmonics: [[f32; 4]; 9],
    }
}
