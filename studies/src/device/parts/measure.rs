//! The rows.

use serde_json::{Map, Value, json};

use crate::device::targets;
use crate::report;

/// One row. `figure` is `None` if it could not be measured; `note` then gives the reason.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Measure {
    pub(super) measure: String,
    pub(super) variant: String,
    pub(super) figure: Option<f64>,
    pub(super) unit: &'static str,
    pub(super) note: String,
}

impl Measure {
    pub(super) fn new(
        measure: impl Into<String>,
        variant: impl Into<String>,
        figure: f64,
        unit: &'static str,
    ) -> Self {
        let figure = figure.is_finite().then_some(figure);
        Self { measure: measure.into(), variant: variant.into(), figure, unit, note: String::new() }
    }

    /// A figure that could not be measured, with the reason.
    pub(super) fn absent(
        measure: impl Into<String>,
        variant: impl Into<String>,
        unit: &'static str,
        why: String,
    ) -> Self {
        Self { note: why, ..Self::new(measure, variant, f64::NAN, unit) }
    }

    pub(super) fn noting(self, note: impl Into<String>) -> Self {
        Self { note: note.into(), ..self }
    }

    pub(super) fn row(&self) -> Map<String, Value> {
        let mut row = report::row(json!({
            "measure": self.measure, "variant": self.variant, "figure": self.figure, "unit": self.unit,
            "target": null, "ratio": null, "note": self.note,
        }));
        if let Some(target) = targets::of("parts", &row) {
            row.insert("target".to_owned(), json!(target.bound.text()));
            let ratio = self.figure.and_then(|figure| target.bound.ratio(figure));
            row.insert("ratio".to_owned(), json!(ratio));
        }
        row
    }
}
