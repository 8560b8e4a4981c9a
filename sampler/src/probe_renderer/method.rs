//! What probes are rendered by, where a method is plugged in: their places, and the bytes of their planes.

use std::sync::Arc;

use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::{Lighting, RenderError, Stage};
use bytes::BytesMut;
use glam::{DVec3, Vec4};

use crate::lit_scene::LitScene;
use crate::passes::ProbePlanes;
use crate::resident::{GBufferUse, Resident};

/// Renders reflection probes from a scene that it has prepared.
pub trait ProbeMethod: Send + Sync {
    /// Prepares what probes are rendered from, unless it is up to date. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`], or the errors of the device.
    fn ready(
        &mut self,
        scene: &mut LitScene<'_>,
        lighting: &Lighting,
        time_secs: f64,
    ) -> Result<Vec<Stage>, RenderError>;

    /// Renders all probes of a side in texels, once the scene is ready. A scene without surfaces has no probes.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`], or the errors of the device.
    fn render(
        &mut self,
        scene: &mut LitScene<'_>,
        lighting: &Lighting,
        places: &ProbePlaces,
        side: u32,
    ) -> Result<ProbeBytes, RenderError>;

    /// Marks all as out of date, because surfaces moved.
    fn forget_pose(&mut self);

    /// Marks the light as out of date.
    fn forget_light(&mut self);
}

/// Makes a [`ProbeMethod`] from an octree of so many levels.
pub type NewProbes = Arc<dyn Fn(&Gpu, &Resident, GBufferUse, u32) -> Box<dyn ProbeMethod> + Send + Sync>;
/// Where probes are, at a pose.
pub struct ProbePlaces {
    /// Centre of the scene, metres, world space.
    pub middle: DVec3,
    /// Viewpoint of each probe relative to it, and radius of the reflector. Metres. Lookups use the same values.
    pub(super) spheres: Vec<Vec4>,
    /// Instance of each probe.
    pub(crate) instances: Vec<u32>,
    /// For each instance 1 + the index of its probe; 0 for none.
    pub probe_of_instance: wgpu::Buffer,
}

impl ProbePlaces {
    /// Viewpoint of each probe, metres, world space.
    pub fn centers(&self) -> Vec<DVec3> {
        self.spheres.iter().map(|sphere| self.middle + sphere.truncate().as_dvec3()).collect()
    }
}

/// Planes of rendered probes.
#[derive(Default)]
pub struct ProbeBytes {
    pub(super) radiance: BytesMut,
    pub(super) inverse_range: BytesMut,
}

impl ProbeBytes {
    /// Submits commands, and appends the probes that they make.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn read(&mut self, mut commands: Commands, planes: &ProbePlanes) -> Result<(), RenderError> {
        let pending = [&planes.radiance, &planes.inverse_range]
            .map(|plane| commands.read_buffer(plane, 0..plane.size()));
        let mut finished = commands.submit().wait()?;
        let [radiance, inverse_range] = pending.map(|pending| finished.take(pending));
        self.radiance.extend_from_slice(&radiance);
        self.inverse_range.extend_from_slice(&inverse_range);
        Ok(())
    }
}
