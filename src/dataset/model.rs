//! Camera models of COLMAP, which other formats name too, as intrinsics.
//!
//! Names, numbers and orders of parameters: COLMAP, `sensor/models.h`.

use anyhow::{bail, ensure};
use argus_scene::{Distortion, Intrinsics};
use glam::DVec2;

/// A camera model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Model {
    SimplePinhole,
    Pinhole,
    SimpleRadial,
    Radial,
    OpenCv,
    OpenCvFisheye,
    FullOpenCv,
}

/// A model and its parameters, in pixels where the centre of the first pixel is (½, ½).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Calibration {
    pub(super) model: Model,
    pub(super) parameters: Vec<f64>,
}

impl Model {
    /// All models, in the order of COLMAP's numbers.
    const ALL: [Self; 7] = [
        Self::SimplePinhole,
        Self::Pinhole,
        Self::SimpleRadial,
        Self::Radial,
        Self::OpenCv,
        Self::OpenCvFisheye,
        Self::FullOpenCv,
    ];

    /// COLMAP's name.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::SimplePinhole => "SIMPLE_PINHOLE",
            Self::Pinhole => "PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::OpenCv => "OPENCV",
            Self::OpenCvFisheye => "OPENCV_FISHEYE",
            Self::FullOpenCv => "FULL_OPENCV",
        }
    }

    /// COLMAP's number.
    pub(super) fn number(self) -> i32 {
        self as i32
    }

    /// Number of parameters.
    pub(super) fn count(self) -> usize {
        match self {
            Self::SimplePinhole => 3,
            Self::Pinhole | Self::SimpleRadial => 4,
            Self::Radial => 5,
            Self::OpenCv | Self::OpenCvFisheye => 8,
            Self::FullOpenCv => 12,
        }
    }

    /// The model of a name.
    ///
    /// # Errors
    /// No model that is supported has this name.
    pub(super) fn named(name: &str) -> anyhow::Result<Self> {
        match Self::ALL.into_iter().find(|model| model.name() == name) {
            Some(model) => Ok(model),
            None => bail!("the camera model {name:?} is not supported: use one of {}", Self::names()),
        }
    }

    /// The model of a number.
    ///
    /// # Errors
    /// No model that is supported has this number.
    pub(super) fn numbered(number: i32) -> anyhow::Result<Self> {
        match Self::ALL.into_iter().find(|model| model.number() == number) {
            Some(model) => Ok(model),
            None => bail!("the camera model {number} is not supported: use one of {}", Self::names()),
        }
    }

    fn names() -> String {
        Self::ALL.map(|model| format!("{} ({})", model.name(), model.number())).join(", ")
    }

    /// The intrinsics of parameters.
    ///
    /// # Errors
    /// Another number of parameters than the model has.
    pub(super) fn intrinsics(self, parameters: &[f64]) -> anyhow::Result<Intrinsics> {
        ensure!(
            parameters.len() == self.count(),
            "{} has {} parameters, not {}",
            self.name(),
            self.count(),
            parameters.len()
        );
        let of_one = matches!(self, Self::SimplePinhole | Self::SimpleRadial | Self::Radial);
        let (focal, rest) = parameters.split_at(if of_one { 1 } else { 2 });
        let focal = DVec2::new(focal[0], focal[focal.len() - 1]);
        let (center, k) = rest.split_at(2);
        let center = DVec2::new(center[0], center[1]);
        let distortion = match self {
            Self::OpenCvFisheye => Distortion::Fisheye(std::array::from_fn(|i| k[i])),
            // k1 k2 p1 p2 k3 k4 k5 k6, of which simpler models have the first.
            _ if k.iter().any(|k| *k != 0.0) => {
                Distortion::Rational(std::array::from_fn(|i| k.get(i).copied().unwrap_or(0.0)))
            }
            _ => Distortion::None,
        };
        Ok(Intrinsics { focal, center, distortion })
    }
}

impl Calibration {
    /// The simplest model that intrinsics have.
    pub(super) fn of(intrinsics: &Intrinsics) -> Self {
        let Intrinsics { focal, center, distortion } = intrinsics;
        let (model, k): (Model, &[f64]) = match distortion {
            Distortion::Rational(k) if k[4..].iter().any(|k| *k != 0.0) => (Model::FullOpenCv, k),
            Distortion::Rational(k) if k.iter().any(|k| *k != 0.0) => (Model::OpenCv, &k[..4]),
            Distortion::Rational(_) | Distortion::None => (Model::Pinhole, &[]),
            Distortion::Fisheye(k) => (Model::OpenCvFisheye, k),
        };
        let parameters = [focal.x, focal.y, center.x, center.y].iter().chain(k).copied().collect();
        Self { model, parameters }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_model_becomes_the_lens_of_its_definition_and_back() {
        let parameters: Vec<f64> = (1..=12).map(|i| 0.01 * f64::from(i)).collect();
        for model in Model::ALL {
            let intrinsics = model.intrinsics(&parameters[..model.count()]).unwrap();
            let back = Calibration::of(&intrinsics);
            let again = back.model.intrinsics(&back.parameters).unwrap();
            assert_eq!(again, intrinsics, "{model:?}");
            assert_eq!(
                (Model::named(model.name()).unwrap(), Model::numbered(model.number()).unwrap()),
                (model, model)
            );
            assert!(model.intrinsics(&parameters[..model.count() - 1]).is_err());
        }
        let radial = Model::Radial.intrinsics(&[500.0, 320.0, 240.0, -0.1, 0.02]).unwrap();
        assert_eq!(radial.focal, DVec2::splat(500.0));
        assert_eq!(radial.distortion, Distortion::Rational([-0.1, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        let full = Model::FullOpenCv.intrinsics(&parameters).unwrap();
        assert_eq!(full.distortion, Distortion::Rational(std::array::from_fn(|i| parameters[4 + i])));
    }

    #[test]
    fn an_unsupported_model_is_told_which_are_supported() {
        for error in [Model::named("THIN_PRISM_FISHEYE").unwrap_err(), Model::numbered(7).unwrap_err()] {
            let text = error.to_string();
            assert!(text.contains("SIMPLE_PINHOLE (0)") && text.contains("FULL_OPENCV (6)"), "{text}");
        }
    }
}
