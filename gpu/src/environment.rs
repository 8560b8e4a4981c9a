//! Environment maps on the device. Both roles look them up with `shaders/shared/shading.wgsl`.

use argus_scene::{RenderError, Sky};

use crate::Gpu;

/// The environment map of a sky, or a black texel in place of one.
#[derive(Debug, Clone)]
pub struct EnvironmentTexture {
    view: wgpu::TextureView,
    hash: Option<[u8; 32]>,
}

impl EnvironmentTexture {
    /// Uploads the map of a sky. A sky without a map gets a texel that programs bind and never read.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for a map that is larger than the device's textures.
    pub fn new(gpu: &Gpu, sky: &Sky) -> Result<Self, RenderError> {
        let Some(map) = &sky.map else { return Ok(Self::none(gpu)) };
        let [width, height] = map.size();
        let most = gpu.device.limits().max_texture_dimension_2d;
        if width > most {
            let reason = format!(
                "the environment map has {width}×{height} texels, and this device has textures of at most {most} a side"
            );
            return Err(RenderError::OutOfMemory(reason));
        }
        Ok(Self { view: upload(gpu, map.size(), map.texels()), hash: Some(map.hash()) })
    }

    /// What is bound where there is no map.
    pub fn none(gpu: &Gpu) -> Self {
        Self { view: upload(gpu, [1, 1], &[0]), hash: None }
    }

    /// The texture, which programs name `environment_map`.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Whether it is a map: the value of the programs' override `has_environment`.
    pub fn is_map(&self) -> bool {
        self.hash.is_some()
    }

    /// Hash of the map; `None` without one.
    pub fn hash(&self) -> Option<[u8; 32]> {
        self.hash
    }
}

fn upload(gpu: &Gpu, [width, height]: [u32; 2], texels: &[u32]) -> wgpu::TextureView {
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let format = wgpu::TextureFormat::Rgb9e5Ufloat;
    let texture = gpu.texture_2d("environment map", [width, height], format, usage);
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(width * 4),
        rows_per_image: Some(height),
    };
    gpu.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(texels),
        layout,
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
