//! The result of a study, as table, CSV and JSON.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use argus_gpu::{Gpu, LONGEST_PASS_MS};
use argus_plot::Plot;
use argus_scene::Stage;
use serde::Serialize;
use serde_json::{Map, Value};

/// The machine that produced the figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// GPU adapter and driver.
    pub gpu: String,
    /// `LP_NUM_THREADS`: threads of the software driver; empty if not set.
    pub driver_threads: String,
    /// Whether the program is a release build.
    pub release_build: bool,
}

impl Machine {
    /// This machine, with the given GPU.
    pub fn here(gpu: &str) -> Self {
        let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = cpuinfo.lines().find_map(|line| line.strip_prefix("model name")?.split(':').nth(1));
        Self {
            cpu: model.unwrap_or(std::env::consts::ARCH).trim().to_owned(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            gpu: gpu.to_owned(),
            driver_threads: std::env::var("LP_NUM_THREADS").unwrap_or_default(),
            release_build: !cfg!(debug_assertions),
        }
    }
}

/// Rows with the columns of all of them, in the order in which they first occur.
fn aligned(rows: Vec<Map<String, Value>>) -> Vec<Map<String, Value>> {
    let mut columns = Map::new();
    for name in rows.iter().flat_map(Map::keys) {
        columns.entry(name.clone()).or_insert(Value::Null);
    }
    let all = |mut row: Map<String, Value>| {
        columns.keys().map(|name| (name.clone(), row.remove(name).unwrap_or_default())).collect()
    };
    rows.into_iter().map(all).collect()
}

/// The result of a study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The scene, or scenes separated by spaces.
    pub scene: String,
    /// The machine it ran on.
    pub machine: Machine,
    /// One object per table row; all have the same keys in the same order.
    pub rows: Vec<Map<String, Value>>,
    /// Sentences about what the table does not show.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Plots of the rows, written as files beside the table.
    #[serde(skip)]
    pub plots: Vec<Plot>,
}

impl Report {
    /// A report without notes or plots. A row without a column that others have is null there.
    pub fn new(scene: impl Into<String>, machine: Machine, rows: Vec<Map<String, Value>>) -> Self {
        Self { scene: scene.into(), machine, rows: aligned(rows), notes: Vec::new(), plots: Vec::new() }
    }

    /// Notes the duration of the longest GPU pass, if the device reports it: drivers end passes that take too long.
    pub(crate) fn note_longest_pass(&mut self, gpu: &Gpu) {
        if let Some(Stage { name, ms }) = gpu.longest_pass() {
            let verdict = if ms <= LONGEST_PASS_MS { "within" } else { "BEYOND" };
            self.notes.push(format!(
                "The longest pass, `{name}`, took {ms:.1} ms: {verdict} the {LONGEST_PASS_MS} ms that every driver allows."
            ));
        }
    }

    /// The rows as a Markdown table, followed by the notes.
    pub fn markdown(&self) -> String {
        let mut table = Self::table(&self.rows);
        if self.rows.is_empty() {
            return table;
        }
        for note in &self.notes {
            let _ = write!(table, "\n{note}\n");
        }
        table
    }

    /// Rows as a Markdown table; empty if there are none.
    pub(crate) fn table(rows: &[Map<String, Value>]) -> String {
        let Some(first) = rows.first() else { return String::new() };
        let mut table = String::new();
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        table += &line(first.keys().cloned().collect());
        table += &line(first.keys().map(|_| "---".to_owned()).collect());
        for row in rows {
            table += &line(row.values().map(shown).collect());
        }
        table
    }

    /// The rows as CSV, at full precision.
    pub fn csv(&self) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let mut csv = first.keys().cloned().collect::<Vec<_>>().join(",") + "\n";
        for row in &self.rows {
            let cells: Vec<String> = row.values().map(cell).collect();
            let _ = writeln!(csv, "{}", cells.join(","));
        }
        csv
    }

    /// Writes `NAME.md`, `NAME.csv`, `NAME.json` and each plot as `NAME-PLOT.svg` into a folder, which is created if
    /// needed. Returns the paths of the files.
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub fn write(&self, folder: &Path, name: &str) -> anyhow::Result<Vec<PathBuf>> {
        fs::create_dir_all(folder)?;
        let mut files = vec![
            (format!("{name}.md"), self.markdown()),
            (format!("{name}.csv"), self.csv()),
            (format!("{name}.json"), serde_json::to_string_pretty(self)?),
        ];
        for plot in &self.plots {
            files.push((format!("{name}-{}.svg", plot.name), plot.svg()?));
        }
        let write = |(file, content): (String, String)| -> anyhow::Result<PathBuf> {
            let path = folder.join(file);
            fs::write(&path, content).with_context(|| format!("cannot write {}", path.display()))?;
            Ok(path)
        };
        files.into_iter().map(write).collect()
    }
}

/// Turns an object literal (`json!({..})`) into a row; any other value gives an empty row.
pub(crate) fn row(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(row) => row,
        _ => Map::new(),
    }
}

/// Formats a value for a table.
pub(crate) fn shown(value: &Value) -> String {
    match value {
        Value::Number(n) if n.is_f64() => {
            let x = n.as_f64().unwrap_or(f64::NAN);
            if x.abs() >= 100.0 { format!("{x:.0}") } else { format!("{x:.4}") }
        }
        Value::Null => "–".to_owned(),
        Value::String(s) => s.clone(),
        Value::Object(parts) if parts.is_empty() => shown(&Value::Null),
        Value::Array(parts) => parts.iter().map(shown).collect::<Vec<_>>().join("…"),
        Value::Object(parts) => {
            let parts = parts.iter().map(|(name, value)| format!("{name} {}", shown(value)));
            parts.collect::<Vec<_>>().join(", ")
        }
        other => other.to_string(),
    }
}

/// Formats a value for CSV. Arrays and objects become a cell of JSON.
fn cell(value: &Value) -> String {
    let text = match value {
        Value::Null => String::new(),
        Value::String(s) => s.clone(),
        other => other.to_string(),
    };
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_have_a_head_and_a_line_per_row() {
        let row = |name: &str, ms: f64| {
            let pairs = [("name".to_owned(), name.into()), ("ms".to_owned(), ms.into())];
            pairs.into_iter().collect::<Map<String, Value>>()
        };
        let rows = vec![row("a,b", 1.25), row("c", f64::NAN)];
        let mut report = Report::new("s", Machine::here("none"), rows);
        assert_eq!(report.markdown().lines().count(), 4);
        let parts = serde_json::json!({"by": {"a": 0.5, "b": 2}, "between": [1.0, 2.0]});
        let of_parts = Report::new("s", Machine::here("none"), vec![super::row(parts)]);
        assert!(
            of_parts.markdown().ends_with("| a 0.5000, b 2 | 1.0000…2.0000 |\n"),
            "{}",
            of_parts.markdown()
        );
        assert_eq!(of_parts.csv(), "by,between\n\"{\"\"a\"\":0.5,\"\"b\"\":2}\",\"[1.0,2.0]\"\n");
        report.notes.push("One was left out.".to_owned());
        assert!(report.markdown().ends_with("|\n\nOne was left out.\n"));
        assert_eq!(report.csv(), "name,ms\n\"a,b\",1.25\nc,\n");
    }

    #[test]
    fn rows_with_different_columns_have_the_columns_of_all() {
        let rows = [serde_json::json!({"a": 1}), serde_json::json!({"b": 3, "a": 2})];
        let report = Report::new("s", Machine::here("none"), rows.map(super::row).to_vec());
        assert_eq!(report.csv(), "a,b\n1,\n2,3\n");
    }
}
