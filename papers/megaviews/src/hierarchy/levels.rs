//! Makes octree nodes from sorted Morton codes. Program: `shaders/levels.wgsl`.

use crate::layout::LevelStep;
use crate::programs::LEVELS;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use argus_gpu::{Commands, ComputePipeline, Gpu, LengthAt, ListScan, Lists, Scan, ScanSums};

/// The pipelines.
#[derive(Debug)]
pub(crate) struct LevelBuilder {
    leaf_heads: ComputePipeline,
    leaf_starts: ComputePipeline,
    level_ranges: ComputePipeline,
    node_heads: ComputePipeline,
    node_links: ComputePipeline,
}

/// Arrays over the nodes of all levels. Leaves come first, the root last.
#[derive(Debug)]
pub(crate) struct LevelBuffers {
    /// Index of each leaf's first sorted element; after the last leaf, the number of elements.
    pub(crate) starts: Buffer,
    /// Morton code of each node.
    pub(crate) codes: Buffer,
    /// First child of each inner node.
    pub(crate) first_children: Buffer,
    /// First node and number of nodes of each level, two u32 each.
    pub(crate) levels: Buffer,
    histogram: Buffer,
}

/// Entries of [`LevelBuffers::levels`].
pub(crate) const LEVELS_BYTES: u64 = 11 * 8;

impl LevelBuffers {
    /// Buffers for at most `leaves` leaves and `nodes` nodes, leaves included.
    pub(crate) fn new(gpu: &Gpu, leaves: u64, nodes: u64) -> Self {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        Self {
            starts: gpu.buffer("starts of leaves", (leaves + 1) * 4, usage),
            codes: gpu.buffer("codes of nodes", nodes * 4, usage),
            first_children: gpu.buffer("first children", nodes * 4, usage),
            levels: gpu.buffer("levels", LEVELS_BYTES, usage),
            histogram: gpu.buffer("leaves by level of divergence", LEVELS_BYTES, usage),
        }
    }
}

impl LevelBuilder {
    /// Makes the pipelines.
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&LEVELS, entry);
        Self {
            leaf_heads: pipeline("leaf_heads"),
            leaf_starts: pipeline("leaf_starts"),
            level_ranges: pipeline("level_ranges"),
            node_heads: pipeline("node_heads"),
            node_links: pipeline("node_links"),
        }
    }

    /// Numbers the leaves. Afterwards `heads` has the leaf of each sorted element that starts one, and the scan's total
    /// is the number of leaves.
    pub(crate) fn number_leaves(
        &self,
        commands: &mut Commands,
        scan: &Scan,
        sorted: &Buffer,
        count: u32,
        heads: &Buffer,
        sums: &ScanSums,
    ) {
        let step = LevelStep { count, level: 0, depth: 0 };
        commands
            .compute("levels", &self.leaf_heads)
            .read("sorted", sorted)
            .write("heads", heads)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(count));
        scan.run(commands, "levels", heads, count, sums);
    }

    /// Computes the start of each leaf, and the number of nodes of each level.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn find_leaves(
        &self,
        commands: &mut Commands,
        sorted: &Buffer,
        count: u32,
        depth: u32,
        heads: &Buffer,
        sums: &ScanSums,
        to: &LevelBuffers,
    ) {
        let step = LevelStep { count, level: depth, depth };
        commands.clear(&to.histogram);
        commands
            .compute("levels", &self.leaf_starts)
            .read("sorted", sorted)
            .write("heads", heads)
            .read("total", sums.total())
            .write("starts", &to.starts)
            .write("codes", &to.codes)
            .write("histogram", &to.histogram)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(count));
        commands
            .compute("levels", &self.level_ranges)
            .write("levels", &to.levels)
            .write("histogram", &to.histogram)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch([1, 1, 1]);
    }

    /// Comes to the list of a level's nodes, whose index is the level.
    pub(crate) fn advance(
        &self,
        commands: &mut Commands,
        (scan, lists): (&ListScan, &Lists),
        level: u32,
        to: &LevelBuffers,
    ) {
        let length = LengthAt { buffer: &to.levels, word: 2 * level + 1, more: 0 };
        scan.advance(commands, "levels", lists, level, length);
    }

    /// Makes the codes and links of a level from the level below. [`Self::advance`] must have come to that one. No length is
    /// read back.
    pub(crate) fn make_level(
        &self,
        commands: &mut Commands,
        (scan, lists): (&ListScan, &Lists),
        level: u32,
        heads: &Buffer,
        to: &LevelBuffers,
    ) {
        let step = LevelStep { count: 0, level, depth: 0 };
        lists.dispatch(
            commands
                .compute("levels", &self.node_heads)
                .write("heads", heads)
                .write("levels", &to.levels)
                .write("codes", &to.codes)
                .immediates(bytemuck::bytes_of(&step)),
        );
        scan.run(commands, "levels", lists, level + 1, heads);
        lists.dispatch(
            commands
                .compute("levels", &self.node_links)
                .write("heads", heads)
                .write("levels", &to.levels)
                .write("codes", &to.codes)
                .write("first_children", &to.first_children)
                .immediates(bytemuck::bytes_of(&step)),
        );
    }
}
