//! Pyramids of samples' nearest surfaces, made of those samples that a pyramid search asks for.

use std::sync::Arc;

use argus_gpu::{Gpu, wgpu};
use argus_scene::{InvalidField, RenderError};

use crate::passes::build_pyramid::{BuildPyramidPass, TILE};

/// The pyramids of the samples of one pool, one a layer.
#[derive(Debug)]
pub(crate) struct Pyramids {
    size: [u32; 2],
    /// All levels of a sample side by side: `shaders/shared/levels.wgsl`.
    pub(crate) view: wgpu::TextureView,
    /// Whether a layer's is made.
    made: Vec<bool>,
}

/// Cells of all levels of a sample: the first has as many as the sample has texels, rounded up to whole tiles, and lies
/// above the others.
fn cells(size: [u32; 2]) -> [u32; 2] {
    let [width, height] = size.map(|side| side.next_multiple_of(TILE));
    [width, height + height / 2]
}

/// Device memory for the pyramids of so many samples.
pub(crate) fn bytes(size: [u32; 2], layers: u32) -> u64 {
    cells(size).iter().fold(4 * u64::from(layers), |bytes, &side| bytes * u64::from(side))
}

impl Pyramids {
    /// Room for the pyramids of a pool's samples, none made yet.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for samples whose levels are larger than an image of this device may be.
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
        // Said outright, since an array of one layer would be seen as no array.
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        Ok(Self { size, view, made: vec![false; layers as usize] })
    }

    /// Makes the pyramids of those of the layers that have none yet, from the samples' inverse range.
    ///
    /// # Errors
    /// Whatever the device fails with.
    pub(crate) fn make(
        &mut self,
        gpu: &Arc<Gpu>,
        pass: &BuildPyramidPass,
        inverse_range: &wgpu::TextureView,
        layers: impl Iterator<Item = u32>,
    ) -> Result<(), RenderError> {
        let missing: Vec<u32> = layers.filter(|&layer| !self.made[layer as usize]).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let mut commands = gpu.commands("make pyramids");
        for &layer in &missing {
            pass.record(&mut commands, inverse_range, self.size, &self.view, layer);
        }
        commands.submit().wait()?;
        missing.iter().for_each(|&layer| self.made[layer as usize] = true);
        Ok(())
    }

    /// Says that a layer's sample is gone.
    pub(crate) fn forget(&mut self, layer: u32) {
        self.made[layer as usize] = false;
    }
}
