//! Texels of all textures in one texture array, addressed by `shaders/shared/texture.wgsl`.
//!
//! Mip levels are stored consecutively, row by row, wrapped into rows of 2048 texels and layers of 2048 rows. So textures
//! of any number and shape fit until the array is full: 2048 layers of 4 million texels on known drivers.

use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::material::{Filter, Wrap};
use argus_scene::texture::{MipChain, mip_chains};
use argus_scene::{RenderError, Scene};

/// Texels of a row of the array, and rows of a layer. Powers of two, as in the program.
const SIDE: u32 = 2048;

/// The levels of a texture.
pub(super) struct InstanceTransform {
    pub(super) size: [u32; 2],
    /// Index of its first entry in [`Texels::levels`].
    pub(super) first_level: u32,
    pub(super) levels: u32,
    pub(super) wrap: [Wrap; 2],
    pub(super) filter: Filter,
    pub(super) srgb: bool,
}

/// The texture array and its addresses.
pub(super) struct Texels {
    /// One entry a texture.
    pub(super) textures: Vec<InstanceTransform>,
    /// Address of each level's first texel.
    pub(super) levels: Vec<u32>,
    /// The array without sRGB decoding.
    pub(super) linear: wgpu::TextureView,
    /// A view of the array with sRGB decoding.
    pub(super) srgb: wgpu::TextureView,
}

impl Texels {
    /// Filters and uploads a scene's textures.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] if the array is full.
    pub(super) fn new(gpu: &Arc<Gpu>, scene: &Scene) -> Result<Self, RenderError> {
        let chains = mip_chains(scene);
        let (mut textures, mut levels, mut end) = (Vec::new(), Vec::new(), 0u64);
        for chain in &chains {
            textures.push(InstanceTransform {
                size: [chain.levels[0].width, chain.levels[0].height],
                first_level: levels.len() as u32,
                levels: chain.levels.len() as u32,
                wrap: chain.wrap,
                filter: chain.filter,
                srgb: chain.srgb,
            });
            for level in &chain.levels {
                levels.push(end as u32);
                end += u64::from(level.width) * u64::from(level.height);
            }
        }
        let layer = u64::from(SIDE) * u64::from(SIDE);
        let layers = end.div_ceil(layer).max(1);
        let most = u64::from(gpu.device.limits().max_texture_array_layers).min((1 << 32) / layer);
        if layers > most {
            let (mib, most) = (end >> 18, (most * layer) >> 18);
            let message =
                format!("textures of this scene take {mib} MiB, and this device binds at most {most} MiB");
            return Err(RenderError::OutOfMemory(message));
        }
        let height = if layers > 1 { SIDE } else { (end.div_ceil(u64::from(SIDE)) as u32).max(1) };
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("texels"),
            size: wgpu::Extent3d { width: SIDE, height, depth_or_array_layers: layers as u32 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[wgpu::TextureFormat::Rgba8UnormSrgb],
        });
        write(gpu, &texture, &chains);
        let view = |format| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                label: Some("texels"),
                format: Some(format),
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            })
        };
        let (linear, srgb) =
            (view(wgpu::TextureFormat::Rgba8Unorm), view(wgpu::TextureFormat::Rgba8UnormSrgb));
        Ok(Self { textures, levels, linear, srgb })
    }
}

/// Fills the array layer by layer.
fn write(gpu: &Gpu, texture: &wgpu::Texture, chains: &[MipChain]) {
    let row_bytes = SIDE as usize * 4;
    let layer_bytes = row_bytes * texture.height() as usize;
    let mut layer = 0;
    let mut pending: Vec<u8> = Vec::with_capacity(layer_bytes);
    let flush = |layer: u32, bytes: &mut Vec<u8>| {
        bytes.resize(bytes.len().next_multiple_of(row_bytes), 0);
        let to = wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
            aspect: wgpu::TextureAspect::All,
        };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row_bytes as u32),
            rows_per_image: None,
        };
        let height = (bytes.len() / row_bytes) as u32;
        let size = wgpu::Extent3d { width: SIDE, height, depth_or_array_layers: 1 };
        gpu.queue.write_texture(to, bytes, layout, size);
        // Submits at once to free staging memory, so that textures are not held twice.
        gpu.queue.submit([]);
        bytes.clear();
    };
    for level in chains.iter().flat_map(|chain| &chain.levels) {
        let mut rest = &level.rgba[..];
        while !rest.is_empty() {
            let (now, later) = rest.split_at(rest.len().min(layer_bytes - pending.len()));
            pending.extend_from_slice(now);
            rest = later;
            if pending.len() == layer_bytes {
                flush(layer, &mut pending);
                layer += 1;
            }
        }
    }
    if !pending.is_empty() {
        flush(layer, &mut pending);
    }
}
