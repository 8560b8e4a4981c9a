//! The CPU ray tracer: the reference for every image.
//!
//! [`Tracer`] finds the nearest surface along a ray with f64 intersections, reads its textures by the rule of
//! [`crate::texture`], and shades it with [`crate::shading`]. The definitions are the GPU's, the code is separate, and
//! the precision shows the GPU's rounding. Only the paths of indirect light ([`Indirect`]) use random numbers, which
//! follow from pixel and path. An image depends only on the scene, the camera, the size, and the numbers of samples
//! per pixel and of paths.
//!
//! Its exactness:
//! - Boxes of the hierarchies are f32 about their own centre and padded by more than the rounding of a traversal
//!   (`boxes`), so that no surface is culled even at 10⁶ m. Every triangle in a visited box is intersected in f64, in
//!   mesh space (`triangle`).
//! - The triangle test is watertight between triangles of an instance that share vertices. Between instances it is
//!   exact to rounding, about 10⁻¹⁶ of the distance.
//! - Of surfaces at equal range the lowest (instance, triangle) is seen, for any hierarchy.
//!
//! Not seen: triangles without area, triangles with a corner that is not finite, and instances whose transform has no
//! inverse or that reach beyond 10¹⁵⁰ m. A ray that is not finite or has no direction meets nothing.

mod boxes;
pub mod cache;
mod corners;
mod image;
mod indirect;
mod light;
mod placed;
mod reflection;
mod search;
mod sight;
mod surface;
mod tracer;
mod triangle;

pub use self::image::{ReferenceImage, SurfaceImage};
pub use indirect::Indirect;
pub use search::{Hit, Seen};
pub use sight::SceneSight;
pub use tracer::{DirectLight, Reflecting, Tracer};

/// Version of the tracer's images. Raise it when the same scene and camera give another image: stored images of an
/// older version are not used.
pub const REFERENCE_VERSION: u32 = 4;
