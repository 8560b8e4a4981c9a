//! The scene's octree, built on the GPU with prefix sums and a radix sort.
//!
//! - [`Octree`]: the scene's surfaces as a sparse voxel octree ([`OctreeBuilder`] makes it);
//! - [`RootCube`]: the root cube of an octree in f64; everything on the GPU is relative to it.
//!
//! The builder finds the cells that triangles overlap, level by level, by a conservative test. Pairs of triangle and cell
//! are sorted by Morton code; then leaves and inner nodes are averaged. Levels are lists whose lengths the device knows: the CPU
//! waits for the number of pairs, for that of nodes, and for the end, however many levels there are. Leaves come first in the array of nodes, the root
//! last. Positions are f32 relative to the root cube, combined in f64 first.

mod error;
mod levels;
mod octree;
mod root;
pub mod stream;
mod voxelize;

pub(crate) use error::numbered;
pub use error::{HierarchyError, MAX_NODES, fits};
pub(crate) use levels::{LevelBuffers, LevelBuilder};
pub use octree::{Octree, OctreeBuilder, OctreeTimes};
pub use root::{RootCube, Triangle};

/// Most levels below the root: three bits a level of a 32-bit Morton code.
pub const MAX_DEPTH: u32 = 10;
