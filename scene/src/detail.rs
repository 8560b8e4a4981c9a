//! How much of a view from triangles is rendered.
//!
//! A service that is asked for more views than it can render in full renders open views in less detail before it lets anyone
//! wait. Which steps are worth it was measured by `argus-lab study views detail`.

use std::fmt;
use std::str::FromStr;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::{Camera, InvalidField};

/// How much of a view from triangles is rendered, in order of the time it takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Detail {
    /// All of it.
    #[default]
    Full,
    /// A pixel casts a quarter of its rays of light to sky, emitters and surfaces.
    FewRays,
    /// One pixel for each 2×2 of the view; the image is enlarged by a cubic filter.
    Half,
    /// Both.
    HalfFewRays,
    /// One pixel for each 4×4 of the view, with few rays; the image is enlarged.
    Quarter,
}

impl Detail {
    /// All, in order of the time they take.
    pub const ALL: [Self; 5] = [Self::Full, Self::FewRays, Self::Half, Self::HalfFewRays, Self::Quarter];

    /// Name in options, JSON and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::FewRays => "few-rays",
            Self::Half => "half",
            Self::HalfFewRays => "half-few-rays",
            Self::Quarter => "quarter",
        }
    }

    /// Pixels of the view on a side for which one is rendered.
    pub fn scale(self) -> u32 {
        match self {
            Self::Full | Self::FewRays => 1,
            Self::Half | Self::HalfFewRays => 2,
            Self::Quarter => 4,
        }
    }

    /// A pixel casts one of so many of its rays of light.
    pub fn ray_divisor(self) -> u32 {
        match self {
            Self::Full | Self::Half => 1,
            Self::FewRays | Self::HalfFewRays | Self::Quarter => 4,
        }
    }

    /// The rendered size of a view of a size in pixels.
    pub fn size(self, size: [u32; 2]) -> [u32; 2] {
        size.map(|side| side.div_ceil(self.scale()))
    }

    /// The camera of the rendered image. Its pixels may reach beyond the view's edges, by equal parts on both sides.
    pub fn camera(self, camera: Camera, [width, height]: [u32; 2]) -> Camera {
        let [columns, rows] = self.size([width, height]);
        if let Some(lens) = camera.lens {
            let reached = DVec2::new(f64::from(columns), f64::from(rows)) * f64::from(self.scale());
            let beyond = reached - DVec2::new(f64::from(width), f64::from(height));
            return Camera { lens: Some(lens.coarser(f64::from(self.scale()), beyond)), ..camera };
        }
        let reach = f64::from(rows * self.scale()) / f64::from(height.max(1));
        match reach == 1.0 {
            true => camera,
            false => {
                let half = (camera.fov_deg * 0.5).to_radians().tan() * reach;
                Camera { fov_deg: (2.0 * half.atan()).to_degrees(), ..camera }
            }
        }
    }
}

impl fmt::Display for Detail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Detail {
    type Err = InvalidField;

    fn from_str(name: &str) -> Result<Self, InvalidField> {
        Self::ALL.into_iter().find(|detail| detail.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            InvalidField::new("detail", format!("has no `{name}`: {known}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::{Distortion, Intrinsics, Lens};

    #[test]
    fn names_bring_back_every_detail_and_others_are_refused() {
        for detail in Detail::ALL {
            assert_eq!(detail.name().parse(), Ok(detail));
        }
        assert!("some".parse::<Detail>().unwrap_err().to_string().contains("half-few-rays"));
    }

    #[test]
    fn a_rendered_pixel_looks_through_the_middle_of_those_that_it_stands_for() {
        let usual = Camera { fov_deg: 70.0, ..Camera::look_at(DVec3::new(3.0, 2.0, 1.0), DVec3::ZERO) };
        let distortion = Distortion::Rational([-0.1, 0.02, 1e-3, -2e-3, 0.0, 0.0, 0.0, 0.0]);
        let center = DVec2::new(90.0, 130.5);
        let lens = |distortion| {
            Some(Lens::Intrinsics(Intrinsics { focal: DVec2::new(310.0, 290.0), center, distortion }))
        };
        for camera in [
            usual,
            Camera { lens: lens(Distortion::None), ..usual },
            Camera { lens: lens(distortion), ..usual },
        ] {
            stands_for_its_pixels(camera);
        }
    }

    fn stands_for_its_pixels(camera: Camera) {
        // Sizes that the scale divides, and that it does not.
        for size @ [width, height] in [[320, 240], [319, 241], [7, 5], [1, 1]] {
            for detail in Detail::ALL {
                let scale = f64::from(detail.scale());
                let [columns, rows] = detail.size(size);
                let small = detail.camera(camera, size);
                let beyond = DVec2::new(f64::from(columns), f64::from(rows)) * scale
                    - DVec2::new(f64::from(width), f64::from(height));
                for place in [DVec2::splat(0.5), DVec2::new(f64::from(columns), f64::from(rows)) * 0.7] {
                    let through = small.direction(place, columns, rows);
                    let expected = camera.direction(place * scale - beyond * 0.5, width, height);
                    assert!(through.distance(expected) < 1e-12, "{detail} {size:?}");
                }
            }
        }
    }
}
