//! Ridge regression of an error's logarithm, with quantiles from its residuals.

use serde::{Deserialize, Serialize};

/// Added to errors before their logarithm: smaller errors are alike.
const LEAST_ERROR: f64 = 1e-4;
/// Penalties that are tried. The best by leave-one-out residuals is kept.
const PENALTIES: [f64; 6] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0];
/// Number of quantiles that represent the residuals, from the least to the greatest.
const QUANTILES: usize = 41;
/// Rise of the error's logarithm for each standard deviation by which a feature lies outside of the calibrated range.
const OUTSIDE: f64 = 0.25;
/// Least standard deviation of a feature, however little calibration varied it. Features are logarithms, roots and
/// shares. So a view with two unresolved pixels is predicted, although nearly all calibrated views had none.
const LEAST_SCALE: f64 = 0.05;

/// The term of one feature.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Term {
    center: f64,
    scale: f64,
    low: f64,
    high: f64,
    weight: f64,
}

/// Predicts positive errors from features.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Regression {
    terms: Vec<Term>,
    intercept: f64,
    /// Quantiles of the leave-one-out residuals, ascending.
    residuals: Vec<f64>,
    /// The residual that a share of [`super::CONFIDENCE`] stays below.
    upper: f64,
}

/// The belief about one error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief<'a> {
    /// Mean of the error's logarithm.
    mean: f64,
    /// Added to every quantile, for features outside of the calibrated range.
    outside: f64,
    of: &'a Regression,
}

impl Regression {
    /// Fits to rows of features and their errors. `None` for fewer than eight usable rows; rows with non-finite
    /// values are omitted.
    pub fn fit(rows: &[Vec<f64>], errors: &[f64]) -> Option<Self> {
        let width = rows.first()?.len();
        let usable = rows.iter().zip(errors).filter(|(row, error)| {
            row.len() == width && **error >= 0.0 && error.is_finite() && row.iter().all(|x| x.is_finite())
        });
        let (rows, targets): (Vec<&Vec<f64>>, Vec<f64>) =
            usable.map(|(row, error)| (row, (error + LEAST_ERROR).ln())).unzip();
        if rows.len() < 8 {
            return None;
        }
        let n = rows.len() as f64;
        let intercept = targets.iter().sum::<f64>() / n;
        let mut terms: Vec<Term> = (0..width)
            .map(|i| {
                let column = || rows.iter().map(|row| row[i]);
                let center = column().sum::<f64>() / n;
                let variance = column().map(|x| (x - center).powi(2)).sum::<f64>() / n;
                Term {
                    center,
                    // A feature that calibration never varied has no weight. A view that varies it is outside by the
                    // full difference.
                    scale: if variance > 1e-12 { variance.sqrt() } else { 1.0 },
                    low: column().fold(f64::INFINITY, f64::min),
                    high: column().fold(f64::NEG_INFINITY, f64::max),
                    weight: 0.0,
                }
            })
            .collect();
        let table: Vec<Vec<f64>> = rows
            .iter()
            .map(|row| row.iter().zip(&terms).map(|(x, t)| (x - t.center) / t.scale).collect())
            .collect();
        let centered: Vec<f64> = targets.iter().map(|t| t - intercept).collect();
        let (weights, mut residuals) = PENALTIES
            .iter()
            .filter_map(|&penalty| ridge(&table, &centered, penalty))
            .min_by(|(_, a), (_, b)| squares(a).total_cmp(&squares(b)))?;
        terms.iter_mut().zip(weights).for_each(|(term, weight)| term.weight = weight);
        residuals.sort_by(f64::total_cmp);
        Some(Self { terms, intercept, upper: upper_quantile(&residuals), residuals: thinned(&residuals) })
    }

    /// The factor between upper bound and median.
    pub fn factor(&self) -> f64 {
        (self.upper - self.middle()).exp().max(1.0)
    }

    fn middle(&self) -> f64 {
        self.residuals.get(self.residuals.len() / 2).copied().unwrap_or(0.0)
    }

    /// The belief about the error of a row of features. A row with non-finite values, or of another length, is as far
    /// outside as possible.
    pub fn believe(&self, features: &[f64]) -> Belief<'_> {
        let mut belief = Belief { mean: self.intercept, outside: 0.0, of: self };
        if features.len() != self.terms.len() || features.iter().any(|x| !x.is_finite()) {
            belief.outside = f64::INFINITY;
            return belief;
        }
        for (x, term) in features.iter().zip(&self.terms) {
            let inside = x.clamp(term.low, term.high);
            belief.mean += term.weight * (inside - term.center) / term.scale;
            belief.outside += OUTSIDE * (x - inside).abs() / term.scale.max(LEAST_SCALE);
        }
        belief
    }
}

impl Belief<'_> {
    /// The median error of such views, 0 to 1.
    pub fn median(&self) -> f64 {
        error_of(self.mean + self.of.middle())
    }

    /// The error that a share of [`super::CONFIDENCE`] of such views stays below, 0 to 1.
    pub fn upper(&self) -> f64 {
        error_of(self.mean + self.outside + self.of.upper)
    }

    /// The share of such views whose error is at most `error / factor`. If `factor` is another regression's factor of
    /// its upper bound above the truth, this is the share that it would accept.
    pub fn share_within(&self, error: f64, factor: f64) -> f64 {
        let room = (error / factor + LEAST_ERROR).ln() - self.mean - self.outside;
        let quantiles = &self.of.residuals;
        // A NaN gives 0.
        let below = quantiles.iter().filter(|&&residual| residual <= room).count();
        below as f64 / quantiles.len().max(1) as f64
    }
}

/// Converts back from the logarithm; unknown values give 1, the greatest FLIP.
fn error_of(logarithm: f64) -> f64 {
    let error = logarithm.exp() - LEAST_ERROR;
    if error <= 1.0 { error.max(0.0) } else { 1.0 }
}

fn squares(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum()
}

/// The ⌈(n + 1)·level⌉-th of `n` ascending residuals; with too few, 1.5 times the greatest.
fn upper_quantile(residuals: &[f64]) -> f64 {
    let rank = ((residuals.len() + 1) as f64 * super::CONFIDENCE).ceil() as usize;
    match residuals.get(rank.saturating_sub(1)) {
        Some(residual) => *residual,
        None => residuals.last().map_or(f64::INFINITY, |most| most + 0.5 * most.abs()),
    }
}

/// Evenly spaced quantiles of ascending values.
fn thinned(values: &[f64]) -> Vec<f64> {
    let at = |i: usize| values[i * (values.len() - 1) / (QUANTILES - 1)];
    (0..QUANTILES).map(at).collect()
}

/// Weights of the ridge regression without intercept, and the leave-one-out residual of every row: eᵢ / (1 − hᵢᵢ),
/// where hᵢᵢ is the diagonal of the hat matrix (Allen's PRESS, Technometrics 1974), including the mean.
fn ridge(table: &[Vec<f64>], targets: &[f64], penalty: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    let width = table.first()?.len();
    let mut normal = vec![vec![0.0; width]; width];
    let mut right = vec![0.0; width];
    for (row, target) in table.iter().zip(targets) {
        for i in 0..width {
            right[i] += row[i] * target;
            for j in 0..=i {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    (0..width).for_each(|i| normal[i][i] += penalty);
    let factor = cholesky(normal)?;
    let weights = solve(&factor, &right);
    let of_mean = 1.0 / table.len() as f64;
    let left_out = table.iter().zip(targets).map(|(row, target)| {
        let predicted: f64 = row.iter().zip(&weights).map(|(x, w)| x * w).sum();
        let leverage = of_mean + forward(&factor, row).iter().map(|z| z * z).sum::<f64>();
        (target - predicted) / (1.0 - leverage).max(0.05)
    });
    let left_out = left_out.collect();
    Some((weights, left_out))
}

/// The lower triangle L of L·Lᵀ, from the lower triangle of a symmetric matrix; `None` if that is not positive
/// definite.
fn cholesky(mut a: Vec<Vec<f64>>) -> Option<Vec<Vec<f64>>> {
    for i in 0..a.len() {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - dot;
            a[i][j] = match i == j {
                // A NaN is refused.
                true if rest > 0.0 => rest.sqrt(),
                true => return None,
                false => rest / a[j][j],
            };
        }
    }
    Some(a)
}

/// L⁻¹·b.
fn forward(factor: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let mut z = Vec::with_capacity(b.len());
    for (i, row) in factor.iter().enumerate() {
        let dot: f64 = row.iter().zip(&z).map(|(l, z)| l * z).sum();
        z.push((b[i] - dot) / row[i]);
    }
    z
}

/// (L·Lᵀ)⁻¹·b.
fn solve(factor: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let mut x = forward(factor, b);
    for i in (0..x.len()).rev() {
        let dot: f64 = (i + 1..x.len()).map(|k| factor[k][i] * x[k]).sum();
        x[i] = (x[i] - dot) / factor[i][i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic pseudo-random numbers, −1 to 1.
    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
        }
    }

    fn rows(count: usize, seed: u64) -> (Vec<Vec<f64>>, Vec<f64>) {
        let mut next = noise(seed);
        (0..count)
            .map(|_| {
                let row = vec![next(), 3.0 * next() + 10.0, next(), 7.0];
                let error = 0.03 * (0.8 * row[0] - 0.2 * (row[1] - 10.0) + 0.15 * next()).exp();
                (row, error)
            })
            .unzip()
    }

    #[test]
    fn features_that_calibration_hardly_varied_may_differ_a_little() {
        let (mut train, errors) = rows(40, 5);
        train.iter_mut().enumerate().for_each(|(i, row)| row.push(if i == 0 { 0.001 } else { 0.0 }));
        let regression = Regression::fit(&train, &errors).unwrap();
        let upper = |more: f64| regression.believe(&[0.0, 10.0, 0.0, 7.0, more]).upper();
        assert!(upper(0.026) < 1.3 * upper(0.001), "{} {}", upper(0.026), upper(0.001));
        assert!(upper(0.3) > 3.0 * upper(0.001), "{} {}", upper(0.3), upper(0.001));
    }

    #[test]
    fn predictions_fit_and_the_upper_bound_holds_as_often_as_promised() {
        let (train, errors) = rows(100, 1);
        let regression = Regression::fit(&train, &errors).unwrap();
        let (test, truth) = rows(2000, 2);
        let beliefs: Vec<Belief<'_>> = test.iter().map(|row| regression.believe(row)).collect();
        let within = beliefs.iter().zip(&truth).filter(|(b, t)| **t <= b.upper()).count();
        let share = within as f64 / 2000.0;
        assert!((share - super::super::CONFIDENCE).abs() < 0.035, "{share}");
        let off = |(b, t): (&Belief<'_>, &f64)| (b.median() / t).ln().abs();
        let mean_off = beliefs.iter().zip(&truth).map(off).sum::<f64>() / 2000.0;
        assert!(mean_off < 0.12, "{mean_off}");
        assert!(beliefs.iter().all(|b| b.upper() < 1.6 * b.median()), "the features explain nearly all");
    }

    #[test]
    fn predictions_outside_of_the_calibrated_range_are_less_certain() {
        let (train, errors) = rows(100, 3);
        let regression = Regression::fit(&train, &errors).unwrap();
        let inside = regression.believe(&[0.0, 10.0, 0.0, 7.0]);
        let outside = regression.believe(&[0.0, 10.0, 0.0, 12.0]);
        assert_eq!(inside.median(), outside.median());
        assert!(outside.upper() > 2.0 * inside.upper());
        assert!(outside.share_within(0.03, 1.0) < inside.share_within(0.03, 1.0));
    }

    #[test]
    fn values_that_are_not_finite_are_ignored() {
        let (mut train, mut errors) = rows(60, 4);
        let clean = Regression::fit(&train, &errors).unwrap();
        train.extend([vec![f64::NAN, 1.0, 1.0, 1.0], vec![0.0, 10.0, 0.0, 7.0], vec![0.0]]);
        errors.extend([0.1, f64::NAN, 0.1]);
        assert_eq!(Regression::fit(&train, &errors).unwrap(), clean);
        for row in [vec![f64::NAN, 10.0, 0.0, 7.0], vec![0.0, f64::INFINITY, 0.0, 7.0], vec![]] {
            let belief = clean.believe(&row);
            assert_eq!((belief.upper(), belief.share_within(0.9, 1.0)), (1.0, 0.0));
        }
        assert!(Regression::fit(&train[..5], &errors[..5]).is_none());
        assert!(Regression::fit(&[], &[]).is_none());
    }

    #[test]
    fn equal_errors_and_few_rows_are_fitted() {
        let (train, _) = rows(40, 5);
        let constant = Regression::fit(&train, &[0.02; 40]).unwrap();
        let belief = constant.believe(&train[0]);
        assert!((belief.median() - 0.02).abs() < 1e-6 && (belief.upper() - 0.02).abs() < 1e-6);
        let wide: Vec<Vec<f64>> = train[..10].iter().map(|row| row.repeat(5)).collect();
        let fitted = Regression::fit(&wide, &[0.01; 10]).unwrap();
        assert!(fitted.believe(&wide[3]).upper().is_finite());
    }
}
