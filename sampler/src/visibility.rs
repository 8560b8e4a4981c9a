//! The visibility backends: rasteriser, compute tracer, CPU packet tracer. Each fills a tile's visibility buffer.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::{RenderError, Scene, Stage, Visibility};
use argus_shaders::layout::sampler::Rays;
use glam::DVec3;

use crate::backend_timing;
use crate::draws::{self, DrawList};
use crate::layers::{LayerTracer, RayLayers};
use crate::packets::PacketTracer;
use crate::passes::{Rasteriser, TileContext, Trace};
use crate::pixel_list::PixelList;
use crate::ray_tile::RayTile;
use crate::ray_watch::RayWatch;
use crate::resident::{Resident, upload};
use crate::scratch::Targets;
use crate::timing;

/// The visibility backends of one scene. Tracers are built when they are first needed.
pub(crate) struct VisibilityBackends {
    scene: Arc<Scene>,
    rasteriser: Rasteriser,
    packets: Option<PacketTracer>,
    /// Transparent surfaces; `None` for a scene without them.
    layers: Option<LayerTracer>,
    /// The compute tracer, or why this device does not support it.
    trace: Option<Result<Trace, String>>,
}

impl VisibilityBackends {
    /// The backends of a scene on the device.
    pub(crate) fn new(gpu: &Gpu, scene: &Arc<Scene>, resident: &Resident) -> Self {
        let rasteriser = Rasteriser::new(gpu, resident);
        let layers = LayerTracer::new(scene, resident);
        Self { scene: Arc::clone(scene), rasteriser, packets: None, layers, trace: None }
    }

    /// Moves instances of a posed scene to their current transforms.
    pub(crate) fn pose(&mut self, gpu: &Gpu, scene: &Arc<Scene>, resident: &Resident) {
        let reshaped = !Arc::ptr_eq(scene, &self.scene) && scene.deforms();
        self.scene = Arc::clone(scene);
        if let Some(layers) = &mut self.layers {
            layers.pose(scene, resident);
        }
        let Some(packets) = &mut self.packets else { return };
        packets.pose(scene, &resident.instances);
        self.trace = match self.trace.take() {
            Some(Ok(trace)) if reshaped => Some(trace.renewed(gpu, packets.hierarchy())),
            trace => trace,
        };
    }

    /// Forgets trees: other instances move from now on, which must have trees of their own.
    pub(crate) fn forget_trees(&mut self, scene: &Arc<Scene>, resident: &Resident) {
        self.scene = Arc::clone(scene);
        (self.packets, self.trace) = (None, None);
        if self.layers.is_some() {
            self.layers = LayerTracer::new(scene, resident);
        }
    }

    /// Reads alpha and transmission from another scene, whose triangles are the same.
    pub(crate) fn set_scene(&mut self, scene: &Arc<Scene>) {
        self.scene = Arc::clone(scene);
        if let Some(packets) = &mut self.packets {
            packets.set_scene(scene);
        }
        if let Some(layers) = &mut self.layers {
            layers.set_scene(scene);
        }
    }

    /// Milliseconds of each supported backend for a tile.
    pub(crate) fn measure(
        &mut self,
        context: &TileContext<'_>,
    ) -> Result<Vec<(Visibility, f64)>, RenderError> {
        let TileContext { gpu, resident, .. } = context;
        let mut backends = Visibility::ALL.to_vec();
        backends.retain(|&backend| self.prepare(gpu, resident, backend).is_ok());
        backend_timing::measure(&backends, |backend| self.fill(context, backend))
    }

    /// Fills a tile's visibility buffer, and waits for it.
    ///
    /// # Errors
    /// The errors of the device.
    pub(crate) fn fill(&self, context: &TileContext<'_>, backend: Visibility) -> Result<(), RenderError> {
        let (gpu, mut stages) = (context.gpu, Vec::new());
        let mut commands = gpu.commands("fill visibility");
        self.record(&mut commands, context, backend, None, &mut stages)?;
        let pending = self.unfinished(gpu, backend).map(|buffer| commands.read_buffer(buffer, 0..4));
        let mut finished = commands.submit().wait()?;
        if let Some(pending) = pending {
            let mut commands = gpu.commands("complete visibility");
            self.complete(&mut commands, context, &finished.take(pending), &mut stages)?;
            commands.submit().wait()?;
        }
        Ok(())
    }

    /// Builds what a backend needs, once. Fails with the reason if the device does not support it.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        resident: &Resident,
        backend: Visibility,
    ) -> Result<(), String> {
        match backend {
            Visibility::Raster => Ok(()),
            Visibility::Cpu => {
                self.prepare_packets(resident);
                Ok(())
            }
            Visibility::Trace => {
                if self.trace.is_none() {
                    let near = draws::near(&resident.bounds);
                    let trace = Trace::new(gpu, self.prepare_packets(resident).hierarchy(), near);
                    self.trace = Some(trace);
                }
                match &self.trace {
                    Some(Err(reason)) => Err(reason.clone()),
                    _ => Ok(()),
                }
            }
        }
    }

    /// The packet tracer, built when it is first needed.
    pub(crate) fn prepare_packets(&mut self, resident: &Resident) -> &PacketTracer {
        self.packets.get_or_insert_with(|| {
            let near = draws::near(&resident.bounds);
            let mut packets = PacketTracer::new(&self.scene, &resident.instances, near);
            if self.scene.is_animated() {
                packets.pose(&self.scene, &resident.instances);
            }
            packets
        })
    }

    /// The packet tracer. Call [`Self::prepare_packets`] first.
    pub(crate) fn packets(&self) -> Result<&PacketTracer, RenderError> {
        self.packets.as_ref().ok_or_else(|| RenderError::Internal("the tracer was not built".to_owned()))
    }

    /// The posed scene.
    pub(crate) fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Whether a ray of sight may cross transparent surfaces.
    pub(crate) fn has_layers(&self) -> bool {
        self.layers.is_some()
    }

    /// The layers of a tile's rays.
    pub(crate) fn layers_of_tile(&mut self, resident: &Resident, eye: DVec3, rays: &Rays) -> Vec<RayLayers> {
        self.prepare_packets(resident);
        match (&self.layers, &self.packets) {
            (Some(layers), Some(packets)) => layers.of_tile(packets, eye, rays),
            _ => Vec::new(),
        }
    }

    /// The layers of the rays of a list of pixels, by their place in its compact image.
    pub(crate) fn layers_of_list(
        &mut self,
        resident: &Resident,
        eye: DVec3,
        list: &PixelList,
    ) -> Vec<RayLayers> {
        self.prepare_packets(resident);
        let (Some(layers), Some(packets)) = (&self.layers, &self.packets) else { return Vec::new() };
        let mut rays = layers.of_list(packets, eye, &list.tile.rays(), &list.sub_samples());
        rays.iter_mut().for_each(|ray| ray.at = list.address(ray.at));
        rays
    }

    /// The layers of rays with these directions, in rows of `width`.
    pub(crate) fn layers_of_rays(
        &mut self,
        resident: &Resident,
        eye: DVec3,
        directions: &[[f32; 4]],
        width: u32,
    ) -> Vec<RayLayers> {
        self.prepare_packets(resident);
        let (Some(layers), Some(packets)) = (&self.layers, &self.packets) else { return Vec::new() };
        layers.of_listed(packets, eye, directions, width)
    }

    /// Fills a tile's visibility buffer. `watch` is told of the rays of sight, if the CPU traces them.
    pub(crate) fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        backend: Visibility,
        watch: Option<&dyn RayWatch>,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        match backend {
            Visibility::Raster => self.rasterise(commands, context, stages),
            Visibility::Trace => self.trace(commands, context, stages),
            Visibility::Cpu => {
                let begin = Instant::now();
                let ids = self.packets()?.trace_watched(context.eye.position, &context.tile.rays(), watch);
                write_ids(context.gpu, &context.targets, context.tile.sub_samples(), &ids);
                timing::add_since(stages, "trace on the CPU", begin);
                Ok(())
            }
        }
    }

    /// Fills the visibility buffer of a list of pixels. Call [`Self::prepare_packets`] first.
    pub(crate) fn record_list(
        &self,
        context: &TileContext<'_>,
        list: &PixelList,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let begin = Instant::now();
        let rays = list.tile.rays();
        let found = self.packets()?.trace_some(context.eye.position, &rays, &list.sub_samples());
        write_ids(context.gpu, &context.targets, context.tile.sub_samples(), &list.image(&found));
        timing::add_since(stages, "trace rays", begin);
        Ok(())
    }

    /// Fills the visibility buffer of a tile that has its own rays. Call [`Self::prepare_packets`] first.
    pub(crate) fn record_rays(
        &self,
        context: &TileContext<'_>,
        cast: &RayTile,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let begin = Instant::now();
        let size = cast.tile.sub_samples();
        let ids = self.packets()?.trace_listed(context.eye.position, &cast.directions, size[0]);
        write_ids(context.gpu, &context.targets, size, &ids);
        timing::add_since(stages, "trace rays", begin);
        Ok(())
    }

    /// Culls, uploads the visible instances and rasterises them.
    fn rasterise(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        let begin = Instant::now();
        let list = DrawList::new(context.resident, context.eye.position, &context.tile);
        let draws = upload(context.gpu, "draws", &list.draws, wgpu::BufferUsages::STORAGE)?;
        timing::add_since(stages, "cull", begin);
        self.rasteriser.record(commands, context, &list, &draws);
        Ok(())
    }

    /// Traces on the device.
    fn trace(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        match &self.trace {
            Some(Ok(trace)) => trace.record(commands, context, self.packets()?.hierarchy()),
            _ => self.rasterise(commands, context, stages),
        }
    }

    /// What has to be read back once a backend is recorded: four bytes for [`Self::complete`]. A software driver silently ends
    /// long loops of the compute tracer.
    pub(crate) fn unfinished(&self, gpu: &Gpu, backend: Visibility) -> Option<&wgpu::Buffer> {
        let trace = self.trace.as_ref()?.as_ref().ok()?;
        (backend == Visibility::Trace && gpu.is_software()).then(|| trace.unfinished())
    }

    /// Rasterises a tile that the compute tracer did not finish.
    pub(crate) fn complete(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        unfinished: &[u8],
        stages: &mut Vec<Stage>,
    ) -> Result<(), RenderError> {
        match Trace::is_whole(unfinished) {
            true => Ok(()),
            false => self.rasterise(commands, context, stages),
        }
    }
}

/// Uploads a visibility buffer from the CPU before the next submission.
pub(crate) fn write_ids(gpu: &Gpu, targets: &Targets, size: [u32; 2], ids: &[[u32; 2]]) {
    let [width, height] = size;
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 8), rows_per_image: None };
    let extent = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let to = targets.visibility.texture().as_image_copy();
    gpu.queue.write_texture(to, bytemuck::cast_slice(ids), layout, extent);
}
