//! What the sampler renders, against what it should.

mod common;

mod against_reference;
mod cells;
mod detail;
mod environment;
mod faces;
mod hard_cases;
mod indirect;
mod light;
mod megaviews;
mod motion;
mod paths;
mod points;
mod reflections;
mod rooms;
mod sight;
mod small_scene;
mod texels;
mod textures;
mod transparency;
mod visibility;
