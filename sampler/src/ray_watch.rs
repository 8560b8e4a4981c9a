//! Whoever wants to know where rays went.

use glam::Vec3;

/// Is told of rays. Threads share it.
pub(crate) trait RayWatch: Sync {
    /// A ray looked from `start`, which is relative to the eye, as far as `most`, in units of its direction.
    fn cast(&self, start: Vec3, direction: Vec3, most: f32);
}
