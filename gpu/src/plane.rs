//! Sample planes as textures and as bytes.

use std::ops::Range;
use std::sync::Arc;

use argus_scene::{Plane, PlaneData, PlaneFormat, RenderError};

use crate::{Gpu, GpuError};

/// What [`PlaneData::Device`] holds: a texture with usages `TEXTURE_BINDING | COPY_SRC | COPY_DST`.
#[derive(Debug, Clone)]
pub struct DevicePlane(pub wgpu::Texture);

/// Usages of every plane's texture.
pub const USAGE: wgpu::TextureUsages = wgpu::TextureUsages::TEXTURE_BINDING
    .union(wgpu::TextureUsages::COPY_SRC)
    .union(wgpu::TextureUsages::COPY_DST);

/// The texture format of a plane format.
pub fn texture_format(format: PlaneFormat) -> wgpu::TextureFormat {
    match format {
        PlaneFormat::Rgb9e5Ufloat => wgpu::TextureFormat::Rgb9e5Ufloat,
        PlaneFormat::Rgba16Float => wgpu::TextureFormat::Rgba16Float,
        PlaneFormat::R32Float => wgpu::TextureFormat::R32Float,
        PlaneFormat::Rg16Snorm => wgpu::TextureFormat::Rg16Snorm,
        PlaneFormat::Rgba8Unorm => wgpu::TextureFormat::Rgba8Unorm,
        PlaneFormat::R32Uint => wgpu::TextureFormat::R32Uint,
    }
}

/// A plane whose texels are on the device.
pub fn device_plane(kind: argus_scene::PlaneKind, format: PlaneFormat, texture: wgpu::Texture) -> Plane {
    let size = [texture.width(), texture.height()];
    Plane { kind, format, size, data: PlaneData::Device(Arc::new(DevicePlane(texture))) }
}

/// The plane's texture; `Ok(None)` if its texels are on the host.
///
/// # Errors
/// The handle is not a texture, which is a bug.
pub fn device_texture(plane: &Plane) -> Result<Option<&wgpu::Texture>, RenderError> {
    match &plane.data {
        PlaneData::Host(_) => Ok(None),
        PlaneData::Device(handle) => match handle.downcast_ref::<DevicePlane>() {
            Some(DevicePlane(texture)) => Ok(Some(texture)),
            None => Err(RenderError::Internal("a plane's device handle is not a texture".to_owned())),
        },
    }
}

/// Copies a plane from host or device into a layer of a texture array (usage `COPY_DST`) before the next submit. Size and
/// format must match.
///
/// # Errors
/// [`RenderError::Internal`] if size or format differ; planes are validated earlier.
pub fn copy_into_layer(
    gpu: &Gpu,
    plane: &Plane,
    array: &wgpu::Texture,
    layer: u32,
) -> Result<(), RenderError> {
    copy_rows_into_layer(gpu, plane, 0..plane.size[1], array, layer)
}

/// Copies some rows of a plane into a layer of a texture array, like [`copy_into_layer`].
///
/// # Errors
/// [`RenderError::Internal`] if size or format differ, or the plane lacks the rows.
pub fn copy_rows_into_layer(
    gpu: &Gpu,
    plane: &Plane,
    rows: Range<u32>,
    array: &wgpu::Texture,
    layer: u32,
) -> Result<(), RenderError> {
    let [width, height] = plane.size;
    let fits =
        [array.width(), array.height()] == plane.size && array.format() == texture_format(plane.format);
    if !fits || rows.start > rows.end || rows.end > height {
        return Err(RenderError::Internal("a plane does not fit its texture array".to_owned()));
    }
    let extent = wgpu::Extent3d { width, height: rows.end - rows.start, depth_or_array_layers: 1 };
    let origin = wgpu::Origin3d { x: 0, y: rows.start, z: layer };
    let target =
        wgpu::TexelCopyTextureInfo { texture: array, mip_level: 0, origin, aspect: wgpu::TextureAspect::All };
    match &plane.data {
        PlaneData::Host(bytes) => {
            let row = width as usize * plane.format.texel_bytes();
            if bytes.len() != row * height as usize {
                return Err(RenderError::Internal("a plane's bytes do not match its size".to_owned()));
            }
            let layout = wgpu::TexelCopyBufferLayout {
                offset: u64::from(rows.start) * row as u64,
                bytes_per_row: Some(row as u32),
                rows_per_image: None,
            };
            gpu.queue.write_texture(target, bytes, layout, extent);
        }
        PlaneData::Device(_) => {
            let Some(texture) = device_texture(plane)? else { return Ok(()) };
            let label = wgpu::CommandEncoderDescriptor { label: Some("hold plane") };
            let mut encoder = gpu.device.create_command_encoder(&label);
            let mut source = texture.as_image_copy();
            source.origin.y = rows.start;
            encoder.copy_texture_to_texture(source, target, extent);
            gpu.queue.submit([encoder.finish()]);
        }
    }
    Ok(())
}

/// The plane with its texels on the host.
///
/// # Errors
/// [`GpuError`] if the readback fails.
pub fn to_host(gpu: &Arc<Gpu>, plane: &Plane) -> Result<Plane, RenderError> {
    let Some(texture) = device_texture(plane)? else { return Ok(plane.clone()) };
    let mut commands = gpu.commands("read plane back");
    let pending = commands.read_texture(texture);
    let bytes = commands.submit().wait().map_err(GpuError::into_render)?.take(pending);
    Ok(Plane { data: PlaneData::Host(bytes), ..plane.clone() })
}

impl GpuError {
    /// The error that roles report.
    pub fn into_render(self) -> RenderError {
        self.into()
    }
}
