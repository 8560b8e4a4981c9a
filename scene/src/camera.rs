//! Cameras of clients and of samples.

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::InvalidField;
use crate::RayList;
use crate::lens::{ImagePlane, Lens, LensRays};
use crate::probe_map::map_size;

/// A client's viewpoint: an ideal pinhole, or another lens, looking from `eye` to `target`.
///
/// Only a camera that passed [`Camera::validate`] is used for rendering.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Centre of projection, metres, world space.
    pub eye: DVec3,
    /// A point on the optical axis, metres, world space.
    pub target: DVec3,
    /// Up direction in the image; need not have unit length or be perpendicular to the axis.
    pub up: DVec3,
    /// Vertical field of view of the ideal pinhole, degrees, in the open interval (0, 180).
    pub fov_deg: f64,
    /// Another lens. Then `fov_deg` is not read.
    pub lens: Option<Lens>,
}

impl Camera {
    /// Vertical field of view of a camera for which none is given, degrees.
    pub const USUAL_FOV_DEG: f64 = 45.0;

    /// A camera with a 45° vertical field of view and +y up.
    pub fn look_at(eye: DVec3, target: DVec3) -> Self {
        Self { eye, target, up: DVec3::Y, fov_deg: Self::USUAL_FOV_DEG, lens: None }
    }

    /// Rejects a camera without an image: non-finite numbers, `eye` = `target`, `up` along the axis, an impossible
    /// field of view. Written so that NaN fails each comparison.
    pub fn validate(&self) -> Result<(), InvalidField> {
        let finite = |field, v: DVec3| match v.is_finite() {
            true => Ok(()),
            false => Err(InvalidField::new(field, format!("must be finite, not {v}"))),
        };
        finite("camera.eye", self.eye)?;
        finite("camera.target", self.target)?;
        finite("camera.up", self.up)?;
        if let Some(lens) = &self.lens {
            lens.validate()?;
        } else if !(self.fov_deg > 0.0 && self.fov_deg < 180.0) {
            let reason = format!("must lie strictly between 0 and 180 degrees, not {}", self.fov_deg);
            return Err(InvalidField::new("camera.fov_deg", reason));
        }
        let axis = self.target - self.eye;
        // Relative to the coordinates: 10⁶ m away, two points closer than their f64 spacing are one point.
        let scale = self.eye.abs().max(self.target.abs()).max_element().max(f64::MIN_POSITIVE);
        if !(axis.length() > 8.0 * f64::EPSILON * scale) || !axis.length().is_finite() {
            return Err(InvalidField::new("camera.target", "must differ from camera.eye"));
        }
        if !(self.up.length() > 0.0) || !self.up.length().is_finite() {
            return Err(InvalidField::new("camera.up", "must have a length between 0 and infinity"));
        }
        if !(axis.normalize().cross(self.up.normalize()).length() > 1e-9) {
            let reason = "must not be parallel to the direction of view".to_owned();
            return Err(InvalidField::new("camera.up", reason));
        }
        Ok(())
    }

    /// Rotation from world to view axes: x right, y up, the camera looks along −z.
    pub fn view_from_world(&self) -> DMat3 {
        let back = (self.eye - self.target).normalize();
        let right = self.up.normalize().cross(back).normalize();
        let up = back.cross(right);
        DMat3::from_cols(right, up, back).transpose()
    }

    /// Whether its image is that of a pinhole. Other images are rendered from triangles alone, as lists of rays.
    pub fn is_pinhole(&self) -> bool {
        self.lens.is_none_or(|lens| lens.is_pinhole())
    }

    /// Half the image's extent at unit distance along the axis: of an ideal pinhole (tan of half the horizontal field of view,
    /// tan of half the vertical one) for an image of `width` × `height` square pixels. Of a lens that is no pinhole, the extent
    /// of an image whose pixels are as large as the lens' in the middle.
    pub fn tan_half_fov(&self, width: u32, height: u32) -> DVec2 {
        self.plane(width, height).half
    }

    /// The part of the plane at unit distance that the image shows, as [`Self::tan_half_fov`].
    pub fn plane(&self, width: u32, height: u32) -> ImagePlane {
        if let Some(lens) = &self.lens {
            return lens.plane([width, height]);
        }
        let y = (self.fov_deg.to_radians() * 0.5).tan();
        let half = DVec2::new(y * f64::from(width) / f64::from(height), y);
        ImagePlane { half, center: DVec2::ZERO }
    }

    /// Unit direction in world space through the image position `pixel` (pixels, (0,0) at the top left
    /// corner of the image, centres at half integers). Along the axis where the lens has no ray; for many rays use [`Self::rays`].
    pub fn direction(&self, pixel: DVec2, width: u32, height: u32) -> DVec3 {
        let axis = || (self.target - self.eye).normalize();
        self.rays(width, height).direction(pixel).unwrap_or_else(axis)
    }

    /// The rays of an image of `width` × `height` pixels.
    pub fn rays(&self, width: u32, height: u32) -> CameraRays {
        let kind = match &self.lens {
            Some(lens) if !lens.is_pinhole() => RayKind::Lens(LensRays::new(lens, [width, height])),
            _ => RayKind::Plane(self.plane(width, height)),
        };
        let size = DVec2::new(f64::from(width), f64::from(height));
        CameraRays { world_from_view: self.view_from_world().transpose(), size, kind }
    }

    /// The rays of a view's image: those of its list, if it has one.
    pub fn rays_of(&self, list: Option<&RayList>, width: u32, height: u32) -> CameraRays {
        let rays = self.rays(width, height);
        match list {
            Some(list) => CameraRays { kind: RayKind::List(list.clone()), ..rays },
            None => rays,
        }
    }
}

/// The rays of a camera's image, for any lens.
#[derive(Debug, Clone)]
pub struct CameraRays {
    world_from_view: DMat3,
    size: DVec2,
    kind: RayKind,
}

#[derive(Debug, Clone)]
enum RayKind {
    Plane(ImagePlane),
    Lens(LensRays),
    List(RayList),
}

impl CameraRays {
    /// Unit direction in world space through an image position, as [`Camera::direction`]. `None` where the lens has no ray.
    pub fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        let in_view = match &self.kind {
            RayKind::Plane(ImagePlane { half, center }) => {
                let at = (pixel / self.size * 2.0 - 1.0) * *half + *center;
                DVec3::new(at.x, -at.y, -1.0)
            }
            RayKind::Lens(lens) => {
                let DVec3 { x, y, z } = lens.direction(pixel)?;
                DVec3::new(x, -y, -z)
            }
            RayKind::List(list) => {
                let [column, row] = pixel.max(DVec2::ZERO).floor().to_array();
                return list.direction((row * self.size.x + column) as usize);
            }
        };
        Some((self.world_from_view * in_view).normalize())
    }
}

/// The layout of an omnidirectional image's directions on a rectangle of texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum OmniLayout {
    /// Six square faces of `face` texels a side in three columns and two rows: +x −x +y over −y +z −z.
    ///
    /// The outermost ring of each face repeats its neighbours' directions (the face covers
    /// tan 45° · face/(face − 2)), so that a bilinear fetch never leaves its face.
    CubeFaces {
        /// Side of a face in texels, ring included; at least 8.
        face: u32,
    },
    /// Two hemispheres about ±x of `side` texels a side, left and right: the output of the MegaViews traversal.
    DualParaboloid {
        /// Side of a hemisphere's square in texels.
        side: u32,
    },
    /// Reflection probes of `count` reflectors, one below another, each seen from its own position
    /// ([`crate::reflection`]).
    ReflectionProbes {
        /// Texels on a side of a map's finest level.
        side: u32,
        /// Number of probes.
        count: u32,
    },
}

/// Position of a sample, and the direction of each of its texels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum SampleCamera {
    /// A pinhole image of `width` × `height` texels.
    Perspective {
        /// Viewpoint and field of view.
        camera: Camera,
        /// Texels in a row.
        width: u32,
        /// Rows of texels.
        height: u32,
    },
    /// All directions from one point; its axes are the world's.
    Omni {
        /// Centre, metres, world space.
        center: DVec3,
        /// How directions are laid out.
        layout: OmniLayout,
    },
}

/// One pinhole image within a sample: a whole perspective sample, or one face of a cube.
///
/// Rasterising, splatting and fetching work face by face, so they need no other kind of camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Rotation from world axes to the face's: x right, y up, looking along −z.
    pub view_from_world: DMat3,
    /// Extent of the face at unit distance: tangents of half its fields of view.
    pub tan_half_fov: DVec2,
    /// Its middle at unit distance: x right, y down; zero if it looks along its axis.
    pub tan_center: DVec2,
    /// Top left texel of the face within the sample.
    pub offset: [u32; 2],
    /// Texels of the face: width, height.
    pub size: [u32; 2],
}

impl Face {
    /// Extent of a texel at unit distance.
    pub fn texel(&self) -> DVec2 {
        2.0 * self.tan_half_fov / DVec2::new(f64::from(self.size[0]), f64::from(self.size[1]))
    }

    /// The top left corner at unit distance: x right, y down.
    pub fn top_left(&self) -> DVec2 {
        self.tan_center - self.tan_half_fov
    }
}

impl SampleCamera {
    /// Centre of projection, metres, world space.
    pub fn center(&self) -> DVec3 {
        match self {
            Self::Perspective { camera, .. } => camera.eye,
            Self::Omni { center, .. } => *center,
        }
    }

    /// Texels of the whole image: width, height.
    pub fn size(&self) -> [u32; 2] {
        match *self {
            Self::Perspective { width, height, .. } => [width, height],
            Self::Omni { layout: OmniLayout::CubeFaces { face }, .. } => [3 * face, 2 * face],
            Self::Omni { layout: OmniLayout::DualParaboloid { side }, .. } => [2 * side, side],
            Self::Omni { layout: OmniLayout::ReflectionProbes { side, count }, .. } => {
                let [columns, rows] = map_size(side);
                [columns, rows.saturating_mul(count)]
            }
        }
    }

    /// The pinhole images of the sample: one for a perspective camera, six for a cube. Dual paraboloids and
    /// reflection probes have none, since their texels are not planar projections.
    pub fn faces(&self) -> Vec<Face> {
        match *self {
            Self::Perspective { camera, width, height } => {
                let ImagePlane { half, center } = camera.plane(width, height);
                vec![Face {
                    view_from_world: camera.view_from_world(),
                    tan_half_fov: half,
                    tan_center: center,
                    offset: [0, 0],
                    size: [width, height],
                }]
            }
            Self::Omni { layout: OmniLayout::CubeFaces { face }, .. } => (0..6)
                .map(|i| Face {
                    view_from_world: cube_face_from_world(i),
                    tan_half_fov: DVec2::splat(f64::from(face) / (f64::from(face) - 2.0)),
                    tan_center: DVec2::ZERO,
                    offset: [(i % 3) * face, (i / 3) * face],
                    size: [face, face],
                })
                .collect(),
            Self::Omni { .. } => Vec::new(),
        }
    }
}

/// The face of a cube that has a direction, as samples are looked up: `cube_face_of` in `shaders/shared/camera.wgsl`.
pub fn cube_face_of(direction: DVec3) -> usize {
    let a = direction.abs();
    let (face, along) = match (a.x >= a.y && a.x >= a.z, a.z > a.y) {
        (true, _) => (0, direction.x),
        (false, true) => (4, direction.z),
        (false, false) => (2, direction.y),
    };
    face + usize::from(along < 0.0)
}

/// Rotation from world axes to those of cube face `index` (+x −x +y −y +z −z). The face looks along its own −z, seen from
/// inside the cube.
fn cube_face_from_world(index: u32) -> DMat3 {
    let (forward, up) = match index {
        0 => (DVec3::X, DVec3::Y),
        1 => (DVec3::NEG_X, DVec3::Y),
        2 => (DVec3::Y, DVec3::Z),
        3 => (DVec3::NEG_Y, DVec3::NEG_Z),
        4 => (DVec3::Z, DVec3::Y),
        _ => (DVec3::NEG_Z, DVec3::Y),
    };
    let back = -forward;
    let right = up.cross(back);
    DMat3::from_cols(right, up, back).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 0.5, 2.0))
    }

    #[test]
    fn each_impossible_camera_is_rejected_by_the_field_at_fault() {
        let reject = |change: fn(&mut Camera)| {
            let mut camera = camera();
            change(&mut camera);
            camera.validate().expect_err("must be rejected").field
        };
        assert_eq!(reject(|c| c.eye.x = f64::NAN), "camera.eye");
        assert_eq!(reject(|c| c.target.y = f64::INFINITY), "camera.target");
        assert_eq!(reject(|c| c.up.z = f64::NEG_INFINITY), "camera.up");
        assert_eq!(reject(|c| c.target = c.eye), "camera.target");
        assert_eq!(reject(|c| c.up = DVec3::ZERO), "camera.up");
        assert_eq!(reject(|c| c.up = c.target - c.eye), "camera.up");
        assert_eq!(reject(|c| c.up = c.eye - c.target), "camera.up");
        for fov in ["0", "180", "-1", "nan", "inf"] {
            let camera = Camera { fov_deg: fov.parse().unwrap(), ..camera() };
            assert_eq!(camera.validate().unwrap_err().field, "camera.fov_deg", "{fov}");
        }
        assert_eq!(reject(|c| c.eye = DVec3::splat(f64::MAX)), "camera.target");
        camera().validate().unwrap();
    }

    #[test]
    fn a_camera_at_a_million_metres_keeps_its_direction() {
        let far = DVec3::splat(1e6);
        let moved = Camera { eye: camera().eye + far, target: camera().target + far, ..camera() };
        moved.validate().unwrap();
        let difference =
            moved.direction(DVec2::new(3.5, 7.5), 64, 48) - camera().direction(DVec2::new(3.5, 7.5), 64, 48);
        assert!(difference.length() < 1e-9);
    }

    #[test]
    fn the_middle_of_the_image_looks_at_the_target_and_its_top_looks_up() {
        let camera = camera();
        let axis = (camera.target - camera.eye).normalize();
        assert!((camera.direction(DVec2::new(32.0, 24.0), 64, 48) - axis).length() < 1e-12);
        assert!(camera.direction(DVec2::new(32.0, 0.0), 64, 48).y > axis.y);
        let right = axis.cross(DVec3::Y);
        assert!(camera.direction(DVec2::new(64.0, 24.0), 64, 48).dot(right) > 0.0);
    }

    #[test]
    fn cube_faces_are_rotations_that_cover_every_direction() {
        let omni = SampleCamera::Omni { center: DVec3::ZERO, layout: OmniLayout::CubeFaces { face: 16 } };
        for face in omni.faces() {
            assert!((face.view_from_world.determinant() - 1.0).abs() < 1e-12);
        }
        for direction in [DVec3::X, DVec3::NEG_Y, DVec3::new(1.0, 1.0, -1.0), DVec3::new(0.2, -0.7, 0.7)] {
            let seen = omni.faces().iter().any(|face| {
                let d = face.view_from_world * direction;
                d.z < 0.0 && (d.truncate() / -d.z).abs().cmple(face.tan_half_fov).all()
            });
            assert!(seen, "{direction}");
        }
    }
}
