//! `shaders/gpu/*.wgsl`: hierarchies and the traversal of two of them.

use super::Mirror;

/// All of this file's.
pub(super) const MIRRORS: &[Mirror] = &[Digit::MIRROR, Split::MIRROR, LevelStep::MIRROR, Average::MIRROR];

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
