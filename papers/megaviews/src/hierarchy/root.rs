//! The root cube of an octree, and triangles.

use argus_scene::Bounds;
use glam::{DVec3, Vec3};

/// The root cube of an octree. Coordinates on the GPU are in its edges, 0..1, combined in f64 first, so scenes far from
/// the origin lose no precision.
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
    /// The cube around bounds, larger by a thousandth. Its edge is 1 m for a single point.
    pub fn around(bounds: &Bounds) -> Self {
        let size = bounds.size().max_element();
        let edge = if size > 0.0 { size * (1.0 + 1.0 / 1024.0) } else { 1.0 };
        Self { origin: bounds.center() - DVec3::splat(0.5 * edge), edge }
    }

    /// A position in edges of the cube from its origin.
    pub fn unit_from_world(&self, position: DVec3) -> DVec3 {
        (position - self.origin) / self.edge
    }

    /// A world position from edges of the cube.
    pub fn world_from_unit(&self, position: DVec3) -> DVec3 {
        self.origin + position * self.edge
    }
}

impl Triangle {
    /// Whether it has an area and finite corners. Other triangles are ignored.
    pub fn is_surface(&self) -> bool {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a);
        normal.is_finite() && normal != DVec3::ZERO
    }
}
