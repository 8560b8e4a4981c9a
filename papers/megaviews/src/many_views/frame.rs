//! Renders frames of many views.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::wgpu::{Buffer, BufferUsages};
use glam::{DVec3, Vec3};

use super::counters::{self, FrameStats, HEAD, entry};
use super::fuse::Fuse;
use super::maps::MAX_ARRAYS;
use super::schedule::{Part, Step, steps};
use super::traverse::{NodeOwners, Queues, TraversalInputs, Traverse};
use super::view_octree::{ViewOctree, ViewOctreeBuilder};
use super::{MapSet, Occlusion, Settings, TexelCode, ViewList};
use crate::hierarchy::{HierarchyError, MAX_DEPTH, Octree};
use argus_gpu::{Commands, Gpu};

/// Most parts of a frame. With more, the dispatches would take longer than the pairs.
const MAX_PARTS: usize = 1024;
/// Most bytes of a queue by default.
const QUEUE_BYTES: u64 = 1 << 30;

/// Renders maps of one octree, frame by frame. Keeps the parts and the number of maps with which the last frame fitted.
#[derive(Debug)]
pub struct ManyViews {
    gpu: Arc<Gpu>,
    octree: Arc<Octree>,
    settings: Settings,
    builder: ViewOctreeBuilder,
    traverse: Traverse,
    fuse: Fuse,
    views: ViewOctree,
    maps: MapSet,
    queues: Queues,
    /// Parts that are traversed one after another, so that each fits the queues.
    parts: Vec<Part>,
    /// Number of times that parts were split.
    multipass_level: u32,
    /// Whether each view is traversed alone although sharing is on.
    fell_back: bool,
    owners: Option<NodeOwners>,
}

impl ManyViews {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// A setting out of range, or the device lacks a feature or memory.
    pub fn new(gpu: &Arc<Gpu>, octree: Arc<Octree>, settings: Settings) -> Result<Self, HierarchyError> {
        settings.validate()?;
        let pairs = (gpu.largest_array().min(QUEUE_BYTES) / 8) as u32;
        let pairs = settings.queue_pairs.map_or(pairs, |n| n.min(pairs));
        Self::begins(&settings, &octree, pairs)?;
        let code = TexelCode::new(settings.texel, octree.node_count(), octree.root.edge)?;
        let maps = MapSet::new(gpu, settings.side, code, 1)?;
        Ok(Self {
            builder: ViewOctreeBuilder::new(gpu),
            traverse: Traverse::new(gpu, &settings, &maps, false),
            fuse: Fuse::new(gpu, &maps),
            views: ViewOctree::new(gpu, 0, 0, false)?,
            maps,
            queues: Queues::new(gpu, pairs, 0),
            parts: Vec::new(),
            multipass_level: 0,
            fell_back: false,
            owners: None,
            gpu: Arc::clone(gpu),
            octree,
            settings,
        })
    }

    /// Reuses `kept` for this octree if its settings are the same, which saves making pipelines. Otherwise makes a new one.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub fn reuse_or_new(
        kept: Option<Self>,
        gpu: &Arc<Gpu>,
        octree: &Arc<Octree>,
        settings: Settings,
    ) -> Result<Self, HierarchyError> {
        let Some(mut kept) = kept.filter(|kept| kept.settings == settings) else {
            return Self::new(gpu, Arc::clone(octree), settings);
        };
        if !Arc::ptr_eq(&kept.octree, octree) {
            kept.set_octree(Arc::clone(octree))?;
        }
        Ok(kept)
    }

    /// Replaces the octree, such as by that of the next pose. Pipelines are kept if the texel encoding is the same: same
    /// root and, for texels of 32 bits, about as many nodes.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub fn set_octree(&mut self, octree: Arc<Octree>) -> Result<(), HierarchyError> {
        Self::begins(&self.settings, &octree, self.queues.capacity)?;
        let code = TexelCode::new(self.settings.texel, octree.node_count(), octree.root.edge)?;
        if code != self.maps.code {
            self.maps = MapSet::new(&self.gpu, self.settings.side, code, 1)?;
            self.traverse = Traverse::new(&self.gpu, &self.settings, &self.maps, self.owners.is_some());
            self.fuse = Fuse::new(&self.gpu, &self.maps);
        }
        // The next list of views allocates maps and parts again.
        self.views = ViewOctree::new(&self.gpu, 0, 0, false)?;
        self.octree = octree;
        Ok(())
    }

    /// Fails if a queue cannot hold the first pairs of a traversal, however views are split.
    fn begins(settings: &Settings, octree: &Octree, pairs: u32) -> Result<(), HierarchyError> {
        if settings.scene_hierarchy || octree.leaf_count() <= pairs {
            return Ok(());
        }
        let [needed, limit] = [octree.leaf_count(), pairs].map(|pairs| u64::from(pairs) * 8);
        Err(HierarchyError::TooLarge { what: "leaves of the scene in a queue of pairs", needed, limit })
    }

    /// Culls each view's own nodes from now on.
    ///
    /// # Errors
    /// [`HierarchyError::OutOfRange`] if views share maps, because a node of one view is visible to others.
    pub fn cull_own_nodes(&mut self, owners: NodeOwners) -> Result<(), HierarchyError> {
        if self.settings.sharing {
            let range = "off where views cull their own nodes".to_owned();
            return Err(HierarchyError::OutOfRange { field: "sharing", range, value: "on".to_owned() });
        }
        if self.owners.is_none() {
            self.traverse = Traverse::new(&self.gpu, &self.settings, &self.maps, true);
        }
        self.owners = Some(owners);
        Ok(())
    }

    /// Renders the maps of all views. If a queue or the maps overflow, the frame is discarded and rendered again with the
    /// overflowing parts split in eight. The next frame starts with those parts. Bytes do not depend on the parts.
    ///
    /// # Errors
    /// Maps or queues exceed the device's memory however they are split, or the device failed.
    pub fn render(&mut self, views: &ViewList) -> Result<FrameStats, HierarchyError> {
        let begin = Instant::now();
        self.make_room(views)?;
        let mut reruns = 0;
        loop {
            let from_level = if self.settings.scene_hierarchy { 0 } else { self.octree.depth };
            let steps = steps(from_level, self.octree.depth, self.views.depth, views.edge);
            let passes = self.passes();
            let words = entry(passes.len() as u32, 0, steps.len());
            self.make_counters(words);
            let mut commands = self.gpu.commands("many views");
            self.record(&mut commands, views, &steps);
            let words = commands.read_buffer(&self.queues.counters, 0..u64::from(words) * 4);
            let map_total = commands.read_buffer(self.views.map_total(), 0..4);
            let levels = commands.read_buffer(&self.views.nodes.levels, 0..88);
            let mut finished = commands.submit().wait()?;
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(&finished.take(words)[..]);
            let map_total: Vec<u32> = bytemuck::pod_collect_to_vec(&finished.take(map_total)[..4]);
            let levels: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&finished.take(levels)[..88]);
            let sizes = [map_total[0], levels[0][0] + 1, levels[self.views.depth as usize][1]];
            let [maps, view_nodes, view_leaves] = if self.shares() { sizes } else { [views.count; 3] };
            if maps > self.maps.capacity {
                // Slack for views that move.
                let roomy = maps.saturating_add(maps / 16);
                self.set_maps(roomy).or_else(|_| self.set_maps(maps))?;
            } else if !self.split_what_overflowed(&words, steps.len())? {
                let stats = FrameStats {
                    fell_back: self.fell_back,
                    steps: counters::read(&words, &steps, &passes),
                    multipass_level: self.multipass_level,
                    reruns,
                    view_depth: self.views.places(),
                    tells_directions: self.views.by_direction,
                    maps,
                    view_nodes,
                    view_leaves,
                    frame_ms: begin.elapsed().as_secs_f64() * 1e3,
                    stages: finished.stages,
                    map_bytes: self.maps.bytes(),
                    queue_bytes: self.queues.pairs.iter().map(Buffer::size).sum(),
                    view_bytes: self.views.bytes(),
                };
                let alone = self.settings.falls_back && stats.views_per_node() < Settings::WORTH_SHARING;
                self.fell_back |= self.shares() && alone;
                return Ok(stats);
            }
            reruns += 1;
        }
    }

    /// Splits the parts whose queues overflowed in eight. Returns whether there were any.
    fn split_what_overflowed(&mut self, words: &[u32], steps: usize) -> Result<bool, HierarchyError> {
        let shells = self.settings.shells().len() as u32;
        let has_overflowed = |part: u32| {
            let mut passes = part * shells..(part + 1) * shells;
            passes.any(|pass| words[counters::overflow(pass, steps) as usize] != 0)
        };
        let depth = self.views.depth;
        let mut parts = Vec::with_capacity(self.parts.len());
        let mut any = false;
        for (pass, part) in (0..).zip(&self.parts) {
            if !has_overflowed(pass) {
                parts.push(*part);
                continue;
            }
            let smaller = part.split(depth);
            if smaller.is_empty() || self.parts.len() > MAX_PARTS {
                let needed = words.iter().copied().map(u64::from).max().unwrap_or(0) * 8;
                let limit = self.queues.pairs[0].size();
                return Err(HierarchyError::TooLarge { what: "pairs of scene and views", needed, limit });
            }
            any = true;
            parts.extend(smaller);
        }
        self.parts = parts;
        self.multipass_level += u32::from(any);
        Ok(any)
    }

    /// The maps of the latest frame.
    pub fn maps(&self) -> &MapSet {
        &self.maps
    }

    /// A word a view of the latest frame: the index of its map. Views of one leaf share a map.
    pub fn map_of_view(&self) -> &Buffer {
        &self.views.leaf_of_view
    }

    /// Reads back the map index of each view of the latest frame.
    ///
    /// # Errors
    /// The device failed.
    pub fn map_of_views(&self, views: usize) -> Result<Vec<u32>, HierarchyError> {
        let size = views as u64 * 4;
        let mut commands = self.gpu.commands("maps of views");
        let pending = commands.read_buffer(&self.views.leaf_of_view, 0..size);
        let bytes = commands.submit().wait()?.take(pending);
        Ok(bytemuck::pod_collect_to_vec(&bytes[..size as usize]))
    }

    /// Reads back the centre of each map of the latest frame, world space.
    ///
    /// # Errors
    /// The device failed.
    pub fn read_map_centers(&self) -> Result<Vec<DVec3>, HierarchyError> {
        let size = u64::from(self.maps.capacity) * 16;
        let mut commands = self.gpu.commands("map centres");
        let pending = commands.read_buffer(&self.views.maps, 0..size.min(self.views.maps.size()));
        let words: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&commands.submit().wait()?.take(pending)[..]);
        let world = |w: &[f32; 4]| self.octree.root.world_from_unit(Vec3::new(w[0], w[1], w[2]).as_dvec3());
        Ok(words.iter().map(world).collect())
    }

    /// Four words a map of the latest frame: its centre (f32, edges of the octree's root), and the index of its parent
    /// map.
    pub fn map_centers(&self) -> &Buffer {
        &self.views.maps
    }

    /// The octree of the maps.
    pub fn octree(&self) -> &Arc<Octree> {
        &self.octree
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Looks up texels in the latest frame's maps and their parents, fused or not. Returns for each (map, texel) the bits
    /// of its inverse range, and its node.
    ///
    /// # Errors
    /// The device failed.
    pub fn query(&self, queries: &[[u32; 2]]) -> Result<Vec<[u32; 2]>, HierarchyError> {
        let asked = self.gpu.upload("queries", queries, BufferUsages::STORAGE);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let answers = self.gpu.buffer("answers", queries.len() as u64 * 8, usage);
        let mut commands = self.gpu.commands("query");
        self.fuse.query(&mut commands, &self.inputs(&[]), &asked, queries.len() as u32, &answers);
        let pending = commands.read_buffer(&answers, 0..queries.len() as u64 * 8);
        let bytes = commands.submit().wait()?.take(pending);
        Ok(bytemuck::pod_collect_to_vec(&bytes[..queries.len() * 8]))
    }

    fn inputs<'a>(&'a self, steps: &'a [Step]) -> TraversalInputs<'a> {
        let Self { octree, views, maps, queues, settings, .. } = self;
        TraversalInputs { octree, views, maps, queues, settings, steps, owners: self.owners.as_ref() }
    }

    fn record(&self, commands: &mut Commands, views: &ViewList, steps: &[Step]) {
        let inputs = self.inputs(steps);
        commands.clear(&self.queues.counters);
        if self.settings.occlusion != Occlusion::Known {
            for array in &self.maps.arrays {
                commands.clear(array);
            }
        }
        if self.shares() {
            self.builder.build(commands, views, &self.settings, &self.views);
        } else {
            self.builder.singles(commands, views, &self.settings, &self.views);
        }
        let shells = self.settings.shells();
        for (pass, part) in (0..).zip(self.passes()) {
            self.traverse.run(commands, &inputs, pass, part, shells[pass as usize % shells.len()]);
        }
        if self.shares() && self.settings.fusion {
            self.fuse.run(commands, &self.traverse, &inputs);
        }
    }

    /// Passes: each part once for each shell.
    fn passes(&self) -> Vec<Part> {
        let shells = self.settings.shells().len();
        self.parts.iter().flat_map(|part| std::iter::repeat_n(*part, shells)).collect()
    }

    /// Whether the next frame uses a view octree.
    fn shares(&self) -> bool {
        self.settings.sharing && !self.fell_back
    }

    /// Levels of the view octree by position (0 without one), and whether there is one more by direction.
    fn view_levels(&self, views: &ViewList) -> (u32, bool) {
        if !self.shares() {
            return (0, false);
        }
        let places = self.settings.view_depth.unwrap_or_else(|| views.depth_for(self.octree.depth));
        // Morton codes of more levels do not fit.
        (places, self.settings.tells_directions && views.look && places < MAX_DEPTH)
    }

    /// Allocates the view octree, and at first about as many maps as views.
    fn make_room(&mut self, views: &ViewList) -> Result<(), HierarchyError> {
        if self.views.capacity != views.count {
            self.fell_back = false;
        }
        let levels = self.view_levels(views);
        if self.views.capacity != views.count || (self.views.places(), self.views.by_direction) != levels {
            self.views = ViewOctree::new(&self.gpu, views.count, levels.0, levels.1)?;
            let maps = if self.shares() { views.count.min(1 << 14) } else { views.count };
            self.set_maps(maps)?;
            let whole = Part::Views { first: 0, count: views.count };
            self.parts = vec![if self.shares() { Part::Octants { path: 0, level: 0 } } else { whole }];
            self.multipass_level = 0;
        }
        Ok(())
    }

    fn set_maps(&mut self, maps: u32) -> Result<(), HierarchyError> {
        let maps = MapSet::new(&self.gpu, self.settings.side, self.maps.code, maps)?;
        debug_assert!(maps.arrays.len() <= MAX_ARRAYS as usize);
        if maps.arrays.len() != self.maps.arrays.len() {
            self.traverse = Traverse::new(&self.gpu, &self.settings, &maps, self.owners.is_some());
            self.fuse = Fuse::new(&self.gpu, &maps);
        }
        self.maps = maps;
        Ok(())
    }

    /// Allocates the counters of all passes.
    fn make_counters(&mut self, words: u32) {
        let words = words.max(HEAD);
        if self.queues.counters.size() < u64::from(words) * 4 {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
            self.queues.counters = self.gpu.buffer("counters", u64::from(words) * 4, usage);
        }
    }
}
