//! A frame of many views, from top to bottom.

use std::sync::Arc;
use std::time::Instant;

use wgpu::{Buffer, BufferUsages};

use super::counters::{self, FrameStats, HEAD, entry};
use super::fuse::Fuse;
use super::maps::MAX_ARRAYS;
use super::schedule::{Step, steps};
use super::traverse::{Part, Queues, Traverse, Work};
use super::view_octree::{ViewOctree, ViewOctreeBuilder};
use super::{Knobs, MapSet, ViewList};
use crate::hierarchy::{HierarchyError, Octree};
use crate::{Commands, Gpu};

/// Most times that queues are split in eight.
const MAX_SPLIT: u32 = 5;
/// Bytes of a queue where nobody says otherwise, at most.
const QUEUE_BYTES: u64 = 1 << 30;

/// Renders maps of one octree, frame after frame; remembers at which split and with how many maps the last one fitted.
#[derive(Debug)]
pub struct ManyViews {
    gpu: Arc<Gpu>,
    octree: Arc<Octree>,
    knobs: Knobs,
    builder: ViewOctreeBuilder,
    traverse: Traverse,
    fuse: Fuse,
    views: ViewOctree,
    maps: MapSet,
    queues: Queues,
    split: u32,
}

impl ManyViews {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// A knob out of range, or a device that lacks what it takes.
    pub fn new(gpu: &Arc<Gpu>, octree: Arc<Octree>, knobs: Knobs) -> Result<Self, HierarchyError> {
        knobs.validate()?;
        let limits = gpu.device.limits();
        let limit = u64::from(limits.max_storage_buffer_binding_size).min(limits.max_buffer_size);
        let pairs = (limit.min(QUEUE_BYTES) / 8) as u32;
        let pairs = knobs.queue_pairs.map_or(pairs, |n| n.min(pairs));
        let maps = MapSet::new(gpu, &knobs, 1)?;
        Ok(Self {
            builder: ViewOctreeBuilder::new(gpu),
            traverse: Traverse::new(gpu, &knobs, 1),
            fuse: Fuse::new(gpu, &knobs, 1),
            views: ViewOctree::new(gpu, 0, 0)?,
            maps,
            queues: Queues::new(gpu, pairs, 0),
            split: 0,
            gpu: Arc::clone(gpu),
            octree,
            knobs,
        })
    }

    /// Renders the maps of all views. A frame in which a queue or the maps overflowed is thrown away and run again,
    /// split in eight once more; the next frame begins with that split.
    ///
    /// # Errors
    /// Maps or queues that do not fit into this device's memory however they are split, or a fault of the device.
    pub fn render(&mut self, views: &ViewList) -> Result<FrameStats, HierarchyError> {
        let begin = Instant::now();
        self.make_room(views)?;
        let mut reruns = 0;
        loop {
            let steps = steps(self.octree.depth, self.view_depth(), views.edge);
            let passes = 1 << (3 * self.split);
            self.make_counters(entry(passes, 0, steps.len()));
            let mut commands = self.gpu.commands("many views");
            self.record(&mut commands, views, &steps);
            let words =
                commands.read_buffer(&self.queues.counters, 0..u64::from(entry(passes, 0, steps.len())) * 4);
            let map_total = commands.read_buffer(self.views.map_total(), 0..4);
            let levels = commands.read_buffer(&self.views.nodes.levels, 0..88);
            let mut finished = commands.submit().wait()?;
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(&finished.take(words)[..]);
            let map_total: Vec<u32> = bytemuck::pod_collect_to_vec(&finished.take(map_total)[..4]);
            let levels: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&finished.take(levels)[..88]);
            let singles = [views.count; 3];
            let sizes = [map_total[0], levels[0][0] + 1, levels[self.view_depth() as usize][1]];
            let [maps, view_nodes, view_leaves] = if self.knobs.sharing { sizes } else { singles };
            match words[0] {
                0 => {
                    return Ok(FrameStats {
                        steps: counters::read(&words, &steps, passes),
                        multipass_level: self.split,
                        reruns,
                        maps,
                        view_nodes,
                        view_leaves,
                        frame_ms: begin.elapsed().as_secs_f64() * 1e3,
                        stages: finished.stages,
                        map_bytes: self.maps.bytes(),
                        queue_bytes: self.queues.pairs.iter().map(Buffer::size).sum(),
                        view_bytes: self.views.bytes(),
                    });
                }
                _ if maps > self.maps.capacity => {
                    // Views move: a little room saves the next frames from the same.
                    let roomy = maps.saturating_add(maps / 16);
                    self.set_maps(roomy).or_else(|_| self.set_maps(maps))?;
                }
                _ if self.split < MAX_SPLIT && self.split < self.deepest_split(views) => self.split += 1,
                _ => {
                    let needed = words.iter().copied().map(u64::from).max().unwrap_or(0) * 8;
                    let limit = self.queues.pairs[0].size();
                    return Err(HierarchyError::TooLarge { what: "pairs of scene and views", needed, limit });
                }
            }
            reruns += 1;
        }
    }

    /// The maps of the latest frame.
    pub fn maps(&self) -> &MapSet {
        &self.maps
    }

    /// A word a view of the latest frame: its map, which views of one leaf share.
    pub fn map_of_view(&self) -> &Buffer {
        &self.views.leaf_of_view
    }

    /// Four words a map of the latest frame: the position that it is rendered from (f32, edges of the octree's root),
    /// and the map that it continues.
    pub fn middles(&self) -> &Buffer {
        &self.views.maps
    }

    /// The knobs.
    pub fn knobs(&self) -> &Knobs {
        &self.knobs
    }

    /// Looks texels up in the latest frame's maps, those above them included, whether they are fused or not: for each
    /// (map, texel), the bits of its inverse range and its node.
    ///
    /// # Errors
    /// A fault of the device.
    pub fn query(&self, queries: &[[u32; 2]]) -> Result<Vec<[u32; 2]>, HierarchyError> {
        let asked = self.gpu.upload("queries", queries, BufferUsages::STORAGE);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let answers = self.gpu.buffer("answers", queries.len() as u64 * 8, usage);
        let mut commands = self.gpu.commands("query");
        self.fuse.query(&mut commands, &self.work(&[]), &asked, queries.len() as u32, &answers);
        let ticket = commands.read_buffer(&answers, 0..queries.len() as u64 * 8);
        let bytes = commands.submit().wait()?.take(ticket);
        Ok(bytemuck::pod_collect_to_vec(&bytes[..queries.len() * 8]))
    }

    fn work<'a>(&'a self, steps: &'a [Step]) -> Work<'a> {
        let Self { octree, views, maps, queues, knobs, .. } = self;
        Work { octree, views, maps, queues, knobs, steps }
    }

    fn record(&self, commands: &mut Commands, views: &ViewList, steps: &[Step]) {
        let work = self.work(steps);
        commands.clear(&self.queues.counters);
        for array in &self.maps.arrays {
            commands.clear(array);
        }
        let parts = 1u32 << (3 * self.split);
        if !self.knobs.sharing {
            self.builder.singles(commands, views, &self.knobs, &self.views);
            let each = views.count.div_ceil(parts).max(1);
            for (pass, first) in (0..views.count).step_by(each as usize).enumerate() {
                let count = each.min(views.count - first);
                self.traverse.run(commands, &work, pass as u32, Part::Views { first, count });
            }
            return;
        }
        self.builder.build(commands, views, &self.knobs, &self.views);
        for path in 0..parts {
            self.traverse.run(commands, &work, path, Part::Octants { path, level: self.split });
        }
        if self.knobs.fusion {
            self.fuse.run(commands, &self.traverse, &work);
        }
    }

    /// Levels of the hierarchy over the views; 0 without one.
    fn view_depth(&self) -> u32 {
        if self.knobs.sharing { self.knobs.view_depth } else { 0 }
    }

    fn deepest_split(&self, views: &ViewList) -> u32 {
        if self.knobs.sharing { self.knobs.view_depth } else { views.count.ilog2() / 3 + 1 }
    }

    /// Room for the views and, to begin with, for about as many maps.
    fn make_room(&mut self, views: &ViewList) -> Result<(), HierarchyError> {
        if self.views.capacity != views.count || self.views.depth != self.view_depth() {
            self.views = ViewOctree::new(&self.gpu, views.count, self.view_depth())?;
            let maps = if self.knobs.sharing { views.count.min(1 << 14) } else { views.count };
            self.set_maps(maps)?;
        }
        Ok(())
    }

    fn set_maps(&mut self, maps: u32) -> Result<(), HierarchyError> {
        let maps = MapSet::new(&self.gpu, &self.knobs, maps)?;
        debug_assert!(maps.arrays.len() <= MAX_ARRAYS as usize);
        if maps.arrays.len() != self.maps.arrays.len() {
            self.traverse = Traverse::new(&self.gpu, &self.knobs, maps.arrays.len());
            self.fuse = Fuse::new(&self.gpu, &self.knobs, maps.arrays.len());
        }
        self.maps = maps;
        Ok(())
    }

    /// Room for the counters of all passes.
    fn make_counters(&mut self, words: u32) {
        let words = words.max(HEAD);
        if self.queues.counters.size() < u64::from(words) * 4 {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
            self.queues.counters = self.gpu.buffer("counters", u64::from(words) * 4, usage);
        }
    }
}
