//! GPU code that both roles share.
//!
//! - [`Gpu`]: the device, and whether it is lost;
//! - [`Commands`]: passes that bind resources by their WGSL names, each with a row of timestamps;
//! - [`Finished`]: the results of a submission, read back through a pool of mapped buffers;
//! - [`plane`]: sample planes as textures and as bytes;
//! - [`hierarchy`]: prefix sums, sorting, and octrees;
//! - [`many_views`]: maps of an octree from very many viewpoints at once;
//! - [`points`]: points of triangles, splatted into maps around reflectors (EPR);
//! - [`ScatteredAtomics`]: a benchmark of the atomics that write such maps.
//!
//! This crate depends on the scene's vocabulary only.

mod commands;
mod device;
mod environment;
mod error;
pub mod hierarchy;
pub mod many_views;
mod pipeline;
pub mod plane;
pub mod points;
mod readback;
mod reflection_probes;
mod scattered_atomics;
mod timing;

pub use commands::{
    Bindable, ColorTarget, Commands, ComputeCall, DepthTarget, DrawCall, RenderPass, Submitted,
};
pub use device::{Gpu, GpuOptions, LONGEST_PASS_MS};
pub use environment::EnvironmentTexture;
pub use error::GpuError;
pub use pipeline::{ComputePipeline, RenderPipeline, RenderPipelineDesc};
pub use plane::DevicePlane;
pub use readback::{Finished, PendingReadback};
pub use reflection_probes::ReflectionProbes;
pub use scattered_atomics::{ScatteredAtomics, Word};
/// Re-exported, so that all crates use one version.
pub use wgpu;
