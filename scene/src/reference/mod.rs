//! The CPU ray tracer that every image is judged against.
//!
//! [`Tracer`] finds the nearest surface along a ray with f64 intersections, looks its textures up by the rule
//! of [`crate::texture`], and shades it with [`crate::shading`]: the same definitions as the GPU's, in other
//! code, at a precision at which the GPU's roundings show. Nothing is random but the paths of indirect light, which
//! only [`Indirect`] asks for, and their numbers follow from pixel and path: an image depends on the scene, the
//! camera, the size, the number of samples a pixel and of paths alone.
//!
//! How it stays exact:
//! - Boxes of the hierarchies are f32 about their own centre and padded by more than traversal can round
//!   (`boxes`), so that at 10⁶ m no surface is culled; every triangle in a box that is met is intersected in
//!   f64, in mesh space (`triangle`).
//! - The triangle test is watertight between triangles of an instance that share vertices. Between instances
//!   it is exact to rounding, which is some 10⁻¹⁶ of the distance.
//! - Of surfaces at equal range the lowest (instance, triangle) is seen, whatever the hierarchy looks like.
//!
//! What is not seen: triangles without area, triangles with a corner that is not finite, and instances whose
//! transform cannot be inverted or that reach beyond 10¹⁵⁰ m. A ray that is not finite or has no direction meets nothing.

mod boxes;
pub mod cache;
mod image;
mod indirect;
mod reflection;
mod sight;
mod surface;
mod tracer;
mod triangle;

pub use self::image::ReferenceImage;
pub use indirect::Indirect;
pub use reflection::Reflecting;
pub use sight::SceneSight;
pub use tracer::{Hit, Tracer};

/// Changes whenever the same scene and camera would give another image, so that stored images of an older
/// tracer are not taken for this one's.
pub const REFERENCE_VERSION: u32 = 1;
