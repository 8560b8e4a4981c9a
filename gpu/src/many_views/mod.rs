//! Dual paraboloid maps of a scene's octree from very many viewpoints at once.
//!
//! [`ManyViews`] traverses the scene's octree with an octree over the views (MegaViews, Kol et al. 2018), or with every
//! view by itself (ManyLoDs, Holländer et al. 2011, basic cuts), and leaves a map of inverse range for each leaf of the
//! views. A frame reads back counters alone, once it is done.
//!
//! - [`ViewList`]: where the views are and which way they look;
//! - [`Texel`]: what a texel of a map holds, in 64, 32 or 16 bits;
//! - [`Knobs`]: resolution, texels, threshold, depth of the view octree, what is shared, culled and fused;
//! - [`ManyLods`]: a cut for each view, from frame to frame, through an octree or a sphere hierarchy ([`CutTree`]);
//! - [`RasterViews`], [`ImperfectViews`]: the same maps without any hierarchy, exact or from random points, to compare
//!   with;
//! - [`FrameStats`]: what a frame did, pair by pair, and how long it took.

mod counters;
mod cuts;
mod frame;
mod fuse;
mod imperfect;
mod knobs;
mod maps;
mod raster;
mod schedule;
mod texels;
mod traverse;
mod view_depth;
mod view_list;
mod view_octree;

pub use counters::{FrameStats, StepStats};
pub use cuts::{CutKnobs, CutMethod, CutStats, CutTree, ManyLods};
pub use frame::ManyViews;
pub use imperfect::ImperfectViews;
pub use knobs::{Bounding, Knobs, Occlusion};
pub use maps::MapSet;
pub use raster::RasterViews;
pub use texels::{Texel, TexelCode};
pub use traverse::Own;
pub use view_list::{ViewList, ViewPoint};
