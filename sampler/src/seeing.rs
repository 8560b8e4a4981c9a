//! What a tile sees: the ways to fill a visibility buffer, and which of them serves samples and direct views.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::{RenderError, Scene, Stage};

use crate::Visibility;
use crate::draws::{self, DrawList};
use crate::packets::PacketTracer;
use crate::passes::{Rasteriser, TileContext, Trace};
use crate::pixels::Listing;
use crate::resident::{Resident, upload};
use crate::scratch::Targets;
use crate::timing;
use crate::ways::{self, Building, Choice, Choices, Way};

/// Which images a choice of way is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Images {
    Samples,
    Views,
}

/// The rasteriser, and the tracers once something needs them.
pub(crate) struct Seeing {
    scene: Arc<Scene>,
    wish: Visibility,
    choices: Choices,
    rasteriser: Rasteriser,
    packets: Option<PacketTracer>,
    /// The tracer on the device, or why there is none.
    trace: Option<Result<Trace, String>>,
    building: Option<Building>,
}

impl Seeing {
    /// For a scene that is on the device.
    pub(crate) fn new(gpu: &Gpu, scene: &Arc<Scene>, resident: &Resident, wish: Visibility) -> Self {
        let near = draws::near(&resident.bounds);
        Self {
            // What may be needed at first use is built while the scene's first order is on its way.
            building: (wish != Visibility::Raster).then(|| Building::start(scene, &resident.instances, near)),
            scene: Arc::clone(scene),
            wish,
            choices: Choices::default(),
            rasteriser: Rasteriser::new(gpu, resident),
            packets: None,
            trace: None,
        }
    }

    /// What was chosen so far, and why.
    pub(crate) fn choices(&self) -> &Choices {
        &self.choices
    }

    /// Puts everything where it is now.
    pub(crate) fn pose(&mut self, resident: &Resident) {
        if let Some(packets) = &mut self.packets {
            packets.pose(&self.scene, &resident.instances);
        }
    }

    /// How images see triangles, if that was settled.
    pub(crate) fn settled(&self, images: Images) -> Option<Way> {
        let choice = match images {
            Images::Samples => &self.choices.samples,
            Images::Views => &self.choices.views,
        };
        choice.as_ref().map(|choice| choice.way)
    }

    /// Settles how images see triangles: measured on one of their tiles, if the user leaves it open.
    pub(crate) fn settle(&mut self, images: Images, context: &TileContext<'_>) -> Result<Way, RenderError> {
        let what = match images {
            Images::Samples => "samples",
            Images::Views => "direct views",
        };
        let choice = self.choose(what, context)?;
        let way = choice.way;
        match images {
            Images::Samples => self.choices.samples = Some(choice),
            Images::Views => self.choices.views = Some(choice),
        }
        Ok(way)
    }

    fn choose(&mut self, what: &str, context: &TileContext<'_>) -> Result<Choice, RenderError> {
        let TileContext { gpu, resident, .. } = context;
        if let Some(way) = Way::wished(self.wish) {
            return Ok(match self.ready(gpu, resident, way) {
                Ok(()) => Choice { way, why: "asked for".to_owned() },
                Err(reason) => {
                    let why = format!("this device cannot trace: {reason}");
                    Choice { way: Way::Raster, why }
                }
            });
        }
        let all = [Way::Raster, Way::Cpu, Way::Trace];
        let ways: Vec<Way> = all.into_iter().filter(|&way| self.ready(gpu, resident, way).is_ok()).collect();
        ways::choose(what, &ways, |way| {
            let mut commands = gpu.commands("measure");
            self.see(&mut commands, context, way, &mut Vec::new())?;
            commands.submit().wait()?;
            Ok(())
        })
    }

    /// Builds what a way needs, once, or says why the device does not have it.
    pub(crate) fn ready(&mut self, gpu: &Gpu, resident: &Resident, way: Way) -> Result<(), String> {
        match way {
            Way::Raster => Ok(()),
            Way::Cpu => {
                self.ready_packets(resident);
                Ok(())
            }
            Way::Trace => {
                self.ready_packets(resident);
                if let (None, Some(packets)) = (&self.trace, &self.packets) {
                    self.trace = Some(Trace::new(gpu, packets.hierarchy(), draws::near(&resident.bounds)));
                }
                match &self.trace {
                    Some(Err(reason)) => Err(reason.clone()),
                    _ => Ok(()),
                }
            }
        }
    }

    /// Waits for the tracer of packets, or builds it.
    pub(crate) fn ready_packets(&mut self, resident: &Resident) {
        if self.packets.is_none() {
            let near = draws::near(&resident.bounds);
            let build = || ways::build(&self.scene, &resident.instances, near);
            let mut packets = self.building.take().map_or_else(build, Building::finish);
            if self.scene.is_animated() {
                packets.pose(&self.scene, &resident.instances);
            }
            self.packets = Some(packets);
        }
    }

    /// The tracer of packets; [`Self::ready_packets`] comes first.
    pub(crate) fn packets(&self) -> Result<&PacketTracer, RenderError> {
        self.packets.as_ref().ok_or_else(|| RenderError::Internal("the tracer was not built".to_owned()))
    }

    /// Finds what a tile sees.
    pub(crate) fn see(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        way: Way,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        match way {
            Way::Raster => self.rasterise(commands, context, stages),
            Way::Trace => self.trace(commands, context, stages),
            Way::Cpu => {
                let begin = Instant::now();
                let ids = self.packets()?.trace(context.eye.position, &context.tile.rays());
                write_ids(context.gpu, &context.targets, context.tile.sub_samples(), &ids);
                timing::add_since(stages, "trace on the CPU", begin);
                Ok(())
            }
        }
    }

    /// Finds what the pixels of a list see; [`Self::ready_packets`] comes first.
    pub(crate) fn see_list(
        &self,
        context: &TileContext<'_>,
        listing: &Listing,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let begin = Instant::now();
        let rays = listing.tile.rays();
        let found = self.packets()?.trace_some(context.eye.position, &rays, &listing.sub_samples());
        write_ids(context.gpu, &context.targets, context.tile.sub_samples(), &listing.image(&found));
        timing::add_since(stages, "trace rays", begin);
        Ok(())
    }

    /// By the rasteriser: culls, uploads what is left, draws it.
    fn rasterise(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let begin = Instant::now();
        let list = DrawList::new(context.resident, context.eye.position, context.tile);
        let draws = upload(context.gpu, "draws", &list.draws, wgpu::BufferUsages::STORAGE)?;
        timing::add_since(stages, "cull", begin);
        self.rasteriser.record(commands, context, &list, &draws);
        Ok(())
    }

    /// By compute. The software driver ends a program whose loops go on for long, without a word: there it is asked
    /// whether the tile is whole, and one that is not is rasterised.
    fn trace(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let hierarchy = self.packets()?.hierarchy();
        let Some(Ok(trace)) = &self.trace else {
            return self.rasterise(commands, context, stages);
        };
        if !context.gpu.is_software() {
            return trace.record(commands, context, hierarchy);
        }
        let mut own = context.gpu.commands("trace");
        trace.record(&mut own, context, hierarchy)?;
        let ticket = trace.read_unfinished(&mut own);
        let mut finished = own.submit().wait()?;
        timing::add(stages, std::mem::take(&mut finished.stages));
        if Trace::is_whole(&finished.take(ticket)) {
            return Ok(());
        }
        self.rasterise(commands, context, stages)
    }
}

/// Hands what was found on the CPU to the device, before its next submission.
fn write_ids(gpu: &Gpu, targets: &Targets, size: [u32; 2], ids: &[[u32; 2]]) {
    let [width, height] = size;
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 8), rows_per_image: None };
    let extent = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let to = targets.visibility.texture().as_image_copy();
    gpu.queue.write_texture(to, bytemuck::cast_slice(ids), layout, extent);
}
