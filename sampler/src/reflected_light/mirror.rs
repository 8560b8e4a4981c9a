//! Reflective surfaces, and the rays that they reflect or let through.

use argus_scene::reflection::{half_vector, refracted};
use glam::Vec3;

use crate::light::{ShadingPoint, shading_point};
use crate::point_shading::GBufferTexel;

/// Largest α (squared roughness) of a reflection that is sharp: a lobe of two degrees.
const SHARP: f32 = 0.02;

/// A ray that a surface reflects or lets through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it begins, off the surface, metres about the eye.
    pub start: Vec3,
    /// Unit vector.
    pub direction: Vec3,
    /// Number of its reflector, from 0.
    pub reflector: u32,
    /// The instance that it passes through.
    pub past: Option<u32>,
    /// Width of what it stands for at its start, metres.
    pub width: f32,
    /// How much wider that is a metre further.
    pub spread: f32,
    /// The sub-sample that it is for.
    pub at: u32,
    /// Whether it began as a refracted ray. A sub-sample has at most one refracted ray, and one reflected ray unless there are
    /// several taps.
    pub is_through: bool,
}

/// A reflective surface as a G-buffer describes it.
#[derive(Clone, Copy)]
pub(crate) struct Mirror {
    pub(crate) point: ShadingPoint,
    /// Number of its reflector, from 0.
    pub(crate) reflector: u32,
    /// Reflectance at normal incidence.
    pub(crate) f0: Vec3,
    pub(crate) roughness: f32,
    /// How much faster light is outside of the surface than within, if it lets light through.
    pub(crate) eta: Option<f32>,
}

impl Mirror {
    /// The surface of a texel of the G-buffer; `None` without one.
    pub(crate) fn of_g_buffer(
        [surface, material]: GBufferTexel,
        offset: impl Fn(Vec3) -> f32,
        reflector: u32,
        lets_through: bool,
    ) -> Option<Self> {
        let point = shading_point(surface, material, offset);
        let [r, g, b, roughness] = material[3].to_le_bytes().map(|byte| f32::from(byte) / 255.0);
        let root = r.clamp(0.0, 0.5).sqrt();
        let eta = lets_through.then_some((1.0 - root) / (1.0 + root));
        point.exists.then_some(Self { point, reflector, f0: Vec3::new(r, g, b), roughness, eta })
    }

    /// α of its lobe.
    pub(crate) fn alpha(&self) -> f32 {
        self.roughness * self.roughness
    }

    /// Whether its lobe counts as one direction.
    pub(crate) fn is_sharp(&self) -> bool {
        self.alpha() < SHARP
    }

    /// The middle of its lobe if it is sharp; otherwise one of `count` half vectors that fill the lobe.
    pub(crate) fn half_vector(&self, index: u32, count: u32) -> Vec3 {
        match self.is_sharp() {
            true => self.point.normal,
            false => half_vector(self.point.normal.as_dvec3(), self.alpha().into(), index, count).as_vec3(),
        }
    }

    /// Where refracted rays begin, and the direction of one that arrives in a unit direction; `None` if nothing passes.
    pub(crate) fn through(&self, direction: Vec3) -> Option<(Vec3, Vec3)> {
        let ShadingPoint { position, normal, start, .. } = self.point;
        let inward = refracted(direction.as_dvec3(), normal.as_dvec3(), f64::from(self.eta?)).as_vec3();
        // From the other side of the surface.
        Some((position - (start - position), inward))
    }
}

/// Direction of the ray that a unit direction is reflected into about a half vector.
pub(crate) fn reflected(towards: Vec3, half: Vec3) -> Vec3 {
    towards - 2.0 * towards.dot(half) * half
}
