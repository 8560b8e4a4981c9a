//! Arguments of the study.

use crate::arguments::{count, or_quick, size};

/// Measures parts of the device: scattered atomics, rays, fragment and compute programs, readback, encoding; with targets
/// for a data-centre GPU
///
/// Only the usual scene and size have targets.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:500000", "terrain:20000"))]
    pub scene: String,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("200x150", "96x72"))]
    pub size: [u32; 2],
    /// Warped views in a batch
    #[arg(skip = or_quick(64_usize, 4))]
    pub batch: usize,
    /// Samples used for each warped view
    #[arg(skip = or_quick(4_usize, 2))]
    pub samples: usize,
    /// Side in pixels of the image whose coherent rays are timed
    #[arg(skip = or_quick(1024_u32, 128))]
    pub rays_side: u32,
    /// Number of incoherent rays of the CPU's tracers
    #[arg(skip = or_quick(1_usize << 20, 1 << 14))]
    pub scattered_rays: usize,
    /// Number of incoherent rays of the device's tracer
    #[arg(skip = or_quick(1_usize << 22, 1 << 16))]
    pub device_rays: usize,
    /// Sizes in bytes of the buffers for scattered atomics: within and beyond the caches of a data-centre GPU
    #[arg(skip = [15_000_000, 4_000_000_000])]
    pub buffers: [u64; 2],
    /// Target duration of a dispatch of atomics, in milliseconds
    #[arg(skip = or_quick(50.0, 2.0))]
    pub dispatch_ms: f64,
    /// Sizes in bytes of the readbacks: a view of 128², one of 200×150, and a batch of large ones, at four bytes a pixel
    #[arg(skip = [65_536, 120_000, 64 << 20])]
    pub readbacks: [u64; 3],
    /// Number of measured rounds; each figure is their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("5", "1"))]
    pub rounds: usize,
}
