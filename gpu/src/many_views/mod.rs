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
//!
//! # A frame
//!
//! Each frame builds an octree over the views and traverses it together with the scene's octree, breadth first, in queues of pairs that
//! only indirect dispatches see (`frame.rs`). All leaves lie on the lowest level, so all pairs of a queue are on the same two levels, and
//! `schedule.rs` knows before the frame what each step divides. Pairs are culled, rendered or queued when they are created. A view node
//! with a single child has no map of its own: both render into one. Leaves that cover many texels are filled after the traversal. Then
//! maps take, from the root down, what the maps above them hold, with the range corrected for their own centre.
//!
//! A part of a frame whose queue overflows stops on the GPU, is split in eight and run again. Bytes do not depend on the split. With
//! `Knobs::occlusion` a part is traversed in four shells, near pairs first, and a pair is skipped where every texel that it could touch
//! already holds something nearer; no byte changes.
//!
//! # Discs
//!
//! A rendered node covers the sample points of texels within a disc about its mean (`Knobs::disc`). With 0.8165 of its ball's radius, discs
//! close every surface, as pictures need. A node is up to a texel large, though, so at a silhouette it covers a texel that is free. Shadow
//! maps of single views err least with half the radius. Where several views share a node, 0.4 balances leaks and false shadows.

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
pub use traverse::NodeOwners;
pub use view_list::{ViewList, ViewPoint};
