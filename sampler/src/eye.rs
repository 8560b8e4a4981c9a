//! The scene relative to one eye: uploaded for every camera.

use argus_gpu::{Gpu, wgpu};
use argus_scene::shading::nearest_lit;
use argus_scene::{Light, Lighting, RenderError};
use argus_shaders::layout::sampler::InstanceTransform;
use argus_shaders::layout::shared::{self, Lighting as LightingData};
use bytemuck::Zeroable;
use glam::{DVec3, Vec3};

use crate::resident::{Placement, Resident, upload};

/// Transforms and lights relative to an eye, combined in f64 and then rounded to f32, so that world coordinates are never
/// f32.
pub struct Eye {
    /// Metres, world space.
    pub position: DVec3,
    pub(crate) instances: wgpu::Buffer,
    /// Lights and sky, as a uniform.
    pub lighting: wgpu::Buffer,
    pub(crate) lights: wgpu::Buffer,
}

impl Eye {
    /// Uploads what passes need to see `resident` from `position` under `lighting`.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if there are more instances than the device can bind.
    pub fn new(
        gpu: &Gpu,
        resident: &Resident,
        position: DVec3,
        lighting: &Lighting,
    ) -> Result<Self, RenderError> {
        let mut placed = vec![InstanceTransform::zeroed(); resident.instance_count];
        for placement in &resident.instances {
            placed[placement.instance as usize] = placed_about(placement, position);
        }
        let lights = lighting.lights.iter().zip(lighting.visibility_bytes());
        let lights: Vec<_> = lights
            .map(|(light, visibility_byte)| shared::Light { visibility_byte, ..light_about(light, position) })
            .collect();
        let data = LightingData {
            sky_zenith: lighting.sky.zenith.to_array(),
            light_count: lights.len() as u32,
            sky_horizon: lighting.sky.horizon.to_array(),
            exposure: lighting.exposure,
            sky_ground: lighting.sky.ground.to_array(),
            _pad: 0.0,
            sky_harmonics: lighting.sky.harmonics(),
        };
        let storage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            position,
            instances: upload(gpu, "instances", &placed, storage)?,
            lighting: upload(gpu, "lighting", &[data], wgpu::BufferUsages::UNIFORM)?,
            lights: upload(gpu, "lights", &lights, storage)?,
        })
    }
}

fn placed_about(placement: &Placement, eye: DVec3) -> InstanceTransform {
    let m = placement.mesh_from_world;
    let eye_in_mesh = m * (eye - placement.origin);
    let row = |i: usize| {
        let row = m.row(i);
        [row.x as f32, row.y as f32, row.z as f32, eye_in_mesh[i] as f32]
    };
    InstanceTransform {
        mesh_from_eye_x: row(0),
        mesh_from_eye_y: row(1),
        mesh_from_eye_z: row(2),
        mesh: placement.mesh,
        _pad: [0; 3],
    }
}

fn light_about(light: &Light, eye: DVec3) -> shared::Light {
    let none = shared::Light::zeroed();
    let about = |position: DVec3| (position - eye).as_vec3().to_array();
    let cut_off = |range: Option<f64>| range.map_or(0.0, |r| r.max(f64::from(f32::MIN_POSITIVE)) as f32);
    let color = |c: Vec3| c.to_array();
    match *light {
        Light::Directional { direction, irradiance, .. } => shared::Light {
            kind: 0,
            direction: direction.as_vec3().to_array(),
            color: color(irradiance),
            ..none
        },
        Light::Point { position, intensity, range, radius } => shared::Light {
            kind: 1,
            nearest: nearest_lit(radius) as f32,
            position: about(position),
            range: cut_off(range),
            color: color(intensity),
            ..none
        },
        Light::Spot { position, direction, intensity, range, inner_cone, outer_cone, radius } => {
            shared::Light {
                kind: 2,
                nearest: nearest_lit(radius) as f32,
                position: about(position),
                direction: direction.as_vec3().to_array(),
                range: cut_off(range),
                color: color(intensity),
                cos_inner: inner_cone.cos() as f32,
                cos_outer: outer_cone.cos() as f32,
                ..none
            }
        }
    }
}
