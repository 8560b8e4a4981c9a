//! ManyLoDs (Holländer et al. 2011): a cut through a sphere tree for every view, found from the root or from the last
//! frame's cut, and a map of inverse range drawn from each.
//!
//! The test of a node gives a margin (`shaders/shared/cut.wgsl`) that changes by at most the motion of the view or the
//! sphere. So it also bounds the motion until the node must be tested again. Entries are in chunks of 64, sorted by due
//! time on a clock of motion; only due chunks are tested and sorted again. While views move steadily, due times follow
//! their course; the first sharp turn makes all chunks due once. Spheres and cells are padded by level, so that f32 tests
//! of children never contradict those of parents: cuts equal those found from the root. Lazy cuts descend few edges a
//! frame, and may lag while views move. A view that jumps restarts. `argus-lab study method manylods` measures it.

use std::sync::Arc;
use std::time::Instant;

use argus_gpu::wgpu::{Buffer, BufferUsages};

use argus_megaviews::many_views::{MapSet, TexelCode, ViewList};

use crate::counters::{CutStats, OVERFLOW, WORDS, WRAPPED};
use crate::draw::DrawPasses;
use crate::passes::{CutPasses, CutWork};
use crate::pool::{CHUNK, Pool, most_entries};
use crate::settings::{CutMethod, CutSettings};
use crate::tree::CutTree;
use argus_gpu::Gpu;
use argus_megaviews::hierarchy::HierarchyError;

/// Most views, by the bits of a view's index in an entry.
const MAX_VIEWS: u32 = 1 << 24;
/// Initial capacity of a view's cut, nodes.
const FIRST_GUESS: u64 = 1024;
/// Bytes of a view's `Eye`: `shaders/shared/cut.wgsl`.
const EYE_BYTES: u64 = 48;
/// Reading of the clock beyond which all views restart and it is reset.
const LATE: u32 = 1 << 31;

/// Cuts of many views through one tree, frame by frame.
#[derive(Debug)]
pub struct ManyLods {
    gpu: Arc<Gpu>,
    tree: CutTree,
    settings: CutSettings,
    code: TexelCode,
    passes: CutPasses,
    draw: Option<(usize, DrawPasses)>,
    pool: Pool,
    eyes: Buffer,
    maps: Option<MapSet>,
    /// Number of views of the last frame; 0 without cuts.
    views: u32,
}

impl ManyLods {
    /// Makes the pipelines.
    ///
    /// # Errors
    /// A setting out of range, or more nodes than texels can index.
    pub fn new(gpu: &Arc<Gpu>, tree: CutTree, settings: CutSettings) -> Result<Self, HierarchyError> {
        settings.validate()?;
        let ordered = settings.method != CutMethod::Basic;
        Ok(Self {
            code: TexelCode::new(settings.texel, tree.node_count(), tree.root.edge)?,
            passes: CutPasses::new(gpu, &settings),
            draw: None,
            pool: Pool::new(gpu, CHUNK, ordered)?,
            eyes: gpu.buffer("eyes", EYE_BYTES, BufferUsages::STORAGE),
            maps: None,
            views: 0,
            gpu: Arc::clone(gpu),
            tree,
            settings,
        })
    }

    /// Finds the cuts of all views without drawing them. Views keep their indices from frame to frame.
    ///
    /// # Errors
    /// Cuts exceed the device's memory, or the device failed.
    pub fn select(&mut self, views: &ViewList) -> Result<CutStats, HierarchyError> {
        self.frame(views, false)
    }

    /// Finds the cuts of all views and draws their maps. Map and view have the same index.
    ///
    /// # Errors
    /// Cuts or maps exceed the device's memory, or the device failed.
    pub fn render(&mut self, views: &ViewList) -> Result<CutStats, HierarchyError> {
        self.frame(views, true)
    }

    fn frame(&mut self, views: &ViewList, draws: bool) -> Result<CutStats, HierarchyError> {
        let begin = Instant::now();
        let mut restart = self.make_room(views, draws)?;
        let mut reruns = 0;
        loop {
            let mut commands = self.gpu.commands("cuts of many views");
            let work = CutWork {
                tree: &self.tree,
                settings: &self.settings,
                pool: &self.pool,
                eyes: &self.eyes,
                views,
                restart,
            };
            if let (Some(maps), true) = (&self.maps, draws) {
                maps.arrays.iter().for_each(|array| {
                    commands.clear(array);
                });
            }
            self.passes.run(&mut commands, &work);
            if let (Some(maps), Some((_, draw)), true) = (&self.maps, &self.draw, draws) {
                draw.run(&mut commands, &work, maps);
            }
            let words = commands.read_buffer(&self.pool.counters, 0..u64::from(WORDS) * 4);
            let state = commands.read_buffer(&self.pool.state, 0..4);
            let mut finished = commands.submit().wait()?;
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(&finished.take(words)[..]);
            let clock: u32 = bytemuck::pod_read_unaligned(&finished.take(state)[..4]);
            if words[OVERFLOW] == 0 && words[WRAPPED] == 0 {
                self.views = if clock < LATE { views.count() } else { 0 };
                return Ok(CutStats {
                    reruns,
                    frame_ms: begin.elapsed().as_secs_f64() * 1e3,
                    stages: finished.stages,
                    cut_bytes: self.pool.bytes(),
                    map_bytes: self.maps.as_ref().map_or(0, MapSet::bytes),
                    ..CutStats::of(&words)
                });
            }
            // Cuts that overflowed may fit after a restart, which compacts them. Cuts that overflow after a restart need
            // larger buffers.
            if words[OVERFLOW] != 0 && restart {
                self.grow()?;
            }
            restart = true;
            reruns += 1;
        }
    }

    /// The maps of the latest frame that drew maps.
    pub fn maps(&self) -> Option<&MapSet> {
        self.maps.as_ref()
    }

    /// Reads back the cuts of the latest frame: node and view of each entry, sorted by view and node.
    ///
    /// # Errors
    /// The device failed.
    pub fn cuts(&self) -> Result<Vec<[u32; 2]>, HierarchyError> {
        let mut commands = self.gpu.commands("read cuts");
        let pending = [&self.pool.entries, &self.pool.chunks, &self.pool.state, &self.eyes]
            .map(|buffer| commands.read_buffer(buffer, 0..buffer.size()));
        let mut finished = commands.submit().wait()?;
        let [entries, chunks, state, eyes] = pending.map(|pending| finished.take(pending));
        let entries: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&entries[..]);
        let chunks: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&chunks[..]);
        let state: Vec<u32> = bytemuck::pod_collect_to_vec(&state[..]);
        let eyes: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&eyes[..]);
        // As many chunks as were ever in use; stale entries have another generation than their view.
        let used = chunks.iter().take(state[4] as usize).zip(entries.chunks_exact(CHUNK as usize));
        let is_current = |entry: &&[u32; 2]| eyes[3 * (entry[1] & 0xff_ffff) as usize][3] == entry[1] >> 24;
        let mut cuts: Vec<[u32; 2]> = used
            .flat_map(|(chunk, entries)| entries[..chunk[1] as usize].iter().filter(is_current))
            .map(|entry| [entry[0], entry[1] & 0xff_ffff])
            .collect();
        cuts.sort_unstable_by_key(|entry| (entry[1], entry[0]));
        Ok(cuts)
    }

    /// Drops the cuts. The next frame starts from the root.
    pub fn forget(&mut self) {
        self.views = 0;
    }

    /// Allocates buffers for the views. Returns whether their cuts start from the root.
    fn make_room(&mut self, views: &ViewList, draws: bool) -> Result<bool, HierarchyError> {
        if views.count() > MAX_VIEWS {
            return Err(HierarchyError::OutOfRange {
                field: "views",
                range: format!("at most {MAX_VIEWS}"),
                value: views.count().to_string(),
            });
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        if self.eyes.size() != u64::from(views.count()) * EYE_BYTES {
            self.eyes = self.gpu.buffer("eyes", u64::from(views.count()) * EYE_BYTES, usage);
            self.views = 0;
        }
        let guess = u64::from(views.count()) * FIRST_GUESS;
        let wanted = self.settings.entries.unwrap_or(guess.min(u64::from(most_entries(&self.gpu))) as u32);
        if self.pool.capacity < wanted {
            self.pool = Pool::new(&self.gpu, wanted, self.settings.method != CutMethod::Basic)?;
            self.views = 0;
        }
        if draws && self.maps.as_ref().is_none_or(|maps| maps.capacity != views.count()) {
            let maps = MapSet::new(&self.gpu, self.settings.side, self.code, views.count())?;
            let arrays = maps.arrays.len();
            if self.draw.as_ref().is_none_or(|(made_for, _)| *made_for != arrays) {
                self.draw =
                    Some((arrays, DrawPasses::new(&self.gpu, &self.settings, self.tree.surfels, &maps)));
            }
            self.maps = Some(maps);
        }
        Ok(self.views != views.count() || self.settings.method == CutMethod::Basic)
    }

    fn grow(&mut self) -> Result<(), HierarchyError> {
        let most = self.settings.entries.unwrap_or_else(|| most_entries(&self.gpu));
        if self.pool.capacity >= most {
            let needed = u64::from(most) * 8;
            return Err(HierarchyError::TooLarge {
                what: "cuts of all views",
                needed: needed + 8,
                limit: needed,
            });
        }
        let capacity = self.pool.capacity.saturating_mul(2).min(most);
        self.pool = Pool::new(&self.gpu, capacity, self.settings.method != CutMethod::Basic)?;
        Ok(())
    }
}
