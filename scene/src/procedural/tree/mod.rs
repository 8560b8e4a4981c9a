//! The highly tessellated tree: a skeleton of branches, with bark and leaves.

mod bark;
mod leaves;
mod skeleton;

pub(super) use bark::mesh as bark_mesh;
pub(super) use leaves::{Leaves, mesh as leaf_mesh};
pub(super) use skeleton::{Branch, grow};
