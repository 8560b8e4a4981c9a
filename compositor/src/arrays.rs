//! Texture arrays for samples of one class, with one layer a sample.

use argus_gpu::Gpu;
use argus_gpu::plane::{self, texture_format};
use argus_gpu::wgpu;
use argus_scene::{PlaneFormat, PlaneKind};

/// Properties that samples must share to be layers of the same texture arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PoolClass {
    pub(crate) size: [u32; 2],
    pub(crate) radiance: PlaneFormat,
    pub(crate) glossy: bool,
    /// Samples have a Reflector plane, which names the reflection probe of each surface.
    pub(crate) reflects: bool,
    /// Samples have a LightVisibility plane.
    pub(crate) light_seen: bool,
    pub(crate) omni: bool,
}

/// Texture format of the display plane: sRGB, and in alpha whether the surface is glossy.
pub(crate) const DISPLAY: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

impl PoolClass {
    fn planes(&self) -> Vec<(PlaneKind, PlaneFormat)> {
        let mut planes =
            vec![(PlaneKind::Radiance, self.radiance), (PlaneKind::InverseRange, PlaneFormat::R32Float)];
        if self.glossy {
            planes.push((PlaneKind::Normal, PlaneFormat::Rg16Snorm));
            planes.push((PlaneKind::Specular, PlaneFormat::Rgba8Unorm));
        }
        if self.reflects {
            planes.push((PlaneKind::Reflector, PlaneFormat::R32Uint));
        }
        if self.light_seen {
            planes.push((PlaneKind::LightVisibility, PlaneFormat::Rgba8Unorm));
        }
        planes
    }

    /// Number of mip levels of a plane. Only radiance has more than one, because views sample it at their own resolution.
    fn levels(&self, kind: PlaneKind) -> u32 {
        let shortest = self.size[0].min(self.size[1]);
        let most = if kind == PlaneKind::Radiance { MAX_LEVELS } else { 1 };
        // Levels of a few texels are useless, above all for the faces of a cube.
        (1..most).take_while(|&level| (shortest >> level) >= LEAST_SIDE).count() as u32 + 1
    }

    /// Bytes of one sample on the device.
    pub(crate) fn layer_bytes(&self) -> u64 {
        let texels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let plane = |&(kind, format): &(PlaneKind, PlaneFormat)| {
            let levels = (0..self.levels(kind)).map(|level| texels >> (2 * level)).sum::<u64>();
            format.texel_bytes() as u64 * levels
        };
        let display =
            (0..self.levels(PlaneKind::Radiance)).map(|level| 4 * (texels >> (2 * level))).sum::<u64>();
        self.planes().iter().map(plane).sum::<u64>() + display
    }
}

/// The texture array of one plane, and the texture views that passes bind.
#[derive(Debug)]
pub(crate) struct Array {
    pub(crate) texture: wgpu::Texture,
    /// All levels.
    pub(crate) view: wgpu::TextureView,
    /// One level each.
    pub(crate) levels: Vec<wgpu::TextureView>,
}

impl Array {
    fn new(gpu: &Gpu, desc: &wgpu::TextureDescriptor<'_>) -> Self {
        let texture = gpu.device.create_texture(desc);
        let view = |base_mip_level, mip_level_count| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                // Explicit, because the default for one layer is a plain 2D view.
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                base_mip_level,
                mip_level_count,
                ..Default::default()
            })
        };
        let levels = (0..desc.mip_level_count).map(|level| view(level, Some(1))).collect();
        Self { view: view(0, None), levels, texture }
    }

    /// The view of one level, or of the coarsest level if `level` is beyond it.
    pub(crate) fn level(&self, level: u32) -> &wgpu::TextureView {
        &self.levels[(level as usize).min(self.levels.len() - 1)]
    }

    /// Copies all levels of a layer of another array into a layer of this array.
    pub(crate) fn copy_layer(
        &self,
        layer: u32,
        from: &Self,
        source: u32,
        encoder: &mut wgpu::CommandEncoder,
    ) {
        for level in 0..self.texture.mip_level_count() {
            encoder.copy_texture_to_texture(
                from.at(level, source),
                self.at(level, layer),
                self.extent(level),
            );
        }
    }

    /// Fills all levels of a layer with zeros. Without this, wgpu clears all layers at the first use of one.
    pub(crate) fn clear_layer(&self, gpu: &Gpu, layer: u32, encoder: &mut wgpu::CommandEncoder) {
        let texel_bytes = self.texture.format().block_copy_size(None).unwrap_or(4);
        let pitch = (self.texture.width() * texel_bytes).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(pitch) * u64::from(self.texture.height());
        // A new buffer is zero.
        let zeros = gpu.buffer("zeros", bytes, wgpu::BufferUsages::COPY_SRC);
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: None };
        for level in 0..self.texture.mip_level_count() {
            let source = wgpu::TexelCopyBufferInfo { buffer: &zeros, layout };
            encoder.copy_buffer_to_texture(source, self.at(level, layer), self.extent(level));
        }
    }

    fn at(&self, mip_level: u32, layer: u32) -> wgpu::TexelCopyTextureInfo<'_> {
        let origin = wgpu::Origin3d { x: 0, y: 0, z: layer };
        wgpu::TexelCopyTextureInfo {
            texture: &self.texture,
            mip_level,
            origin,
            aspect: wgpu::TextureAspect::All,
        }
    }

    fn extent(&self, level: u32) -> wgpu::Extent3d {
        let side = |texels: u32| (texels >> level).max(1);
        let (width, height) = (side(self.texture.width()), side(self.texture.height()));
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 }
    }
}

/// The texture arrays of one class.
#[derive(Debug)]
pub(crate) struct Arrays {
    pub(crate) planes: Vec<(PlaneKind, Array)>,
    /// Display plane: exposed sRGB colours, derived from the planes by `shaders/compositor/mips.wgsl`.
    pub(crate) display: Array,
}

impl Arrays {
    /// Arrays of `layers` layers. Their content is undefined.
    pub(crate) fn new(gpu: &Gpu, class: &PoolClass, layers: u32) -> Self {
        let [width, height] = class.size;
        let array = |levels, format, usage| {
            Array::new(
                gpu,
                &wgpu::TextureDescriptor {
                    label: Some("samples"),
                    size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
                    mip_level_count: levels,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage,
                    view_formats: &[],
                },
            )
        };
        let plane = |(kind, format)| (kind, array(class.levels(kind), texture_format(format), plane::USAGE));
        let display_usage = plane::USAGE | wgpu::TextureUsages::STORAGE_BINDING;
        Self {
            planes: class.planes().into_iter().map(plane).collect(),
            display: array(class.levels(PlaneKind::Radiance), DISPLAY, display_usage),
        }
    }

    /// Number of arrays.
    pub(crate) fn count(&self) -> usize {
        self.planes.len() + 1
    }

    /// The array of an index. The display plane is the last one.
    pub(crate) fn array(&self, index: usize) -> &Array {
        self.planes.get(index).map_or(&self.display, |(_, array)| array)
    }
}

/// Most mip levels of radiance. A view up to eight times coarser than its samples does not alias.
const MAX_LEVELS: u32 = 4;

/// Fewest texels on the shorter side of the coarsest level.
const LEAST_SIDE: u32 = 16;
