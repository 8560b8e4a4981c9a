//! Indirect diffuse light: by paths, or by a method that is plugged in.

use std::any::Any;
use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{Indirect, LightLevel, Lighting, RenderError, Scene, Stage};

use crate::frame::Frame;
use crate::light::{DirectLight, LightTracing, PathLight};
use crate::packets::PacketTracer;
use crate::ray_watch::RayWatch;
use crate::resident::{Placement, Resident};
use crate::scratch::Scratch;

/// The light of one scene on one device.
#[derive(Default)]
pub(crate) struct Lights {
    /// Direct light by rays, made when it is first needed; `None` without effects of light.
    pub(crate) direct: Option<DirectLight>,
    /// Indirect light, made when it is first needed.
    pub(crate) indirect: Option<IndirectLight>,
}

impl Lights {
    /// Whether light is added to what is shaded, for which shading leaves a G-buffer.
    pub(crate) fn any(&self) -> bool {
        self.direct.is_some() || self.indirect.is_some()
    }

    /// The light by paths, and what traces it, if the CPU finds all of it.
    pub(crate) fn paths_on_cpu(&mut self) -> Option<(&mut PathLight, &LightTracing)> {
        match (&mut self.indirect, self.direct.as_ref().filter(|direct| direct.is_on_cpu())) {
            (Some(IndirectLight::Paths(paths)), Some(direct)) => Some((paths, direct.tracing())),
            _ => None,
        }
    }

    /// Is told of rays of sight, if it is written down what a face is found by.
    pub(crate) fn watch(&self) -> Option<&dyn RayWatch> {
        let paths = self.indirect.as_ref().and_then(IndirectLight::paths)?;
        paths.trail().map(|trail| trail as &dyn RayWatch)
    }
}

/// Finds indirect light. [`Any`] gives access to its report.
pub trait IndirectMethod: Any + Send + Sync {
    /// Changes the settings. Marks the light as out of date. Returns false if they are of another method.
    fn set_settings(&mut self, settings: Indirect) -> bool;

    /// Moves instances of a posed scene. Marks the light as out of date.
    fn place(&mut self, scene: &Arc<Scene>, placements: &[Placement]);

    /// Prepares the light of tiles, unless it is up to date. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if a buffer exceeds what the device can bind, or the errors of the device.
    fn ready(&mut self, inputs: &LightInputs<'_>, scratch: &mut Scratch) -> Result<Vec<Stage>, RenderError>;

    /// Records what it must know of a shaded frame before it adds light. The buffer that it returns is read back.
    ///
    /// # Errors
    /// The errors of [`Self::ready`].
    fn choose(&mut self, _frame: &mut Frame<'_>) -> Result<Option<wgpu::Buffer>, RenderError> {
        Ok(None)
    }

    /// Adds its light to a shaded frame, once the buffer that it asked for is read.
    ///
    /// # Errors
    /// The errors of [`Self::ready`].
    fn add(&mut self, frame: &mut Frame<'_>, read: Option<&[u8]>) -> Result<(), RenderError>;
}

/// Makes the [`IndirectMethod`] of settings; `None` for settings of another method.
pub type NewIndirect =
    Arc<dyn Fn(&Arc<Gpu>, &Arc<Scene>, &Resident, Indirect) -> Option<Box<dyn IndirectMethod>> + Send + Sync>;
/// The indirect light of one scene on one device.
pub(crate) enum IndirectLight {
    Method(Box<dyn IndirectMethod>),
    /// Added with direct light.
    Paths(Box<PathLight>),
}

/// Inputs of indirect light.
#[derive(Clone, Copy)]
pub struct LightInputs<'a> {
    /// The device.
    pub gpu: &'a Arc<Gpu>,
    /// The posed scene.
    pub scene: &'a Arc<Scene>,
    /// The scene on the device.
    pub resident: &'a Resident,
    /// The scene for single rays.
    pub tracer: &'a PacketTracer,
    pub(crate) direct: Option<&'a DirectLight>,
    /// Lights and sky.
    pub lighting: &'a Lighting,
    pub(crate) light: LightLevel,
    /// Whether the light may be that of an earlier pose.
    pub(crate) may_lag: bool,
    /// Time of the pose, seconds.
    pub time_secs: f64,
}

impl IndirectLight {
    /// The indirect light of these settings; `None` if it is off, or if `new` is none or finds none, which
    /// [`crate::plug::Methods::check_indirect`] refuses first.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        scene: &Arc<Scene>,
        resident: &Resident,
        settings: Indirect,
        new: Option<&NewIndirect>,
    ) -> Option<Self> {
        match settings {
            Indirect::Off => None,
            Indirect::Vpl(_) | Indirect::Points(_) => new?(gpu, scene, resident, settings).map(Self::Method),
            Indirect::Paths(settings) => {
                Some(Self::Paths(Box::new(PathLight::new(scene, &resident.instances, settings, None))))
            }
            Indirect::Cells(settings) => {
                let light = PathLight::new(scene, &resident.instances, settings.paths, Some(settings));
                Some(Self::Paths(Box::new(light)))
            }
        }
    }

    /// The light that is added with direct light.
    pub(crate) fn paths(&self) -> Option<&PathLight> {
        match self {
            Self::Paths(light) => Some(light),
            Self::Method(_) => None,
        }
    }

    /// The method that is plugged in.
    pub(crate) fn method(&self) -> Option<&dyn IndirectMethod> {
        match self {
            Self::Method(light) => Some(&**light),
            Self::Paths(_) => None,
        }
    }

    /// Changes the settings. Returns false if they are of another method.
    pub(crate) fn set_settings(&mut self, settings: Indirect) -> bool {
        match (self, settings) {
            (Self::Method(light), settings) => return light.set_settings(settings),
            (Self::Paths(light), Indirect::Paths(settings)) if light.cells().is_none() => {
                light.set_settings(settings)
            }
            (Self::Paths(light), Indirect::Cells(settings)) if light.cells() == Some(settings) => {}
            _ => return false,
        }
        true
    }

    /// Moves instances of a posed scene. Marks the light as out of date.
    pub(crate) fn place(&mut self, scene: &Arc<Scene>, placements: &[Placement]) {
        match self {
            Self::Method(light) => light.place(scene, placements),
            Self::Paths(light) => light.place(scene, placements),
        }
    }

    /// Prepares the light of tiles, unless it is up to date. Returns the cost.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if a buffer exceeds what the device can bind, or the errors of the device.
    pub(crate) fn ready(
        &mut self,
        inputs: &LightInputs<'_>,
        scratch: &mut Scratch,
    ) -> Result<Vec<Stage>, RenderError> {
        match self {
            Self::Method(light) => light.ready(inputs, scratch),
            Self::Paths(light) => {
                let none = || RenderError::Internal("paths need direct light by rays".to_owned());
                light.ready(inputs.direct.ok_or_else(none)?.tracing(), inputs.light, inputs.may_lag)
            }
        }
    }
}
