//! Mirrors of structs of `shaders/gpu/*.wgsl`: hierarchies and their traversals.

use super::Mirror;

/// All mirrors of this file.
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
    PointPiece::MIRROR,
    PointFacet::MIRROR,
    PointMap::MIRROR,
    PointStep::MIRROR,
    SplatStep::MIRROR,
];

mirror! {
    /// One digit of a radix sort: `gpu/sort.wgsl`.
    pub struct Digit {
        /// Number of keys.
        pub count: u32,
        /// Number of runs of keys.
        pub runs: u32,
        /// Lowest bit of the digit.
        pub shift: u32,
    }
}

mirror! {
    /// One level of voxelisation: `gpu/voxelize.wgsl`.
    pub struct Split {
        /// Number of pieces: pairs of a triangle and a cell that it overlaps.
        pub count: u32,
        /// Cells along an edge of the root, on the next level.
        pub cells: f32,
    }
}

mirror! {
    /// One level of an octree that is built: `gpu/levels.wgsl`.
    pub struct LevelStep {
        /// Number of sorted elements, or bound on the number of nodes.
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
        /// Bound on the number of nodes of the level.
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
        /// Least corner of the views' root cube, in edges of the scene's root cube.
        pub origin: [f32; 3],
        /// Edge of the views' root cube, in edges of the scene's root cube.
        pub edge: f32,
        /// Number of views, or bound on the number of nodes.
        pub count: u32,
        /// The level.
        pub level: u32,
        /// Cells along an edge of the root on the level.
        pub cells: f32,
        /// Bits. 1: uses a sphere around the views themselves if it is smaller than the cell's. 2: the nodes of this level
        /// divide the views of a cell by their direction.
        pub flags: u32,
    }
}

mirror! {
    /// One step of a traversal: `gpu/traverse.wgsl`.
    pub struct PairStep {
        /// Cells along an edge of the scene's root, on the level of the tested pairs.
        pub cells: f32,
        /// Radius of such a cell's sphere.
        pub radius: f32,
        /// Texels of a hemisphere's side.
        pub side: f32,
        /// Largest apparent size of a node that is rendered, texels.
        pub threshold: f32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Capacity of the queues, pairs.
        pub capacity: u32,
        /// Index in the counters of the queue that is read.
        pub counters_in: u32,
        /// Index in the counters of the queue that is filled.
        pub counters_out: u32,
        /// Index in the counters of the overflow flag of this part of the frame.
        pub overflow: u32,
        /// The octant of the view node that this pass descends to; 8: all octants.
        pub octant: u32,
        /// 1: this pass counts the pairs of the step.
        pub counted: u32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
        /// Least distance of the centres of a rendered pair, edges of the root.
        pub near: f32,
        /// Bound of the distance of the centres of a rendered pair, edges of the root.
        pub far: f32,
        /// 1: the view nodes of the tested pairs are leaves.
        pub leaf_views: u32,
        /// Owner number of the first view.
        pub first_owner: u32,
    }
}

mirror! {
    /// Workgroups and first pairs of a step: `gpu/queue.wgsl`.
    pub struct QueueStep {
        /// Index of the queue in the counters.
        pub counters: u32,
        /// Index in the counters of the overflow flag of this part of the frame.
        pub overflow: u32,
        /// Index in the arguments of the three numbers of workgroups.
        pub arguments: u32,
        /// Pairs per workgroup.
        pub group: u32,
        /// The scene's root, or the first of its leaves.
        pub scene_node: u32,
        /// First view.
        pub first_view: u32,
        /// Number of pairs that the traversal starts with.
        pub count: u32,
        /// Level of the view octree.
        pub level: u32,
        /// Number of allocated maps.
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
        /// Capacity of the queue, pairs.
        pub capacity: u32,
        /// Index of the queue in the counters.
        pub counters: u32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
    }
}

mirror! {
    /// Merging maps into those of descendants: `shared/map_fusion.wgsl`.
    pub struct Fusion {
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
        /// Level of the maps, or number of queries.
        pub level: u32,
    }
}

mirror! {
    /// Every triangle for every view: `gpu/raster_views.wgsl`.
    pub struct RasterStep {
        /// Number of triangles.
        pub triangles: u32,
        /// First view that is rendered.
        pub first_view: u32,
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
    }
}

mirror! {
    /// One level of a sphere tree: `gpu/spheres.wgsl`.
    pub struct SphereStep {
        /// Number of points, or of nodes of the level.
        pub count: u32,
        /// First node of the level.
        pub first: u32,
    }
}

mirror! {
    /// One level of an octree that is cut: `gpu/cut_tree.wgsl`.
    pub struct CellStep {
        /// Number of nodes of the level.
        pub count: u32,
        /// First node of the level.
        pub first: u32,
        /// Cells along an edge of the root on the level.
        pub cells: f32,
        /// Padding of the spheres' radii, edges of the root.
        pub pad: f32,
    }
}

mirror! {
    /// A step of finding cuts: `gpu/cut.wgsl`.
    pub struct CutStep {
        /// Number of views.
        pub views: u32,
        /// Index of the tree's root.
        pub root: u32,
        /// Texels of a hemisphere's side, divided by the threshold.
        pub scale: f32,
        /// Motion of a view, edges of the root, beyond which its cut restarts from the root.
        pub jump: f32,
        /// Capacity of the queues and of the cuts, entries.
        pub capacity: u32,
        /// Number of chunks.
        pub chunks: u32,
        /// Index in the counters of the queue that is read.
        pub queue_in: u32,
        /// Index in the counters of the queue that is filled.
        pub queue_out: u32,
        /// Index in the arguments of the numbers of workgroups.
        pub arguments: u32,
        /// Lazy cuts: units of motion by which chunks may be overdue while views move.
        pub lag: u32,
        /// 1: the cuts of all views restart from the root.
        pub restart: u32,
        /// 0: this step divides only nodes of views that restarted in this frame.
        pub deep: u32,
    }
}

mirror! {
    /// Drawing cuts: `gpu/cut_draw.wgsl`.
    pub struct DrawStep {
        /// Number of views.
        pub views: u32,
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Largest apparent size of a node that is drawn as one disc, texels.
        pub threshold: f32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
        /// Capacity of the queue, entries.
        pub capacity: u32,
        /// Index of the queue in the counters.
        pub queue: u32,
        /// Index in the arguments of the number of workgroups.
        pub arguments: u32,
    }
}

mirror! {
    /// Splatting random points, and filling gaps from coarser levels: `gpu/imperfect_views.wgsl`.
    pub struct ImperfectStep {
        /// Number of maps.
        pub count: u32,
        /// Number of points per map.
        pub points: u32,
        /// Number of points to choose from.
        pub pool: u32,
        /// Index of the first point among the nodes.
        pub first: u32,
        /// Texels of a hemisphere's side.
        pub side: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
        /// Texels on a side of the level that is written.
        pub to_side: u32,
        /// Texels on a side of the level that is read.
        pub from_side: u32,
        /// Offset of the written level in the pyramid.
        pub to_begin: u32,
        /// Offset of the read level in the pyramid.
        pub from_begin: u32,
    }
}

mirror! {
    /// Atomics at pseudo-random words: `gpu/scattered_atomics.wgsl`.
    pub struct Scatter {
        /// Number of words of the buffer, of 32 or 64 bits.
        pub words: u32,
        /// Seed of the words, different in each dispatch.
        pub seed: u32,
    }
}

mirror! {
    /// A piece of a triangle with points: `shared/eye_points.wgsl`. Positions have a second part, which the first rounds away.
    pub struct PointPiece {
        /// Corner of row 0, column 0 of its grid, metres.
        pub origin: [f32; 3],
        /// Cells for each metre.
        pub density: f32,
        /// Second part of the corner.
        pub origin_low: [f32; 3],
        /// Index of its triangle.
        pub facet: u32,
        /// Unit vector along rows.
        pub right: [f32; 3],
        /// Bits. 1: its one cell is not cut off at the triangle's edges.
        pub flags: u32,
        /// Unit vector from row to row.
        pub up: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad: f32,
        /// Column and row of each corner, with fractions.
        pub places: [[f32; 2]; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _end: [f32; 2],
    }
}

mirror! {
    /// A triangle: `shared/eye_points.wgsl`. Positions have a second part, which the first rounds away.
    pub struct PointFacet {
        /// First corner, metres.
        pub a: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_a: f32,
        /// Second corner, metres.
        pub b: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_b: f32,
        /// Third corner, metres.
        pub c: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_c: f32,
        /// Second part of the first corner.
        pub a_low: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_a_low: f32,
        /// Second part of the second corner.
        pub b_low: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_b_low: f32,
        /// Second part of the third corner.
        pub c_low: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad_c_low: f32,
        /// Unit normal.
        pub normal: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad_normal: f32,
    }
}

mirror! {
    /// A map of six faces around a point: `shared/eye_points.wgsl`.
    pub struct PointMap {
        /// Its middle, metres.
        pub center: [f32; 3],
        /// Index of its first texel; `u32::MAX` for a map that is not filled now.
        pub first: u32,
        /// Second part of the middle.
        pub center_low: [f32; 3],
        /// Texels on an edge of a face.
        pub side: u32,
        /// Unit normal, and distance of the border from the middle, metres, of the half-space that the map sees. Zero and -1:
        /// all of space.
        pub front: [f32; 4],
    }
}

mirror! {
    /// One pass that makes points: `gpu/points_cells.wgsl`.
    pub struct PointStep {
        /// Number of pieces, rows or points.
        pub count: u32,
        /// Number of pieces.
        pub pieces: u32,
        /// Number of rows.
        pub rows: u32,
    }
}

mirror! {
    /// One pass that splats points: `gpu/points_splat.wgsl`.
    pub struct SplatStep {
        /// First point, or tile, of this dispatch.
        pub first: u32,
        /// Number of points of this dispatch, or of all further tiles.
        pub count: u32,
        /// 32-bit words of visibility bits of a piece.
        pub words: u32,
        /// Number of all points.
        pub points: u32,
    }
}
