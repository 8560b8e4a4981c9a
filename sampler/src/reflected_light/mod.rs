//! Light along reflected rays: what they meet, what that reflects in turn, and so on (Gavane and Watson 2022, section 4.1.4).
//!
//! What a ray meets is shaded without what depends on the viewer. If it is reflective, it sends one ray on: glass a refracted
//! one, anything else a reflected one. So as many points are shaded as rays are cast, and a ray's points are where the ray is in
//! an image, whose neighbours share light.
//!
//! Direct views and reflection probes share it.

mod bounces;
mod mirror;
mod point_method;
mod rays;
mod reflectors;
mod scene;

pub(crate) use self::bounces::{Bounces, Paths, offset_about};
pub use self::mirror::Ray;
pub(crate) use self::mirror::{Mirror, reflected};
pub use self::point_method::{FilledMaps, Met, NewPoints, PointMethod, ViewMaps};
pub use self::rays::{MetByRay, ReflectionRays};
pub(crate) use self::reflectors::Reflectors;
pub(crate) use self::scene::{ReflectedScene, ReflectionSource};
