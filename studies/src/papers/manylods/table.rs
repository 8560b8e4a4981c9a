//! The study's rows; all have the same columns.

use argus_manylods::CutStats;
use serde_json::{Map, Value, json};

use crate::median::{mean, median};
use crate::report;

/// One row; columns that do not apply are `None`.
#[derive(Debug, Clone, Default)]
pub(super) struct Row {
    /// The part of the study: hierarchy, threshold, equal-time or animation.
    pub(super) part: &'static str,
    pub(super) tree: Option<&'static str>,
    pub(super) method: Option<&'static str>,
    pub(super) path: Option<&'static str>,
    pub(super) threshold: Option<f32>,
    pub(super) views: Option<u32>,
    /// Motion per frame, as a share of the scene's extent.
    pub(super) motion: Option<f64>,
    pub(super) points: Option<u32>,
    pub(super) build_ms: Option<f64>,
    pub(super) rebuild_ms: Option<f64>,
    pub(super) update_ms: Option<f64>,
    pub(super) frame_ms: Option<f64>,
    pub(super) cut_ms: Option<f64>,
    pub(super) draw_ms: Option<f64>,
    pub(super) nodes: Option<f64>,
    pub(super) visits: Option<f64>,
    pub(super) splits: Option<f64>,
    pub(super) merges: Option<f64>,
    /// Factors over the basic method: fewer visits, fewer operations, less time.
    pub(super) fewer_visits: Option<f64>,
    pub(super) fewer_operations: Option<f64>,
    pub(super) faster: Option<f64>,
    /// Share of the last cuts' nodes that differ from the basic method's.
    pub(super) differing: Option<f64>,
    pub(super) wrong: Option<f64>,
    pub(super) bytes: Option<u64>,
}

impl Row {
    /// Fills in medians of times and means of counts over frames.
    pub(super) fn of(self, frames: &[CutStats]) -> Self {
        let times = |of: &dyn Fn(&CutStats) -> f64| Some(median(&frames.iter().map(of).collect::<Vec<_>>()));
        let counts = |of: &dyn Fn(&CutStats) -> u64| Some(mean(frames.iter().map(|frame| of(frame) as f64)));
        let all = |frame: &CutStats| frame.stages.iter().map(|stage| stage.ms).sum::<f64>();
        let drawn = frames.iter().any(|frame| frame.nodes > 0);
        Self {
            frame_ms: times(&|frame| frame.frame_ms),
            cut_ms: times(&CutStats::cut_ms),
            draw_ms: if drawn { times(&|frame| all(frame) - frame.cut_ms()) } else { None },
            nodes: if drawn { counts(&|frame| frame.nodes) } else { None },
            visits: counts(&|frame| frame.visits),
            splits: counts(&|frame| frame.splits),
            merges: counts(&|frame| frame.merges),
            bytes: frames.last().map(|frame| frame.cut_bytes + frame.map_bytes),
            ..self
        }
    }

    /// Splits plus merges.
    pub(super) fn operations(&self) -> f64 {
        self.splits.unwrap_or(f64::NAN) + self.merges.unwrap_or(0.0)
    }

    pub(super) fn into_map(self) -> Map<String, Value> {
        report::row(json!({
            "part": self.part,
            "tree": self.tree,
            "method": self.method,
            "path": self.path,
            "threshold": self.threshold,
            "views": self.views,
            "motion": self.motion,
            "points": self.points,
            "build_ms": self.build_ms,
            "rebuild_ms": self.rebuild_ms,
            "update_ms": self.update_ms,
            "frame_ms": self.frame_ms,
            "cut_ms": self.cut_ms,
            "draw_ms": self.draw_ms,
            "nodes": self.nodes,
            "visits": self.visits,
            "splits": self.splits,
            "merges": self.merges,
            "fewer_visits": finite(self.fewer_visits),
            "fewer_operations": finite(self.fewer_operations),
            "faster": finite(self.faster),
            "differing_fraction": self.differing,
            "wrong_shadow_fraction": self.wrong,
            "bytes": self.bytes,
        }))
    }
}

/// Drops infinities, which JSON does not have.
fn finite(x: Option<f64>) -> Option<f64> {
    x.filter(|x| x.is_finite())
}
