//! A batch, its single views and their replays have equal bytes.

use crate::short_forms::{number, rows};
use crate::support::json;

/// Frames of the study: `ARGUS_REPEATS`, or few.
fn frames() -> String {
    std::env::var("ARGUS_REPEATS").unwrap_or_else(|_| "12".to_owned())
}

#[test]
fn batches_single_views_and_replays_are_equal_while_workers_are_killed() {
    let study = json(&["study", "load", "repeats", "--quick", "--json", "--frames", &frames()]);
    let rows = rows(&study);
    assert_eq!(rows.len(), 6, "from triangles, samples and frames, by rays and by cells: {study:#}");
    let all: f64 = rows.iter().map(|row| number(row, "first")).sum();
    for row in rows {
        assert_eq!((number(row, "singles_differ"), number(row, "replays_differ")), (0.0, 0.0), "{row:#}");
        assert_eq!(row["passed"], true, "{study:#}");
        assert!(number(row, "first") >= all / 10.0, "a fifth each of both lights: {row:#}");
    }
}
