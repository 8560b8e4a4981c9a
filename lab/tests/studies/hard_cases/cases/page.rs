//! The table of hard cases as a documentation page.

use std::fmt::Write as _;

use super::oracle::{COLOR, RANGE};
use super::{KNOWN_FAILURE, Outcome, Row};

/// The page of these rows.
pub(in super::super) fn page(rows: &[Row]) -> String {
    let mut page = format!(
        "# Hard cases\n\n\
         Difficult cases of image reconstruction, and the error of each search against the f64 ray tracer.\n\
         `cargo test -p argus-lab --test studies hard_cases` runs them; with `ARGUS_WRITE_PAGE=1` it also writes this \
         page.\n\n\
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
    for row in rows {
        if theme != row.theme {
            theme = row.theme;
            let name = format!("{:?}", row.theme.unwrap()).to_lowercase();
            let _ = write!(
                page,
                "\n## {name}\n\n| case | search | measure | oracle error | at most | unresolved | at most | why |\n\
                 | --- | --- | --- | --- | --- | --- | --- | --- |\n",
            );
        }
        let outcome = match row.outcome {
            Outcome::Passed => "",
            Outcome::KnownFailure => " *known failure*",
            Outcome::Failed => " **failed**",
        };
        let Row {
            case, search, measure, oracle_error, tolerance, unresolved, unresolved_tolerance, why, ..
        } = row;
        let _ = writeln!(
            page,
            "| {case} | {search} | {measure} | {oracle_error:.4}{outcome} | {tolerance:.3} | {unresolved:.4} | \
             {unresolved_tolerance:.3} | {why} |",
        );
    }
    let count = |outcome| rows.iter().filter(|row| row.outcome == outcome).count();
    let counts = Outcome::ALL.map(|outcome| format!("{} {}", count(outcome), outcome.words()));
    let _ = write!(page, "\nOf {} cases: {}.\n", rows.len(), counts.join(", "));
    page
}

/// The cases and searches of a page, in their order.
pub(in super::super) fn claims(page: &str) -> Vec<(String, String)> {
    let row = |line: &str| {
        let mut cells = line.strip_prefix("| ")?.split(" | ");
        let (case, search) = (cells.next()?, cells.next()?);
        (case != "case" && case != "---").then(|| (case.to_owned(), search.to_owned()))
    };
    page.lines().filter_map(row).collect()
}
