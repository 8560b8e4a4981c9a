//! Views: what an image costs each way it can be made, and how far it is from the converged one.

pub mod baseline;
pub mod bounds;
pub mod detail;
pub mod reprojection;
pub mod scenes;
pub mod walk;
pub mod warp;
