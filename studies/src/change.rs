//! Change: how the cluster's balance follows changes, simulated with the real coordinator core. See
//! [`crate::simulate::change`] for the scenarios.

use anyhow::{Context as _, Result};
use indicatif::ProgressBar;

use crate::simulate::Parameters;
use crate::simulate::change::{Outcome, placement, scenarios};
use crate::{Machine, Report, report};

/// Runs every scenario with the given costs.
///
/// # Errors
/// A row that cannot be serialised.
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
    let steady = outcomes.iter().filter_map(|o| Some((o.scenario, o.seeds, o.steady_changes_per_min?)));
    let moved: Vec<String> = steady
        .filter(|(_, _, changes)| *changes > 0.0)
        .map(|(scenario, runs, changes)| format!("{scenario}: {changes:.2} (mean of {runs} runs)"))
        .collect();
    report.notes.push(match moved.is_empty() {
        true => {
            "Changes of role a minute under steady load: 0 in every scenario with a steady load.".to_owned()
        }
        false => {
            format!("Changes of role a minute under steady load, with a target of 0: {}.", moved.join("; "))
        }
    });
    report.notes.push(
        "Configured by default: idle samplers compose, and half of their time may go into refinements. The other scenarios \
         have exclusive roles and no refinements. Simulated views have no holes, so there are no refinements."
            .to_owned(),
    );
    report.notes.push(format!("Costs: {}", serde_json::to_string(parameters)?));
    Ok(report)
}
