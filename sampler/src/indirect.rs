//! Light that surfaces reflect onto one another, whichever way it is found.

use std::sync::Arc;

use argus_gpu::{Commands, Gpu};
use argus_scene::{Indirect, Lighting, RenderError, Scene, Stage};

use crate::packets::PacketTracer;
use crate::passes::TileContext;
use crate::point_based::PointBased;
use crate::radiosity::Radiosity;
use crate::resident::{Placement, Resident};
use crate::scratch::Scratch;

/// The indirect light of one scene on one device.
pub(crate) enum IndirectLight {
    Vpls(Box<Radiosity>),
    Points(Box<PointBased>),
}

/// What is lit, and by what.
#[derive(Clone, Copy)]
pub(crate) struct ToLight<'a> {
    pub(crate) gpu: &'a Arc<Gpu>,
    pub(crate) scene: &'a Arc<Scene>,
    pub(crate) resident: &'a Resident,
    pub(crate) tracer: &'a PacketTracer,
    pub(crate) lighting: &'a Lighting,
    pub(crate) time_secs: f64,
}

/// Which sub-samples of a tile may take light that others received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Spreading {
    /// Those around it in an image.
    Image,
    /// Those around it in a sample, whose texels have `side` sub-samples along each side.
    Texels { side: u32 },
    /// Those of the same pixel, since neighbours in a list are none in the view.
    Pixels,
    /// Those that follow one another in a list of leaves, which are neighbours in space.
    Leaves,
    /// None.
    Each,
}

impl Spreading {
    /// What blocks that share receivers hold of a tile, and how many blocks away a receiver may lie; for blocks of `block`
    /// sub-samples of an image, and `side` of them on each side of a pixel.
    pub(crate) fn blocks(self, block: u32, side: u32) -> ([u32; 2], u32) {
        match self {
            Self::Image => ([block, block], 1),
            // Receivers as far apart as if sub-samples were lit.
            Self::Texels { side } => ([(block / side).max(1); 2], 1),
            Self::Pixels => ([side, side], 0),
            Self::Leaves => ([16, 1], 1),
            Self::Each => ([1, 1], 0),
        }
    }
}

impl IndirectLight {
    /// By those knobs; none where there is to be none.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        scene: &Arc<Scene>,
        resident: &Resident,
        knobs: Indirect,
    ) -> Option<Self> {
        match knobs {
            Indirect::Off => None,
            Indirect::Vpl(knobs) => {
                Some(Self::Vpls(Box::new(Radiosity::new(gpu, scene, &resident.instances, knobs))))
            }
            Indirect::Points(knobs) => Some(Self::Points(Box::new(PointBased::new(gpu, resident, knobs)))),
        }
    }

    /// Takes other knobs of its kind; whether they are.
    pub(crate) fn set_knobs(&mut self, knobs: Indirect) -> bool {
        match (self, knobs) {
            (Self::Vpls(light), Indirect::Vpl(knobs)) => light.set_knobs(knobs),
            (Self::Points(light), Indirect::Points(knobs)) => light.set_knobs(knobs),
            _ => return false,
        }
        true
    }

    /// Puts instances where they are now; what lit the scene before does not light it any more.
    pub(crate) fn place(&mut self, placements: &[Placement]) {
        match self {
            Self::Vpls(light) => light.place(placements),
            Self::Points(light) => light.forget_pose(),
        }
    }

    /// Makes ready what tiles are lit by, unless it is.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for what is larger than the device can bind, or the device.
    pub(crate) fn ready(
        &mut self,
        to_light: &ToLight<'_>,
        scratch: &mut Scratch,
    ) -> Result<Vec<Stage>, RenderError> {
        match self {
            Self::Vpls(light) => light.ready(to_light),
            Self::Points(light) => light.ready(to_light, scratch),
        }
    }

    /// Adds the indirect light of a tile that `commands` shade; hands back where what follows is to be recorded.
    ///
    /// # Errors
    /// As [`Self::ready`].
    pub(crate) fn add(
        &mut self,
        mut commands: Commands,
        context: &TileContext<'_>,
        spreading: Spreading,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError> {
        match self {
            Self::Vpls(light) => {
                light.record(&mut commands, context);
                Ok(commands)
            }
            Self::Points(light) => light.add(commands, context, spreading, stages),
        }
    }
}
