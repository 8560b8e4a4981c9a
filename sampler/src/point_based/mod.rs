//! Point-based indirect light: the scene's surfaces as an octree of shaded points, of which some of what is visible sees a
//! small image (MegaViews, Kol et al. 2018, section 6; after Christensen, "Point-Based Approximate Color Bleeding", 2008).
//!
//! Once a lighting, the octree's leaves are lit, bounce by bounce: by the lights, and by what their own small images show
//! of the bounce before. Then, for every tile, each block of sub-samples has a *receiver* or two; one traversal renders
//! the dual-paraboloid maps of nodes around all of them; what a map shows is weighed by the cosine of its receiver's
//! normal, which is the diffuse reflection's share; and sub-samples take the light of the receivers around them that stand
//! for them best. All of it is done where samples are rendered, once for all views that are made of them.
//!
//! # Passes of a tile
//!
//! *choose receivers* takes the middle sub-sample of each block and, where the block sees two surfaces, one of the other. One traversal
//! renders the maps around all receivers. *receive* weights what a map shows by the cosine of its receiver's normal. *spread* gives
//! each sub-sample the light of the receivers around it that stand for it best.
//!
//! A receiver's eye is lifted off its surface by a cell and a half, so that the cells of that surface hide nothing; light from nearer
//! than that is lost. Receivers are read back between the passes, since lists of views are made on the CPU.

mod direct;

use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

use argus_gpu::hierarchy::Octree;
use argus_gpu::many_views::{Knobs, ManyViews, Texel, ViewList, ViewPoint};
use argus_gpu::{Commands, Gpu, wgpu};
use argus_scene::{Effect, Lighting, RenderError, Sky, Stage};
use argus_shaders::layout::sampler::Chosen;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::PointKnobs;
use crate::eye::Eye;
use crate::indirect::{Spreading, ToLight};
use crate::lit_octree::{LitOctree, refused};
use crate::passes::{Batch, ChooseReceivers, OF_BLOCK, Receive, Spread, SpreadFrom, TileContext, Told};
use crate::radiosity::paths::off_surface;
use crate::resident::{Resident, upload};
use crate::scratch::{Extras, Scratch};
use crate::timing;

/// Receivers whose maps are rendered in one traversal, at most: 128 MiB of maps of 16².
const MOST_RECEIVERS: usize = 1 << 15;
/// Pairs of a queue, at most.
const QUEUE_PAIRS: u32 = 1 << 23;
/// Edges of a leaf's cell by which a receiver's eye is lifted off its surface, so that the cells of that very surface,
/// which stand out from it by as much as their diagonal, hide nothing and shine on nothing.
const LIFT: f64 = 1.5;
/// In place of a receiver that a block does not have; as `shaders/sampler/spread.wgsl` has it.
const NONE: u32 = u32::MAX;

/// What was found out about a scene's light by points.
#[derive(Debug, Clone, PartialEq)]
pub struct PointReport {
    /// Leaves of the scene's octree.
    pub leaves: u32,
    /// Milliseconds that building it took, which only what moves makes anew.
    pub octree_ms: f64,
    /// And lighting its leaves.
    pub light_ms: f64,
    /// Receivers of the latest tile.
    pub receivers: usize,
    /// Bytes of the latest maps.
    pub map_bytes: u64,
}

/// The indirect light of one scene on one device.
pub(crate) struct PointBased {
    knobs: PointKnobs,
    octree: LitOctree,
    choose: ChooseReceivers,
    receive: Receive,
    spread: Spread,
    /// Programs outlast the octree that they were made for.
    views: Option<ManyViews>,
    report: PointReport,
}

/// Irradiance by π at a position with a normal, in world space.
type LightAt<'a> = &'a (dyn Fn(DVec3, Vec3) -> Vec3 + Sync);

/// Some surfaces of a tile, and which blocks they receive light for.
struct Receivers {
    /// About the eye.
    chosen: Vec<Chosen>,
    of_blocks: Vec<[u32; OF_BLOCK]>,
}

impl PointBased {
    /// For a scene that lies on a device.
    pub(crate) fn new(gpu: &Gpu, resident: &Resident, knobs: PointKnobs) -> Self {
        Self {
            knobs,
            octree: LitOctree::new(gpu, resident, true, knobs.levels),
            choose: ChooseReceivers::new(gpu),
            receive: Receive::new(gpu, 1),
            spread: Spread::new(gpu),
            views: None,
            report: PointReport { leaves: 0, octree_ms: 0.0, light_ms: 0.0, receivers: 0, map_bytes: 0 },
        }
    }

    /// Takes other knobs, by which the scene is lit anew.
    pub(crate) fn set_knobs(&mut self, knobs: PointKnobs) {
        self.octree.set_levels(knobs.levels);
        self.octree.forget_light();
        self.knobs = knobs;
    }

    /// Surfaces lie elsewhere.
    pub(crate) fn forget_pose(&mut self) {
        self.octree.forget_pose();
    }

    /// What is known, once the scene was lit.
    pub(crate) fn report(&self) -> Option<PointReport> {
        self.octree.nodes().map(|_| self.report.clone())
    }

    /// Lights the octree's leaves, unless that was done for these lights.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the octree or its maps are larger than the device can bind.
    pub(crate) fn ready(
        &mut self,
        to_light: &ToLight<'_>,
        scratch: &mut Scratch,
    ) -> Result<Vec<Stage>, RenderError> {
        let ToLight { gpu, scene, resident, lighting, time_secs, .. } = *to_light;
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
        if let Err(error) = self.light_leaves(to_light, scratch, &octree) {
            // Nobody is to go by a bounce that is not the last.
            self.octree.forget_light();
            return Err(error);
        }
        self.report.light_ms = begin.elapsed().as_secs_f64() * 1e3;
        timing::add_since(&mut stages, "light points", begin);
        Ok(stages)
    }

    /// Lights the leaves bounce by bounce, each by what nodes show of the one before.
    fn light_leaves(
        &mut self,
        to_light: &ToLight<'_>,
        scratch: &mut Scratch,
        octree: &Octree,
    ) -> Result<(), RenderError> {
        let ToLight { gpu, scene, resident, tracer, lighting, time_secs } = *to_light;
        // What surfaces emit alone; the lights' light is added with its shadows, and the sky's is not reflected on.
        let dark = Lighting { lights: Vec::new(), sky: Sky::BLACK, exposure: lighting.exposure };
        let eye = Eye::new(gpu, resident, octree.root.world_from_unit(DVec3::splat(0.5)), &dark)?;
        let off = off_surface(scene.bounds()) * 16.0;
        let of_lights =
            |position: DVec3, normal: Vec3| direct::direct_by_pi(tracer, lighting, off, position, normal);
        // What is emitted is seen without any reflection, and each reflection sees what came of the one before.
        let emits = scene.effects().contains(&Effect::Emission);
        for bounce in u32::from(!emits)..=self.knobs.bounces {
            let lights: Option<LightAt<'_>> = if bounce == 0 { None } else { Some(&of_lights) };
            let surfels = self.octree.make_surfels(gpu)?;
            for chunk in &self.octree.chunks(gpu) {
                let mut commands = gpu.commands("light leaves");
                let extras = Extras { guides: true, ..Extras::default() };
                let context = TileContext {
                    places: self.octree.places(),
                    ..TileContext::new(gpu, resident, &eye, &chunk.tile, scratch, extras)
                };
                self.octree.shade(&mut commands, &context, chunk, &surfels);
                let mut commands =
                    self.add_with(commands, &context, Spreading::Each, lights, &mut Vec::new())?;
                self.octree.keep(&mut commands, &context, chunk, &surfels);
                commands.submit().wait()?;
            }
            let mut commands = gpu.commands("average surfels");
            self.octree.light(&mut commands, surfels, lighting, time_secs);
            commands.submit().wait()?;
        }
        Ok(())
    }

    /// Adds the indirect light of a tile that was shaded.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if maps are larger than the device can bind, or the device.
    pub(crate) fn add(
        &mut self,
        commands: Commands,
        context: &TileContext<'_>,
        spreading: Spreading,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError> {
        if self.octree.nodes().is_none() {
            return Ok(commands);
        }
        self.add_with(commands, context, spreading, None, stages)
    }

    /// Adds the light, with light that receivers receive from elsewhere.
    fn add_with(
        &mut self,
        mut commands: Commands,
        context: &TileContext<'_>,
        spreading: Spreading,
        more: Option<LightAt<'_>>,
        stages: &mut Vec<Stage>,
    ) -> Result<Commands, RenderError> {
        let gpu = context.gpu;
        let Some(guides) = &context.targets.guides else { return Ok(commands) };
        let (block, reach) = spreading.blocks(self.knobs.block, context.tile.side);
        let told = Told::new(gpu, context.tile.sub_samples(), block, reach);
        let chosen = self.choose.record(gpu, &mut commands, &told, guides);
        let ticket = commands.read_buffer(&chosen, 0..chosen.size());
        let mut finished = commands.submit().wait()?;
        timing::add(stages, std::mem::take(&mut finished.stages));
        let all: Vec<Chosen> = bytemuck::pod_collect_to_vec(&finished.take(ticket)[..]);
        let receivers = Receivers::of(&all);
        self.report.receivers = receivers.chosen.len();
        if receivers.chosen.is_empty() {
            return Ok(gpu.commands("nothing receives light"));
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
                let views = ManyViews::kept_or_new(kept, gpu, nodes.octree, traversal(&self.knobs));
                let views = self.views.insert(views.map_err(refused)?);
                views.render(&list).map_err(refused)?;
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

        let mut commands = gpu.commands("spread light");
        let of_blocks = upload(gpu, "receivers of blocks", &receivers.of_blocks, storage)?;
        let from = SpreadFrom {
            told: &told,
            guides,
            of_blocks: &of_blocks,
            receivers: &buffer,
            received: &received,
        };
        self.spread.record(&mut commands, context, &from);
        Ok(commands)
    }
}

/// How maps of receivers are rendered: by a function of the knobs and of who receives alone.
fn traversal(knobs: &PointKnobs) -> Knobs {
    Knobs {
        side: knobs.map_side,
        texel: Texel::RangeAndNode,
        disc: Knobs::COVERING,
        shared_disc: Knobs::COVERING,
        sharing: knobs.sharing,
        // What was rendered before decides nothing.
        falls_back: false,
        // The cell that an eye stands in is none of what it sees.
        own_cell: false,
        queue_pairs: Some(QUEUE_PAIRS),
        ..Knobs::default()
    }
}

impl Receivers {
    /// Those that exist and are somewhere, of what was chosen for each block.
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
