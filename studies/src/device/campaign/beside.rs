//! Compares the rows of one study from two campaigns, side by side.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde_json::{Map, Value};

use crate::device::targets::text;
use crate::report::shown;

/// A row of a study.
pub(super) type Row = Map<String, Value>;

/// Whether a smaller or a larger figure is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Better {
    Less,
    More,
}

/// A Markdown table: a row's keys, then each figure as `here / beside (how many times better here)`. A row that only one
/// campaign has stands alone.
pub(super) fn table(keys: &[&str], here: &[Row], other: &[Row]) -> String {
    let keys: Vec<&str> =
        keys.iter().copied().filter(|key| here.iter().any(|row| row.contains_key(*key))).collect();
    let figures = figures(here);
    let mut others: BTreeMap<Vec<String>, Vec<&Row>> = BTreeMap::new();
    for row in other.iter().rev() {
        others.entry(named(&keys, row)).or_default().push(row);
    }
    let mut table = String::new();
    let heads = keys.iter().copied().chain(figures.iter().map(String::as_str));
    let _ = writeln!(table, "| {} |", heads.clone().collect::<Vec<_>>().join(" | "));
    let _ = writeln!(table, "|{}", heads.map(|_| "---|").collect::<String>());
    for row in here {
        let name = named(&keys, row);
        let beside = others.get_mut(&name).and_then(Vec::pop);
        let cells = figures.iter().map(|figure| pair(figure, row, beside));
        let _ = writeln!(table, "| {} |", name.into_iter().chain(cells).collect::<Vec<_>>().join(" | "));
    }
    for (name, rows) in others {
        for row in rows.into_iter().rev() {
            let cells = figures.iter().map(|figure| format!("– / {}", of(row, figure)));
            let name = name.iter().cloned();
            let _ = writeln!(table, "| {} |", name.chain(cells).collect::<Vec<_>>().join(" | "));
        }
    }
    table
}

/// A row's key values, as text.
fn named(keys: &[&str], row: &Row) -> Vec<String> {
    keys.iter()
        .map(|key| row.get(*key).filter(|value| !value.is_null()).map(text).unwrap_or_default())
        .collect()
}

/// Columns that can be compared, in their order: times, rates, errors, and `figure`, whose row names its unit.
fn figures(rows: &[Row]) -> Vec<String> {
    let first = rows.first().into_iter().flat_map(|row| row.keys());
    first.filter(|key| better(key, "").is_some()).cloned().collect()
}

/// Whether less or more is better in a column; `None` if it cannot be compared.
fn better(column: &str, unit: &str) -> Option<Better> {
    let ends = |ends: &[&str]| ends.iter().any(|end| column.ends_with(end));
    match column {
        "figure" if unit.ends_with("/s") => Some(Better::More),
        "figure" | "flip" => Some(Better::Less),
        _ if ends(&["_per_sec"]) => Some(Better::More),
        _ if ends(&["_ms", "_secs"]) && column != "stages_ms" => Some(Better::Less),
        _ => None,
    }
}

fn of(row: &Row, column: &str) -> String {
    row.get(column).map_or_else(|| "–".to_owned(), shown)
}

fn pair(column: &str, here: &Row, other: Option<&Row>) -> String {
    let Some(other) = other else { return format!("{} / –", of(here, column)) };
    let unit = here.get("unit").map(text).unwrap_or_default();
    let number = |row: &Row| row.get(column)?.as_f64().filter(|value| *value > 0.0);
    let times = match (number(here), number(other), better(column, &unit)) {
        (Some(a), Some(b), Some(Better::Less)) => format!(" ({:.2}×)", b / a),
        (Some(a), Some(b), Some(Better::More)) => format!(" ({:.2}×)", a / b),
        _ => String::new(),
    };
    format!("{} / {}{times}", of(here, column), of(other, column))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::report::row;

    #[test]
    fn rows_match_by_key_in_any_order_and_repeated_keys_in_turn() {
        let of = |way: &str, ms: f64, rate: f64| {
            row(json!({"way": way, "n": 3, "view_ms": ms, "views_per_sec": rate}))
        };
        let here = vec![of("a", 1.0, 10.0), of("b", 2.0, 20.0), of("b", 4.0, 5.0), of("c", 1.0, 1.0)];
        let other = vec![of("b", 1.0, 40.0), of("b", 8.0, 5.0), of("a", 3.0, 5.0), of("d", 7.0, 1.0)];
        let table = table(&["way", "missing"], &here, &other);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "| way | view_ms | views_per_sec |");
        assert_eq!(lines[2], "| a | 1.0000 / 3.0000 (3.00×) | 10.0000 / 5.0000 (2.00×) |");
        assert_eq!(lines[3], "| b | 2.0000 / 1.0000 (0.50×) | 20.0000 / 40.0000 (0.50×) |");
        assert_eq!(lines[4], "| b | 4.0000 / 8.0000 (2.00×) | 5.0000 / 5.0000 (1.00×) |");
        assert_eq!(lines[5], "| c | 1.0000 / – | 1.0000 / – |");
        assert_eq!(lines[6], "| d | – / 7.0000 | – / 1.0000 |");
        assert_eq!(lines.len(), 7);
    }

    #[test]
    fn the_unit_decides_whether_more_is_better_and_a_missing_figure_has_no_ratio() {
        let of = |figure: Option<f64>, unit: &str| row(json!({"figure": figure, "unit": unit}));
        assert!(pair("figure", &of(Some(2.0), "G/s"), Some(&of(Some(1.0), "G/s"))).ends_with("(2.00×)"));
        assert!(pair("figure", &of(Some(2.0), "µs"), Some(&of(Some(1.0), "µs"))).ends_with("(0.50×)"));
        assert_eq!(pair("figure", &of(None, "µs"), Some(&of(Some(1.0), "µs"))), "– / 1.0000");
    }

    #[test]
    fn a_study_without_rows_makes_an_empty_table() {
        assert_eq!(table(&["a"], &[], &[]).lines().count(), 2);
    }
}
