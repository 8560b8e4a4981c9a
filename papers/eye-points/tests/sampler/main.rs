//! Reflections that a sampler finds by points.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

#[path = "../../../../sampler/tests/samples/common/mod.rs"]
mod common;
#[path = "../../../../sampler/tests/samples/reflecting.rs"]
mod reflecting;
mod reflections;
#[path = "../../../../sampler/tests/samples/rooms.rs"]
mod rooms;

use argus_sampler::plug::Methods;

/// The methods of samplers in these tests.
fn methods() -> Methods {
    let mut methods = Methods::default();
    argus_megaviews::add_to(&mut methods);
    argus_eye_points::add_to(&mut methods);
    methods
}
