//! Mirrors of structs of `shaders/`.

#[cfg(test)]
use argus_shaders::layout::Mirror;
use argus_shaders::mirror;

/// All mirrors of this crate, for the test.
#[cfg(test)]
pub(crate) const MIRRORS: &[Mirror] =
    &[SphereStep::MIRROR, CellStep::MIRROR, CutStep::MIRROR, DrawStep::MIRROR, ImperfectStep::MIRROR];

mirror! {
    /// One level of a sphere tree: `shaders/spheres.wgsl`.
    pub struct SphereStep {
        /// Number of points, or of nodes of the level.
        pub count: u32,
        /// First node of the level.
        pub first: u32,
    }
}

mirror! {
    /// One level of an octree that is cut: `shaders/cut_tree.wgsl`.
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
    /// A step of finding cuts: `shaders/cut.wgsl`.
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
    /// Drawing cuts: `shaders/cut_draw.wgsl`.
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
    /// Splatting random points, and filling gaps from coarser levels: `shaders/imperfect_views.wgsl`.
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
