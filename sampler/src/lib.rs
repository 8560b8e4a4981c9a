//! Scene to sample sets: visibility, then shading.
//!
//! [`GpuSampler`] holds a scene on the device and renders it from triangles, for others as samples and as
//! direct views. Each image is cut into tiles that bound its memory. Of a tile, a visibility buffer says which triangle
//! of which instance each sub-sample sees.
//!
//! A direct view shades every sub-sample and averages those of a pixel. A texel of a sample shows one surface, of those that
//! its sub-samples see the one that covers most. Each triangle of it is shaded once, in the middle of the sub-samples that
//! see it: a texel within a triangle costs one shading, however many sub-samples it has. Both are shaded by the same code.

mod backend_timing;
mod bvh;
mod draws;
mod eye;
mod indirect;
mod knobs;
mod lit_octree;
mod omni_maps;
mod packets;
mod pass_plan;
mod passes;
mod pixel_list;
mod point_based;
mod probe_renderer;
mod radiosity;
mod resident;
mod sampler;
mod scratch;
mod sight;
mod tile;
mod timing;
mod view;
mod visibility;
mod wide;

pub use indirect::Indirect;
pub use knobs::{RadianceFormat, SamplerKnobs};
pub use pass_plan::PassPlan;
pub use point_based::{PointKnobs, PointReport};
pub use radiosity::{IndirectReport, MapSource, VplKnobs};
pub use sampler::GpuSampler;
pub use sight::PacketSight;
