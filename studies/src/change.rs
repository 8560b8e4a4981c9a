//! Balance under change, by simulation with the real core: demand that rises and falls, workers that differ, come, go,
//! hang and are restarted. See [`crate::simulate::change`].

use anyhow::{Context as _, Result};
use indicatif::ProgressBar;

use crate::simulate::Parameters;
use crate::simulate::change::{Outcome, placement, scenarios};
use crate::{Machine, Report, report};

/// Runs every scenario with the given costs.
///
/// # Errors
/// A row that cannot be written down.
pub fn run(parameters: &Parameters, progress: &ProgressBar) -> Result<Report> {
    let all = scenarios();
    progress.set_length(all.len() as u64 + 1);
    let mut outcomes: Vec<Outcome> = Vec::new();
    for (name, scenario) in all {
        progress.set_message(name);
        outcomes.push(scenario(parameters));
        progress.inc(1);
    }
    outcomes.push(placement(parameters));
    let rows = outcomes.iter().map(|outcome| Ok(report::row(serde_json::to_value(outcome)?)));
    let rows = rows.collect::<Result<Vec<_>, serde_json::Error>>().context("a scenario's outcome")?;
    let mut report = Report::new("simulated", Machine::here("none"), rows);
    let lost: u64 = outcomes.iter().map(|outcome| outcome.lost).sum();
    report.notes.push(format!("Views lost in all scenarios together: {lost}."));
    report.notes.push(format!("Costs: {}", serde_json::to_string(parameters)?));
    Ok(report)
}
