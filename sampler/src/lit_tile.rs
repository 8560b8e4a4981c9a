//! The texels of a tile on the device, as passes of light read them, and the buffers of their light.

use argus_gpu::{ComputeCall, Gpu, wgpu};

use crate::scratch::GBuffer;

/// Bits of an `array<vec4f>`: irradiance / π, and the shares of lights and sky that are seen, a byte each.
pub(crate) type Arriving = [f32; 4];

/// Buffers of a tile's light, one entry a texel.
#[derive(Clone)]
pub(crate) struct LitBuffers {
    pub(crate) count: u32,
    /// Rays that [`Self::rays`] and [`Self::passed`] have room for.
    pub(crate) capacity: u32,
    pub(crate) rays: wgpu::Buffer,
    /// The share of light that passes each ray.
    pub(crate) passed: wgpu::Buffer,
    /// The share of a light that each texel sees.
    pub(crate) shares: wgpu::Buffer,
    /// Texels in a penumbra, and their number.
    pub(crate) penumbra: wgpu::Buffer,
    pub(crate) penumbra_count: wgpu::Buffer,
    /// Irradiance / π of all lights, and which of them are seen.
    pub(crate) lit: wgpu::Buffer,
    pub(crate) seen: wgpu::Buffer,
    /// Sums over rays to the sky, before and after a step of the filter.
    pub(crate) sky: [wgpu::Buffer; 2],
}

impl LitBuffers {
    pub(crate) fn new(gpu: &Gpu, count: u32) -> Self {
        // A texel in a penumbra needs 16.
        let capacity = count.next_multiple_of(16).max(16);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let of = |label, entries: u32, bytes: u64| gpu.buffer(label, u64::from(entries) * bytes, usage);
        Self {
            count,
            capacity,
            rays: of("rays to lights", capacity, 32),
            passed: of("light that passes", capacity, 4),
            shares: of("shares of a light", count, 4),
            penumbra: of("texels in a penumbra", count, 4),
            penumbra_count: of("number of texels in a penumbra", 1, 4),
            lit: of("light of lights", count, 16),
            seen: of("lights that are seen", count, 16),
            sky: [of("light of the sky", count, 32), of("light of the sky, filtered", count, 32)],
        }
    }
}

/// The texels of a tile on the device, and the light that is found for them.
pub(crate) struct LitTexels {
    pub(crate) tile: wgpu::Buffer,
    pub(crate) g_buffer: GBuffer,
    pub(crate) count: u32,
    pub(crate) buffers: LitBuffers,
}

impl LitTexels {
    /// Binds what a program reads to find texels.
    pub(crate) fn bind<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        self.bind_size(call).read("g_materials", &self.g_buffer.materials)
    }

    /// Binds what a program reads to find how many texels there are.
    pub(crate) fn bind_size<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        call.read("tile", &self.tile).read("g_surfaces", &self.g_buffer.surfaces)
    }
}
