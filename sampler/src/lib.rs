//! Scene to sample sets: visibility, then shading.
//!
//! [`GpuSampler`] holds a scene on the device and renders it from triangles, for others as samples and as
//! direct views. Each image is cut into tiles that bound its memory; a tile is rasterised into a visibility
//! buffer (which triangle of which instance each sub-sample sees), shaded in one compute pass that recomputes
//! what the rasteriser found, and resolved: to the surface that covers most of a texel (samples), or to the mean of
//! a pixel (direct views). What the two kinds of image have in common is the same code, so a
//! sample holds what a direct view from its camera shows.

mod bvh;
mod draws;
mod eye;
mod indirect;
mod knobs;
mod lit_octree;
mod mirrors;
mod omni_maps;
mod packets;
mod passes;
mod pixels;
mod plan;
mod point_based;
mod radiosity;
mod resident;
mod sampler;
mod scratch;
mod seeing;
mod sight;
mod tile;
mod timing;
mod view;
mod ways;
mod wide;

pub use indirect::Indirect;
pub use knobs::{RadianceFormat, SamplerKnobs};
pub use plan::PassPlan;
pub use point_based::{PointKnobs, PointReport};
pub use radiosity::{IndirectReport, MapSource, VplKnobs};
pub use sampler::GpuSampler;
pub use sight::PacketSight;
