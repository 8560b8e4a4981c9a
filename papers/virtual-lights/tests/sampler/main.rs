//! Indirect light that a sampler finds by virtual point lights and by points.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

#[path = "../../../../sampler/tests/samples/common/mod.rs"]
mod common;
mod points;
#[path = "../../../../sampler/tests/samples/rooms.rs"]
mod rooms;
mod vpls;

use argus_sampler::plug::Methods;

/// The methods of samplers in these tests.
fn methods() -> Methods {
    let mut methods = Methods::default();
    argus_megaviews::add_to(&mut methods);
    argus_virtual_lights::add_to(&mut methods);
    methods
}
