//! Indirect light by paths between *leaf sides*: the surfaces in a cell of a grid over the scene's extent, as seen from one side.
//!
//! A ray of a leaf side is traced once a pose, and kept as a *link* to the leaf side that it hits. Bounces of light are
//! sums over links, so that new lights and further bounces trace no such ray. Visible surfaces then gather once more, by
//! rays of their own: as final gathering from a photon map does (Jensen, "Global Illumination using Photon Maps", 1996).
//!
//! # Steps
//!
//! 1. [`leaves`], once a pose: the triangles are clipped to cells and divided into leaf sides.
//! 2. [`links`], once a pose: each leaf side casts its rays.
//! 3. Once a lighting: direct light at the points where these rays start, as texels have it; then the bounces, and a mean
//!    over alike neighbours.
//! 4. [`gather`], once a tile: a quarter of the texels cast rays, and surfaces share what they found.
//!
//! A ray that gathers adds what the leaf side at its hit reflects. It adds neither emission nor sky, which are direct light
//! ([`argus_scene::Indirect::effects_with`]); what leaf sides reflect includes both.
//!
//! # What leaks
//!
//! The two faces of a wall are different leaf sides, however thin it is. But a leaf side is lit evenly: where a wall stands
//! on a floor, the floor in the cells under it mixes the light of both rooms, and the mean over neighbours takes it a cell
//! further. Two faces that look the same way in one cell, as shelves above one another, are one leaf side.
//!
//! # Levels
//!
//! Leaf sides are lit at two levels ([`argus_scene::LightLevel`]). While one level is shown, [`super::path_light`] lights the next one
//! in another thread.

mod gather;
mod grid;
mod leaves;
mod links;
mod polygon;

pub(super) use gather::Gatherer;
pub(super) use leaves::{LeafChanges, LeafRead, Leaves, Side};
pub(super) use links::Links;
pub(super) use polygon::Polygon;
