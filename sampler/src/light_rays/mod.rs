//! Scattered rays for light on the CPU: shadow rays, sky rays and bounces.
//!
//! [`LightRays`] holds the trees of [`crate::bvh`] with eight children a node and up to eight triangles a leaf. One ray is
//! tested against eight boxes at once, then against eight triangles. Rays may start anywhere and share nothing, so each
//! is traced alone; many threads may trace at once. Everything is f32, about the eye for placed objects and about the
//! object's own origin for triangles; [`crate::packets`] has an f64 tracer of single rays.
//!
//! The traversal is compiled twice, with and without AVX2. Both give the same bits on every machine: multiplications and
//! additions are never fused.

pub(crate) mod device;
mod rays;
#[cfg(test)]
mod tests;
mod trace;
mod tree;
mod triangles;
mod walk;

pub(crate) use rays::{LightRays, LightRaysAbout, has_avx2};
pub(crate) use tree::CullMode;
pub(crate) use triangles::RayHit;
