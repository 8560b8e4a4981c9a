//! What the sampler renders, against what it should.

mod common;

mod against_reference;
mod cells;
mod detail;
mod environment;
mod faces;
mod hard_cases;
mod light;
mod motion;
mod moving;
mod paths;
mod plug;
mod reflecting;
mod reflections;
mod rooms;
mod sight;
mod small_scene;
mod texels;
mod textures;
mod transparency;
mod visibility;

use argus_sampler::plug::Methods;

/// The methods of samplers in these tests, beside their own: none.
fn methods() -> Methods {
    Methods::default()
}
