//! Pyramids of samples' nearest surfaces. They are built when a pyramid search first reads a sample.

use argus_gpu::{Gpu, wgpu};
use argus_scene::{InvalidField, RenderError};

/// Texels on a side of the tile that a workgroup reduces to one cell.
pub(crate) const TILE: u32 = 64;

/// The pyramids of one pool's samples, one a layer.
#[derive(Debug)]
pub(crate) struct Pyramids {
    /// All levels of a sample side by side: `shaders/shared/levels.wgsl`.
    pub(crate) view: wgpu::TextureView,
    /// Whether a layer's pyramid is built.
    made: Vec<bool>,
}

/// Columns and rows of the image that holds all levels of a sample. The first level has the sample's texels, rounded up
/// to whole tiles; the others lie below it.
fn cells(size: [u32; 2]) -> [u32; 2] {
    let [width, height] = size.map(|side| side.next_multiple_of(TILE));
    [width, height + height / 2]
}

/// Bytes of the pyramids of `layers` samples.
pub(crate) fn bytes(size: [u32; 2], layers: u32) -> u64 {
    cells(size).iter().fold(4 * u64::from(layers), |bytes, &side| bytes * u64::from(side))
}

impl Pyramids {
    /// Allocates the pyramids of a pool's samples. None is built yet.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] if the levels of a sample exceed the device's texture size.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2], layers: u32) -> Result<Self, RenderError> {
        let [width, height] = cells(size);
        let most = gpu.device.limits().max_texture_dimension_2d;
        if width.max(height) > most {
            let reason =
                format!("a pyramid of {width}×{height} cells is more than the {most} of this device");
            return Err(InvalidField::new("plan.search", reason).into());
        }
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("nearest surfaces"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        // Explicit, because the default for one layer is a plain 2D view.
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        Ok(Self { view, made: vec![false; layers as usize] })
    }

    /// Whether a layer's pyramid is built.
    pub(crate) fn is_made(&self, layer: u32) -> bool {
        self.made[layer as usize]
    }

    /// Marks the pyramids of layers as built.
    pub(crate) fn set_made(&mut self, layers: &[u32]) {
        layers.iter().for_each(|&layer| self.made[layer as usize] = true);
    }

    /// Marks a layer's pyramid as missing, because its sample was released.
    pub(crate) fn forget(&mut self, layer: u32) {
        self.made[layer as usize] = false;
    }
}
