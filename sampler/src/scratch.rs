//! Render targets and buffers of tiles, reused for tiles of the same size.

use argus_gpu::{Gpu, wgpu};

/// Format of the visibility buffer: instance + 1 and triangle.
pub(crate) const VISIBILITY: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;
/// Format of depth.
pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Most sub-samples that are kept in total, at 28 to 60 bytes each: two tiles of the largest size.
const KEPT: u64 = 2 << 22;

/// Targets of one size.
#[derive(Clone)]
pub struct Targets {
    size: [u32; 2],
    pub(crate) visibility: wgpu::TextureView,
    pub(crate) depth: wgpu::TextureView,
    /// Four floats a sub-sample.
    pub shaded: wgpu::Buffer,
    /// Two words a sub-sample; allocated when a glossy sample first needs it.
    pub(crate) gloss: Option<wgpu::Buffer>,
    /// A word a sub-sample; allocated when a sample with reflection probes first needs it.
    pub(crate) reflectors: Option<wgpu::Buffer>,
    /// Inputs of indirect light; `None` without indirect light.
    pub g_buffer: Option<GBuffer>,
}

/// The G-buffer: the surface of each sub-sample, written by shading for later light: `shaders/shared/g_buffer.wgsl`.
#[derive(Clone)]
pub struct GBuffer {
    /// Position and normal, four words a sub-sample.
    pub surfaces: wgpu::Buffer,
    /// Albedo, the triangle's normal, the start of rays to lights, and the specular lobe: four words a sub-sample.
    pub materials: wgpu::Buffer,
}

impl GBuffer {
    /// Surfaces and materials.
    pub fn both(&self) -> (&wgpu::Buffer, &wgpu::Buffer) {
        (&self.surfaces, &self.materials)
    }
}

/// Optional buffers of a tile.
#[derive(Debug, Clone, Copy, Default)]
pub struct Extras {
    /// Specular lobes, for glossy samples.
    pub gloss: bool,
    /// Numbers of reflectors.
    pub reflectors: bool,
    /// Inputs of later light.
    pub g_buffer: bool,
}

/// Targets of the most recently used sizes.
#[derive(Default)]
pub struct Scratch(Vec<Targets>);

impl Scratch {
    /// Targets for `size` sub-samples.
    pub(crate) fn targets(&mut self, gpu: &Gpu, size: [u32; 2], extras: Extras) -> Targets {
        let kept = self.0.iter().position(|t| t.size == size);
        let mut targets = match kept {
            Some(index) => self.0.remove(index),
            None => Targets::new(gpu, size),
        };
        let all = u64::from(size[0]) * u64::from(size[1]);
        let storage = wgpu::BufferUsages::STORAGE;
        if extras.gloss && targets.gloss.is_none() {
            targets.gloss = Some(gpu.buffer("gloss", all * 8, storage));
        }
        if extras.reflectors && targets.reflectors.is_none() {
            targets.reflectors =
                Some(gpu.buffer("reflectors", all * 4, storage | wgpu::BufferUsages::COPY_SRC));
        }
        if extras.g_buffer && targets.g_buffer.is_none() {
            targets.g_buffer = Some(GBuffer {
                surfaces: gpu.buffer(
                    "G-buffer, surfaces",
                    all * 16,
                    storage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                ),
                materials: gpu.buffer(
                    "G-buffer, materials",
                    all * 16,
                    storage | wgpu::BufferUsages::COPY_SRC,
                ),
            });
        }
        self.0.insert(0, targets.clone());
        let mut kept = 0;
        self.0.retain(|t| {
            kept += u64::from(t.size[0]) * u64::from(t.size[1]);
            kept <= KEPT
        });
        targets
    }
}

impl Targets {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let view = |label, format, usage| {
            gpu.texture_2d(label, size, format, usage).create_view(&wgpu::TextureViewDescriptor::default())
        };
        let bytes = u64::from(size[0]) * u64::from(size[1]) * 16;
        Self {
            size,
            // Rasterised, traced, or written from the CPU; read by shading, and read back by `identify`.
            visibility: view(
                "visibility",
                VISIBILITY,
                attachment
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_DST
                    | wgpu::TextureUsages::STORAGE_BINDING
                    | wgpu::TextureUsages::COPY_SRC,
            ),
            depth: view("depth", DEPTH, attachment),
            shaded: gpu.buffer("shaded sub-samples", bytes, wgpu::BufferUsages::STORAGE),
            gloss: None,
            reflectors: None,
            g_buffer: None,
        }
    }
}
