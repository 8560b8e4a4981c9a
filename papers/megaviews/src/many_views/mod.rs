//! Dual paraboloid maps of a scene's octree from very many viewpoints at once.
//!
//! [`ManyViews`] traverses the scene's octree together with an octree over the views (MegaViews, Kol et al. 2018), or for
//! every view alone (ManyLoDs, Holländer et al. 2011, basic cuts). It renders a map of inverse range for each leaf of the
//! view octree. A frame reads back only counters.
//!
//! - [`ViewList`]: positions and directions of the views;
//! - [`Texel`]: formats of texels, 64, 32 or 16 bits;
//! - [`Settings`]: resolution, texels, threshold, depth of the view octree, sharing, culling, fusion;
//! - [`RasterViews`]: maps by rasterised triangles, for comparison;
//! - [`FrameStats`]: counts and times of a frame.
//!
//! # A frame
//!
//! Each frame builds an octree over the views and traverses it together with the scene's octree, breadth first, with
//! queues of pairs on the GPU and indirect dispatches (`frame.rs`). All leaves are on the lowest level, so all pairs of a
//! queue have the same two levels, and `schedule.rs` computes in advance what each step divides. Pairs are culled,
//! rendered or queued when they are created. A view node with a single child shares its map. Leaves that cover many
//! texels are filled after the traversal. Then maps are fused with their parents from the root down, with ranges
//! corrected for their own centre.
//!
//! A part of a frame whose queue overflows is split in eight and run again. Bytes do not depend on the split. With
//! `Settings::occlusion` a part is traversed in four shells, near pairs first, and a pair is culled if all its texels
//! already have something nearer; bytes stay the same.
//!
//! # Discs
//!
//! A rendered node covers the sample points within a disc about its mean position (`Settings::disc`). With 0.8165 of its
//! sphere's radius, discs close every surface, as images need. At a silhouette such a disc covers texels that are free.
//! Unshared shadow maps have the least error with half the radius. For nodes that several views share, 0.4 balances leaks
//! and false shadows.

mod counters;
mod frame;
mod fuse;
mod maps;
mod raster;
mod schedule;
mod settings;
mod texels;
mod traverse;
mod view_depth;
mod view_list;
mod view_octree;

pub use counters::{FrameStats, StepStats};
pub use frame::ManyViews;
pub use maps::MapSet;
pub use raster::RasterViews;
pub use settings::{Bounding, Occlusion, Settings};
pub use texels::{Texel, TexelCode};
pub use traverse::{NodeOwners, with_maps};
pub use view_list::{ViewList, ViewPoint};
