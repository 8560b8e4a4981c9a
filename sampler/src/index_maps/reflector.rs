//! Reflective objects with a map.

use glam::DVec3;

/// An object that reflects the scene in a map around its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MappedReflector {
    /// Index into [`argus_scene::Scene::instances`].
    pub instance: u32,
    /// Where its map is seen from, metres, world space: the middle of its bounds, or the eye's mirror image.
    pub center: DVec3,
    /// Distance of its farthest vertex from the middle, metres.
    pub radius: f64,
    /// A low percentile of its surface's curvature, 1/metres; 0 for a planar or a hollow one.
    pub curvature: f64,
    /// Texels on an edge of each of its map's six faces.
    pub side: u32,
    /// What the map sees, if that is only what lies in front of a planar mirror.
    pub front: Option<HalfSpace>,
}

impl MappedReflector {
    /// Distance from the map's middle at which it begins to see along a unit direction, metres; `None` if it sees nothing
    /// there.
    pub fn begin(&self, direction: DVec3) -> Option<f64> {
        let Some(front) = self.front else { return Some(0.0) };
        let begin = (front.point - self.center).dot(front.normal) / direction.dot(front.normal);
        (begin >= 0.0 && begin.is_finite()).then_some(begin)
    }
}

/// A half-space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// A point of its border, metres, world space.
    pub point: DVec3,
    /// Unit normal of the border, into the half-space.
    pub normal: DVec3,
}

impl HalfSpace {
    /// Whether a point lies within.
    #[inline]
    pub fn contains(&self, point: DVec3) -> bool {
        (point - self.point).dot(self.normal) > 0.0
    }

    /// The mirror image of a point.
    pub fn mirrored(&self, point: DVec3) -> DVec3 {
        point - self.normal * (2.0 * (point - self.point).dot(self.normal))
    }
}
