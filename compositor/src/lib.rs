//! Sample sets to frames: depth-corrected inverse warping.
//!
//! A compositor never sees a triangle. It holds samples (images of radiance and range, taken elsewhere) as
//! layers of texture arrays, and answers views from them: a *search* finds the depth of each pixel, and the
//! colour is fetched where the samples have that point, from texels whose range agrees with it. All searches end in
//! the same fetch:
//!
//! - [`argus_scene::Search::Splat`]: samples' texels are projected forward into cells of the view, the nearest
//!   stays, gaps between cells of one surface are closed;
//! - [`argus_scene::Search::Linear`]: the cluster paper's (section 4.2), linear steps and bisection;
//! - [`argus_scene::Search::FixedPoint`]: from the middle of the scene's bounds to the surface that a sample has there, back to
//!   the ray, and again; a linear search where that does not settle;
//! - [`argus_scene::Search::Seeded`]: the same, begun at what a coarse splat left, or where an earlier frame of the same
//!   session had its surfaces ([`argus_scene::History`]);
//! - [`argus_scene::Search::Pyramid`]: the ray is followed texel by texel through all samples, in large steps where a pyramid of
//!   their nearest surfaces has nothing.
//!
//! What a frame's pixels mean, beside [`argus_scene::Output`]:
//! - a pixel is *sky* (source 0, mask 0, no range) where its ray misses the scene's bounds or samples see past
//!   everything on it;
//! - it is *unresolved* (source 0, mask 255, no range) where no sample saw what it shows. Its colour is a guess,
//!   never passed off as more: the farthest texel that the first sample looking there has around the place, for
//!   background goes on behind the edge that hid it; sky if no sample looks there;
//! - with supersampling, colour is the mean in linear radiance, and range, mask and source are those of the
//!   middle sub-pixel (of an even number, the one below and right of the middle).
//!
//! [`compositor`] tells a batch from top to bottom; `passes` has one file a pass, its program at
//! `shaders/compositor/` under the same name.

mod arrays;
mod autotune;
mod bare_fetch;
mod batch;
mod chunk;
pub mod compositor;
mod cull;
mod draw_batch;
mod frames;
mod geometry;
mod knobs;
mod layout;
mod lights;
mod pass_plan;
mod passes;
mod pool;
mod prepare;
mod pyramid;
mod reprojection;
mod sample_store;
mod sample_upload;
mod search_pipelines;
mod targets;
mod validate;

pub use bare_fetch::BareFetch;
pub use compositor::GpuCompositor;
pub use knobs::{CompositorKnobs, SearchBackend};
pub use pass_plan::PassPlan;
