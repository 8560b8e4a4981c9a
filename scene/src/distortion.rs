//! Distortion of images by OpenCV's models, and its inverse.
//!
//! A model maps where a pinhole would show a direction, on the plane at depth 1, to where the lens shows it. Beyond some angle
//! from the axis models fold back: two directions would be shown at one place. Up to there they are monotonic, and only
//! these directions are shown. A place that shows none of them has no ray.
//!
//! Models: OpenCV 4, documentation of the modules `calib3d` and `calib3d::fisheye`; the latter is that of Kannala and Brandt,
//! "A Generic Camera Model and Calibration Method for Conventional, Wide-Angle, and Fish-Eye Lenses", 2006.

use std::f64::consts::PI;

use glam::{DMat2, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::InvalidField;

/// A model of distortion, by its coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Distortion {
    /// A pinhole.
    None,
    /// OpenCV's rational model: k1, k2, p1, p2, k3, k4, k5, k6, in this order, as in OpenCV.
    Rational([f64; 8]),
    /// OpenCV's fisheye model: k1 to k4. It may show directions behind the camera.
    Fisheye([f64; 4]),
}

/// Fields of the coefficients of [`Distortion::Rational`].
const RATIONAL: [&str; 8] = [
    "camera.intrinsics.opencv.k1",
    "camera.intrinsics.opencv.k2",
    "camera.intrinsics.opencv.p1",
    "camera.intrinsics.opencv.p2",
    "camera.intrinsics.opencv.k3",
    "camera.intrinsics.opencv.k4",
    "camera.intrinsics.opencv.k5",
    "camera.intrinsics.opencv.k6",
];
/// Fields of the coefficients of [`Distortion::Fisheye`].
const FISHEYE: [&str; 4] = [
    "camera.intrinsics.fisheye.k1",
    "camera.intrinsics.fisheye.k2",
    "camera.intrinsics.fisheye.k3",
    "camera.intrinsics.fisheye.k4",
];
/// Largest coefficient. Calibrations of real lenses have less than 10³.
const MOST: f64 = 1e6;

/// Steps by which the end of the monotonic range is sought.
const STEPS: u32 = 2048;
/// Largest angle from the axis that the rational model shows, radians: 89.9°. Its plane is infinite at 90°.
const WIDEST: f64 = 1.569_051_0;

impl Distortion {
    /// Whether the image is that of a pinhole.
    pub fn is_none(&self) -> bool {
        match self {
            Self::None => true,
            Self::Rational(k) => k.iter().all(|k| *k == 0.0),
            Self::Fisheye(_) => false,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), InvalidField> {
        let (fields, values): (&[&'static str], &[f64]) = match self {
            Self::None => (&[], &[]),
            Self::Rational(k) => (&RATIONAL, k),
            Self::Fisheye(k) => (&FISHEYE, k),
        };
        for (field, value) in fields.iter().zip(values) {
            // Written so that NaN is refused.
            if !(value.abs() <= MOST) {
                let reason =
                    format!("a coefficient must be finite and at most {MOST:e} in size, not {value}");
                return Err(InvalidField::new(field, reason));
            }
        }
        Ok(())
    }

    /// Where the lens shows a direction in the axes of OpenCV (x right, y down, z forward), on the plane at depth 1. `None` for a
    /// direction that a pinhole does not show, unless the model is of fisheyes.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let on_plane = || (direction.z > 0.0).then(|| direction.truncate() / direction.z);
        match self {
            Self::None => on_plane(),
            Self::Rational(k) => Some(distorted(k, on_plane()?).0),
            Self::Fisheye(k) => {
                let across = direction.truncate();
                let angle = across.length().atan2(direction.z);
                Some(across.normalize_or_zero() * fisheye(k, angle).0)
            }
        }
    }
}

/// Value and derivative of the fisheye model's distance from the middle, by the angle from the axis.
fn fisheye(k: &[f64; 4], angle: f64) -> (f64, f64) {
    let u = angle * angle;
    let value = angle * (1.0 + u * (k[0] + u * (k[1] + u * (k[2] + u * k[3]))));
    let slope = 1.0 + u * (3.0 * k[0] + u * (5.0 * k[1] + u * (7.0 * k[2] + u * 9.0 * k[3])));
    (value, slope)
}

/// The rational model's factor of a squared distance from the middle, its derivative by that, and its denominator.
fn factor(k: &[f64; 8], u: f64) -> (f64, f64, f64) {
    let [k1, k2, _, _, k3, k4, k5, k6] = *k;
    let above = 1.0 + u * (k1 + u * (k2 + u * k3));
    let below = 1.0 + u * (k4 + u * (k5 + u * k6));
    let above_slope = k1 + u * (2.0 * k2 + u * 3.0 * k3);
    let below_slope = k4 + u * (2.0 * k5 + u * 3.0 * k6);
    (above / below, (above_slope * below - above * below_slope) / (below * below), below)
}

/// Value and derivative of the rational model's distance from the middle, without its tangential part. The derivative is not
/// positive where the denominator is not.
fn radial(k: &[f64; 8], r: f64) -> (f64, f64) {
    let u = r * r;
    let (factor, slope, below) = factor(k, u);
    let slope = factor + 2.0 * u * slope;
    (r * factor, if below > 0.0 { slope } else { f64::NEG_INFINITY })
}

/// The rational model with its tangential part, and its Jacobian.
fn distorted(k: &[f64; 8], at: DVec2) -> (DVec2, DMat2) {
    let [_, _, p1, p2, ..] = *k;
    let DVec2 { x, y } = at;
    let u = at.length_squared();
    let (factor, slope, _) = factor(k, u);
    let shift =
        DVec2::new(2.0 * p1 * x * y + p2 * (u + 2.0 * x * x), p1 * (u + 2.0 * y * y) + 2.0 * p2 * x * y);
    let both = 2.0 * slope * x * y + 2.0 * (p1 * x + p2 * y);
    let jacobian = DMat2::from_cols(
        DVec2::new(factor + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x, both),
        DVec2::new(both, factor + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x),
    );
    (at * factor + shift, jacobian)
}

/// The inverse of a model.
#[derive(Debug, Clone)]
pub(crate) struct Undistortion {
    model: Distortion,
    /// End of the monotonic range: distance from the middle without distortion, or angle from the axis of a fisheye.
    end: f64,
    /// Distance from the middle that it is shown at.
    shown_end: f64,
}

impl Undistortion {
    pub(crate) fn new(model: &Distortion) -> Self {
        let widest = if let Distortion::Fisheye(_) = model { PI } else { WIDEST };
        let value = |angle: f64| match model {
            Distortion::None => (angle, 1.0),
            Distortion::Rational(k) => radial(k, angle.tan()),
            Distortion::Fisheye(k) => fisheye(k, angle),
        };
        // NaN ends the range.
        let rises = |angle: f64| value(angle).1 > 0.0;
        let step = widest / f64::from(STEPS);
        let first_bad = (1..=STEPS).map(|i| f64::from(i) * step).find(|angle| !rises(*angle));
        let angle = first_bad.map_or(widest, |bad| {
            let (mut good, mut bad) = (bad - step, bad);
            for _ in 0..60 {
                let middle = 0.5 * (good + bad);
                if rises(middle) { good = middle } else { bad = middle }
            }
            good
        });
        let end = if let Distortion::Fisheye(_) = model { angle } else { angle.tan() };
        Self { model: *model, end, shown_end: value(angle).0 }
    }

    /// Unit direction that is shown at a place on the plane at depth 1. `None` if it lies outside of the monotonic range.
    pub(crate) fn direction(&self, shown: DVec2) -> Option<DVec3> {
        let away = shown.length();
        match self.model {
            Distortion::None => Some(shown.extend(1.0).normalize()),
            Distortion::Fisheye(k) => {
                let angle = self.solved(away, |angle| fisheye(&k, angle))?;
                let (across, along) = angle.sin_cos();
                Some((shown.normalize_or_zero() * across).extend(along))
            }
            Distortion::Rational(k) => {
                let [_, _, p1, p2, ..] = k;
                let is_radial = p1 == 0.0 && p2 == 0.0;
                let distance = match self.solved(away, |r| radial(&k, r)) {
                    // The tangential part may bring it back.
                    None if !is_radial => self.end,
                    distance => distance?,
                };
                let guess = shown.normalize_or_zero() * distance;
                let at = if is_radial { guess } else { self.refined(&k, shown, guess)? };
                Some(at.extend(1.0).normalize())
            }
        }
    }

    /// Where a rising function has a value, within the monotonic range: Newton's method between bounds.
    fn solved(&self, value: f64, function: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
        // Written so that NaN has no solution.
        if !(value <= self.shown_end) {
            return None;
        }
        let (mut low, mut high) = (0.0, self.end);
        let mut at = value.min(high);
        for _ in 0..100 {
            let (found, slope) = function(at);
            if found < value {
                low = at
            } else {
                high = at
            }
            let next = at - (found - value) / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - at).abs() <= 1e-15 * at.abs() {
                return Some(next);
            }
            at = next;
        }
        Some(at)
    }

    /// Newton's method in the plane, for the tangential part.
    fn refined(&self, k: &[f64; 8], shown: DVec2, guess: DVec2) -> Option<DVec2> {
        let mut at = guess;
        for _ in 0..50 {
            let (found, jacobian) = distorted(k, at);
            let off = found - shown;
            // NaN fails.
            if !(jacobian.determinant() > 0.0) {
                return None;
            }
            if off.length() <= 1e-14 * (1.0 + shown.length()) {
                return (at.length() <= self.end).then_some(at);
            }
            at = (at - jacobian.inverse() * off).clamp_length_max(1.5 * self.end);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of lenses: mild, of a wide lens with all terms, strong barrel, pincushion, tangential alone.
    const LENSES: [[f64; 8]; 5] = [
        [-0.28, 0.07, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.9, 0.2, 3e-4, -2e-4, 0.01, 1.3, 0.45, 0.04],
        [-0.45, 0.25, 0.0, 0.0, -0.08, 0.0, 0.0, 0.0],
        [0.3, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.01, -0.02, 0.0, 0.0, 0.0, 0.0],
    ];

    fn directions() -> impl Iterator<Item = DVec3> {
        let around = |i: i32| f64::from(i) * 0.7;
        (0..9).flat_map(move |i| (0..40).map(move |j| (around(i), f64::from(j) * 0.018))).map(
            |(around, angle)| DVec3::new(around.cos() * angle.sin(), around.sin() * angle.sin(), angle.cos()),
        )
    }

    #[test]
    fn directions_survive_a_distortion_and_its_inverse_up_to_the_end_of_the_range() {
        for lens in LENSES {
            let model = Distortion::Rational(lens);
            let inverse = Undistortion::new(&model);
            let mut shown = 0;
            for direction in directions() {
                let r = direction.truncate().length() / direction.z;
                if r < 0.98 * inverse.end {
                    let back = inverse.direction(model.project(direction).unwrap());
                    let back = back.unwrap_or_else(|| panic!("{lens:?}: {direction} has no ray"));
                    assert!(back.distance(direction) < 1e-12, "{lens:?}: {direction} {back}");
                    shown += 1;
                }
            }
            assert!(shown > 100, "{lens:?}: {shown}");
        }
    }

    #[test]
    fn a_fisheye_shows_directions_behind_the_camera() {
        for k in [[0.0; 4], [0.02, -0.004, 0.001, -1e-4], [-0.03, 0.0, 0.0, 0.0]] {
            let model = Distortion::Fisheye(k);
            let inverse = Undistortion::new(&model);
            for angle in [0.0, 1e-9, 0.3, 1.5, 1.6, 2.3] {
                let direction = DVec3::new(-0.6 * f64::sin(angle), 0.8 * f64::sin(angle), f64::cos(angle));
                let back = inverse.direction(model.project(direction).unwrap()).unwrap();
                assert!(back.distance(direction) < 1e-12, "{k:?} {angle}: {back}");
            }
        }
        let straight = Undistortion::new(&Distortion::Fisheye([0.0; 4]));
        let back = straight.direction(DVec2::new(PI, 0.0)).unwrap();
        assert!(back.distance(DVec3::NEG_Z) < 1e-12);
        assert!(straight.direction(DVec2::new(PI + 1e-6, 0.0)).is_none());
    }

    #[test]
    fn a_place_beyond_the_fold_of_a_barrel_has_no_ray() {
        // r (1 − 0.3 r²) rises up to r² = 1 / 0.9.
        let barrel = Undistortion::new(&Distortion::Rational([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        let end = (1.0f64 / 0.9).sqrt();
        let shown = end * (1.0 - 0.3 / 0.9);
        assert!((barrel.end - end).abs() < 1e-9 && (barrel.shown_end - shown).abs() < 1e-9);
        assert!(barrel.direction(DVec2::new(0.0, shown * (1.0 - 1e-9))).is_some());
        assert!(barrel.direction(DVec2::new(0.0, shown * (1.0 + 1e-9))).is_none());
        // A denominator with a root.
        let pole = Undistortion::new(&Distortion::Rational([0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0]));
        assert!(pole.end <= 2.0, "{}", pole.end);
        assert!(pole.direction(DVec2::new(1.0, 0.0)).is_some());
        // NaN has no ray.
        assert!(barrel.direction(DVec2::NAN).is_none());
    }

    #[test]
    fn projections_are_those_that_the_models_define() {
        // Worked out by hand: r² = 0.25 at (0.3, 0.4).
        let k = [0.1, 0.2, 0.01, 0.02, 0.4, 0.5, 0.6, 0.8];
        let factor = (1.0 + 0.025 + 0.0125 + 0.00625) / (1.0 + 0.125 + 0.0375 + 0.0125);
        let expected = DVec2::new(
            0.3 * factor + 2.0 * 0.01 * 0.12 + 0.02 * (0.25 + 0.18),
            0.4 * factor + 0.01 * (0.25 + 0.32) + 2.0 * 0.02 * 0.12,
        );
        let found = Distortion::Rational(k).project(DVec3::new(0.6, 0.8, 2.0)).unwrap();
        assert!(found.distance(expected) < 1e-15, "{found} {expected}");
        let quarter = Distortion::Fisheye([0.1, 0.0, 0.0, 0.0]).project(DVec3::X).unwrap();
        let theta = 0.5 * PI;
        assert!(quarter.distance(DVec2::X * (theta + 0.1 * theta.powi(3))) < 1e-12);
        assert!(Distortion::None.project(DVec3::NEG_Z).is_none());
    }

    #[test]
    fn a_coefficient_that_is_no_number_is_refused_by_its_own_field() {
        for at in 0..8 {
            for wrong in [f64::NAN, f64::INFINITY, -1e7] {
                let mut k = [0.0; 8];
                k[at] = wrong;
                assert_eq!(Distortion::Rational(k).validate().unwrap_err().field, RATIONAL[at]);
                if at < 4 {
                    let k = [k[0], k[1], k[2], k[3]];
                    assert_eq!(Distortion::Fisheye(k).validate().unwrap_err().field, FISHEYE[at]);
                }
            }
        }
    }
}
