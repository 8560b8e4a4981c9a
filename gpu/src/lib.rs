//! GPU code that both roles share.
//!
//! - [`Gpu`]: the device, and whether it is lost;
//! - [`Commands`]: passes that bind resources by their WGSL names, each with a row of timestamps;
//! - [`Finished`]: the results of a submission, read back through a pool of mapped buffers;
//! - [`quirks`]: what drivers do otherwise than one would think, and what works around it;
//! - [`plane`]: sample planes as textures and as bytes;
//! - [`Scan`] and [`Sort`]: exclusive prefix sums of 32-bit numbers, and a stable sort of 64-bit keys;
//! - [`ListScan`]: the same sums of lists whose lengths only the device knows;
//! - [`ScatteredAtomics`]: a benchmark of the atomics that write such maps.
//!
//! This crate depends on the scene's vocabulary only.

mod bindings;
mod commands;
mod device;
mod environment;
mod error;
mod list_scan;
mod pipeline;
pub mod plane;
pub mod quirks;
mod readback;
mod readback_pool;
mod reflection_probes;
mod scan;
mod scattered_atomics;
mod sort;
mod timing;

pub use bindings::Bindable;
pub use commands::{ColorTarget, Commands, ComputeCall, DepthTarget, DrawCall, RenderPass, Submitted};
pub use device::{Gpu, GpuOptions};
pub use environment::EnvironmentTexture;
pub use error::GpuError;
pub use list_scan::{LengthAt, ListScan, Lists};
pub use pipeline::{ComputePipeline, RenderPipeline, RenderPipelineDesc};
pub use plane::DevicePlane;
pub use quirks::LONGEST_PASS_MS;
pub use readback::{Finished, PendingReadback};
pub use reflection_probes::ReflectionProbes;
pub use scan::{Scan, ScanSums};
pub use scattered_atomics::{ScatteredAtomics, Word};
pub use sort::{Sort, SortScratch};
/// Re-exported, so that all crates use one version.
pub use wgpu;
