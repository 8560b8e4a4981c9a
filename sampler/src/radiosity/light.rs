//! Indirect light as a sampler asks for it: none, or what is made when it is first needed.

use std::sync::Arc;

use argus_gpu::{Commands, Gpu};
use argus_scene::{InvalidField, Lighting, RenderError, Scene, Stage};

use super::{Indirect, IndirectReport, Radiosity, VplKnobs};
use crate::packets::PacketTracer;
use crate::passes::{IndirectScratch, TileContext};
use crate::resident::Resident;
use crate::tile::Tile;

/// The indirect light of a sampler's scene.
pub(crate) struct IndirectLight {
    gpu: Arc<Gpu>,
    scene: Arc<Scene>,
    knob: Indirect,
    radiosity: Option<Radiosity>,
}

impl IndirectLight {
    pub(crate) fn new(gpu: &Arc<Gpu>, scene: &Arc<Scene>, knob: Indirect) -> Self {
        Self { gpu: Arc::clone(gpu), scene: Arc::clone(scene), knob, radiosity: None }
    }

    /// Whether there is any.
    pub(crate) fn is_on(&self) -> bool {
        self.knob != Indirect::Off
    }

    /// Takes other knobs from now on.
    pub(crate) fn set_knobs(&mut self, knobs: VplKnobs) -> Result<(), RenderError> {
        knobs.validate()?;
        if !self.is_on() {
            return Err(InvalidField::new("indirect", "this sampler was made without indirect light").into());
        }
        self.knob = Indirect::Vpl(knobs);
        if let Some(radiosity) = &mut self.radiosity {
            radiosity.set_knobs(knobs);
        }
        Ok(())
    }

    /// As [`crate::SamplerKnobs`] has it.
    pub(crate) fn knob(&self) -> &Indirect {
        &self.knob
    }

    /// Puts instances where they are now.
    pub(crate) fn pose(&mut self, resident: &Resident) {
        if let Some(radiosity) = &mut self.radiosity {
            radiosity.place(&resident.instances);
        }
    }

    /// Lights the scene, unless it is lit so already; what that cost.
    pub(crate) fn ready(
        &mut self,
        resident: &Resident,
        tracer: &PacketTracer,
        lighting: &Lighting,
    ) -> Result<Vec<Stage>, RenderError> {
        let Indirect::Vpl(knobs) = self.knob else { return Ok(Vec::new()) };
        let (gpu, scene) = (&self.gpu, &self.scene);
        let radiosity =
            self.radiosity.get_or_insert_with(|| Radiosity::new(gpu, scene, &resident.instances, knobs));
        radiosity.ready(gpu, tracer, lighting)
    }

    /// Memory for a tile's indirect light, if it has any.
    pub(crate) fn scratch(&mut self, tile: &Tile) -> Option<IndirectScratch> {
        let gpu = &self.gpu;
        self.radiosity.as_mut().map(|radiosity| radiosity.scratch(gpu, tile.sub_samples()))
    }

    /// Adds the indirect light of a tile that was shaded.
    pub(crate) fn record(&self, commands: &mut Commands, context: &TileContext<'_>) {
        if let Some(radiosity) = &self.radiosity {
            radiosity.record(commands, context);
        }
    }

    /// What is known, and what was culled since the last call; none before anything was lit.
    pub(crate) fn report(&self) -> Result<Option<IndirectReport>, RenderError> {
        self.radiosity.as_ref().map_or(Ok(None), |radiosity| radiosity.report(&self.gpu))
    }
}
