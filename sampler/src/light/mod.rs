//! Light by rays: lights, sky and emitting triangles with what blocks them, and indirect light by paths.
//!
//! Shading leaves a *G-buffer* of the visible surfaces. This stage casts rays from each to the lights, the sky and emitters,
//! and adds what arrives to the surfaces' radiance. The definition is the reference's (`scene/src/reference/light.rs`).
//! Samples, direct views, lists of pixels and leaves of octrees all pass through here.
//!
//! Neighbouring texels cast different rays ([`pattern`]) and share what they found within a surface ([`filter`]), so that
//! few rays a texel suffice. Which rays a texel casts depends on its place in its image alone.
//!
//! # Steps of a tile
//!
//! 1. [`shading_points`]: reads the G-buffer back and finds where rays begin.
//! 2. [`shadows`]: the share of each light that each texel sees.
//! 3. [`sky`] and [`emitters`]: irradiance of the sky, and of emitting triangles.
//! 4. [`paths`]: indirect irradiance, if it is found by paths. Or [`cells`]: that and the sky's, from cells on surfaces.
//! 5. `passes/add_direct.rs`: adds the light, and the reflection of lights and sky on glossy surfaces of views.
//!
//! On a GPU, [`device`] does all of them for images. Then nothing is read back, but which light cells a view lacks. Lists of pixels
//! and points of reflections have no neighbours: they are lit on the CPU.

mod cells;
pub(crate) mod device;
mod direct;
mod emitters;
mod filter;
mod lattice;
mod on_cpu;
mod path_light;
mod paths;
mod pattern;
mod pose;
mod shading_points;
mod shadows;
mod sky;
mod tracing;

#[cfg(feature = "fuzzing")]
pub(crate) use cells::fuzzing;
pub(crate) use cells::{CellUse, SampleOf, Trail as FaceTrail};
pub(crate) use direct::{DirectLight, LightConditions};
pub(crate) use path_light::PathLight;
pub use path_light::PathReport;
pub(crate) use shading_points::{ShadingPoint, of_g_buffer as shading_point};
pub(crate) use tracing::LightTracing;
