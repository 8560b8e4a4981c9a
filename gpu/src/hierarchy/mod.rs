//! Hierarchies built on the GPU: prefix sums, a radix sort, and the octrees made of them.
//!
//! - [`Scan`] and [`Sort`]: exclusive prefix sums of 32-bit numbers, and a stable sort of 64-bit keys;
//! - [`Octree`]: the scene's surfaces as a sparse voxel octree ([`OctreeBuilder`] makes it);
//! - [`SphereHierarchy`]: a perfect binary tree of balls over points of the surfaces, fitted anew as they move
//!   ([`SphereBuilder`] makes it);
//! - [`RootCube`]: the cube that an octree divides, in f64; everything on the GPU is relative to it.
//!
//! The octree's builder divides triangles among the cells that they meet, level by level, by a conservative test. Pieces are sorted by
//! Morton code, and leaves and nodes are averaged. Leaves come first in the array of nodes, the root last. Everything is f32 relative to
//! the root cube, combined in f64 first.

mod error;
mod levels;
mod octree;
mod root;
mod samples;
mod scan;
mod sort;
mod spheres;
pub mod stream;
mod voxelize;

pub use error::{HierarchyError, MAX_NODES};
pub(crate) use levels::{LevelBuffers, LevelBuilder};
pub use octree::{Octree, OctreeBuilder, OctreeTimes};
pub(crate) use octree::{fits, largest_array, numbered};
pub use root::{RootCube, Triangle};
pub use samples::{SurfaceSample, surface_samples};
pub use scan::{Scan, ScanSums};
pub use sort::{Sort, SortScratch};
pub use spheres::{MAX_SPHERE_DEPTH, SphereBuilder, SphereHierarchy, SphereTimes};

/// Most levels below the root: three bits a level of a 32-bit Morton code.
pub const MAX_DEPTH: u32 = 10;
