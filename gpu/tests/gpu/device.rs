//! One device for all tests, and what its buffers hold.
#![allow(clippy::unwrap_used, reason = "a test ends at the first thing that goes wrong")]

use std::sync::{Arc, OnceLock};

use argus_gpu::wgpu::Buffer;
use argus_gpu::{Gpu, GpuOptions};

/// One device for all tests.
pub(crate) fn gpu() -> Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    let open = || {
        Gpu::new(&GpuOptions::default())
            .expect("these tests need a Vulkan driver; scripts/setup installs one")
    };
    Arc::clone(GPU.get_or_init(open))
}

/// What a buffer holds.
pub(crate) fn read<T: bytemuck::Pod>(buffer: &Buffer, count: usize) -> Vec<T> {
    let mut commands = gpu().commands("read back");
    let pending = commands.read_buffer(buffer, 0..(count * size_of::<T>()) as u64);
    let bytes = commands.submit().wait().unwrap().take(pending);
    bytemuck::pod_collect_to_vec(&bytes[..count * size_of::<T>()])
}
