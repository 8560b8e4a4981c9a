//! Exposure: the factor from radiance to display values, fixed for a sample set.
//!
//! Automatic exposure meters the light that arrives at visible surfaces, not the light that they send to a viewer: a black
//! room stays black, and a white one white. Photographers call this incident metering. What surfaces send only keeps the
//! picture within limits ([`metered`]): neither all dark nor all white.

use std::fmt;
use std::str::FromStr;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::tone::srgb_from_linear;
use crate::{InvalidField, LightEffects};

/// How a service's exposure is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Exposure {
    /// By the light at visible surfaces.
    #[default]
    Auto,
    /// The scene's own exposure times 2 to this power: stops.
    Stops(f32),
}

/// Largest number of stops in either direction that a user sets. Sunlight has 2¹⁷ lux.
pub const MOST_STOPS: f32 = 32.0;

/// Display-linear value of a white diffuse surface in the metered light.
const WHITE: f64 = 0.7;

impl Exposure {
    /// The exposure of a scene whose own is `own`, from what [`metered`] gives; `None` without light.
    pub fn factor(self, own: f32, metered: Option<f64>) -> f32 {
        match (self, metered) {
            (Self::Stops(stops), _) => own * stops.exp2(),
            // Any light that is a number has an exposure that is one.
            (Self::Auto, Some(light)) => {
                (WHITE / light).clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)) as f32
            }
            (Self::Auto, None) => own,
        }
    }
}

impl FromStr for Exposure {
    type Err = InvalidField;

    /// `auto` or a number of stops.
    fn from_str(text: &str) -> Result<Self, InvalidField> {
        match text.parse::<f32>() {
            _ if text == "auto" => Ok(Self::Auto),
            Ok(stops) if stops.abs() <= MOST_STOPS => Ok(Self::Stops(stops)),
            _ => {
                let reason = format!(
                    "must be auto or a number of stops from -{MOST_STOPS} to {MOST_STOPS}, not `{text}`"
                );
                Err(InvalidField::new("exposure", reason))
            }
        }
    }
}

impl fmt::Display for Exposure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Stops(stops) => stops.fmt(f),
        }
    }
}

/// What is metered: light with these effects, and light that surfaces reflect onto one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Metering {
    /// Effects of direct light.
    pub effects: LightEffects,
    /// Whether surfaces light one another.
    pub indirect: bool,
}

/// A visible point of a surface that light can change.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeteredPoint {
    /// Luminance of the irradiance by π that arrives.
    pub light: f64,
    /// About the radiance that the surface sends to a viewer, emission included.
    pub radiance: Vec3,
    /// Whether it emits: what is white there is a lamp.
    pub emits: bool,
}

/// Mean display values between which a picture is left as incident metering has it.
const MEANS: [f64; 2] = [0.27, 0.53];
/// Mean display value below which no picture is darkened for the sake of its highlights.
const LEAST_MEAN: f64 = 0.23;
/// Share of the surfaces that may be clipped to white.
const MOST_WHITE: f64 = 0.05;

/// Light at visible points, for [`Exposure::factor`]: the mean of its logarithm over the points that light reaches, so that
/// neither a sunlit spot nor a dark corner decides. It is then moved as little as needed for what a display shows: the
/// mean of its values is between [`MEANS`], and at most [`MOST_WHITE`] is white. `None` if no light arrives.
///
/// Light that is n times as strong gives n times the value.
pub fn metered(points: &[MeteredPoint]) -> Option<f64> {
    let is_lit = |point: &&MeteredPoint| point.light > 0.0 && point.light.is_finite();
    let lit = || points.iter().filter(is_lit);
    let mean = lit().map(|point| point.light.log2()).sum::<f64>() / lit().count() as f64;
    let light = mean.exp2();
    if !(light > 0.0 && light.is_finite()) {
        return None;
    }
    // From here on in units of that light.
    let shown: Vec<(f64, f64, bool)> = points
        .iter()
        .map(|point| {
            let color = point.radiance.as_dvec3() * (WHITE / light);
            let luminance = color.dot(glam::DVec3::new(0.2126, 0.7152, 0.0722));
            (luminance.max(0.0), color.max_element().max(0.0), point.emits)
        })
        .filter(|(luminance, most, _)| luminance.is_finite() && most.is_finite())
        .collect();
    let mean_at = |stops: f64| {
        let value = |&(luminance, _, _): &(f64, f64, bool)| {
            f64::from(srgb_from_linear((luminance * stops.exp2()).min(1.0) as f32))
        };
        shown.iter().map(value).sum::<f64>() / shown.len() as f64
    };
    let mut stops = 0.0;
    if shown.iter().any(|(luminance, _, _)| *luminance > 0.0) {
        let means = MEANS.map(|mean| stops_for(mean, mean_at));
        stops = f64::clamp(stops, means[0], means[1].max(means[0]));
        let mut brightest: Vec<f64> =
            shown.iter().filter(|(_, _, emits)| !emits).map(|(_, most, _)| *most).collect();
        brightest.sort_by(f64::total_cmp);
        let place = (brightest.len() as f64 * (1.0 - MOST_WHITE)) as usize;
        if let Some(white) = brightest.get(place).filter(|white| **white > 0.0) {
            let most = -white.log2();
            stops = stops.min(most.max(stops_for(LEAST_MEAN, mean_at)));
        }
    }
    Some(light / stops.exp2())
}

/// Most stops that limits of what is shown move an exposure.
const MOST_MOVED: f64 = 16.0;

/// Stops at which a rising function has a value.
fn stops_for(value: f64, of: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (-MOST_MOVED, MOST_MOVED);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if of(middle) < value {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grey points with these amounts of light.
    fn points(lights: &[f64], albedo: f32) -> Vec<MeteredPoint> {
        let point = |&light: &f64| MeteredPoint {
            light,
            radiance: Vec3::splat(light as f32) * albedo,
            ..Default::default()
        };
        lights.iter().map(point).collect()
    }

    fn exposure(points: &[MeteredPoint]) -> f64 {
        f64::from(Exposure::Auto.factor(1.0, metered(points)))
    }

    #[test]
    fn light_of_any_strength_gives_the_same_picture() {
        let light = [1.0, 0.2, 0.0, 3.0, 0.01, 0.7];
        let once = exposure(&points(&light, 0.4));
        for factor in [1e-12, 1e-6, 0.3, 1e6, 1e12] {
            let other = exposure(&points(&light.map(|light| factor * light), 0.4));
            assert!((once / other / factor - 1.0).abs() < 1e-4, "{factor}: {once} {other}");
        }
    }

    #[test]
    fn a_grey_surface_in_even_light_is_shown_by_the_light_and_not_by_its_colour() {
        for light in [1e-9, 1e-3, 1.0, 1e5] {
            for albedo in [0.1, 0.2, 0.3] {
                let found = exposure(&points(&[light; 7], albedo));
                assert!((found * light / WHITE).log2().abs() < 1e-3, "{light}, {albedo}: {found}");
            }
        }
    }

    #[test]
    fn neither_black_nor_white_surfaces_fill_a_picture() {
        for albedo in [0.001f32, 0.02, 0.9, 1.0] {
            let value = srgb_from_linear(exposure(&points(&[2.0; 9], albedo)) as f32 * 2.0 * albedo);
            assert!((0.2..=0.6).contains(&value), "{albedo}: {value}");
        }
    }

    #[test]
    fn a_bright_tenth_of_the_surfaces_is_not_clipped_and_lamps_may_be() {
        let mut lights = [1.0; 100];
        lights[..10].fill(12.0);
        let mut all = points(&lights, 0.5);
        assert!(exposure(&all) * 6.0 <= 1.0 + 1e-3);
        all[..10].iter_mut().for_each(|point| point.emits = true);
        assert!(exposure(&all) * 6.0 > 1.0);
    }

    #[test]
    fn points_without_light_do_not_count() {
        let (lit, with_dark) = (points(&[1.0, 2.0, 1.5], 0.3), points(&[1.0, 0.0, 2.0, f64::NAN, 1.5], 0.3));
        assert!((exposure(&lit) / exposure(&with_dark)).log2().abs() < 0.5);
    }

    #[test]
    fn darkness_and_light_that_is_no_number_leave_the_scenes_own_exposure() {
        for light in [&[][..], &[0.0; 3], &[f64::NAN, 0.0], &[f64::INFINITY], &[-1.0]] {
            assert_eq!(Exposure::Auto.factor(3.0, metered(&points(light, 0.5))), 3.0, "{light:?}");
        }
        for light in [1e-300, 1e-30, 1e300] {
            let factor = Exposure::Auto.factor(1.0, metered(&points(&[light], 0.5)));
            assert!(factor.is_finite() && factor > 0.0, "{light}: {factor}");
        }
    }

    #[test]
    fn stops_double_the_scenes_own_exposure() {
        assert_eq!("1".parse::<Exposure>().unwrap().factor(3.0, Some(9.0)), 6.0);
        assert_eq!("-2".parse::<Exposure>().unwrap().factor(1.0, None), 0.25);
        assert_eq!("auto".parse::<Exposure>().unwrap(), Exposure::Auto);
        for text in ["", "bright", "33", "NaN", "inf", "-1e9"] {
            let error = text.parse::<Exposure>().unwrap_err();
            assert_eq!(error.field, "exposure");
        }
    }
}
