//! Stage times of several submissions in one table.

use std::time::Instant;

use argus_scene::Stage;

/// Adds rows to a table. Rows of one name are summed.
pub fn add(table: &mut Vec<Stage>, rows: Vec<Stage>) {
    for row in rows {
        match table.iter_mut().find(|stage| stage.name == row.name) {
            Some(stage) => stage.ms += row.ms,
            None => table.push(row),
        }
    }
}

/// Adds the time since `begin` as a row.
pub fn add_since(table: &mut Vec<Stage>, name: &str, begin: Instant) {
    add(table, vec![Stage::new(name, begin.elapsed().as_secs_f64() * 1e3)]);
}

/// Adds rows, and the time since `begin` that none of them accounts for as a row before them.
pub(crate) fn add_with_rest(table: &mut Vec<Stage>, name: &str, begin: Instant, rows: Vec<Stage>) {
    let rest = begin.elapsed().as_secs_f64() * 1e3 - rows.iter().map(|row| row.ms).sum::<f64>();
    add(table, vec![Stage::new(name, rest.max(0.0))]);
    add(table, rows);
}

/// Adds the time since `begin` that no row accounts for as the row "other": submission, copies, and gaps between
/// timestamps, which the software driver has between consecutive compute passes.
pub fn add_rest(table: &mut Vec<Stage>, begin: Instant) {
    let rows: f64 = table.iter().map(|stage| stage.ms).sum();
    let rest = begin.elapsed().as_secs_f64() * 1e3 - rows;
    if rest > 0.0 {
        table.push(Stage::new("other", rest));
    }
}
