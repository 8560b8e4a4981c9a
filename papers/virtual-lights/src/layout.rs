//! Mirrors of structs of `shaders/`.

#[cfg(test)]
use argus_shaders::layout::Mirror;
use argus_shaders::mirror;

/// All mirrors of this crate, for the test.
#[cfg(test)]
pub(crate) const MIRRORS: &[Mirror] = &[
    Vpl::MIRROR,
    VplNode::MIRROR,
    Gathering::MIRROR,
    AdoptMaps::MIRROR,
    Imperfect::MIRROR,
    Blocks::MIRROR,
    Chosen::MIRROR,
    Receive::MIRROR,
];

/// Sizes of blocks and of their lists of VPLs. Equal to those of `shaders/shared/vpl.wgsl`.
pub(crate) mod vpl {
    /// Most groups of a list.
    pub(crate) const MOST_GROUPS: u32 = 256;
    /// Words of a list.
    pub(crate) const LIST_WORDS: u32 = 3 + 4 * MOST_GROUPS;
    /// Sub-samples on a side of a block.
    pub(crate) const BLOCK: u32 = 16;
}

mirror! {
    /// A virtual point light: `shaders/shared/vpl.wgsl`.
    pub struct Vpl {
        /// Position relative to the centre of the scene, metres.
        pub position: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad: f32,
        /// Unit normal; zero for a particle.
        pub normal: [f32; 3],
        /// WGSL aligns what follows.
        pub _pad2: f32,
        /// Flux / π²; of a particle, flux / 4π².
        pub intensity: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad3: f32,
    }
}

mirror! {
    /// A node of the tree over VPLs: `shaders/shared/vpl.wgsl`.
    pub struct VplNode {
        /// Centre of the bounding sphere of the positions, relative to the centre of the scene.
        pub center: [f32; 3],
        /// Radius of the bounding sphere.
        pub radius: f32,
        /// Axis of the bounding cone of the normals.
        pub axis: [f32; 3],
        /// Cosine of the cone's half angle; -1 if it holds all directions.
        pub cosine: f32,
        /// First VPL.
        pub first: u32,
        /// Number of VPLs.
        pub count: u32,
        /// The next node after all descendants of this one.
        pub skip: u32,
        /// 1: a leaf.
        pub leaf: u32,
        /// Sum of the intensities, averaged over the channels.
        pub power: f32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 3],
    }
}

mirror! {
    /// Uniform of the passes that gather light from VPLs: `shaders/shared/vpl.wgsl`.
    pub struct Gathering {
        /// Vector from the centre of the scene to the eye, metres.
        pub root_from_eye: [f32; 3],
        /// VPLs that each sub-sample gathers from.
        pub samples: u32,
        /// Number of blocks of the tile.
        pub blocks: [u32; 2],
        /// Sub-samples of the tile.
        pub size: [u32; 2],
        /// Position of the tile in the image, sub-samples.
        pub origin: [u32; 2],
        /// Texels on a side of a hemisphere's map.
        pub map_side: u32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
        /// Radius of the filter, sub-samples.
        pub reach: u32,
        /// Distance in metres below which a VPL's light is clamped.
        pub least_distance: f32,
        /// Distance in metres beyond which a VPL has no effect.
        pub cutoff: f32,
        /// Depth bias of shadow maps, in widths of a texel.
        pub bias: f32,
        /// Metres by which surfaces in the maps may be in front of the true ones.
        pub slack: f32,
        /// 1: groups that cannot light a block are culled.
        pub culls: u32,
        /// 1: groups are drawn by their estimated light; 0: by their number of VPLs.
        pub weighs: u32,
        /// Average number of groups in a block's list; 0: all groups that may light it.
        pub kept_groups: u32,
    }
}

mirror! {
    /// Uniform of `shaders/adopt_maps.wgsl`.
    pub struct AdoptMaps {
        /// Corner of the octree's root relative to the scene's centre, metres.
        pub octree_from_root: [f32; 3],
        /// Length of the root's edge, metres.
        pub edge: f32,
        /// Number of VPLs.
        pub count: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 3],
    }
}

mirror! {
    /// Immediates of `shaders/imperfect.wgsl`.
    pub struct Imperfect {
        /// Texels on a side of a hemisphere's map.
        pub side: u32,
        /// Points of a map.
        pub points: u32,
        /// Texels on a side of the level that is written.
        pub to_side: u32,
        /// Texels on a side of the level that is read.
        pub from_side: u32,
        /// Offset of the written level in the pyramid.
        pub to_begin: u32,
        /// Offset of the level that is read.
        pub from_begin: u32,
        /// Number of maps.
        pub count: u32,
        /// Seed of the choice of points.
        pub seed: u32,
    }
}

mirror! {
    /// Blocks of a tile that share receivers: `shaders/shared/receivers.wgsl`.
    pub struct Blocks {
        /// Sub-samples of the tile.
        pub size: [u32; 2],
        /// Sub-samples of a block, 256 at most.
        pub block: [u32; 2],
        /// Blocks of the tile.
        pub count: [u32; 2],
        /// Reach of receivers, in blocks: 0 or 1.
        pub reach: u32,
        /// WGSL rounds the struct up to 8 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// A receiver: `shaders/shared/receivers.wgsl`.
    pub struct Chosen {
        /// Position relative to the eye, metres.
        pub position: [f32; 3],
        /// Column and row of its sub-sample in the tile, 16 bits each.
        pub place: u32,
        /// Unit shading normal of the visible side.
        pub normal: [f32; 3],
        /// 0 for a missing receiver.
        pub exists: u32,
    }
}

mirror! {
    /// Uniform of `shaders/receive.wgsl`.
    pub struct Receive {
        /// First receiver of the batch.
        pub first: u32,
        /// Number of receivers.
        pub count: u32,
        /// Base-2 logarithm of the number of maps in one array.
        pub map_shift: u32,
        /// Texels of a hemisphere's side.
        pub map_side: u32,
    }
}
