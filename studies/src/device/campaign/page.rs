//! A campaign's Markdown page: targets first, then the outcome of each step, then every step's rows. Figures of another
//! campaign stand beside them if there is one.

use std::fmt::Write as _;

use serde_json::Value;

use super::beside::{self, Row};
use super::record::{Outcome, Results, StepRecord};
use super::steps::{SELFTEST, STEPS, Step};
use crate::device::parts::FRAGMENTS;
use crate::device::targets::{TARGETS, Target};
use crate::report::{Report, shown};

/// The page, in Markdown.
pub(super) fn page(here: &Results, other: Option<&Results>) -> String {
    let mut page = "# Campaign\n\n".to_owned();
    let _ = writeln!(page, "On {}.", device(here));
    if let Some(other) = other {
        let _ = writeln!(page, "Beside it: {}.", device(other));
        page += "Cells are *here / beside*, and in brackets how many times better here is.\n";
    }
    if here.record.quick || other.is_some_and(|other| other.record.quick) {
        page += "\nA quick campaign shows that everything works; its figures are noise.\n";
    }
    targets(&mut page, here, other);
    steps(&mut page, here);
    selftest(&mut page, here, other);
    for step in &STEPS {
        study(&mut page, step, here, other);
    }
    fragments(&mut page);
    page += TESTS;
    page
}

/// How to run the tests that a campaign does not run.
const TESTS: &str = "\n## Tests of the crates\n\n\
    `argus selftest` tests the device through the whole of Argus. The crates' own tests are programs as well: `cargo test \
    --release --no-run -p argus-gpu -p argus-sampler -p argus-compositor` builds them and prints their paths; copied to this \
    machine each runs by itself, without arguments.\n";

/// The device of a campaign, from a study's report or else from the self-test.
fn device(results: &Results) -> String {
    let machine = results.printed.values().find_map(|printed| printed.get("machine"));
    let text = |value: Option<&Value>| value.and_then(Value::as_str).unwrap_or_default().to_owned();
    if let Some(machine) = machine {
        let cores = machine.get("cores").map(shown).unwrap_or_default();
        let of = |key: &str| text(machine.get(key));
        return format!("{}, with {} ({cores} cores)", of("gpu"), of("cpu"));
    }
    let found = results.printed.get(SELFTEST).and_then(|printed| printed.get("device"));
    match found.filter(|device| !device.is_null()) {
        Some(device) => format!("{} ({})", text(device.get("adapter")), text(device.get("driver"))),
        None => "a machine whose device is not known".to_owned(),
    }
}

fn targets(page: &mut String, here: &Results, other: Option<&Results>) {
    *page += "\n## Targets\n\nFor a data-centre GPU of the H100's class. The ratio says how many times over a target is met.\n\n";
    *page += "| target | bound | here | ratio |";
    *page += if other.is_some() { " beside | ratio | with |\n" } else { " with |\n" };
    *page += if other.is_some() { "|---|---|---|---|---|---|---|\n" } else { "|---|---|---|---|---|\n" };
    for target in &TARGETS {
        let own = figure(target, here);
        let _ = write!(page, "| {} | {} {} |", target.claim, target.bound.text(), target.unit);
        let _ = write!(page, " {} | {} |", own.figure, own.ratio);
        if let Some(other) = other {
            let theirs = figure(target, other);
            let _ = write!(page, " {} | {} |", theirs.figure, theirs.ratio);
        }
        let _ = writeln!(page, " {} |", own.with);
    }
}

/// A target's table cells.
#[derive(Debug, PartialEq)]
struct Cells {
    figure: String,
    ratio: String,
    with: String,
}

fn figure(target: &Target, results: &Results) -> Cells {
    let nothing = "–".to_owned();
    let printed = STEPS.iter().filter(|step| step.name == target.study);
    let rows: Vec<Row> =
        printed.filter_map(|step| results.printed.get(step.name)).flat_map(rows_of).collect();
    let Some((row, figure)) = target.best(&rows) else {
        // A row without the figure may still hold a note with the reason.
        let row = rows.iter().find(|row| target.is_about(row));
        let with = row.map_or_else(|| "not measured".to_owned(), |row| beside_figure(target, row));
        return Cells { figure: nothing.clone(), ratio: nothing, with };
    };
    let ratio = target.bound.ratio(figure).map_or(nothing, |ratio| format!("{ratio:.3}"));
    Cells { figure: format!("{figure:.3}"), ratio, with: beside_figure(target, row) }
}

fn beside_figure(target: &Target, row: &Row) -> String {
    let of = |key: &&str| Some(format!("{key} {}", shown(row.get(*key)?)));
    let texts = target.beside.iter().filter_map(of);
    cell(&texts.map(|text| text.trim_start_matches("note ").to_owned()).collect::<Vec<_>>().join(", "))
}

fn steps(page: &mut String, here: &Results) {
    *page += "\n## Steps\n\n| step | outcome | s | of | command |\n|---|---|---|---|---|\n";
    for StepRecord { name, command, outcome, secs, most_secs } in &here.record.steps {
        let (secs, most) = match outcome {
            Outcome::Waiting | Outcome::Skipped { .. } => ("–".to_owned(), "–".to_owned()),
            _ => (format!("{secs:.1}"), format!("{most_secs:.0}")),
        };
        let command = command.join(" ");
        let _ = writeln!(
            page,
            "| {name} | {} | {secs} | {most} | `argus {command}` |",
            cell(&outcome_text(outcome))
        );
    }
}

fn outcome_text(outcome: &Outcome) -> String {
    match outcome {
        Outcome::Waiting => "not begun".to_owned(),
        Outcome::Begun => "begun, and not ended when this page was written".to_owned(),
        Outcome::Done => "done".to_owned(),
        Outcome::Failed { reason } => format!("FAILED: {reason}"),
        Outcome::TimedOut => "FAILED: took longer than it might, and was killed".to_owned(),
        Outcome::Skipped { reason } => format!("left out: {reason}"),
    }
}

/// The device's description, and the checks that failed.
fn selftest(page: &mut String, here: &Results, other: Option<&Results>) {
    let Some(printed) = here.printed.get(SELFTEST) else { return };
    *page += "\n## Device\n\n";
    *page += if other.is_some() { "| | here | beside |\n|---|---|---|\n" } else { "| | |\n|---|---|\n" };
    let beside =
        other.and_then(|other| other.printed.get(SELFTEST)).and_then(|printed| printed.get("device"));
    for (key, value) in printed.get("device").and_then(Value::as_object).into_iter().flatten() {
        let _ = write!(page, "| {key} | {} |", listed(value));
        if other.is_some() {
            let value = beside.and_then(|device| device.get(key)).map(listed).unwrap_or_default();
            let _ = write!(page, " {value} |");
        }
        *page += "\n";
    }
    let checks: Vec<Row> = printed.get("checks").map(objects).unwrap_or_default();
    let of = |state: &str| checks.iter().filter(|check| check["result"] == state).collect::<Vec<_>>();
    let _ = writeln!(
        page,
        "\n{} of {} checks passed, {} failed, {} are of what the device does not have.",
        of("passed").len(),
        checks.len(),
        of("failed").len(),
        of("absent").len()
    );
    for check in of("failed").into_iter().chain(of("absent")) {
        let text = |key: &str| check.get(key).map(shown).unwrap_or_default();
        let _ = writeln!(page, "- {}: {} {}: {}", text("result"), text("name"), text("figure"), text("note"));
    }
}

/// A value of the device's description, as text.
fn listed(value: &Value) -> String {
    cell(&match value {
        Value::Array(parts) if parts.is_empty() => "nothing".to_owned(),
        Value::Array(parts) => parts.iter().map(shown).collect::<Vec<_>>().join(", "),
        value => shown(value),
    })
}

fn study(page: &mut String, step: &Step, here: &Results, other: Option<&Results>) {
    let Some(printed) = here.printed.get(step.name) else { return };
    let rows = rows_of(printed);
    if rows.is_empty() {
        return;
    }
    let _ = writeln!(page, "\n## {}\n", step.name);
    *page += &match other.and_then(|other| other.printed.get(step.name)).map(rows_of) {
        Some(others) => beside::table(step.keys, &rows, &others),
        None => Report::table(&rows),
    };
    for note in printed.get("notes").and_then(Value::as_array).into_iter().flatten() {
        let _ = write!(page, "\n{}\n", shown(note));
    }
}

fn fragments(page: &mut String) {
    *page += "\n## Fragment programs and their backends in compute\n\n| program | in compute | which one runs |\n|---|---|---|\n";
    for program in FRAGMENTS {
        let compute = program.compute.unwrap_or("none");
        let _ = writeln!(page, "| {} | {compute} | {} |", program.label, program.note);
    }
}

/// The rows of a printed report.
fn rows_of(printed: &Value) -> Vec<Row> {
    printed.get("rows").map(objects).unwrap_or_default()
}

fn objects(value: &Value) -> Vec<Row> {
    value.as_array().into_iter().flatten().filter_map(Value::as_object).cloned().collect()
}

/// Escapes text for a table cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::record::Record;
    use super::*;

    fn results(frame_ms: f64, gpu: &str) -> Results {
        let mut results = Results { record: Record::new(false, 30.0), ..Results::default() };
        let row = json!({"method": "megaviews", "placement": "all", "views": 1 << 20, "resolution": 16, "levels": 10,
            "frame_ms": frame_ms, "extrapolated": false, "maps": 7000, "wrong_shadow_fraction": 0.01});
        results.printed.insert(
            "megaviews".to_owned(),
            json!({"machine": {"gpu": gpu, "cpu": "a CPU", "cores": 2}, "rows": [row], "notes": ["A note."]}),
        );
        results
    }

    /// Lines of the page that start with `begin`.
    fn lines<'a>(page: &'a str, begin: &str) -> Vec<&'a str> {
        page.lines().filter(|line| line.starts_with(begin)).collect()
    }

    #[test]
    fn a_target_shows_its_ratio_and_the_figures_beside_it() {
        let page = page(&results(40.0, "soft"), None);
        let row = lines(&page, "| 1M maps")[0];
        assert_eq!(
            row,
            "| 1M maps of 16² at 11 levels | ≤ 10 ms | 40.000 | 0.250 | maps 7000, wrong_shadow_fraction 0.0100 |"
        );
        assert!(lines(&page, "| incoherent rays")[0].contains("| – | – | not measured |"), "{page}");
        assert!(page.contains("On soft, with a CPU (2 cores).") && page.contains("\nA note.\n"), "{page}");
    }

    #[test]
    fn two_campaigns_are_compared_side_by_side() {
        let page = page(&results(5.0, "fast"), Some(&results(40.0, "soft")));
        let target = lines(&page, "| 1M maps")[0];
        assert!(target.contains("| 5.000 | 2.000 | 40.000 | 0.250 |"), "{target}");
        assert!(page.contains("Beside it: soft"), "{page}");
        assert!(page.contains("5.0000 / 40.0000 (8.00×)"), "{page}");
    }

    #[test]
    fn a_failed_step_is_a_row_with_its_reason_and_cells_are_escaped() {
        let mut results = results(1.0, "soft");
        results.record.steps[2].outcome = Outcome::Failed { reason: "a | b".to_owned() };
        results.record.steps[3].outcome = Outcome::Skipped { reason: "no time left".to_owned() };
        results.record.steps[4].outcome = Outcome::Begun;
        let page = page(&results, None);
        assert!(lines(&page, "| baseline")[0].contains("FAILED: a \\| b"));
        assert!(lines(&page, "| warp |")[0].contains("left out: no time left"));
        assert!(lines(&page, "| visibility")[0].contains("not ended when this page was written"));
    }

    #[test]
    fn the_page_describes_the_device_and_lists_failed_and_absent_checks() {
        let mut results = Results { record: Record::new(true, 1.0), ..Results::default() };
        let check =
            |name: &str, result: &str| json!({"name": name, "result": result, "figure": 0.5, "note": "why"});
        results.printed.insert(
            SELFTEST.to_owned(),
            json!({"device": {"adapter": "A", "driver": "D", "lacks": ["x", "y"]}, "checks": [
                check("good", "passed"), check("bad", "failed"), check("gone", "absent")]}),
        );
        let page = page(&results, None);
        assert!(page.contains("On A (D).") && page.contains("| lacks | x, y |"), "{page}");
        assert!(page.contains("1 of 3 checks passed, 1 failed, 1 are of"), "{page}");
        assert!(
            page.contains("- failed: bad") && page.contains("- absent: gone") && !page.contains(": good")
        );
        assert!(page.contains("figures are noise"));
    }

    #[test]
    fn an_empty_campaign_still_lists_all_targets() {
        let page = page(&Results::default(), None);
        assert!(page.contains("whose device is not known") && page.contains("## Targets"), "{page}");
        assert!(lines(&page, "| compositor/resolve")[0].contains("| none |"));
    }
}
