//! Texture arrays that samples of one size and format are layers of.
//!
//! Binding arrays are not available everywhere, so all samples that a view may be made of must lie in one
//! array per plane. Samples of a rig share a size, so in practice there is one pool.

use std::sync::Arc;

use argus_gpu::Gpu;
use argus_gpu::plane::{self, texture_format};
use argus_gpu::wgpu;
use argus_scene::{PlaneFormat, PlaneKind, RenderError, Sample};

use crate::passes::halve::HalvePass;
use crate::pyramid::{self, Pyramids};

/// What samples must have in common to share texture arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PoolClass {
    pub(crate) size: [u32; 2],
    pub(crate) radiance: PlaneFormat,
    pub(crate) glossy: bool,
    /// They say which map of surroundings each surface looks up.
    pub(crate) reflects: bool,
    pub(crate) omni: bool,
}

/// The texture format of the display plane: sRGB, and whether it is glossy.
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
        planes
    }

    /// Levels of a plane, each half as fine as the one before: radiance is looked up with a footprint that fits the view.
    fn levels(&self, kind: PlaneKind) -> u32 {
        let shortest = self.size[0].min(self.size[1]);
        let most = if kind == PlaneKind::Radiance { MAX_LEVELS } else { 1 };
        // A level of a few texels is of no use, least for the faces of a cube.
        (1..most).take_while(|&level| (shortest >> level) >= LEAST_SIDE).count() as u32 + 1
    }

    /// Bytes of one sample.
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

/// One plane's array, and the views that passes bind.
#[derive(Debug)]
pub(crate) struct Array {
    pub(crate) texture: wgpu::Texture,
    /// All levels.
    pub(crate) view: wgpu::TextureView,
    /// Each level alone.
    pub(crate) levels: Vec<wgpu::TextureView>,
}

impl Array {
    fn new(gpu: &Gpu, desc: &wgpu::TextureDescriptor<'_>) -> Self {
        let texture = gpu.device.create_texture(desc);
        let view = |base_mip_level, mip_level_count| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                // Said outright, since a pool of one layer would be seen as no array.
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                base_mip_level,
                mip_level_count,
                ..Default::default()
            })
        };
        let levels = (0..desc.mip_level_count).map(|level| view(level, Some(1))).collect();
        Self { view: view(0, None), levels, texture }
    }

    /// A level alone, or the coarsest if there is none so coarse.
    pub(crate) fn level(&self, level: u32) -> &wgpu::TextureView {
        &self.levels[(level as usize).min(self.levels.len() - 1)]
    }

    /// Copies the layers of a smaller array.
    fn copy_from(&self, old: &Self, encoder: &mut wgpu::CommandEncoder) {
        for mip_level in 0..self.texture.mip_level_count() {
            let kept = wgpu::Extent3d {
                width: self.texture.width() >> mip_level,
                height: self.texture.height() >> mip_level,
                depth_or_array_layers: old.texture.depth_or_array_layers(),
            };
            let level = |texture| wgpu::TexelCopyTextureInfo {
                texture,
                mip_level,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::All,
            };
            encoder.copy_texture_to_texture(level(&old.texture), level(&self.texture), kept);
        }
    }
}

/// The arrays of a class.
#[derive(Debug)]
struct Arrays {
    planes: Vec<(PlaneKind, Array)>,
    /// What most views show of the samples, derived from the planes: `shaders/compositor/mips.wgsl`.
    display: Array,
}

/// Samples of one class.
#[derive(Debug)]
pub(crate) struct Pool {
    pub(crate) class: PoolClass,
    arrays: Option<Arrays>,
    capacity: u32,
    free: Vec<u32>,
    pyramids: Option<Pyramids>,
}

/// Levels of radiance: a view may be up to eight times as coarse as its samples before it aliases.
const MAX_LEVELS: u32 = 4;

/// Texels on a side of the coarsest level.
const LEAST_SIDE: u32 = 16;

/// Layers that a pool begins with: the samples of one tile or the nearest of one cell.
const FIRST_LAYERS: u32 = 4;

impl Pool {
    /// An empty pool; memory is taken with the first sample.
    pub(crate) fn new(class: PoolClass) -> Self {
        Self { class, arrays: None, capacity: 0, free: Vec::new(), pyramids: None }
    }

    /// The array of a plane that the class has.
    ///
    /// # Errors
    /// [`RenderError::Internal`] for one that it has not.
    pub(crate) fn array(&self, kind: PlaneKind) -> Result<&Array, RenderError> {
        let planes = self.arrays.iter().flat_map(|arrays| &arrays.planes);
        let array = planes.into_iter().find(|(of, _)| *of == kind).map(|(_, array)| array);
        array.ok_or_else(|| RenderError::Internal(format!("no samples have a {kind:?} plane")))
    }

    /// All levels of a plane that the class has.
    ///
    /// # Errors
    /// As [`Pool::array`].
    pub(crate) fn view(&self, kind: PlaneKind) -> Result<&wgpu::TextureView, RenderError> {
        Ok(&self.array(kind)?.view)
    }

    /// What views show of the samples.
    ///
    /// # Errors
    /// [`RenderError::Internal`] where no sample was ever held.
    pub(crate) fn display(&self) -> Result<&Array, RenderError> {
        let missing = || RenderError::Internal("a pool without samples has no display plane".to_owned());
        self.arrays.as_ref().map(|arrays| &arrays.display).ok_or_else(missing)
    }

    /// The array of a plane, or that of radiance where the class has none: programs name what only glossy samples have, and
    /// look at it only there.
    ///
    /// # Errors
    /// As [`Pool::view`].
    pub(crate) fn view_or_radiance(&self, kind: PlaneKind) -> Result<&wgpu::TextureView, RenderError> {
        self.view(kind).or_else(|_| self.view(PlaneKind::Radiance))
    }

    /// A layer for one more sample, doubling the arrays where all are taken.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] beyond the layers that the device can address.
    pub(crate) fn take_layer(&mut self, gpu: &Gpu) -> Result<u32, RenderError> {
        if let Some(layer) = self.free.pop() {
            return Ok(layer);
        }
        let most = gpu.device.limits().max_texture_array_layers;
        if self.capacity >= most {
            let reason =
                format!("{most} samples of one size are held, and a texture array has no more layers");
            return Err(RenderError::OutOfMemory(reason));
        }
        let capacity = (2 * self.capacity).clamp(FIRST_LAYERS, most);
        self.grow(gpu, capacity);
        // Made again, in a larger array, by the next search that asks.
        self.pyramids = None;
        self.free.extend((self.capacity..capacity).rev());
        self.capacity = capacity;
        self.free.pop().ok_or_else(|| RenderError::Internal("a grown pool has no free layer".to_owned()))
    }

    /// Gives a layer back.
    pub(crate) fn free_layer(&mut self, layer: u32) {
        self.free.push(layer);
        if let Some(pyramids) = &mut self.pyramids {
            pyramids.forget(layer);
        }
    }

    /// Makes the pyramids of samples that have none yet.
    ///
    /// # Errors
    /// Whatever the device fails with.
    pub(crate) fn make_pyramids(
        &mut self,
        gpu: &Arc<Gpu>,
        pass: &HalvePass,
        layers: impl Iterator<Item = u32>,
    ) -> Result<(), RenderError> {
        let mut pyramids = match self.pyramids.take() {
            Some(pyramids) => pyramids,
            None => Pyramids::new(gpu, self.class.size, self.capacity)?,
        };
        let made =
            self.view(PlaneKind::InverseRange).and_then(|plane| pyramids.make(gpu, pass, plane, layers));
        self.pyramids = Some(pyramids);
        made
    }

    /// What a pyramid search reads, once [`Pool::make_pyramids`] made it.
    ///
    /// # Errors
    /// [`RenderError::Internal`] before.
    pub(crate) fn pyramids(&self) -> Result<&wgpu::TextureView, RenderError> {
        let missing = || RenderError::Internal("pyramids are searched that were never made".to_owned());
        self.pyramids.as_ref().map(|pyramids| &pyramids.view).ok_or_else(missing)
    }

    /// Device memory that pyramids take, or would take if `wanted`.
    pub(crate) fn pyramid_bytes(&self, wanted: bool) -> u64 {
        if wanted || self.pyramids.is_some() { pyramid::bytes(self.class.size, self.capacity) } else { 0 }
    }

    /// Whether no sample is in it.
    pub(crate) fn is_empty(&self) -> bool {
        self.free.len() as u32 == self.capacity
    }

    /// Puts a sample's planes into a layer.
    ///
    /// # Errors
    /// [`RenderError::Internal`] if they do not fit, which validation excludes.
    pub(crate) fn write(&self, gpu: &Gpu, sample: &Sample, layer: u32) -> Result<(), RenderError> {
        for (kind, array) in self.arrays.iter().flat_map(|arrays| &arrays.planes) {
            if let Some(plane) = sample.plane(*kind) {
                plane::copy_into_layer(gpu, plane, &array.texture, layer)?;
            }
        }
        Ok(())
    }

    fn grow(&mut self, gpu: &Gpu, capacity: u32) {
        let [width, height] = self.class.size;
        let label = wgpu::CommandEncoderDescriptor { label: Some("grow sample pool") };
        let mut encoder = gpu.device.create_command_encoder(&label);
        let array = |levels, format, usage| {
            Array::new(
                gpu,
                &wgpu::TextureDescriptor {
                    label: Some("samples"),
                    size: wgpu::Extent3d { width, height, depth_or_array_layers: capacity },
                    mip_level_count: levels,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage,
                    view_formats: &[],
                },
            )
        };
        let plane =
            |(kind, format)| (kind, array(self.class.levels(kind), texture_format(format), plane::USAGE));
        let display_usage = plane::USAGE | wgpu::TextureUsages::STORAGE_BINDING;
        let new = Arrays {
            planes: self.class.planes().into_iter().map(plane).collect(),
            display: array(self.class.levels(PlaneKind::Radiance), DISPLAY, display_usage),
        };
        if let Some(old) = &self.arrays {
            for ((_, new), (_, old)) in new.planes.iter().zip(&old.planes) {
                new.copy_from(old, &mut encoder);
            }
            new.display.copy_from(&old.display, &mut encoder);
        }
        self.arrays = Some(new);
        gpu.queue.submit([encoder.finish()]);
        tracing::debug!(layers = capacity, ?self.class, "sample pool grown");
    }
}
