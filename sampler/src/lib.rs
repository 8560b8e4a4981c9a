//! Scene to sample sets: visibility, then shading.
//!
//! [`GpuSampler`] holds a scene on the device and renders it from triangles, for others as samples and as
//! direct views. Each image is cut into tiles that bound its memory. Of a tile, a visibility buffer says which triangle
//! of which instance each sub-sample sees.
//!
//! A direct view shades every sub-sample and averages those of a pixel. A texel of a sample shows one surface, of those that
//! its sub-samples see the one that covers most. Each triangle of it is shaded once, in the middle of the sub-samples that
//! see it: a texel within a triangle costs one shading, however many sub-samples it has. Both are shaded by the same code.

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

pub use argus_scene::indirect::{Indirect, MapSource, PointKnobs, VplKnobs};
pub use knobs::{RadianceFormat, SamplerKnobs};
pub use plan::PassPlan;
pub use point_based::PointReport;
pub use radiosity::IndirectReport;
pub use sampler::GpuSampler;
pub use sight::PacketSight;
