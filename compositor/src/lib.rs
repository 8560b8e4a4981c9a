//! Sample sets to frames: depth-corrected inverse warping.
//!
//! A compositor needs no triangles. It holds samples (images of radiance and range) as layers of texture arrays, and
//! composes views from them. A *search* finds the depth of each pixel. The colour is then fetched from the samples'
//! texels whose range agrees with that depth. The searches:
//!
//! - [`argus_scene::Search::Splat`]: the samples' texels are projected into cells of the view, each cell keeps the
//!   nearest, and gaps within a surface are filled;
//! - [`argus_scene::Search::Linear`]: linear steps and bisection (the cluster paper, section 4.2);
//! - [`argus_scene::Search::Seeded`]: fixed-point iteration between the ray and a sample's surface, from a coarse splat or
//!   from the previous frame of the session ([`argus_scene::History`]);
//! - [`argus_scene::Search::Pyramid`]: the ray is marched through a pyramid of each sample's nearest surfaces (exact).
//!
//! The meaning of a frame's pixels, in addition to [`argus_scene::Output`]:
//! - a pixel is *sky* (source 0, mask 0, no range) if its ray misses the scene's bounds, or if samples see past every
//!   point of it;
//! - a pixel is *unresolved* (source 0, mask 255, no range) if no sample saw its surface at its range: `is_seen` in
//!   `shaders/shared/fetch.wgsl` has the rule. Its colour is a guess. Where a sample has the surface in texels that are too
//!   coarse for the view, it is theirs; else the farthest nearby texel of the first sample that looks there, because
//!   background continues behind a foreground edge; sky if no sample looks there;
//! - with supersampling, colour is the mean in linear radiance. Range, mask and source are those of the middle sub-pixel
//!   (for an even number, the one below and right of the middle).
//!
//! [`compositor`] has the list of passes. `passes` has one file a pass; its program has the same name in
//! `shaders/compositor/`.

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
#[allow(
    clippy::needless_range_loop,
    clippy::manual_range_contains,
    clippy::manual_clamp,
    reason = "the compiler computes eight lanes of such loops at a time, and a number that is none becomes a bound"
)]
mod host;
mod layout;
mod lights;
mod pass_plan;
mod passes;
mod pool;
mod prepare;
mod pyramid;
mod radiance;
mod reprojection;
mod sample_store;
mod sample_upload;
mod search_pipelines;
mod settings;
mod targets;
mod validate;

pub use bare_fetch::BareFetch;
pub use compositor::GpuCompositor;
pub use pass_plan::PassPlan;
pub use settings::{CompositorSettings, SearchBackend};
