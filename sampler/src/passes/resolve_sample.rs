//! Program: `shaders/sampler/resolve_sample.wgsl`. Quantises texels into the planes of a sample.

use std::sync::Arc;

use argus_gpu::{Commands, ComputePipeline, Gpu, PendingReadback, plane, wgpu};
use argus_scene::{InvalidField, Plane, PlaneData, PlaneFormat, PlaneKind, RenderError, Sample};
use argus_shaders::layout::sampler::ResolveSample as Parameters;
use argus_shaders::sampler::RESOLVE_SAMPLE;

use super::TileContext;
use crate::{RadianceFormat, SamplerSettings};

/// Alignment of the rows of device planes, in texels: 256 bytes of the smallest texel.
const ROW_TEXELS: u32 = 64;

/// Quantises texels, after reducing sub-samples to texels where those were shaded. Nothing else loses precision.
pub struct ResolveSample {
    pipeline: ComputePipeline,
    glossy: bool,
    reflects: bool,
    /// Samples have a LightVisibility plane.
    light_seen: bool,
    /// Bound where surfaces look up no probes, or see all light.
    unused: wgpu::Buffer,
    /// Bound without direct light by rays.
    nothing_arrives: wgpu::Buffer,
}

/// Planes of one sample while it is rendered.
pub struct PlaneBuffers {
    planes: Vec<(PlaneKind, PlaneFormat, wgpu::Buffer)>,
    size: [u32; 2],
    /// Texels from one row to the next.
    stride: u32,
}

impl ResolveSample {
    /// The pipeline for a scene with or without glossy materials and reflection probes. `side` is the number of shaded
    /// sub-samples along a texel's side; 1 if texels were shaded.
    pub fn new(gpu: &Gpu, glossy: bool, side: u32, reflects: bool, light_seen: bool) -> Self {
        let entry = if glossy { "resolve_glossy" } else { "resolve_matt" };
        let (reflects, light_seen) = (glossy && reflects, glossy && light_seen);
        let flag = |on: bool| f64::from(u8::from(on));
        let constants =
            [("side", f64::from(side)), ("reflects", flag(reflects)), ("light_seen", flag(light_seen))];
        Self {
            pipeline: gpu.compute_pipeline_with(&RESOLVE_SAMPLE, entry, &constants),
            glossy,
            reflects,
            light_seen,
            unused: gpu.buffer("unused", 16, wgpu::BufferUsages::STORAGE),
            nothing_arrives: gpu.buffer("nothing arrives", 16, wgpu::BufferUsages::STORAGE),
        }
    }

    /// Buffers for a sample of `size` texels. Rows are padded unless they are read back.
    pub fn planes(
        &self,
        gpu: &Gpu,
        settings: &SamplerSettings,
        size: [u32; 2],
        to_host: bool,
    ) -> PlaneBuffers {
        let stride = if to_host { size[0] } else { size[0].next_multiple_of(ROW_TEXELS) };
        let mut kinds = vec![
            (PlaneKind::Radiance, settings.radiance.plane()),
            (PlaneKind::InverseRange, PlaneFormat::R32Float),
        ];
        if self.glossy {
            kinds.push((PlaneKind::Normal, PlaneFormat::Rg16Snorm));
            kinds.push((PlaneKind::Specular, PlaneFormat::Rgba8Unorm));
        }
        if self.reflects {
            kinds.push((PlaneKind::Reflector, PlaneFormat::R32Uint));
        }
        if self.light_seen {
            kinds.push((PlaneKind::LightVisibility, PlaneFormat::Rgba8Unorm));
        }
        let planes = kinds
            .into_iter()
            .map(|(kind, format)| {
                let bytes = u64::from(stride) * u64::from(size[1]) * format.texel_bytes() as u64;
                let usage =
                    wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
                (kind, format, gpu.buffer("sample plane", bytes, usage))
            })
            .collect();
        PlaneBuffers { planes, size, stride }
    }

    /// Writes a tile's texels into the planes. `arriving` is its direct light by rays, if there is any.
    pub fn record(
        &self,
        commands: &mut Commands,
        context: &TileContext<'_>,
        settings: &SamplerSettings,
        planes: &PlaneBuffers,
        arriving: Option<&wgpu::Buffer>,
    ) {
        let TileContext { gpu, targets, tile, .. } = context;
        let parameters = Parameters {
            size: tile.size,
            offset: tile.offset(),
            stride: planes.stride,
            range_bits: settings.range_bits,
            half_float: u32::from(settings.radiance == RadianceFormat::HalfFloat),
            shaded_stride: tile.sub_samples()[0],
        };
        let parameters = gpu.upload("resolve sample", &[parameters], wgpu::BufferUsages::UNIFORM);
        let mut call = commands
            .compute("store texels", &self.pipeline)
            .read("resolve", &parameters)
            .read("shaded", &targets.shaded);
        if let (true, Some(gloss)) = (self.glossy, &targets.gloss) {
            call = call.read("gloss", gloss).read("reflectors", targets.reflectors.as_ref().unwrap_or(gloss));
            if !self.reflects {
                call = call.write("reflector_plane", &self.unused);
            }
            call = call.read("arriving", arriving.unwrap_or(&self.nothing_arrives));
            if !self.light_seen {
                call = call.write("light_visibility_plane", &self.unused);
            }
        }
        for (kind, _, buffer) in &planes.planes {
            call = call.write(name(*kind), buffer);
        }
        call.dispatch_threads([tile.size[0], tile.size[1], 1]);
    }
}

/// The plane's name in the program.
fn name(kind: PlaneKind) -> &'static str {
    match kind {
        PlaneKind::Radiance => "radiance_plane",
        PlaneKind::InverseRange => "inverse_range_plane",
        PlaneKind::Normal => "normal_plane",
        PlaneKind::Specular => "specular_plane",
        PlaneKind::Reflector => "reflector_plane",
        PlaneKind::LightVisibility => "light_visibility_plane",
        PlaneKind::ProbeSphere => "no plane of a sample",
    }
}

impl PlaneBuffers {
    /// The planes of a finished sample: read back, or as textures on the device.
    ///
    /// # Errors
    /// The errors of the device.
    pub fn hand_over(&self, gpu: &Arc<Gpu>, to_host: bool) -> Result<Vec<Plane>, RenderError> {
        let mut commands = gpu.commands("hand sample over");
        if !to_host {
            let planes = self.to_textures(gpu, &mut commands);
            commands.submit().wait()?;
            return Ok(planes);
        }
        let pending = self.read(&mut commands);
        let mut finished = commands.submit().wait()?;
        let host = |(kind, format, pending)| {
            let data = PlaneData::Host(finished.take(pending));
            Plane { kind, format, size: self.size, data }
        };
        Ok(pending.into_iter().map(host).collect())
    }

    /// Begins with the texels of a sample of the same camera. Tiles that are rendered replace theirs.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for a sample of other planes; errors of reading them back.
    pub(crate) fn take_over(&self, gpu: &Arc<Gpu>, sample: &Sample) -> Result<(), RenderError> {
        for (kind, format, buffer) in &self.planes {
            let plane =
                sample.plane(*kind).filter(|plane| plane.format == *format && plane.size == self.size);
            let plane = plane.ok_or_else(|| {
                let reason = format!("sample {} has no {kind:?} plane like that of the job", sample.id);
                InvalidField::new("extended.planes", reason)
            })?;
            let PlaneData::Host(bytes) = plane::to_host(gpu, plane)?.data else { continue };
            let texel = format.texel_bytes();
            let [row, stride] = [self.size[0], self.stride].map(|texels| texels as usize * texel);
            let mut padded = vec![0; stride * self.size[1] as usize];
            let faces = sample.camera.faces().into_iter().enumerate();
            for (_, face) in faces.filter(|(number, _)| sample.faces.has(*number)) {
                let ([x, y], [width, height]) =
                    (face.offset.map(|at| at as usize), face.size.map(|side| side as usize));
                for y in y..y + height {
                    let texels = |row: usize| y * row + x * texel..y * row + (x + width) * texel;
                    padded[texels(stride)].copy_from_slice(&bytes[texels(row)]);
                }
            }
            gpu.queue.write_buffer(buffer, 0, &padded);
        }
        Ok(())
    }

    /// Reads back the planes. Rows must not be padded.
    pub(crate) fn read(&self, commands: &mut Commands) -> Vec<(PlaneKind, PlaneFormat, PendingReadback)> {
        let pending = self.planes.iter().map(|(kind, format, buffer)| {
            let texels = u64::from(self.stride) * u64::from(self.size[1]);
            (*kind, *format, commands.read_buffer(buffer, 0..texels * format.texel_bytes() as u64))
        });
        pending.collect()
    }

    /// Copies the planes into new textures.
    pub(crate) fn to_textures(&self, gpu: &Gpu, commands: &mut Commands) -> Vec<Plane> {
        let [width, height] = self.size;
        let extent = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let planes = self.planes.iter().map(|(kind, format, buffer)| {
            let texture =
                gpu.texture_2d("sample plane", self.size, plane::texture_format(*format), plane::USAGE);
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(self.stride * format.texel_bytes() as u32),
                rows_per_image: None,
            };
            let from = wgpu::TexelCopyBufferInfo { buffer, layout };
            commands.encoder().copy_buffer_to_texture(from, texture.as_image_copy(), extent);
            plane::device_plane(*kind, *format, texture)
        });
        planes.collect()
    }
}
