//! Lowers the density of points until they fit in a budget.

use crate::Density;

/// How a budget was kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BudgetReport {
    /// Points at full density.
    pub wanted: u64,
    /// Factor on the density, linear: 1 within the budget.
    pub reduction: f64,
    /// Whether the points fit in the budget. If not, there are more pieces of triangles than points are allowed.
    pub kept: bool,
}

/// Most rounds in which density is lowered.
const MOST_ROUNDS: u32 = 6;
/// Least and largest factor on the density in a round after the first.
const LARGEST_STEP: f64 = 0.05;
const SMALLEST_STEP: f64 = 0.95;

/// Cuts triangles at lower and lower densities until the points fit in the budget. `cut` returns what it cut, and the numbers
/// of pieces and of points. Its last call is for what is returned.
///
/// # Errors
/// That of `cut`.
pub(crate) fn within_budget<T, E>(
    (density, budget): (Density, u32),
    mut cut: impl FnMut(Density) -> Result<(T, [u64; 2]), E>,
) -> Result<(T, BudgetReport), E> {
    let (mut reduction, mut wanted) = (density.reduction, None);
    for round in 0.. {
        let (found, [pieces, points]) = cut(Density { reduction, ..density })?;
        let wanted = *wanted.get_or_insert(points);
        let kept = points <= u64::from(budget);
        if kept || round == MOST_ROUNDS {
            return Ok((found, BudgetReport { wanted, reduction, kept }));
        }
        let (budget, points) = (f64::from(budget), points as f64);
        reduction *= match round {
            0 => (budget / points).sqrt(),
            // Cells on edges follow the density itself, and every piece keeps one.
            _ => {
                let pieces = pieces as f64;
                ((budget - pieces) / (points - pieces)).clamp(LARGEST_STEP, SMALLEST_STEP)
            }
        };
    }
    unreachable!("the last round returns")
}
