//! Validates samples before they are uploaded.

use argus_gpu::plane::device_texture;
use argus_scene::{InvalidField, PlaneData, PlaneFormat, PlaneKind, RenderError, Sample, SampleCamera};

use crate::arrays::PoolClass;

/// Most texels on a side that a splat's blocks can address.
const MAX_SIDE: u32 = (1 << 14) - 1;

/// The class of a sample.
///
/// # Errors
/// [`RenderError::Invalid`] that names the invalid plane and the reason.
pub(crate) fn class_of(sample: &Sample) -> Result<PoolClass, RenderError> {
    let invalid = |reason: String| RenderError::from(InvalidField::new("sample.planes", reason));
    let omni = match sample.camera {
        SampleCamera::Perspective { camera, .. } => {
            camera.validate()?;
            false
        }
        SampleCamera::Omni { center, .. } => {
            if !center.is_finite() {
                return Err(
                    InvalidField::new("sample.camera", format!("must be finite, not {center}")).into()
                );
            }
            true
        }
    };
    if sample.camera.faces().is_empty() {
        let reason = "a dual paraboloid is no set of pinhole images, and is not warped";
        return Err(InvalidField::new("sample.camera", reason).into());
    }
    let size = sample.camera.size();
    if size.iter().any(|side| !(1..=MAX_SIDE).contains(side)) {
        return Err(invalid(format!("{}×{} texels: sides must be 1 to {MAX_SIDE}", size[0], size[1])));
    }
    let required = |kind: PlaneKind| {
        sample.plane(kind).ok_or_else(|| invalid(format!("sample {} has no {kind:?} plane", sample.id)))
    };
    let radiance = required(PlaneKind::Radiance)?.format;
    required(PlaneKind::InverseRange)?;
    let has = |kind| sample.plane(kind).is_some();
    let glossy = has(PlaneKind::Normal);
    if glossy != has(PlaneKind::Specular) {
        return Err(invalid("Normal and Specular planes come together or not at all".to_owned()));
    }
    let reflects = has(PlaneKind::Reflector);
    let light_seen = has(PlaneKind::LightVisibility);
    if (reflects || light_seen) && !glossy {
        return Err(invalid("Reflector and LightVisibility planes come with Normal".to_owned()));
    }
    for (i, plane) in sample.planes.iter().enumerate() {
        let kind = plane.kind;
        if sample.planes[..i].iter().any(|other| other.kind == kind) {
            return Err(invalid(format!("two {kind:?} planes")));
        }
        let formats: &[PlaneFormat] = match kind {
            PlaneKind::Radiance => &[PlaneFormat::Rgb9e5Ufloat, PlaneFormat::Rgba16Float],
            PlaneKind::InverseRange => &[PlaneFormat::R32Float],
            PlaneKind::Normal => &[PlaneFormat::Rg16Snorm],
            PlaneKind::Specular | PlaneKind::LightVisibility => &[PlaneFormat::Rgba8Unorm],
            PlaneKind::Reflector => &[PlaneFormat::R32Uint],
            PlaneKind::ProbeSphere => {
                return Err(invalid("a sample of the rig has no spheres of reflection probes".to_owned()));
            }
        };
        if !formats.contains(&plane.format) {
            return Err(invalid(format!("{kind:?} is stored as {:?}, not {formats:?}", plane.format)));
        }
        if plane.size != size {
            return Err(invalid(format!("{kind:?} has {:?} texels, the camera {size:?}", plane.size)));
        }
        match &plane.data {
            PlaneData::Host(bytes) => {
                let expected = size[0] as usize * size[1] as usize * plane.format.texel_bytes();
                if bytes.len() != expected {
                    let reason = format!("{kind:?} has {} bytes, not {expected}", bytes.len());
                    return Err(invalid(reason));
                }
            }
            PlaneData::Device(_) => {
                let texture = device_texture(plane)?.map(|t| [t.width(), t.height()]);
                if texture != Some(size) {
                    return Err(invalid(format!(
                        "{kind:?} is {texture:?} texels on the device, not {size:?}"
                    )));
                }
            }
        }
    }
    Ok(PoolClass { size, radiance, glossy, reflects, light_seen, omni })
}
