//! The texels of a tile on the device, as passes of light read them, and the buffers of their light.

use std::sync::{Arc, OnceLock};

use argus_gpu::{ComputeCall, Gpu, wgpu};
use argus_shaders::layout::sampler::ScatteredHit;

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
    /// Made when light of emitters or surfaces is first asked for.
    found: Arc<OnceLock<FoundLight>>,
}

/// Buffers of the light of emitters and of other surfaces, one entry a texel.
pub(crate) struct FoundLight {
    /// The nearest hit of each ray.
    pub(crate) hits: wgpu::Buffer,
    /// Irradiance / π of emitters, and of other surfaces.
    pub(crate) emitted: wgpu::Buffer,
    pub(crate) indirect: wgpu::Buffer,
    /// The share of the sky that is seen, by light cells.
    pub(crate) sky_share: wgpu::Buffer,
    /// Sums over rays, and room for a step of the filter.
    pub(crate) work: [wgpu::Buffer; 3],
    pub(crate) spare: wgpu::Buffer,
    /// Texels that are points of an image which is filtered.
    pub(crate) members: [wgpu::Buffer; 2],
    /// Texels that are lit after others, and their number.
    pub(crate) list: wgpu::Buffer,
    pub(crate) list_count: wgpu::Buffer,
}

impl FoundLight {
    fn new(gpu: &Gpu, count: u32, capacity: u32) -> Self {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let of = |label, entries: u32, bytes: u64| gpu.buffer(label, u64::from(entries) * bytes, usage);
        let sums = || of("sums over rays", count, 16);
        Self {
            hits: of("hits of rays", capacity, size_of::<ScatteredHit>() as u64),
            emitted: of("light of emitters", count, 16),
            indirect: of("light of surfaces", count, 16),
            sky_share: of("share of the sky", count, 16),
            work: [sums(), sums(), sums()],
            spare: sums(),
            members: [of("points of an image", count, 4), of("points of another image", count, 4)],
            list: of("texels that are lit later", count, 4),
            list_count: of("number of texels that are lit later", 1, 4),
        }
    }
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
            found: Arc::default(),
        }
    }
}

/// The texels of a tile on the device, and the light that is found for them.
pub(crate) struct LitTexels {
    pub(crate) gpu: Arc<Gpu>,
    pub(crate) tile: wgpu::Buffer,
    /// Columns and rows, and the coordinates of the first texel in the whole image.
    pub(crate) size: [u32; 2],
    pub(crate) first: [u32; 2],
    pub(crate) g_buffer: GBuffer,
    pub(crate) count: u32,
    pub(crate) buffers: LitBuffers,
}

impl LitTexels {
    /// Buffers of the light of emitters and of other surfaces.
    pub(crate) fn found(&self) -> &FoundLight {
        let LitBuffers { found, count, capacity, .. } = &self.buffers;
        found.get_or_init(|| FoundLight::new(&self.gpu, *count, *capacity))
    }

    /// Binds what a program reads to find texels.
    pub(crate) fn bind<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        self.bind_size(call).read("g_materials", &self.g_buffer.materials)
    }

    /// Binds what a program reads to find how many texels there are.
    pub(crate) fn bind_size<'b>(&'b self, call: ComputeCall<'b>) -> ComputeCall<'b> {
        call.read("tile", &self.tile).read("g_surfaces", &self.g_buffer.surfaces)
    }
}
