//! Performance targets on a data-centre GPU of the H100's class, as data.

use serde_json::{Map, Value};

/// A target's limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bound {
    /// An upper limit, for times.
    AtMost(f64),
    /// A lower limit, for rates.
    AtLeast(f64),
}

impl Bound {
    /// How many times over a figure meets the target; 1 or more meets it. `None` if the figure is not
    /// positive and finite.
    pub fn ratio(self, figure: f64) -> Option<f64> {
        if !(figure > 0.0 && figure.is_finite()) {
            return None;
        }
        Some(match self {
            Self::AtMost(most) => most / figure,
            Self::AtLeast(least) => figure / least,
        })
    }

    /// The target's number.
    pub fn value(self) -> f64 {
        match self {
            Self::AtMost(value) | Self::AtLeast(value) => value,
        }
    }

    /// The limit as text: `≤ 10` or `≥ 1000`.
    pub fn text(self) -> String {
        match self {
            Self::AtMost(most) => format!("≤ {most}"),
            Self::AtLeast(least) => format!("≥ {least}"),
        }
    }
}

/// A target, and the row of a study that it judges.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// The target in words.
    pub claim: &'static str,
    /// The study with the figure.
    pub study: &'static str,
    /// Columns and values that select the row, as text. The best of several such rows counts.
    pub row: &'static [(&'static str, &'static str)],
    /// The figure's column.
    pub figure: &'static str,
    /// The figure's limit.
    pub bound: Bound,
    /// The figure's unit.
    pub unit: &'static str,
    /// Columns shown beside the figure, which it means little without.
    pub beside: &'static [&'static str],
}

/// Measure and variant of the rows of `argus-lab study device parts` with a target.
pub(crate) const WARP: [&str; 2] = ["warp, splat", "best program, 200x150, 64 views"];
/// Measure and variant, like [`WARP`].
pub(crate) const SEEN: [&str; 2] = ["triangles seen, 500000", "best backend, 200x150"];
/// Measure and variant, like [`WARP`].
pub(crate) const SCATTERED_RAYS: [&str; 2] = ["scattered rays", "on the device"];

/// All targets.
pub const TARGETS: [Target; 5] = [
    Target {
        claim: "1M maps of 16² at 11 levels",
        study: "megaviews",
        row: &[
            ("method", "megaviews"),
            ("views", "1048576"),
            ("resolution", "16"),
            ("levels", "10"),
            ("extrapolated", "false"),
        ],
        figure: "frame_ms",
        bound: Bound::AtMost(10.0),
        unit: "ms",
        beside: &["maps", "wrong_shadow_fraction"],
    },
    Target {
        claim: "views of 128² of one scene, on the device",
        study: "throughput",
        row: &[("size", "128x128")],
        figure: "device_views_per_sec",
        bound: Bound::AtLeast(200_000.0),
        unit: "views/s",
        beside: &["flip"],
    },
    Target {
        claim: "a warp of 200×150 in a batch of 64",
        study: "parts",
        row: &[("measure", WARP[0]), ("variant", WARP[1])],
        figure: "figure",
        bound: Bound::AtMost(15.0),
        unit: "µs",
        beside: &["note"],
    },
    Target {
        claim: "500k triangles seen by the best backend",
        study: "parts",
        row: &[("measure", SEEN[0]), ("variant", SEEN[1])],
        figure: "figure",
        bound: Bound::AtMost(100.0),
        unit: "µs",
        beside: &["note"],
    },
    Target {
        claim: "incoherent rays",
        study: "parts",
        row: &[("measure", SCATTERED_RAYS[0]), ("variant", SCATTERED_RAYS[1])],
        figure: "figure",
        bound: Bound::AtLeast(1000.0),
        unit: "M/s",
        beside: &["note"],
    },
];

impl Target {
    /// Whether the target selects a row.
    pub fn is_about(&self, row: &Map<String, Value>) -> bool {
        self.row.iter().all(|(key, value)| row.get(*key).is_some_and(|found| text(found) == *value))
    }

    /// The row with the best figure that the target selects, and that figure.
    pub fn best<'a>(&self, rows: &'a [Map<String, Value>]) -> Option<(&'a Map<String, Value>, f64)> {
        let rows = rows.iter().filter(|row| self.is_about(row));
        let figures = rows.filter_map(|row| Some((row, row.get(self.figure)?.as_f64()?)));
        figures.filter(|(_, figure)| self.bound.ratio(*figure).is_some()).max_by(|(_, a), (_, b)| {
            let ratio = |figure| self.bound.ratio(figure).unwrap_or(0.0);
            ratio(*a).total_cmp(&ratio(*b))
        })
    }
}

/// The target that selects a row of a study, if any.
pub fn of(study: &str, row: &Map<String, Value>) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.study == study && target.is_about(row))
}

/// A value as text for comparison; strings without quotation marks.
pub(crate) fn text(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::report::row;

    #[test]
    fn a_met_target_has_a_ratio_of_at_least_one() {
        assert_eq!(Bound::AtMost(10.0).ratio(5.0), Some(2.0));
        assert_eq!(Bound::AtMost(10.0).ratio(40.0), Some(0.25));
        assert_eq!(Bound::AtLeast(1000.0).ratio(1000.0), Some(1.0));
        assert_eq!(Bound::AtLeast(1000.0).ratio(100.0), Some(0.1));
        for nothing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(Bound::AtMost(1.0).ratio(nothing), None);
            assert_eq!(Bound::AtLeast(1.0).ratio(nothing), None);
        }
    }

    #[test]
    fn the_best_of_the_selected_rows_counts() {
        let views = |views: u32, ms: f64, extrapolated: bool| {
            row(
                json!({"method": "megaviews", "views": views, "resolution": 16, "levels": 10, "frame_ms": ms, "extrapolated": extrapolated}),
            )
        };
        let rows = [
            views(65_536, 1.0, false),
            views(1 << 20, 12.0, false),
            views(1 << 20, 8.0, false),
            views(1 << 20, 0.5, true),
        ];
        let target = &TARGETS[0];
        assert_eq!(target.best(&rows).map(|(_, figure)| figure), Some(8.0));
        assert_eq!(of("megaviews", &rows[1]).map(|found| found.claim), Some(target.claim));
        assert!(of("megaviews", &rows[0]).is_none() && of("virtual-lights", &rows[1]).is_none());
        assert!(target.best(&rows[..1]).is_none());
        let without = row(json!({"method": "megaviews", "views": 1 << 20, "frame_ms": null}));
        assert!(target.best(&[without]).is_none());
    }
}
