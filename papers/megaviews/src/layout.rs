//! Mirrors of structs of `shaders/`.

#[cfg(test)]
use argus_shaders::layout::Mirror;
use argus_shaders::mirror;

/// All mirrors of this crate, for the test.
#[cfg(test)]
pub(crate) const MIRRORS: &[Mirror] = &[
    Split::MIRROR,
    LevelStep::MIRROR,
    Average::MIRROR,
    ViewStep::MIRROR,
    PairStep::MIRROR,
    QueueStep::MIRROR,
    FillStep::MIRROR,
    Fusion::MIRROR,
    RasterStep::MIRROR,
    NodeLevel::MIRROR,
    MapLookup::MIRROR,
    OwnLevel::MIRROR,
];

/// Bytes of a surfel of `shared/surfel.wgsl`.
pub(crate) const SURFEL_BYTES: u64 = 32;

mirror! {
    /// One level of voxelisation: `shaders/voxelize.wgsl`.
    pub struct Split {
        /// Index of the list of pieces: pairs of a triangle and a cell that it overlaps.
        pub list: u32,
        /// Cells along an edge of the root, on the next level.
        pub cells: f32,
    }
}

mirror! {
    /// One level of an octree that is built: `shaders/levels.wgsl`.
    pub struct LevelStep {
        /// Number of sorted elements; not used by passes over nodes.
        pub count: u32,
        /// The level that is made.
        pub level: u32,
        /// Levels below the root.
        pub depth: u32,
    }
}

mirror! {
    /// One level of the scene's octree: `shaders/octree.wgsl`.
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
    /// One step of a view octree: `shaders/view_octree.wgsl`.
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
    /// One step of a traversal: `shaders/traverse.wgsl`.
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
    /// Workgroups and first pairs of a step: `shaders/queue.wgsl`.
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
    /// Leaves that cover many texels: `shaders/fill.wgsl`.
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
    /// Merging maps into those of descendants: `shaders/shared/map_fusion.wgsl`.
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
    /// Every triangle for every view: `shaders/raster_views.wgsl`.
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
    /// A level of an octree, in `shaders/surfels.wgsl`.
    pub struct NodeLevel {
        /// First node.
        pub first: u32,
        /// Number of nodes.
        pub count: u32,
        /// Length of the root's edge, metres.
        pub edge: f32,
    }
}

mirror! {
    /// Uniform of lookups in maps of an octree: `shaders/shared/lit_maps.wgsl`.
    pub struct MapLookup {
        /// Index of the camera, or of the first one, among the views of the traversal.
        pub view: u32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
        /// Texels on a side of a hemisphere.
        pub map_side: u32,
        /// Length of the octree's root's edge, metres.
        pub edge: f32,
        /// Radius of the sphere around a leaf's cell, metres.
        pub radius: f32,
    }
}

mirror! {
    /// A level of an octree: `shaders/own_nodes.wgsl`.
    pub struct OwnLevel {
        /// First node.
        pub first: u32,
        /// Number of nodes.
        pub count: u32,
    }
}
