//! Writes the table of hard cases as a documentation page.

use std::fmt::Write as _;

use super::KNOWN_FAILURE;
use super::oracle::{COLOR, RANGE};
use crate::Report;

/// The page, from a report's rows.
pub fn page(report: &Report) -> String {
    let mut page = format!(
        "# Hard cases\n\n\
         Difficult cases of image reconstruction, and the error of each search against the f64 ray tracer.\n\
         Written by `argus-lab study hard-cases --page docs/hard-cases.md`; `cargo test -p argus-lab --test studies hard_cases` runs the \
         same cases.\n\n\
         A *wrong* pixel claims to be resolved, and its range differs by more than {:.0}% or its colour by more \
         than {COLOR}\nof 255 steps from what its own ray and each of the eight around it meet. *Unresolved* \
         pixels say that no sample\nsaw them. Shares are of all pixels; the largest accepted share stands beside each. \
         In every case, no\npixel may contradict itself (NaN, a range without a source), and a search's fragment and \
         compute programs must give\nequal bytes. A case that accepts more than {:.0}% wrong pixels is a *known \
         failure*: it counts as neither passed nor failed.\n",
        RANGE * 100.0,
        KNOWN_FAILURE * 100.0
    );
    let mut theme = None;
    for row in &report.rows {
        let text = |key: &str| row.get(key).and_then(|v| v.as_str()).unwrap_or_default();
        let number = |key: &str| row.get(key).and_then(|v| v.as_f64()).unwrap_or(f64::NAN);
        if theme != Some(text("theme")) {
            theme = Some(text("theme"));
            let _ = write!(
                page,
                "\n## {}\n\n| case | search | measure | oracle error | at most | unresolved | at most | why |\n\
                 | --- | --- | --- | --- | --- | --- | --- | --- |\n",
                text("theme")
            );
        }
        let outcome = match text("outcome") {
            "passed" => "",
            "known-failure" => " *known failure*",
            _ => " **failed**",
        };
        let _ = writeln!(
            page,
            "| {} | {} | {} | {:.4}{outcome} | {} | {:.4} | {} | {} |",
            text("case"),
            text("search"),
            text("measure"),
            number("oracle_error"),
            bound(number("tolerance")),
            number("unresolved"),
            bound(number("unresolved_tolerance")),
            text("why"),
        );
    }
    for note in &report.notes {
        let _ = write!(page, "\n{note}\n");
    }
    page
}

/// A limit, as the page shows it.
fn bound(value: f64) -> String {
    format!("{value:.3}")
}

/// The cases and searches of a page, in their order.
pub fn claims(page: &str) -> Vec<(String, String)> {
    let row = |line: &str| {
        let mut cells = line.strip_prefix("| ")?.split(" | ");
        let (case, search) = (cells.next()?, cells.next()?);
        (case != "case" && case != "---").then(|| (case.to_owned(), search.to_owned()))
    };
    page.lines().filter_map(row).collect()
}
