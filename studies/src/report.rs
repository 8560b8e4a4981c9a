//! What an experiment found, in the three forms that people and scripts read.

use std::fmt::Write as _;
use std::path::Path;
use std::{fs, io};

use serde::Serialize;
use serde_json::{Map, Value};

/// Where the figures were taken: they mean little without it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// GPU adapter and driver.
    pub gpu: String,
    /// `LP_NUM_THREADS`: threads of the software driver, empty where it is left to choose.
    pub driver_threads: String,
    /// Whether the program was built with optimisation for release.
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

/// The outcome of a study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Scene, or scenes separated by spaces.
    pub scene: String,
    /// Where it was measured.
    pub machine: Machine,
    /// One object a table row, all with the same keys in the same order.
    pub rows: Vec<Map<String, Value>>,
}

impl Report {
    /// The rows as a Markdown table.
    pub fn markdown(&self) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let mut table = String::new();
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        table += &line(first.keys().cloned().collect());
        table += &line(first.keys().map(|_| "---".to_owned()).collect());
        for row in &self.rows {
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

    /// Writes `NAME.md`, `NAME.csv` and `NAME.json` into a folder, which is made if need be.
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub fn write(&self, folder: &Path, name: &str) -> io::Result<()> {
        fs::create_dir_all(folder)?;
        let path = |extension| folder.join(format!("{name}.{extension}"));
        fs::write(path("md"), self.markdown())?;
        fs::write(path("csv"), self.csv())?;
        fs::write(path("json"), serde_json::to_string_pretty(self)?)
    }
}

/// A value with the digits that a reader needs.
fn shown(value: &Value) -> String {
    match value {
        Value::Number(n) if n.is_f64() => {
            let x = n.as_f64().unwrap_or(f64::NAN);
            if x.abs() >= 100.0 { format!("{x:.0}") } else { format!("{x:.4}") }
        }
        Value::Null => "–".to_owned(),
        Value::String(s) => s.clone(),
        other => other.to_string(),
    }
}

/// A value as CSV has it.
fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(s) if s.contains([',', '"', '\n']) => format!("\"{}\"", s.replace('"', "\"\"")),
        Value::String(s) => s.clone(),
        other => other.to_string(),
    }
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
        let report = Report { scene: "s".to_owned(), machine: Machine::here("none"), rows };
        assert_eq!(report.markdown().lines().count(), 4);
        assert_eq!(report.csv(), "name,ms\n\"a,b\",1.25\nc,\n");
    }
}
