//! `shaders/gpu/*.wgsl`: hierarchies and the traversal of two of them.

use super::Mirror;

/// All of this file's.
pub(super) const MIRRORS: &[Mirror] = &[
    Digit::MIRROR,
    Split::MIRROR,
    LevelStep::MIRROR,
    Average::MIRROR,
    ViewStep::MIRROR,
    PairStep::MIRROR,
    QueueStep::MIRROR,
    FillStep::MIRROR,
    Fusion::MIRROR,
    RasterStep::MIRROR,
    SphereStep::MIRROR,
    CellStep::MIRROR,
    CutStep::MIRROR,
    DrawStep::MIRROR,
    ImperfectStep::MIRROR,
    Scatter::MIRROR,
];

mirror! {
    /// One digit of a radix sort: `gpu/sort.wgsl`.
    pub struct Digit {
        /// Keys.
        pub count: u32,
        /// Runs of keys.
        pub runs: u32,
        /// Lowest bit of the digit.
        pub shift: u32,
    }
}

mirror! {
    /// One level of voxelisation: `gpu/voxelize.wgsl`.
    pub struct Split {
        /// Pairs of a triangle and a cell.
        pub count: u32,
        /// Cells along an edge of the root, one level further down.
        pub cells: f32,
    }
}

mirror! {
    /// One level of an octree in the making: `gpu/levels.wgsl`.
    pub struct LevelStep {
        /// Sorted elements, or most nodes there can be.
        pub count: u32,
        /// The level that is made.
        pub level: u32,
        /// Levels below the root.
        pub depth: u32,
    }
}

mirror! {
    /// One level of the scene's octree: `gpu/octree.wgsl`.
    pub struct Average {
        /// Most nodes there can be on the level.
        pub count: u32,
        /// The level.
        pub level: u32,
        /// Cells along an edge of the root on the level.
        pub cells: f32,
    }
}

mirror! {
    /// One step of a view octree: `gpu/view_octree.wgsl`.
    pub struct ViewStep {
        /// The views' root cube, in edges of the scene's.
        pub origin: [f32; 3],
        /// Its edge.
        pub edge: f32,
        /// Views, or most nodes there can be.
        pub count: u32,
        /// The level.
        pub level: u32,
        /// Cells along an edge of the root on the level.
        pub cells: f32,
        /// 1: spheres around the views themselves, where those are smaller than the cell's; 2: nodes of this level tell
        /// views apart by which way they look.
        pub flags: u32,
    }
}

mirror! {
    /// One step of a traversal: `gpu/traverse.wgsl`.
    pub struct PairStep {
        /// Cells along an edge of the scene's root, of the pairs that are tested.
        pub cells: f32,
        /// Radius of such a cell's sphere.
        pub radius: f32,
        /// Texels of a hemisphere's side.
        pub side: f32,
        /// How large a node may appear and still be rendered whole, texels.
        pub threshold: f32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Pairs that the queues hold.
        pub capacity: u32,
        /// Entry of the counters for this step's queue.
        pub counters_in: u32,
        /// Entry for the queue that it fills.
        pub counters_out: u32,
        /// Entry that says whether a queue of this part of the frame overflowed.
        pub overflow: u32,
        /// The only octant that this pass follows; 8: all.
        pub octant: u32,
        /// 1: the pairs of this step are counted.
        pub counted: u32,
        /// Maps of one array: 2 to the power of this.
        pub map_shift: u32,
        /// Pairs whose centers are nearer, edges of the root, are not rendered.
        pub near: f32,
        /// Pairs whose centers are at least this far, edges of the root, are not rendered.
        pub far: f32,
        /// 1: the view nodes of the pairs tested are leaves.
        pub leaf_views: u32,
        /// The owner of what belongs to the first view.
        pub first_owner: u32,
    }
}

mirror! {
    /// What goes before a step: `gpu/queue.wgsl`.
    pub struct QueueStep {
        /// Entry of the counters for the queue.
        pub counters: u32,
        /// Entry that says whether a queue of this part of the frame overflowed.
        pub overflow: u32,
        /// Where the three numbers of workgroups go.
        pub arguments: u32,
        /// Pairs that a workgroup takes.
        pub group: u32,
        /// The scene's root, or the first of its leaves.
        pub scene_node: u32,
        /// First view.
        pub first_view: u32,
        /// Pairs that a traversal begins with.
        pub count: u32,
        /// Of the view octree.
        pub level: u32,
        /// Maps that there is room for.
        pub maps: u32,
    }
}

mirror! {
    /// Leaves that cover many texels: `gpu/fill.wgsl`.
    pub struct FillStep {
        /// Cells along an edge of the scene's root.
        pub cells: f32,
        /// Radius of a cell's sphere.
        pub radius: f32,
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Pairs that the queue holds.
        pub capacity: u32,
        /// Entry of the counters for the queue.
        pub counters: u32,
        /// Maps of one array: 2 to the power of this.
        pub map_shift: u32,
    }
}

mirror! {
    /// Maps that take what those above them hold: `shared/map_fusion.wgsl`.
    pub struct Fusion {
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Maps of one array: 2 to the power of this.
        pub map_shift: u32,
        /// Level of the maps, or number of queries.
        pub level: u32,
    }
}

mirror! {
    /// Every triangle for every view: `gpu/raster_views.wgsl`.
    pub struct RasterStep {
        /// Triangles.
        pub triangles: u32,
        /// The first of the views that are rendered.
        pub first_view: u32,
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Maps of one array: 2 to the power of this.
        pub map_shift: u32,
    }
}

mirror! {
    /// One level of a tree of balls: `gpu/spheres.wgsl`.
    pub struct SphereStep {
        /// Points, or nodes of the level.
        pub count: u32,
        /// First node of the level.
        pub first: u32,
    }
}

mirror! {
    /// One level of an octree that is cut: `gpu/cut_tree.wgsl`.
    pub struct CellStep {
        /// Nodes of the level.
        pub count: u32,
        /// The first of them.
        pub first: u32,
        /// Cells along an edge of the root on the level.
        pub cells: f32,
        /// By how much a ball is larger than its cell's.
        pub pad: f32,
    }
}

mirror! {
    /// A step of finding cuts: `gpu/cut.wgsl`.
    pub struct CutStep {
        /// Views.
        pub views: u32,
        /// The tree's root.
        pub root: u32,
        /// Texels of a hemisphere's side by the threshold.
        pub scale: f32,
        /// Motion of a view, edges of the root, beyond which it starts over.
        pub jump: f32,
        /// Entries that the queues and the cut hold.
        pub capacity: u32,
        /// Chunks of the cut.
        pub chunks: u32,
        /// Entry of the counters for the queue that is read.
        pub queue_in: u32,
        /// Entry for the queue that is filled.
        pub queue_out: u32,
        /// Where numbers of workgroups go.
        pub arguments: u32,
        /// Units of motion by which chunks may be overdue while views move.
        pub lag: u32,
        /// 1: every view starts over.
        pub restart: u32,
        /// 0: of this step's queue only what started over is divided.
        pub deep: u32,
    }
}

mirror! {
    /// Drawing cuts: `gpu/cut_draw.wgsl`.
    pub struct DrawStep {
        /// Views.
        pub views: u32,
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// How large a node may appear and be drawn whole, texels.
        pub threshold: f32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Maps of one array: 2 to the power of this.
        pub map_shift: u32,
        /// Entries that the queue holds.
        pub capacity: u32,
        /// Its entry of the counters.
        pub queue: u32,
        /// Where the number of workgroups goes.
        pub arguments: u32,
    }
}

mirror! {
    /// Random points splatted, and levels between which gaps are filled: `gpu/imperfect_views.wgsl`.
    pub struct ImperfectStep {
        /// Maps.
        pub count: u32,
        /// Points to each.
        pub points: u32,
        /// Points to choose from.
        pub pool: u32,
        /// Where those begin among the nodes.
        pub first: u32,
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Maps of one array: 2 to the power of this.
        pub map_shift: u32,
        /// Texels on a side of the level that is written.
        pub to_side: u32,
        /// Texels on a side of the level that is read.
        pub from_side: u32,
        /// Where the level that is written begins in the pyramid.
        pub to_begin: u32,
        /// Where the level that is read begins in the pyramid.
        pub from_begin: u32,
    }
}

mirror! {
    /// Atomics at pseudo-random places: `gpu/scattered_atomics.wgsl`.
    pub struct Scatter {
        /// Words of the buffer, of 32 or of 64 bits.
        pub words: u32,
        /// Tells dispatches apart.
        pub seed: u32,
    }
}
