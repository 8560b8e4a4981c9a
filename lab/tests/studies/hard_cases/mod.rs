//! The conformance suite of reconstruction: every case within its bounds.

mod cases;
mod omni;
mod page;
mod poses;
mod precision;
mod rays;
mod sizes;
mod surfaces;

use std::sync::{Arc, OnceLock};

use argus_gpu::{Gpu, GpuOptions};

use self::cases::{Outcome, Row, Stages, Theme, claims};

/// Runs the cases of a theme.
fn rows(theme: Theme) -> Vec<Row> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    let gpu = GPU.get_or_init(|| Gpu::new(&GpuOptions::default()).expect("these tests need a Vulkan driver"));
    theme.run(&mut Stages::new(gpu).unwrap()).unwrap()
}

/// Runs the cases of a theme; fails with all that are out of bounds, and with one that the page lacks.
#[track_caller]
fn holds(theme: Theme) -> Vec<Row> {
    let rows = rows(theme);
    let failed: Vec<String> =
        rows.iter().filter(|row| row.outcome == Outcome::Failed).map(|row| format!("{row:?}")).collect();
    assert!(
        failed.is_empty(),
        "{} of {} are out of bounds:\n{}",
        failed.len(),
        rows.len(),
        failed.join("\n")
    );
    let written = claims(&page::text());
    for row in &rows {
        let claim = (row.case.clone(), row.search.to_owned());
        assert!(written.contains(&claim), "write docs/hard-cases.md again: it lacks {claim:?}");
    }
    rows
}

/// Checks that a theme has these cases.
#[track_caller]
fn has(rows: &[Row], cases: &[&str]) {
    for case in cases {
        assert!(rows.iter().any(|row| row.case.contains(case)), "no case `{case}`");
    }
}
