//! ManyLoDs (Holländer et al. 2011): a level-of-detail cut through a tree for every one of many views, kept from frame to frame,
//! and a map drawn from each.
//!
//! - [`SphereHierarchy`]: a perfect binary tree of bounding spheres over surface points, refitted as they move
//!   ([`SphereBuilder`] makes it);
//! - [`CutTree`]: such a tree, or an octree of `argus-megaviews`, as cuts go through it;
//! - [`ManyLods`]: the cuts of many views, and their maps;
//! - [`ImperfectViews`]: maps from random points, for comparison.

mod counters;
mod cuts;
mod draw;
mod imperfect;
mod layout;
mod passes;
mod pool;
pub mod programs;
mod settings;
mod spheres;
mod surface_samples;
mod tree;

pub use counters::CutStats;
pub use cuts::ManyLods;
pub use imperfect::ImperfectViews;
pub use settings::{CutMethod, CutSettings};
pub use spheres::{MAX_SPHERE_DEPTH, SphereBuilder, SphereHierarchy, SphereTimes};
pub use surface_samples::{SurfaceSample, surface_samples};
pub use tree::CutTree;
