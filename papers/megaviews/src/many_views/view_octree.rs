//! The octree over the views, built each frame. Program: `shaders/view_octree.wgsl`.

use crate::layout::ViewStep;
use crate::programs::VIEW_OCTREE;
use argus_gpu::wgpu::{Buffer, BufferUsages};

use super::{Bounding, Settings, ViewList};
use crate::hierarchy::{HierarchyError, LevelBuffers, LevelBuilder, MAX_DEPTH, fits, numbered};
use argus_gpu::{
    Commands, ComputePipeline, Gpu, LengthAt, ListScan, Lists, Scan, ScanSums, Sort, SortScratch,
};

/// The pipelines.
#[derive(Debug)]
pub(super) struct ViewOctreeBuilder {
    scan: Scan,
    lists: ListScan,
    sort: Sort,
    levels: LevelBuilder,
    view_keys: ComputePipeline,
    single_views: ComputePipeline,
    view_leaves: ComputePipeline,
    view_nodes: ComputePipeline,
    map_heads: ComputePipeline,
    map_links: ComputePipeline,
    map_parents: ComputePipeline,
    map_ranges: ComputePipeline,
}

/// The view octree and the buffers that build it, for a maximal number of views.
#[derive(Debug)]
pub(super) struct ViewOctree {
    pub(super) capacity: u32,
    pub(super) depth: u32,
    /// Whether the lowest level divides views by direction.
    pub(super) by_direction: bool,
    /// Two vec4f a node: sphere of positions, and cone of directions.
    pub(super) bounds: Buffer,
    /// A vec4u a node: mean position and children.
    pub(super) links: Buffer,
    /// A node's map and number of views.
    pub(super) node_maps: Buffer,
    /// Leaf of each view, which is its map.
    pub(super) leaf_of_view: Buffer,
    /// A vec4u a map: mean position of its views, and its parent map.
    pub(super) maps: Buffer,
    /// First map and number of maps of each level.
    pub(super) map_levels: Buffer,
    pub(super) nodes: LevelBuffers,
    heads: Buffer,
    sums: ScanSums,
    /// Nodes of each level, and those of all levels.
    lists: Lists,
    keys: Buffer,
    scratch: SortScratch,
    node_capacity: u64,
}

/// Index of the list of all nodes, after those of the levels.
const ALL_NODES: u32 = MAX_DEPTH + 1;

/// Most nodes of a level.
fn bound(views: u32, level: u32) -> u32 {
    u64::from(views).min(1 << (3 * level)) as u32
}

impl ViewOctree {
    /// Allocates a view octree for at most `capacity` views. `places` is the number of levels of cells (0: no octree);
    /// one more level may divide by direction.
    pub(super) fn new(
        gpu: &Gpu,
        capacity: u32,
        places: u32,
        by_direction: bool,
    ) -> Result<Self, HierarchyError> {
        let depth = places + u32::from(by_direction);
        let nodes: u64 = match depth {
            0 => u64::from(capacity),
            depth => (0..=depth).map(|level| u64::from(bound(capacity, level))).sum(),
        };
        if depth > 0 {
            numbered(nodes)?;
        }
        fits(gpu, "nodes of the view octree", nodes * 32)?;
        // Every inner map has at least two children.
        let maps = nodes.min(2 * u64::from(capacity));
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let sorted = if depth == 0 { 1 } else { u64::from(capacity) };
        let heads = if depth == 0 { 1 } else { nodes.max(sorted) };
        Ok(Self {
            capacity,
            depth,
            by_direction,
            bounds: gpu.buffer("bounds of view nodes", nodes * 32, usage),
            links: gpu.buffer("links of view nodes", nodes * 16, usage),
            node_maps: gpu.buffer("maps of view nodes", nodes * 8, usage),
            leaf_of_view: gpu.buffer("leaves of views", u64::from(capacity) * 4, usage),
            maps: gpu.buffer("map centres", maps * 16, usage),
            map_levels: gpu.buffer("maps of levels", 11 * 8, usage),
            nodes: LevelBuffers::new(gpu, sorted, if depth == 0 { 1 } else { nodes }),
            heads: gpu.buffer("heads", heads * 4, usage),
            sums: ScanSums::new(gpu, heads),
            lists: Lists::new(gpu, ALL_NODES + 1, heads as u32),
            keys: gpu.buffer("cells of views", sorted * 8, usage),
            scratch: SortScratch::new(gpu, sorted),
            node_capacity: nodes,
        })
    }

    /// Levels below the root that divide by position.
    pub(super) fn places(&self) -> u32 {
        self.depth - u32::from(self.by_direction)
    }

    /// Buffer of one u32: the number of maps.
    pub(super) fn map_total(&self) -> &Buffer {
        self.lists.total()
    }

    /// Bytes on the device, without build buffers.
    pub(super) fn bytes(&self) -> u64 {
        [&self.bounds, &self.links, &self.node_maps, &self.leaf_of_view, &self.maps]
            .into_iter()
            .map(Buffer::size)
            .sum()
    }
}

impl ViewOctreeBuilder {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let pipeline = |entry| gpu.compute_pipeline(&VIEW_OCTREE, entry);
        Self {
            scan: Scan::new(gpu),
            lists: ListScan::new(gpu),
            sort: Sort::new(gpu),
            levels: LevelBuilder::new(gpu),
            view_keys: pipeline("view_keys"),
            single_views: pipeline("single_views"),
            view_leaves: pipeline("view_leaves"),
            view_nodes: pipeline("view_nodes"),
            map_heads: pipeline("map_heads"),
            map_links: pipeline("map_links"),
            map_parents: pipeline("map_parents"),
            map_ranges: pipeline("map_ranges"),
        }
    }

    fn step(views: &ViewList, settings: &Settings, to: &ViewOctree, count: u32, level: u32) -> ViewStep {
        let tight = u32::from(settings.bounding == Bounding::Tight);
        let by_direction = u32::from(to.by_direction && level == to.depth);
        ViewStep {
            origin: views.origin.as_vec3().to_array(),
            edge: views.edge as f32,
            count,
            level,
            cells: (1u32 << level) as f32,
            flags: tight | by_direction << 1,
        }
    }

    /// Makes every view a node with its own map.
    pub(super) fn singles(
        &self,
        commands: &mut Commands,
        views: &ViewList,
        settings: &Settings,
        to: &ViewOctree,
    ) {
        let step = Self::step(views, settings, to, views.count, 0);
        commands
            .compute("view hierarchy", &self.single_views)
            .read("views", &views.buffer)
            .write("view_bounds", &to.bounds)
            .write("view_links", &to.links)
            .write("view_maps", &to.node_maps)
            .write("leaf_of_view", &to.leaf_of_view)
            .write("maps", &to.maps)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(views.count));
    }

    /// Builds the octree of the views and assigns maps to its nodes.
    pub(super) fn build(
        &self,
        commands: &mut Commands,
        views: &ViewList,
        settings: &Settings,
        to: &ViewOctree,
    ) {
        let (name, depth) = ("view hierarchy", to.depth);
        let step = Self::step(views, settings, to, views.count, depth);
        commands
            .compute(name, &self.view_keys)
            .read("views", &views.buffer)
            .write("keys", &to.keys)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(views.count));
        let bits = 32..32 + 3 * depth;
        let sorted = self.sort.run(commands, &self.scan, &to.keys, views.count, bits, &to.scratch);
        self.levels.number_leaves(commands, &self.scan, sorted, views.count, &to.heads, &to.sums);
        self.levels.find_leaves(commands, sorted, views.count, depth, &to.heads, &to.sums, &to.nodes);
        commands
            .compute(name, &self.view_leaves)
            .read("views", &views.buffer)
            .read("sorted", sorted)
            .read("starts", &to.nodes.starts)
            .read("levels", &to.nodes.levels)
            .read("codes", &to.nodes.codes)
            .write("view_bounds", &to.bounds)
            .write("view_links", &to.links)
            .write("view_maps", &to.node_maps)
            .write("leaf_of_view", &to.leaf_of_view)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(views.count));
        let lists = (&self.lists, &to.lists);
        self.levels.advance(commands, lists, depth, &to.nodes);
        for level in (0..depth).rev() {
            self.levels.make_level(commands, lists, level, &to.heads, &to.nodes);
            self.levels.advance(commands, lists, level, &to.nodes);
            to.lists.dispatch(
                commands
                    .compute(name, &self.view_nodes)
                    .read("levels", &to.nodes.levels)
                    .read("codes", &to.nodes.codes)
                    .read("first_children", &to.nodes.first_children)
                    .write("view_bounds", &to.bounds)
                    .write("view_links", &to.links)
                    .write("view_maps", &to.node_maps)
                    .immediates(bytemuck::bytes_of(&Self::step(views, settings, to, 0, level))),
            );
        }
        self.number_maps(commands, views, settings, to);
    }

    /// Assigns a map to every leaf and every node with several children, and links each map to its parent.
    fn number_maps(&self, commands: &mut Commands, views: &ViewList, settings: &Settings, to: &ViewOctree) {
        let name = "view hierarchy";
        let step = Self::step(views, settings, to, to.node_capacity as u32, to.depth);
        // The root is the last node.
        let all = LengthAt { buffer: &to.nodes.levels, word: 0, more: 1 };
        self.lists.advance(commands, name, &to.lists, ALL_NODES, all);
        to.lists.dispatch(
            commands
                .compute(name, &self.map_heads)
                .read("levels", &to.nodes.levels)
                .write("view_links", &to.links)
                .write("heads", &to.heads)
                .immediates(bytemuck::bytes_of(&step)),
        );
        self.lists.run(commands, name, &to.lists, ALL_NODES, &to.heads);
        to.lists.dispatch(
            commands
                .compute(name, &self.map_links)
                .read("levels", &to.nodes.levels)
                .write("view_links", &to.links)
                .write("view_maps", &to.node_maps)
                .write("heads", &to.heads)
                .write("maps", &to.maps)
                .immediates(bytemuck::bytes_of(&step)),
        );
        to.lists.dispatch(
            commands
                .compute(name, &self.map_parents)
                .read("levels", &to.nodes.levels)
                .write("view_links", &to.links)
                .write("view_maps", &to.node_maps)
                .write("maps", &to.maps)
                .immediates(bytemuck::bytes_of(&step)),
        );
        commands
            .compute(name, &self.map_ranges)
            .read("levels", &to.nodes.levels)
            .write("heads", &to.heads)
            .read("total", to.map_total())
            .write("map_levels", &to.map_levels)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch([1, 1, 1]);
    }
}
