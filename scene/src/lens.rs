//! Lenses: which direction each position of an image looks in.
//!
//! Positions are in pixels from the image's top left corner, so the centre of the first pixel is (½, ½). Directions are in
//! the axes of OpenCV: x right, y down, z forward. Those of a view are x right, y up, −z forward.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

use crate::InvalidField;
use crate::distortion::{Distortion, Undistortion};

/// A lens other than an ideal one of a vertical field of view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Lens {
    /// A calibrated camera.
    Intrinsics(Intrinsics),
    /// All directions: 360° of longitude from left to right, 180° of latitude from top to bottom. The middle of the image looks
    /// along the camera's axis.
    Equirectangular,
    /// The directions of the view's own [`crate::RayList`]. A camera alone has none of them.
    Rays {
        /// Angle between neighbouring rays, degrees: the size of a pixel, where textures and light are filtered.
        spacing_deg: f64,
    },
}

/// A calibrated camera: OpenCV's camera matrix without skew, in pixels of the view's size, and distortion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Focal lengths fx and fy, pixels.
    pub focal: DVec2,
    /// Principal point cx and cy, pixels from the image's top left corner; may lie outside of the image.
    pub center: DVec2,
    /// How the image differs from that of a pinhole.
    pub distortion: Distortion,
}

/// The part of the plane at unit depth that a pinhole image shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePlane {
    /// Half its width and height.
    pub half: DVec2,
    /// Its middle: x right, y down; zero if the image looks along the axis.
    pub center: DVec2,
}

impl Intrinsics {
    /// Range of focal lengths, pixels. They keep directions within what f32 holds.
    const FOCAL: std::ops::RangeInclusive<f64> = 1e-3..=1e9;
    /// Farthest principal point along each axis, pixels.
    const MOST_CENTER: f64 = 1e6;

    /// A pinhole.
    pub fn pinhole(focal: DVec2, center: DVec2) -> Self {
        Self { focal, center, distortion: Distortion::None }
    }

    /// The image without its distortion.
    pub fn plane(&self, [width, height]: [u32; 2]) -> ImagePlane {
        let half_size = DVec2::new(f64::from(width), f64::from(height)) * 0.5;
        ImagePlane { half: half_size / self.focal, center: (half_size - self.center) / self.focal }
    }

    fn validate(&self) -> Result<(), InvalidField> {
        for (field, focal) in [("camera.intrinsics.fx", self.focal.x), ("camera.intrinsics.fy", self.focal.y)]
        {
            if !Self::FOCAL.contains(&focal) {
                let (least, most) = (Self::FOCAL.start(), Self::FOCAL.end());
                let reason = format!("a focal length must be {least} to {most:e} pixels, not {focal}");
                return Err(InvalidField::new(field, reason));
            }
        }
        for (field, at) in [("camera.intrinsics.cx", self.center.x), ("camera.intrinsics.cy", self.center.y)]
        {
            // Written so that NaN is refused.
            if !(at.abs() <= Self::MOST_CENTER) {
                let most = Self::MOST_CENTER;
                let reason = format!("must lie within {most:e} pixels of the image, not at {at}");
                return Err(InvalidField::new(field, reason));
            }
        }
        self.distortion.validate()
    }
}

impl Lens {
    /// Rejects a lens without an image, by field.
    pub(crate) fn validate(&self) -> Result<(), InvalidField> {
        match self {
            Self::Intrinsics(intrinsics) => intrinsics.validate(),
            Self::Equirectangular => Ok(()),
            // Written so that NaN is refused.
            Self::Rays { spacing_deg } if !(*spacing_deg > 0.0 && *spacing_deg <= 180.0) => {
                let reason = format!("must be above 0 and up to 180, not {spacing_deg}");
                Err(InvalidField::new("camera.listed_rays.spacing_deg", reason))
            }
            Self::Rays { .. } => Ok(()),
        }
    }

    /// Whether its image is that of a pinhole, of which any part of a plane at unit depth is one.
    pub fn is_pinhole(&self) -> bool {
        matches!(self, Self::Intrinsics(intrinsics) if intrinsics.distortion.is_none())
    }

    /// The plane of its image. Of a lens that is no pinhole, one whose pixels are as large as the lens' in the middle.
    pub(crate) fn plane(&self, size: [u32; 2]) -> ImagePlane {
        match self {
            Self::Intrinsics(intrinsics) => intrinsics.plane(size),
            Self::Equirectangular => ImagePlane { half: DVec2::new(PI, 0.5 * PI), center: DVec2::ZERO },
            Self::Rays { spacing_deg } => {
                let half = DVec2::from(size.map(f64::from)) * (0.5 * spacing_deg.to_radians());
                ImagePlane { half, center: DVec2::ZERO }
            }
        }
    }

    /// The lens of an image that is `scale` times as coarse, and whose pixels may reach `beyond` pixels past the edges of the
    /// finer image, by equal parts on opposite sides.
    pub(crate) fn coarser(self, scale: f64, beyond: DVec2) -> Self {
        match self {
            Self::Intrinsics(i) => Self::Intrinsics(Intrinsics {
                focal: i.focal / scale,
                center: (i.center + 0.5 * beyond) / scale,
                ..i
            }),
            Self::Equirectangular | Self::Rays { .. } => self,
        }
    }
}

/// A lens that is no pinhole, prepared for many rays.
#[derive(Debug, Clone)]
pub(crate) enum LensRays {
    Distorted {
        focal: DVec2,
        center: DVec2,
        undistortion: Undistortion,
    },
    Equirectangular {
        size: DVec2,
    },
    /// Of a list that is not known here.
    Unknown,
}

impl LensRays {
    /// The rays of a lens for an image of a size in pixels.
    pub(crate) fn new(lens: &Lens, [width, height]: [u32; 2]) -> Self {
        match lens {
            Lens::Intrinsics(Intrinsics { focal, center, distortion }) => Self::Distorted {
                focal: *focal,
                center: *center,
                undistortion: Undistortion::new(distortion),
            },
            Lens::Equirectangular => {
                Self::Equirectangular { size: DVec2::new(f64::from(width), f64::from(height)) }
            }
            Lens::Rays { .. } => Self::Unknown,
        }
    }

    /// Unit direction of an image position, in OpenCV's axes. `None` where the lens has no ray.
    pub(crate) fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        match self {
            Self::Unknown => None,
            Self::Distorted { focal, center, undistortion } => {
                undistortion.direction((pixel - center) / focal)
            }
            Self::Equirectangular { size } => {
                let share = pixel / size - 0.5;
                let (longitude, down) = (share.x * 2.0 * PI, share.y * PI);
                let around = down.cos();
                Some(DVec3::new(longitude.sin() * around, down.sin(), longitude.cos() * around))
            }
        }
    }
}
