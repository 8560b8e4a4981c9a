//! Stage times of several submissions as one table.

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
