//! A posed and lit scene, as methods that render samples or probes from it see it.

use std::sync::Arc;

use argus_gpu::Gpu;
use argus_scene::{Cancel, Lighting, RenderError, SampleCamera, Scene};
use glam::DVec3;

use crate::SamplerSettings;
use crate::eye::Eye;
use crate::frame::{Frame, check_wanted};
use crate::indirect::Lights;
use crate::passes::TileContext;
use crate::resident::Resident;
use crate::scratch::{Extras, Scratch};
use crate::stages;
use crate::tile::{Tile, sample_tiles};

/// A scene on a device, at the pose and in the light of a job.
pub struct LitScene<'a> {
    /// The device.
    pub gpu: &'a Arc<Gpu>,
    /// The posed scene.
    pub scene: &'a Arc<Scene>,
    /// The scene on the device.
    pub resident: &'a Resident,
    /// The sampler's settings.
    pub settings: &'a SamplerSettings,
    pub(crate) lights: &'a mut Lights,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) cancel: &'a Cancel,
}

impl<'a> LitScene<'a> {
    /// Checks that the job is still wanted.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`].
    pub fn check_wanted(&self) -> Result<(), RenderError> {
        check_wanted(self.cancel)
    }

    /// Uploads what passes need to see the scene from a place, metres, world space.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if there are more instances than the device can bind.
    pub fn eye(&self, position: DVec3, lighting: &Lighting) -> Result<Eye, RenderError> {
        Eye::new(self.gpu, self.resident, position, lighting)
    }

    /// The tiles of a sample camera.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for a camera without pinhole faces.
    pub fn tiles(&self, camera: &SampleCamera) -> Result<Vec<Tile>, RenderError> {
        sample_tiles(camera, self.settings.side())
    }

    /// What the passes of a tile share. With `g_buffer`, the targets have room for what later light needs.
    pub fn context<'b>(&mut self, eye: &'b Eye, tile: &Tile, g_buffer: bool) -> TileContext<'b>
    where
        'a: 'b,
    {
        let extras = Extras { g_buffer, ..Extras::default() };
        TileContext::new(self.gpu, self.resident, eye, tile, self.scratch, extras)
    }

    /// Whether light is added to what is shaded, for which shading leaves a G-buffer.
    pub fn keeps_g_buffer(&self) -> bool {
        self.lights.any()
    }

    /// Whether light changes with time in a static scene.
    pub fn drifts(&self) -> bool {
        self.settings.indirect.drifts()
    }

    /// Adds direct light by rays and indirect light to a shaded frame, as far as there are any.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn add_light(&mut self, frame: &mut Frame<'_>) -> Result<(), RenderError> {
        stages::light(frame, self.lights)
    }
}
