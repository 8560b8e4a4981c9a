//! Exposure: the factor from radiance to display values, fixed for a sample set.
//!
//! Automatic exposure meters the light that arrives at visible surfaces, not the light that they send to a viewer: a black
//! room stays black, and a white one white. Photographers call this incident metering.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

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

/// Largest number of stops in either direction. Sunlight has 2¹⁷ lux.
pub const MOST_STOPS: f32 = 32.0;

/// Display-linear value of a white diffuse surface in the metered light.
const WHITE: f64 = 0.7;

impl Exposure {
    /// The exposure of a scene whose own is `own`, from what [`metered`] gives; `None` without light.
    pub fn factor(self, own: f32, metered: Option<f64>) -> f32 {
        match (self, metered) {
            (Self::Stops(stops), _) => own * stops.exp2(),
            // Whole tenths of a stop, so that tiny changes of a scene do not change its exposure.
            (Self::Auto, Some(light)) => {
                let stops = (WHITE / light).log2().clamp(-f64::from(MOST_STOPS), f64::from(MOST_STOPS));
                ((stops * 10.0).round() / 10.0).exp2() as f32
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

/// Exponent of displays: about sRGB's.
const GAMMA: f64 = 2.2;

/// Mean of luminances of irradiance / π at visible points, for [`Exposure::factor`]: of what a display makes of them, so that
/// neither a sunlit spot nor a dark corner decides. `None` if no light arrives.
pub fn metered(luminances: &[f64]) -> Option<f64> {
    let sound = || luminances.iter().copied().filter(|light| light.is_finite() && *light >= 0.0);
    let mean = sound().map(|light| light.powf(GAMMA.recip())).sum::<f64>() / sound().count() as f64;
    let light = mean.powf(GAMMA);
    (light > 0.0 && light.is_finite()).then_some(light)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twice_the_light_has_half_the_exposure() {
        let light = [1.0, 0.2, 0.0, 3.0];
        let twice = light.map(|light| 2.0 * light);
        let [once, twice] = [light, twice].map(|light| Exposure::Auto.factor(1.0, metered(&light)));
        assert!((once / twice - 2.0).abs() < 1e-5, "{once} {twice}");
    }

    #[test]
    fn a_white_surface_in_even_light_is_shown_nearly_white() {
        for light in [1e-9, 1e-3, 1.0, 1e5] {
            let exposure = f64::from(Exposure::Auto.factor(1.0, metered(&[light; 7])));
            assert!((exposure * light / WHITE).log2().abs() <= 0.0501, "{light}: {exposure}");
        }
    }

    #[test]
    fn darkness_and_light_that_is_no_number_leave_the_scenes_own_exposure() {
        for light in [&[][..], &[0.0; 3], &[f64::NAN, 0.0], &[f64::INFINITY], &[-1.0]] {
            assert_eq!(Exposure::Auto.factor(3.0, metered(light)), 3.0, "{light:?}");
        }
        let factor = Exposure::Auto.factor(1.0, metered(&[1e-300]));
        assert!(factor.is_finite() && factor > 0.0);
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
