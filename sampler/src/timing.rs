//! Stage times of several submissions as one table.

use std::time::Instant;

use argus_scene::Stage;

/// Adds rows to a table; those of the same name are summed.
pub(crate) fn add(table: &mut Vec<Stage>, rows: Vec<Stage>) {
    for row in rows {
        match table.iter_mut().find(|stage| stage.name == row.name) {
            Some(stage) => stage.ms += row.ms,
            None => table.push(row),
        }
    }
}

/// Adds what passed since `begin` as a row.
pub(crate) fn add_since(table: &mut Vec<Stage>, name: &str, begin: Instant) {
    add(table, vec![Stage::new(name, begin.elapsed().as_secs_f64() * 1e3)]);
}

/// Adds what passed since `begin` beyond the rows of the table: submission, copies, and what a driver's
/// timestamps leave out, as the software driver's do of compute passes that follow one another.
pub(crate) fn add_rest(table: &mut Vec<Stage>, begin: Instant) {
    let rows: f64 = table.iter().map(|stage| stage.ms).sum();
    let rest = begin.elapsed().as_secs_f64() * 1e3 - rows;
    if rest > 0.0 {
        table.push(Stage::new("other", rest));
    }
}
