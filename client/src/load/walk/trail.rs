//! A smooth line through the corners of a way, walked at a steady speed.

use glam::DVec3;

use super::explore::corner;

/// Points of each rounded corner.
const POINTS: u32 = 12;

/// A line of many points, with the length walked at each.
#[derive(Debug, Clone)]
pub(super) struct Trail {
    points: Vec<DVec3>,
    walked: Vec<f64>,
}

impl Trail {
    /// The line through the middles of all steps, with rounded corners.
    pub(super) fn new(corners: &[DVec3]) -> Self {
        let mut points: Vec<DVec3> = corners.first().copied().into_iter().collect();
        for step in corners.windows(3) {
            let (from, onto) = (step[0].midpoint(step[1]), step[1].midpoint(step[2]));
            let rounded = (0..=POINTS).map(|i| corner(from, step[1], onto, f64::from(i) / f64::from(POINTS)));
            points.extend(rounded);
        }
        let mut walked = vec![0.0];
        for pair in points.windows(2) {
            walked.push(walked[walked.len() - 1] + (pair[1] - pair[0]).length());
        }
        Self { points, walked }
    }

    /// Its length in metres.
    pub(super) fn length(&self) -> f64 {
        self.walked.last().copied().unwrap_or_default()
    }

    /// The point after a length; behind its end the line leads back, and so on.
    pub(super) fn at(&self, length: f64) -> DVec3 {
        let whole = self.length();
        if !(whole > 0.0) {
            return self.points[0];
        }
        let there = length.rem_euclid(2.0 * whole);
        let length = if there > whole { 2.0 * whole - there } else { there };
        let next = self.walked.partition_point(|walked| *walked < length).clamp(1, self.points.len() - 1);
        let [a, b] = [self.walked[next - 1], self.walked[next]];
        let share = if b > a { ((length - a) / (b - a)).clamp(0.0, 1.0) } else { 0.0 };
        self.points[next - 1].lerp(self.points[next], share)
    }
}
