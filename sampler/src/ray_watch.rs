//! An observer of the rays that are cast.

use glam::Vec3;

/// Receives each ray that is cast, from several threads.
pub(crate) trait RayWatch: Sync {
    /// A ray looked from `start`, which is relative to the eye, as far as `most`, in units of its direction.
    fn cast(&self, start: Vec3, direction: Vec3, most: f32);
}
