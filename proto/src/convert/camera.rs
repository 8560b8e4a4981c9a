//! Conversions of cameras, boxes and sample cameras.

use argus_scene::scene::NamedCamera;
use argus_scene::{Bounds, Camera, InvalidField, OmniLayout, Reflections, SampleCamera};
use glam::DVec3;

use super::{point, required};
use crate::v1;

/// Field of view of a camera whose field of view is absent: that of [`Camera::look_at`].
const DEFAULT_FOV_DEG: f64 = 45.0;

impl From<&Camera> for v1::Camera {
    fn from(camera: &Camera) -> Self {
        Self {
            eye: Some(camera.eye.into()),
            target: Some(camera.target.into()),
            up: Some(camera.up.into()),
            fov_deg: Some(camera.fov_deg),
        }
    }
}

impl TryFrom<v1::Camera> for Camera {
    type Error = InvalidField;

    /// The camera, validated.
    fn try_from(wire: v1::Camera) -> Result<Self, InvalidField> {
        let camera = Self {
            eye: point(wire.eye, "camera.eye")?,
            target: point(wire.target, "camera.target")?,
            up: match wire.up {
                None => DVec3::Y,
                up => point(up, "camera.up")?,
            },
            fov_deg: wire.fov_deg.unwrap_or(DEFAULT_FOV_DEG),
        };
        camera.validate()?;
        Ok(camera)
    }
}

impl From<&NamedCamera> for v1::NamedCamera {
    fn from(named: &NamedCamera) -> Self {
        Self { name: named.name.clone(), camera: Some((&named.camera).into()) }
    }
}

impl TryFrom<v1::NamedCamera> for NamedCamera {
    type Error = InvalidField;

    fn try_from(wire: v1::NamedCamera) -> Result<Self, InvalidField> {
        Ok(Self { name: wire.name, camera: required(wire.camera, "cameras.camera")?.try_into()? })
    }
}

impl From<Bounds> for v1::Bounds {
    /// An empty box has no corners on the wire, which carries no infinities.
    fn from(bounds: Bounds) -> Self {
        if bounds.is_empty() {
            return Self { min: None, max: None };
        }
        Self { min: Some(bounds.min.into()), max: Some(bounds.max.into()) }
    }
}

impl TryFrom<v1::Bounds> for Bounds {
    type Error = InvalidField;

    fn try_from(wire: v1::Bounds) -> Result<Self, InvalidField> {
        if wire.min.is_none() && wire.max.is_none() {
            return Ok(Self::EMPTY);
        }
        let bounds = Self { min: point(wire.min, "bounds.min")?, max: point(wire.max, "bounds.max")? };
        if bounds.is_empty() {
            return Err(InvalidField::new("bounds.max", "must not be less than bounds.min"));
        }
        Ok(bounds)
    }
}

impl From<&SampleCamera> for v1::SampleCamera {
    fn from(camera: &SampleCamera) -> Self {
        use v1::omni_camera::Layout;
        use v1::sample_camera::Kind;
        let kind = match camera {
            SampleCamera::Perspective { camera, width, height } => Kind::Perspective(v1::PerspectiveCamera {
                camera: Some(camera.into()),
                width: *width,
                height: *height,
            }),
            SampleCamera::Omni { center, layout } => Kind::Omni(v1::OmniCamera {
                center: Some((*center).into()),
                layout: Some(match *layout {
                    OmniLayout::CubeFaces { face } => Layout::CubeFace(face),
                    OmniLayout::DualParaboloid { side } => Layout::ParaboloidSide(side),
                    OmniLayout::ReflectionProbes { side, count } => {
                        Layout::ReflectionProbes(v1::ReflectionProbesLayout { side, count })
                    }
                }),
            }),
        };
        Self { kind: Some(kind) }
    }
}

impl TryFrom<v1::SampleCamera> for SampleCamera {
    type Error = InvalidField;

    /// The sample camera. Its size must be within the limits of [`argus_scene::Rig::validate`].
    fn try_from(wire: v1::SampleCamera) -> Result<Self, InvalidField> {
        use v1::omni_camera::Layout;
        use v1::sample_camera::Kind;
        let within = InvalidField::within::<u32>;
        match required(wire.kind, "sample.camera")? {
            Kind::Perspective(p) => Ok(Self::Perspective {
                camera: required(p.camera, "sample.camera.perspective.camera")?.try_into()?,
                width: within("sample.camera.perspective.width", p.width, 1..=8192)?,
                height: within("sample.camera.perspective.height", p.height, 1..=8192)?,
            }),
            Kind::Omni(o) => Ok(Self::Omni {
                center: point(o.center, "sample.camera.omni.center")?,
                layout: match required(o.layout, "sample.camera.omni.layout")? {
                    Layout::CubeFace(face) => OmniLayout::CubeFaces {
                        face: within("sample.camera.omni.cube_face", face, 8..=2048)?,
                    },
                    Layout::ParaboloidSide(side) => OmniLayout::DualParaboloid {
                        side: within("sample.camera.omni.paraboloid_side", side, 1..=4096)?,
                    },
                    Layout::ReflectionProbes(v1::ReflectionProbesLayout { side, count }) => {
                        let settings = Reflections { side, ..Reflections::default() };
                        settings.validate()?;
                        OmniLayout::ReflectionProbes {
                            side,
                            count: within("sample.camera.omni.reflection_probes.count", count, 1..=1024)?,
                        }
                    }
                },
            }),
        }
    }
}
