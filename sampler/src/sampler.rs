//! Renders samples, direct views and lists of pixels.

mod gpu_sampler;
mod identify;
mod light;
mod light_cells;
mod lists;
mod method_samples;
mod point_probes;
mod prepared;
mod probes;
mod rays;
mod ready_scene;
mod role;
mod samples;
mod slices;
mod surface_programs;
mod tile_loop;
mod unchanged;
mod views;

pub use self::gpu_sampler::GpuSampler;
pub use self::prepared::PreparedSampler;
