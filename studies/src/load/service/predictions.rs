//! How well the planner predicts the time of frames.

use argus_scene::Frame;

/// A prediction is close if it differs by at most this share of the predicted time,
const SHARE: f64 = 0.3;
/// or by at most this many milliseconds.
const MS: f64 = 5.0;

/// Counts of frames with a predicted time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Timed {
    predicted: u64,
    close: u64,
}

impl Timed {
    /// Counts a frame. Frames with a named plan or an unknown cost have no prediction.
    pub(super) fn take(&mut self, frame: &Frame) {
        let Some(decision) = frame.decision.filter(|decision| decision.render_ms > 0.0) else { return };
        self.predicted += 1;
        self.close += u64::from(is_close(decision.wait_ms + decision.render_ms, took_ms(frame)));
    }

    /// Share of predicted frames whose prediction was close.
    pub(super) fn share(&self) -> Option<f64> {
        (self.predicted > 0).then(|| self.close as f64 / self.predicted as f64)
    }
}

/// Milliseconds that a view waited for its worker's render thread and was rendered.
pub(super) fn took_ms(frame: &Frame) -> f64 {
    let queued = frame.stages.iter().filter(|stage| stage.name == "queue").map(|stage| stage.ms);
    queued.sum::<f64>() + frame.rendering_ms()
}

fn is_close(predicted_ms: f64, measured_ms: f64) -> bool {
    (measured_ms - predicted_ms).abs() <= (SHARE * predicted_ms).max(MS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prediction_is_close_within_thirty_per_cent_or_five_milliseconds() {
        assert!(is_close(1.0, 5.9) && !is_close(1.0, 6.1));
        assert!(is_close(100.0, 71.0) && is_close(100.0, 129.0) && !is_close(100.0, 131.0));
        assert!(!is_close(10.0, f64::NAN));
        assert_eq!(Timed::default().share(), None);
    }
}
