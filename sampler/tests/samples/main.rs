//! What the sampler renders, against what it should.

mod common;

mod against_reference;
mod cell_hard_cases;
mod cells;
mod detail;
mod device_light;
mod environment;
mod even_cells;
mod faces;
mod hard_cases;
mod kept_faces;
mod lenses;
mod light;
mod motion;
mod moved_nodes;
mod movers;
mod moving;
mod outputs;
mod paths;
mod plug;
mod reflecting;
mod reflections;
mod rooms;
mod sight;
mod slices;
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
