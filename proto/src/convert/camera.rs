//! Conversions of cameras, boxes and sample cameras.

use argus_scene::scene::NamedCamera;
use argus_scene::{
    Bounds, Camera, Distortion, Intrinsics, InvalidField, Lens, OmniLayout, RayList, Reflections,
    SampleCamera,
};
use glam::{DVec2, DVec3};

use super::{point, required};
use crate::v1;

impl From<&Camera> for v1::Camera {
    fn from(camera: &Camera) -> Self {
        Self {
            eye: Some(camera.eye.into()),
            target: Some(camera.target.into()),
            up: Some(camera.up.into()),
            fov_deg: camera.lens.is_none().then_some(camera.fov_deg),
            lens: camera.lens.as_ref().map(Into::into),
        }
    }
}

impl TryFrom<v1::Camera> for Camera {
    type Error = InvalidField;

    /// The camera, validated.
    fn try_from(wire: v1::Camera) -> Result<Self, InvalidField> {
        if wire.fov_deg.is_some() && wire.lens.is_some() {
            let reason = "must be absent where a lens is given, which has its own";
            return Err(InvalidField::new("camera.fov_deg", reason));
        }
        let camera = Self {
            eye: point(wire.eye, "camera.eye")?,
            target: point(wire.target, "camera.target")?,
            up: match wire.up {
                None => DVec3::Y,
                up => point(up, "camera.up")?,
            },
            fov_deg: wire.fov_deg.unwrap_or(Self::USUAL_FOV_DEG),
            lens: wire.lens.map(Lens::try_from).transpose()?,
        };
        camera.validate()?;
        Ok(camera)
    }
}

impl From<&Lens> for v1::camera::Lens {
    fn from(lens: &Lens) -> Self {
        use v1::intrinsics::Distortion as Wire;
        let Intrinsics { focal, center, distortion } = match lens {
            Lens::Intrinsics(intrinsics) => intrinsics,
            Lens::Equirectangular => return Self::Equirectangular(v1::Equirectangular {}),
            Lens::Rays { spacing_deg } => {
                return Self::ListedRays(v1::ListedRays { spacing_deg: Some(*spacing_deg) });
            }
        };
        let distortion = match *distortion {
            Distortion::None => None,
            Distortion::Rational([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                Some(Wire::Opencv(v1::OpenCvDistortion { k1, k2, p1, p2, k3, k4, k5, k6 }))
            }
            Distortion::Fisheye([k1, k2, k3, k4]) => {
                Some(Wire::Fisheye(v1::FisheyeDistortion { k1, k2, k3, k4 }))
            }
        };
        Self::Intrinsics(v1::Intrinsics {
            fx: focal.x,
            fy: focal.y,
            cx: center.x,
            cy: center.y,
            pixel_center: None,
            distortion,
        })
    }
}

impl TryFrom<v1::camera::Lens> for Lens {
    type Error = InvalidField;

    /// The lens, with the image's corner as origin; not validated.
    fn try_from(wire: v1::camera::Lens) -> Result<Self, InvalidField> {
        use v1::intrinsics::Distortion as Wire;
        let wire = match wire {
            v1::camera::Lens::Equirectangular(_) => return Ok(Self::Equirectangular),
            v1::camera::Lens::ListedRays(v1::ListedRays { spacing_deg }) => {
                let spacing_deg = spacing_deg.unwrap_or(RayList::USUAL_SPACING_DEG);
                return Ok(Self::Rays { spacing_deg });
            }
            v1::camera::Lens::Intrinsics(intrinsics) => intrinsics,
        };
        let pixel_center = wire.pixel_center.unwrap_or(0.5);
        if pixel_center != 0.5 && pixel_center != 0.0 {
            let reason = format!("must be 0.5 or 0, not {pixel_center}");
            return Err(InvalidField::new("camera.intrinsics.pixel_center", reason));
        }
        let distortion = match wire.distortion {
            None => Distortion::None,
            Some(Wire::Opencv(v1::OpenCvDistortion { k1, k2, p1, p2, k3, k4, k5, k6 })) => {
                Distortion::Rational([k1, k2, p1, p2, k3, k4, k5, k6])
            }
            Some(Wire::Fisheye(v1::FisheyeDistortion { k1, k2, k3, k4 })) => {
                Distortion::Fisheye([k1, k2, k3, k4])
            }
        };
        let focal = DVec2::new(wire.fx, wire.fy);
        let center = DVec2::new(wire.cx, wire.cy) + (0.5 - pixel_center);
        Ok(Self::Intrinsics(Intrinsics { focal, center, distortion }))
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
            Kind::Perspective(p) => {
                const FIELD: &str = "sample.camera.perspective.camera";
                let camera = Camera::try_from(required(p.camera, FIELD)?)?;
                if !camera.is_pinhole() {
                    return Err(InvalidField::new(FIELD, "a sample is the image of a pinhole"));
                }
                Ok(Self::Perspective {
                    camera,
                    width: within("sample.camera.perspective.width", p.width, 1..=8192)?,
                    height: within("sample.camera.perspective.height", p.height, 1..=8192)?,
                })
            }
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
