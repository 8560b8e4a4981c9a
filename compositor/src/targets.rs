//! Render targets and working buffers, reused from batch to batch.

use argus_gpu::{Commands, Finished, Gpu, PendingReadback, wgpu};
use argus_scene::{Output, Outputs};

use crate::frames::ChunkImages;

/// sRGB and the source of a pixel.
pub(crate) const SRGB_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Uint;
/// Linear radiance and the source of a sub-pixel. Half floats have 11 bits, and a frame shows 8.
pub(crate) const LINEAR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Metres; 0 where there is no surface.
pub(crate) const RANGE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
/// Confidence in the low byte. 32 bits, because every device lets compute programs write this format.
pub(crate) const CONFIDENCE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

/// A render target that passes also sample and write.
#[derive(Debug)]
pub(crate) struct Target {
    pub(crate) texture: wgpu::Texture,
    pub(crate) view: wgpu::TextureView,
}

/// The images that a search writes. An image that no piece of the chunk needs has one texel: what is written outside it is
/// dropped.
#[derive(Debug)]
pub(crate) struct TargetSet {
    pub(crate) srgb: Target,
    pub(crate) linear: Target,
    pub(crate) range: Target,
    pub(crate) confidence: Target,
}

/// The images of one chunk.
#[derive(Debug)]
pub(crate) struct ChunkTargets {
    /// One texel a pixel; read back.
    pub(crate) pixels: TargetSet,
    /// One texel a sub-pixel, where they are drawn as linear radiance.
    pub(crate) sub_pixels: Option<TargetSet>,
    /// The outputs of all views of the chunk together.
    pub(crate) outputs: Outputs,
}

impl ChunkTargets {
    /// Images of `size` pixels, and of their sub-pixels as linear radiance with so many along the edge of a pixel.
    pub(crate) fn take(
        pool: &mut TargetPool,
        gpu: &Gpu,
        size: [u32; 2],
        sub_pixels: Option<u32>,
        outputs: Outputs,
    ) -> Self {
        let mut take =
            |wanted: bool, size, format| pool.take(gpu, if wanted { size } else { [1, 1] }, format);
        let has_range = outputs.has(Output::Range) || outputs.has(Output::Confidence) || sub_pixels.is_some();
        let pixels = TargetSet {
            srgb: take(true, size, SRGB_FORMAT),
            linear: take(false, size, LINEAR_FORMAT),
            range: take(has_range, size, RANGE_FORMAT),
            confidence: take(outputs.has(Output::Confidence), size, CONFIDENCE_FORMAT),
        };
        let sub_pixels = sub_pixels.map(|side| {
            let fine = size.map(|pixels| pixels * side);
            TargetSet {
                srgb: take(false, fine, SRGB_FORMAT),
                linear: take(true, fine, LINEAR_FORMAT),
                range: take(true, fine, RANGE_FORMAT),
                confidence: take(outputs.has(Output::Confidence), fine, CONFIDENCE_FORMAT),
            }
        });
        Self { pixels, sub_pixels, outputs }
    }

    /// The images that searches write.
    pub(crate) fn drawn(&self) -> &TargetSet {
        self.sub_pixels.as_ref().unwrap_or(&self.pixels)
    }

    /// Reads the images back that the chunk's views ask for.
    pub(crate) fn read_back(&self, commands: &mut Commands) -> ChunkReadback {
        let Self { pixels, sub_pixels, outputs } = self;
        let linear = sub_pixels.as_ref().filter(|_| outputs.has(Output::Radiance));
        ChunkReadback {
            srgb: commands.read_texture(&pixels.srgb.texture),
            linear: linear.map(|sub_pixels| commands.read_texture(&sub_pixels.linear.texture)),
            range: outputs.has(Output::Range).then(|| commands.read_texture(&pixels.range.texture)),
            confidence: outputs
                .has(Output::Confidence)
                .then(|| commands.read_texture(&pixels.confidence.texture)),
        }
    }

    /// Gives all images back to the pool.
    pub(crate) fn give_back(self, pool: &mut TargetPool) {
        for TargetSet { srgb, linear, range, confidence } in
            [Some(self.pixels), self.sub_pixels].into_iter().flatten()
        {
            [srgb, linear, range, confidence].into_iter().for_each(|target| pool.give_back(target));
        }
    }
}

/// Pending readbacks of a chunk's images.
#[derive(Debug)]
pub(crate) struct ChunkReadback {
    srgb: PendingReadback,
    linear: Option<PendingReadback>,
    range: Option<PendingReadback>,
    confidence: Option<PendingReadback>,
}

impl ChunkReadback {
    /// The images; those that were not read back are empty.
    pub(crate) fn take(self, finished: &mut Finished) -> ChunkImages {
        let mut optional = |pending: Option<PendingReadback>| {
            pending.map(|pending| finished.take(pending)).unwrap_or_default()
        };
        let (range, confidence) = (optional(self.range), optional(self.confidence));
        let linear = optional(self.linear);
        ChunkImages { srgb: finished.take(self.srgb), linear, range, confidence }
    }
}

/// The targets of the sizes that were used last, and the largest buffer of each name.
#[derive(Debug, Default)]
pub(crate) struct TargetPool {
    kept: Vec<Target>,
    buffers: Vec<(&'static str, wgpu::Buffer)>,
}

/// Targets that are kept: the eight images of two chunk sizes, a batch's usual one and its last.
const KEPT: usize = 16;

impl TargetPool {
    /// A target of undefined content. [`TargetPool::give_back`] returns it.
    fn take(&mut self, gpu: &Gpu, size: [u32; 2], format: wgpu::TextureFormat) -> Target {
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

    /// Keeps a target for the next batch. The least recently used one is dropped if there are too many.
    fn give_back(&mut self, target: Target) {
        if self.kept.len() == KEPT {
            self.kept.remove(0);
        }
        self.kept.push(target);
    }

    /// A buffer of at least `size` bytes under that name; its content is undefined.
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
