//! Point-based indirect light: some visible surfaces integrate small maps of an octree of shaded points (MegaViews, Kol
//! et al. 2018, section 6; after Christensen, "Point-Based Approximate Color Bleeding", 2008).
//!
//! Once a lighting, the octree's leaves are lit bounce by bounce: by the lights, and by their own maps of the previous
//! bounce. Per tile, each block of sub-samples has one or two *receivers*. One traversal renders the dual-paraboloid maps
//! around all receivers, each map is integrated by the cosine of its receiver's normal, and sub-samples interpolate
//! nearby receivers. It is paid when samples are rendered, once for all their views.
//!
//! # Passes of a tile
//!
//! *Choose receivers* takes the central sub-sample of each block and, if the block sees two surfaces, one of the other
//! surface. One traversal renders the maps. *Receive* integrates each map by the cosine. *Spread* interpolates at
//! sub-samples.
//!
//! A receiver's map is centred a cell and a half off its surface, so that the cells of that surface hide nothing. Light
//! from nearer is lost. Receivers are read back between the passes, because lists of views are made on the CPU.

mod direct;

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;
use std::time::Instant;

use crate::layout::Chosen;
use argus_gpu::{Gpu, wgpu};
use argus_megaviews::hierarchy::Octree;
use argus_megaviews::many_views::{ManyViews, Settings, Texel, ViewList, ViewPoint};
use argus_megaviews::{LitOctree, to_render_error};
use argus_sampler::plug::{
    Extras, Eye, Frame, GBufferUse, IndirectMethod, LightInputs, LightSharing, Placement, Resident, Scratch,
    TileContext, timing, upload,
};
use argus_scene::indirect::PointSettings;
use argus_scene::{Effect, Indirect, Lighting, RenderError, Scene, Sky, Stage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::passes::{Batch, BlockUniform, ChooseReceivers, OF_BLOCK, Receive, Spread, SpreadFrom};
use crate::vpl::paths::off_surface;

/// Most receivers of one traversal: 128 MiB of maps of 16² texels.
const MOST_RECEIVERS: usize = 1 << 15;
/// Most pairs of a queue.
const QUEUE_PAIRS: u32 = 1 << 23;
/// Distance of a map's centre from its receiver's surface, in edges of a leaf's cell. The cells of that surface extend by
/// up to their diagonal, and must neither hide nor light.
const LIFT: f64 = 1.5;
/// Marks a missing receiver of a block, as in `shaders/spread.wgsl`.
const NONE: u32 = u32::MAX;

/// Report on a scene's point-based light.
#[derive(Debug, Clone, PartialEq)]
pub struct PointReport {
    /// Number of leaves of the scene's octree.
    pub leaves: u32,
    /// Milliseconds of building it. Rebuilt only if the scene moves.
    pub octree_ms: f64,
    /// Milliseconds of lighting its leaves.
    pub light_ms: f64,
    /// Number of receivers of the latest tile.
    pub receivers: usize,
    /// Bytes of the latest tile's maps.
    pub map_bytes: u64,
}

/// The indirect light of one scene on one device.
pub(crate) struct PointBased {
    settings: PointSettings,
    octree: LitOctree,
    choose: ChooseReceivers,
    receive: Receive,
    spread: Spread,
    /// Kept across octrees, because its programs are reused.
    views: Option<ManyViews>,
    report: PointReport,
}

/// Irradiance / π at a position with a normal, world space.
type LightAt<'a> = &'a (dyn Fn(DVec3, Vec3) -> Vec3 + Sync);

/// Receivers of a tile, and their blocks.
struct Receivers {
    /// Relative to the eye.
    chosen: Vec<Chosen>,
    of_blocks: Vec<[u32; OF_BLOCK]>,
}

impl IndirectMethod for PointBased {
    fn set_settings(&mut self, settings: Indirect) -> bool {
        let Indirect::Points(settings) = settings else { return false };
        self.octree.set_levels(settings.levels);
        self.octree.forget_light();
        self.settings = settings;
        true
    }

    fn place(&mut self, _: &Arc<Scene>, _: &[Placement]) {
        self.octree.forget_pose();
    }

    fn ready(&mut self, inputs: &LightInputs<'_>, scratch: &mut Scratch) -> Result<Vec<Stage>, RenderError> {
        let LightInputs { gpu, scene, resident, lighting, time_secs, .. } = *inputs;
        let Some(mut stages) = self.octree.pose(gpu, scene, &resident.instances)? else {
            return Ok(Vec::new());
        };
        if !stages.is_empty() {
            self.report.octree_ms = stages.iter().map(|stage| stage.ms).sum();
        }
        let Some(octree) = self.octree.octree().cloned() else { return Ok(stages) };
        if self.octree.is_lit(lighting, time_secs, false) {
            return Ok(stages);
        }
        let begin = Instant::now();
        self.report.leaves = octree.leaf_count();
        self.octree.forget_light();
        if let Err(error) = self.light_leaves(inputs, scratch, &octree) {
            // An unfinished lighting must not be used.
            self.octree.forget_light();
            return Err(error);
        }
        self.report.light_ms = begin.elapsed().as_secs_f64() * 1e3;
        timing::add_since(&mut stages, "light points", begin);
        Ok(stages)
    }

    fn choose(&mut self, frame: &mut Frame<'_>) -> Result<Option<wgpu::Buffer>, RenderError> {
        Ok(if self.octree.nodes().is_none() { None } else { self.choose_receivers(frame) })
    }

    fn add(&mut self, frame: &mut Frame<'_>, chosen: Option<&[u8]>) -> Result<(), RenderError> {
        chosen.map_or(Ok(()), |chosen| self.add_with(frame, chosen, None))
    }
}

impl PointBased {
    /// The point-based light of a scene on a device.
    pub(crate) fn new(gpu: &Gpu, resident: &Resident, settings: PointSettings) -> Self {
        Self {
            settings,
            octree: LitOctree::new(gpu, resident, GBufferUse::IndirectLight, settings.levels),
            choose: ChooseReceivers::new(gpu),
            receive: Receive::new(gpu, 1),
            spread: Spread::new(gpu),
            views: None,
            report: PointReport { leaves: 0, octree_ms: 0.0, light_ms: 0.0, receivers: 0, map_bytes: 0 },
        }
    }

    /// The report, once the scene is lit.
    pub(crate) fn report(&self) -> Option<PointReport> {
        self.octree.nodes().map(|_| self.report.clone())
    }

    /// Lights the leaves bounce by bounce, each from the nodes of the previous one.
    fn light_leaves(
        &mut self,
        inputs: &LightInputs<'_>,
        scratch: &mut Scratch,
        octree: &Octree,
    ) -> Result<(), RenderError> {
        let LightInputs { gpu, scene, resident, tracer, lighting, time_secs, .. } = *inputs;
        // Emission only. Lights are added with their shadows; sky light is not reflected.
        let dark = Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: lighting.exposure };
        let eye = Eye::new(gpu, resident, octree.root.world_from_unit(DVec3::splat(0.5)), &dark)?;
        let off = off_surface(scene.bounds()) * 16.0;
        let of_lights =
            |position: DVec3, normal: Vec3| direct::direct_by_pi(tracer, lighting, off, position, normal);
        // Emission is bounce 0; each bounce reads the previous one.
        let emits = scene.effects().contains(&Effect::Emission);
        for bounce in u32::from(!emits)..=self.settings.bounces {
            let lights: Option<LightAt<'_>> = if bounce == 0 { None } else { Some(&of_lights) };
            let surfels = self.octree.make_surfels(gpu)?;
            for chunk in &self.octree.chunks(gpu) {
                let extras = Extras { g_buffer: true, ..Extras::default() };
                let context = TileContext {
                    places: self.octree.places(),
                    ..TileContext::new(gpu, resident, &eye, &chunk.tile, scratch, extras)
                };
                let mut stages = Vec::new();
                let mut frame = Frame::new(context, LightSharing::Each, "light leaves", &mut stages);
                self.octree.shade(&mut frame.commands, &frame.context, chunk, &surfels);
                if let Some(buffer) = self.choose_receivers(&mut frame) {
                    let [chosen] = frame.read_back([(&buffer, buffer.size())], "light leaves")?;
                    self.add_with(&mut frame, &chosen, lights)?;
                }
                self.octree.keep(&mut frame.commands, &frame.context, chunk, &surfels);
                frame.commands.submit().wait()?;
            }
            let mut commands = gpu.commands("average surfels");
            self.octree.light(&mut commands, surfels, lighting, time_secs);
            commands.submit().wait()?;
        }
        Ok(())
    }

    /// The blocks of a frame that share receivers.
    fn blocks(&self, frame: &Frame<'_>) -> BlockUniform {
        let TileContext { gpu, tile, .. } = &frame.context;
        let (block, reach) = frame.sharing.blocks(self.settings.block, tile.side);
        BlockUniform::new(gpu, tile.sub_samples(), block, reach)
    }

    /// Records the choice of a frame's receivers.
    fn choose_receivers(&self, frame: &mut Frame<'_>) -> Option<wgpu::Buffer> {
        let layout = self.blocks(frame);
        let Frame { commands, context, .. } = frame;
        Some(self.choose.record(context.gpu, commands, &layout, context.targets.g_buffer.as_ref()?))
    }

    /// Adds the light that chosen receivers get, with additional light at them.
    fn add_with(
        &mut self,
        frame: &mut Frame<'_>,
        chosen: &[u8],
        more: Option<LightAt<'_>>,
    ) -> Result<(), RenderError> {
        let layout = self.blocks(frame);
        let Frame { commands: spreading, context, stages, .. } = frame;
        let gpu = context.gpu;
        let Some(g_buffer) = &context.targets.g_buffer else { return Ok(()) };
        let all: Vec<Chosen> = bytemuck::pod_collect_to_vec(chosen);
        let receivers = Receivers::of(&all);
        self.report.receivers = receivers.chosen.len();
        if receivers.chosen.is_empty() {
            return Ok(());
        }

        let world = |c: &Chosen| context.eye.position + Vec3::from_array(c.position).as_dvec3();
        let normal = |c: &Chosen| Vec3::from_array(c.normal);
        let storage = wgpu::BufferUsages::STORAGE;
        let from_elsewhere = |c: &Chosen| {
            let light = more.map_or(Vec3::ZERO, |light| light(world(c), normal(c)));
            light.extend(0.0).to_array()
        };
        let received: Vec<[f32; 4]> = receivers.chosen.par_iter().map(from_elsewhere).collect();
        let received = upload(gpu, "received light", &received, storage)?;
        let buffer = upload(gpu, "receivers", &receivers.chosen, storage)?;
        if let Some(nodes) = self.octree.nodes() {
            let begin = Instant::now();
            let cell = nodes.octree.root.edge * (-f64::from(nodes.octree.depth)).exp2();
            for (number, batch) in receivers.chosen.chunks(MOST_RECEIVERS).enumerate() {
                let point = |c: &Chosen| ViewPoint {
                    position: world(c) + normal(c).as_dvec3() * (LIFT * cell),
                    direction: normal(c).as_dvec3(),
                    half_fov: FRAC_PI_2,
                };
                let points: Vec<ViewPoint> = batch.iter().map(point).collect();
                let list = ViewList::new(gpu, &nodes.octree.root, &points)?;
                let kept = self.views.take();
                let views = ManyViews::reuse_or_new(kept, gpu, nodes.octree, traversal(&self.settings));
                let views = self.views.insert(views.map_err(to_render_error)?);
                views.render(&list).map_err(to_render_error)?;
                let arrays = views.maps().arrays.len();
                if arrays != self.receive.arrays() {
                    self.receive = Receive::new(gpu, arrays);
                }
                let first = (number * MOST_RECEIVERS) as u32;
                let (count, surfels) = (batch.len() as u32, nodes.surfels);
                let batch = Batch { receivers: &buffer, first, count, views, surfels };
                let mut commands = gpu.commands("receive light");
                self.receive.record(gpu, &mut commands, &batch, &received);
                commands.submit().wait()?;
                self.report.map_bytes = views.maps().bytes();
            }
            timing::add_since(stages, "maps of receivers", begin);
        }

        let of_blocks = upload(gpu, "receivers of blocks", &receivers.of_blocks, storage)?;
        let from = SpreadFrom {
            layout: &layout,
            g_buffer,
            of_blocks: &of_blocks,
            receivers: &buffer,
            received: &received,
        };
        self.spread.record(spreading, context, &from);
        Ok(())
    }
}

/// Settings of the receivers' maps, a function of settings and receivers alone.
fn traversal(settings: &PointSettings) -> Settings {
    Settings {
        side: settings.map_side,
        texel: Texel::RangeAndNode,
        disc: Settings::COVERING,
        shared_disc: Settings::COVERING,
        sharing: settings.sharing,
        // Would depend on earlier frames.
        falls_back: false,
        // Culls the cell that the map's centre is in.
        own_cell: false,
        queue_pairs: Some(QUEUE_PAIRS),
        ..Settings::default()
    }
}

impl Receivers {
    /// Valid receivers of those that were selected for each block.
    fn of(all: &[Chosen]) -> Self {
        let (mut chosen, mut of_blocks) = (Vec::new(), Vec::with_capacity(all.len() / OF_BLOCK));
        for block in all.as_chunks::<OF_BLOCK>().0 {
            of_blocks.push(block.map(|one| {
                let is_somewhere = one.position.iter().chain(&one.normal).all(|x| x.is_finite());
                if one.exists == 0 || !is_somewhere {
                    return NONE;
                }
                chosen.push(one);
                chosen.len() as u32 - 1
            }));
        }
        Self { chosen, of_blocks }
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn blocks_without_surfaces_and_receivers_that_are_nowhere_are_left_out() {
        let there = |x: f32| Chosen {
            position: [x, 0.0, 0.0],
            normal: [0.0, 1.0, 0.0],
            exists: 1,
            ..Chosen::zeroed()
        };
        let none = Chosen::zeroed();
        let receivers = Receivers::of(&[there(1.0), none, none, none, there(f32::NAN), there(2.0)]);
        assert_eq!(receivers.of_blocks, [[0, NONE], [NONE, NONE], [NONE, 1]]);
        assert_eq!(receivers.chosen.len(), 2);
        assert_eq!(receivers.chosen[1].position[0], 2.0);
    }
}
