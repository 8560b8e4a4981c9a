//! Reflection probes on the device. Both roles look them up with `shaders/shared/reflection_probes.wgsl`.

use argus_scene::reflection::map_size;
use argus_scene::{
    InvalidField, OmniLayout, Plane, PlaneData, PlaneFormat, PlaneKind, RenderError, Sample, SampleCamera,
};
use argus_shaders::layout::shared::ProbeUniform;
use bytes::Bytes;
use glam::DVec3;

use crate::plane::texture_format;
use crate::{Bindable, Gpu};

/// The reflection probes of a scene at one time.
#[derive(Debug)]
pub struct ReflectionProbes {
    radiance: wgpu::TextureView,
    inverse_range: wgpu::TextureView,
    sampler: wgpu::Sampler,
    spheres: wgpu::Buffer,
    /// Bound in place of a missing Reflector plane.
    no_reflectors: wgpu::TextureView,
    /// Centre of the scene's bounds, metres, world space.
    middle: DVec3,
    side: u32,
    bytes: u64,
}

impl ReflectionProbes {
    /// Uploads a set's reflection probes.
    ///
    /// # Errors
    /// [`RenderError::Invalid`] for a sample of another kind or with wrong planes; [`RenderError::OutOfMemory`] for more
    /// probes than a texture array has layers.
    pub fn new(gpu: &Gpu, sample: &Sample) -> Result<Self, RenderError> {
        let invalid = |reason: String| RenderError::from(InvalidField::new("sample.planes", reason));
        let SampleCamera::Omni { center, layout: OmniLayout::ReflectionProbes { side, count } } =
            sample.camera
        else {
            return Err(InvalidField::new("sample.camera", "must be of reflection probes").into());
        };
        let most = gpu.device.limits().max_texture_array_layers;
        if count > most {
            let reason = format!("{count} reflection probes, and this device has {most} layers");
            return Err(RenderError::OutOfMemory(reason));
        }
        let host = |kind: PlaneKind, format: PlaneFormat| -> Result<(&Plane, &Bytes), RenderError> {
            let plane = sample
                .plane(kind)
                .ok_or_else(|| invalid(format!("reflection probes have no {kind:?} plane")))?;
            let size = Plane::size_of(kind, &sample.camera);
            let expected = size[0] as usize * size[1] as usize * plane.format.texel_bytes();
            match &plane.data {
                PlaneData::Host(bytes)
                    if plane.format == format && plane.size == size && bytes.len() == expected =>
                {
                    Ok((plane, bytes))
                }
                data => {
                    let is = format!("{:?} texels of {:?}, {data:?}", plane.size, plane.format);
                    Err(invalid(format!("{kind:?} is {is}, not {size:?} of {format:?} on the host")))
                }
            }
        };
        let radiance = host(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat)?;
        let inverse_range = host(PlaneKind::InverseRange, PlaneFormat::R32Float)?;
        let (_, spheres) = host(PlaneKind::ProbeSphere, PlaneFormat::R32Float)?;
        let spheres: Vec<[f32; 4]> =
            spheres.as_chunks::<16>().0.iter().map(|row| bytemuck::pod_read_unaligned(row)).collect();
        if !spheres.iter().flatten().all(|value| value.is_finite()) {
            return Err(invalid("the viewpoint or radius of a reflection probe is not finite".to_owned()));
        }
        let [width, height] = map_size(side);
        let layers = |(plane, bytes): (&Plane, &Bytes)| {
            let size = wgpu::Extent3d { width, height, depth_or_array_layers: count };
            let texture = array(gpu, size, texture_format(plane.format));
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * plane.format.texel_bytes() as u32),
                rows_per_image: Some(height),
            };
            gpu.queue.write_texture(texture.as_image_copy(), bytes, layout, size);
            view(&texture)
        };
        let bytes = (radiance.1.len() + inverse_range.1.len()) as u64;
        Ok(Self {
            radiance: layers(radiance),
            inverse_range: layers(inverse_range),
            spheres: gpu.upload("reflection probe spheres", &spheres, wgpu::BufferUsages::STORAGE),
            middle: center,
            side,
            bytes,
            ..Self::none(gpu)
        })
    }

    /// Bound where nothing looks up probes.
    pub fn none(gpu: &Gpu) -> Self {
        let one = wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 };
        let any = |format| view(&array(gpu, one, format));
        Self {
            radiance: any(wgpu::TextureFormat::Rgb9e5Ufloat),
            inverse_range: any(wgpu::TextureFormat::R32Float),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("reflection probes"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            spheres: gpu.upload("no reflection probes", &[[0f32; 4]], wgpu::BufferUsages::STORAGE),
            no_reflectors: any(wgpu::TextureFormat::R32Uint),
            middle: DVec3::ZERO,
            side: 1,
            bytes: 0,
        }
    }

    /// The uniform for an eye.
    pub fn uniform(&self, eye: DVec3) -> ProbeUniform {
        ProbeUniform { middle: (self.middle - eye).as_vec3().to_array(), side: self.side as f32 }
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The bindings by WGSL name.
    pub fn bindings(&self) -> [(&'static str, &dyn Bindable); 4] {
        [
            ("probe_radiance", &self.radiance),
            ("probe_range", &self.inverse_range),
            ("probe_sampler", &self.sampler),
            ("probe_spheres", &self.spheres),
        ]
    }

    /// Bound in place of the Reflector plane of samples without one.
    pub fn no_reflectors(&self) -> &wgpu::TextureView {
        &self.no_reflectors
    }
}

fn array(gpu: &Gpu, size: wgpu::Extent3d, format: wgpu::TextureFormat) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("reflection probes"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// An array view; explicit, because the default for one layer is a plain 2D view.
fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    let dimension = Some(wgpu::TextureViewDimension::D2Array);
    texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() })
}
