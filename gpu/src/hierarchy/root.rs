//! The cube that an octree divides, and the triangles in it.

use argus_scene::Bounds;
use glam::{DVec3, Vec3};

/// The root of an octree. Coordinates on the GPU are in its edges, 0..1, combined in f64 first: what is far from the
/// world's zero loses nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RootCube {
    /// Its corner of least coordinates, world space, metres.
    pub origin: DVec3,
    /// Length of an edge, metres.
    pub edge: f64,
}

/// A triangle for the hierarchy: world space, metres, and its linear reflectance, 0..1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// World space, metres.
    pub corners: [DVec3; 3],
    /// Linear reflectance.
    pub color: Vec3,
}

impl RootCube {
    /// The cube about the middle of some bounds that is a thousandth larger than they are; of an edge of 1 m about a
    /// single point.
    pub fn around(bounds: &Bounds) -> Self {
        let size = bounds.size().max_element();
        let edge = if size > 0.0 { size * (1.0 + 1.0 / 1024.0) } else { 1.0 };
        Self { origin: bounds.center() - DVec3::splat(0.5 * edge), edge }
    }

    /// A position in edges of the cube from its origin.
    pub fn unit_from_world(&self, position: DVec3) -> DVec3 {
        (position - self.origin) / self.edge
    }

    /// The way back.
    pub fn world_from_unit(&self, position: DVec3) -> DVec3 {
        self.origin + position * self.edge
    }
}

impl Triangle {
    /// Whether it has an area and every corner is finite; what has not is no surface.
    pub fn is_surface(&self) -> bool {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a);
        normal.is_finite() && normal != DVec3::ZERO
    }
}
