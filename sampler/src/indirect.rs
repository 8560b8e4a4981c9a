//! Indirect diffuse light: by paths, or by a method that is plugged in.

use std::sync::Arc;

use argus_gpu::{Commands, Gpu};
use argus_scene::{Indirect, LightLevel, Lighting, RenderError, Scene, Stage};

use crate::light::{DirectLight, Neighbours, PathLight};
use crate::packets::PacketTracer;
use crate::passes::TileContext;
use crate::plug::{IndirectMethod, Methods};
use crate::resident::{Placement, Resident};
use crate::scratch::Scratch;

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
    /// Time of the pose, seconds.
    pub time_secs: f64,
}

/// Which sub-samples of a tile share received light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightSharing {
    /// Neighbours in an image.
    Image,
    /// Neighbours in a sample. Its texels have `side` sub-samples along each side.
    Texels {
        /// Sub-samples along each side of a texel.
        side: u32,
    },
    /// Sub-samples of one pixel, because neighbours in a list are not neighbours in the view.
    Pixels,
    /// Consecutive leaves of a list, which are neighbours in space.
    Leaves,
    /// Nothing is shared.
    Each,
}

impl LightSharing {
    /// The texels of a tile that know one another, for direct light.
    pub(crate) fn neighbours(self, tile: &crate::tile::Tile) -> Neighbours {
        match self {
            Self::Image | Self::Texels { .. } => Neighbours::Image(tile.begin.map(|texel| texel * tile.side)),
            Self::Pixels => Neighbours::None { rays: 64 },
            Self::Leaves | Self::Each => Neighbours::None { rays: 16 },
        }
    }

    /// Size of the blocks that share receivers, in sub-samples, and the reach of a receiver, in blocks. `block` is the
    /// block side in an image; `side` is the number of sub-samples along a pixel's side.
    pub fn blocks(self, block: u32, side: u32) -> ([u32; 2], u32) {
        match self {
            Self::Image => ([block, block], 1),
            // Receivers are as far apart as if sub-samples were lit.
            Self::Texels { side } => ([(block / side).max(1); 2], 1),
            Self::Pixels => ([side, side], 0),
            Self::Leaves => ([16, 1], 1),
            Self::Each => ([1, 1], 0),
        }
    }
}

impl IndirectLight {
    /// The indirect light of these knobs; `None` if it is off, or if none of the methods finds it, which
    /// [`Methods::check_indirect`] refuses first.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        scene: &Arc<Scene>,
        resident: &Resident,
        knobs: Indirect,
        methods: &Methods,
    ) -> Option<Self> {
        match knobs {
            Indirect::Off => None,
            Indirect::Vpl(_) | Indirect::Points(_) => {
                let new = methods.indirect.as_ref()?;
                new(gpu, scene, resident, knobs).map(Self::Method)
            }
            Indirect::Paths(knobs) => {
                Some(Self::Paths(Box::new(PathLight::new(scene, &resident.instances, knobs, None))))
            }
            Indirect::Cells(knobs) => {
                let light = PathLight::new(scene, &resident.instances, knobs.paths, Some(knobs));
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

    /// Changes the knobs. Returns false if they are of another method.
    pub(crate) fn set_knobs(&mut self, knobs: Indirect) -> bool {
        match (self, knobs) {
            (Self::Method(light), knobs) => return light.set_knobs(knobs),
            (Self::Paths(light), Indirect::Paths(knobs)) if light.cells().is_none() => light.set_knobs(knobs),
            (Self::Paths(light), Indirect::Cells(knobs)) if light.cells() == Some(knobs) => {}
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
                light.ready(inputs.direct.ok_or_else(none)?.tracing(), inputs.light)
            }
        }
    }

    /// Adds the indirect light of a tile that `commands` shade. Returns the commands that later passes are recorded into.
    ///
    /// # Errors
    /// The errors of [`Self::ready`].
    pub(crate) fn add(
        &mut self,
        commands: Commands,
        context: &TileContext<'_>,
        sharing: LightSharing,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError> {
        match self {
            Self::Method(light) => light.add(commands, context, sharing, stages),
            Self::Paths(_) => Ok(commands),
        }
    }
}
