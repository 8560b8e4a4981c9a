//! What both roles need of a GPU, and nothing that either alone needs.
//!
//! - [`Gpu`]: one way to get a device, and to know when it is lost;
//! - [`Commands`]: passes that say what they read and write, by the names their WGSL has, with a timing row
//!   for each by timestamp queries;
//! - [`Finished`]: what came back, through a pool of mapped buffers that are reused;
//! - [`plane`]: sample planes as textures and as bytes;
//! - [`hierarchy`]: prefix sums, sorting, and octrees;
//! - [`many_views`]: maps of an octree from very many viewpoints at once;
//! - [`ScatteredAtomics`]: a benchmark of what such maps are written by.
//!
//! This crate knows no scene beyond the vocabulary.

mod commands;
mod device;
mod error;
pub mod hierarchy;
pub mod many_views;
mod pipeline;
pub mod plane;
mod readback;
mod reflection_probes;
mod scattered_atomics;
mod timing;

pub use commands::{
    Bindable, ColorTarget, Commands, ComputeCall, DepthTarget, DrawCall, RenderPass, Submitted,
};
pub use device::{Gpu, GpuOptions, LONGEST_PASS_MS};
pub use error::GpuError;
pub use pipeline::{ComputePipeline, RenderPipeline, RenderPipelineDesc};
pub use plane::DevicePlane;
pub use readback::{Finished, PendingReadback};
pub use reflection_probes::ReflectionProbes;
pub use scattered_atomics::{ScatteredAtomics, Word};
/// The graphics library itself, so that a role depends on one version of it.
pub use wgpu;
