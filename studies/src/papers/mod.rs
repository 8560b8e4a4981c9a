//! The papers: their figures and tables, made anew with this implementation.

mod contents;
pub mod eye_points;
pub mod manylods;
pub mod megaviews;
pub mod omni_maps;
pub mod page;
pub mod particles;
pub mod probes;
pub mod virtual_lights;
