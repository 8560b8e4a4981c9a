//! Render targets and working buffers, kept from batch to batch.

use argus_gpu::{Gpu, wgpu};

/// A render target that is also read.
#[derive(Debug)]
pub(crate) struct Target {
    pub(crate) texture: wgpu::Texture,
    pub(crate) view: wgpu::TextureView,
}

/// Targets of the sizes that came up last, and the largest buffers that were needed.
#[derive(Debug, Default)]
pub(crate) struct Targets {
    kept: Vec<Target>,
    buffers: Vec<(&'static str, wgpu::Buffer)>,
}

/// Targets that are kept: the six kinds of two sizes, a batch's chunks and its last.
const KEPT: usize = 12;

impl Targets {
    /// A target whose content is whatever was there; [`Targets::give_back`] it.
    pub(crate) fn take(&mut self, gpu: &Gpu, size: [u32; 2], format: wgpu::TextureFormat) -> Target {
        let fits =
            |t: &Target| [t.texture.width(), t.texture.height()] == size && t.texture.format() == format;
        if let Some(index) = self.kept.iter().position(fits) {
            return self.kept.remove(index);
        }
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::COPY_SRC
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::STORAGE_BINDING;
        let texture = gpu.texture_2d("frames", size, format, usage);
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Target { texture, view }
    }

    /// Keeps a target for the next batch, in place of the one that was not needed for longest.
    pub(crate) fn give_back(&mut self, target: Target) {
        if self.kept.len() == KEPT {
            self.kept.remove(0);
        }
        self.kept.push(target);
    }

    /// A buffer of at least `size` bytes under that name; its content is whatever was there.
    pub(crate) fn buffer(
        &mut self,
        gpu: &Gpu,
        label: &'static str,
        size: u64,
        usage: wgpu::BufferUsages,
    ) -> wgpu::Buffer {
        if let Some((_, buffer)) = self.buffers.iter().find(|(l, b)| *l == label && b.size() >= size) {
            return buffer.clone();
        }
        self.buffers.retain(|(l, _)| *l != label);
        let buffer = gpu.buffer(label, size.next_power_of_two(), usage | wgpu::BufferUsages::COPY_DST);
        self.buffers.push((label, buffer.clone()));
        buffer
    }
}
