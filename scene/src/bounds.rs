//! Axis-aligned boxes.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// An axis-aligned box; empty while `min > max`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Smallest coordinates, metres.
    pub min: DVec3,
    /// Largest coordinates, metres.
    pub max: DVec3,
}

impl Bounds {
    /// The empty box.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// Grows to hold `point`; a point that is not finite is ignored.
    pub fn extend(&mut self, point: DVec3) {
        if point.is_finite() {
            self.min = self.min.min(point);
            self.max = self.max.max(point);
        }
    }

    /// Whether it is empty.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Its middle; the origin if empty.
    pub fn center(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.min + (self.max - self.min) * 0.5 }
    }

    /// Its edge lengths; zero if empty.
    pub fn size(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.max - self.min }
    }

    /// The smallest box that holds both.
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// What is in both; empty if they do not meet.
    pub fn intersection(&self, other: &Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    /// Whether `point` lies inside or on its surface.
    pub fn contains(&self, point: DVec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }
}
