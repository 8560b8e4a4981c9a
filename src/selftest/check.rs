//! Checks: a figure, its limit, and the time it took.

use std::fmt::Write as _;
use std::time::Instant;

use serde::Serialize;

/// The outcome of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Outcome {
    Passed,
    Failed,
    /// The device lacks the feature, and Argus works without it.
    Absent,
}

/// One line of the report.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Check {
    pub(super) name: String,
    pub(super) result: Outcome,
    /// The measured figure; `None` for yes-or-no checks. Infinite figures are null in JSON.
    pub(super) figure: Option<f64>,
    pub(super) unit: &'static str,
    pub(super) at_most: Option<f64>,
    pub(super) at_least: Option<f64>,
    pub(super) ms: f64,
    /// Why the check failed or the feature is absent.
    pub(super) note: Option<String>,
}

impl Check {
    pub(super) fn failed(&self) -> bool {
        self.result == Outcome::Failed
    }
}

/// The limit of a figure.
#[derive(Debug, Clone, Copy)]
pub(super) enum Limit {
    AtMost(f64),
    AtLeast(f64),
}

/// The checks so far.
#[derive(Default)]
pub(super) struct Checks(Vec<Check>);

impl Checks {
    /// Runs work that must succeed. Returns its value if it did.
    pub(super) fn attempt<T>(&mut self, name: &str, work: impl FnOnce() -> anyhow::Result<T>) -> Option<T> {
        let begin = Instant::now();
        let result = work();
        let note = result.as_ref().err().map(one_line);
        let outcome = if result.is_ok() { Outcome::Passed } else { Outcome::Failed };
        self.push(name, outcome, None, "", None, begin, note);
        result.ok()
    }

    /// Checks a figure, measured since `begin`, against its limit. NaN fails.
    pub(super) fn figure(
        &mut self,
        name: &str,
        figure: f64,
        unit: &'static str,
        limit: Limit,
        begin: Instant,
    ) {
        let within = match limit {
            Limit::AtMost(most) => figure <= most,
            Limit::AtLeast(least) => figure >= least,
        };
        let outcome = if within { Outcome::Passed } else { Outcome::Failed };
        self.push(name, outcome, Some(figure), unit, Some(limit), begin, None);
    }

    /// Records that the device lacks a feature that Argus can do without.
    pub(super) fn absent(&mut self, name: &str, why: String) {
        self.push(name, Outcome::Absent, None, "", None, Instant::now(), Some(why));
    }

    #[expect(clippy::too_many_arguments, reason = "the fields of a line, in one private place")]
    fn push(
        &mut self,
        name: &str,
        result: Outcome,
        figure: Option<f64>,
        unit: &'static str,
        limit: Option<Limit>,
        begin: Instant,
        note: Option<String>,
    ) {
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        let (at_most, at_least) = match limit {
            Some(Limit::AtMost(most)) => (Some(most), None),
            Some(Limit::AtLeast(least)) => (None, Some(least)),
            None => (None, None),
        };
        self.0.push(Check { name: name.to_owned(), result, figure, unit, at_most, at_least, ms, note });
    }

    pub(super) fn done(self) -> Vec<Check> {
        self.0
    }
}

/// An error and its causes in one line.
fn one_line(error: &anyhow::Error) -> String {
    format!("{error:#}").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The checks as text, one per line.
pub(super) fn table(checks: &[Check]) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{:<48} {:<7} {:>10} {:>14} {:>8}", "check", "result", "figure", "limit", "ms");
    for check in checks {
        let result = match check.result {
            Outcome::Passed => "passed",
            Outcome::Failed => "FAILED",
            Outcome::Absent => "absent",
        };
        let limit = match (check.at_most, check.at_least) {
            (Some(most), _) => format!("≤ {most} {}", check.unit),
            (_, Some(least)) => format!("≥ {least} {}", check.unit),
            _ => String::new(),
        };
        let figure = check.figure.map(|figure| format!("{figure:.4}")).unwrap_or_default();
        let _ = write!(
            text,
            "{:<48} {result:<7} {figure:>10} {:>14} {:>8.1}",
            check.name,
            limit.trim(),
            check.ms
        );
        let _ = writeln!(text, "{}", check.note.as_ref().map(|note| format!("  {note}")).unwrap_or_default());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_at_its_limit_passes_and_beyond_it_or_nan_fails() {
        let mut checks = Checks::default();
        let now = Instant::now();
        for (figure, limit) in [
            (0.5, Limit::AtMost(0.5)),
            (f64::INFINITY, Limit::AtLeast(30.0)),
            (0.6, Limit::AtMost(0.5)),
            (f64::NAN, Limit::AtMost(0.5)),
            (f64::NAN, Limit::AtLeast(0.5)),
        ] {
            checks.figure("x", figure, "", limit, now);
        }
        let failed: Vec<bool> = checks.done().iter().map(Check::failed).collect();
        assert_eq!(failed, [false, false, true, true, true]);
    }

    #[test]
    fn a_failure_states_its_reason_and_an_absent_feature_is_no_failure() {
        let mut checks = Checks::default();
        assert_eq!(checks.attempt("good", || Ok(7)), Some(7));
        assert_eq!(checks.attempt("bad", || anyhow::bail!("two\nlines")), None::<()>);
        checks.absent("missing", "not here".to_owned());
        let checks = checks.done();
        assert_eq!(checks.iter().filter(|check| check.failed()).count(), 1);
        let table = table(&checks);
        assert!(
            table.contains("FAILED") && table.contains("two lines") && table.contains("absent"),
            "{table}"
        );
        assert_eq!(table.lines().count(), 4);
    }
}
