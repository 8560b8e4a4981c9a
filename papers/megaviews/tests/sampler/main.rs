//! Samples and reflection probes that a sampler renders from an octree.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod cells;
#[path = "../../../../sampler/tests/samples/common/mod.rs"]
mod common;
mod motion;
#[path = "../../../../sampler/tests/samples/moving.rs"]
mod moving;
mod probes;
#[path = "../../../../sampler/tests/samples/reflecting.rs"]
mod reflecting;
#[path = "../../../../sampler/tests/samples/rooms.rs"]
mod rooms;
mod samples;

use argus_sampler::plug::Methods;

/// The methods of samplers in these tests.
fn methods() -> Methods {
    let mut methods = Methods::default();
    argus_megaviews::add_to(&mut methods);
    argus_virtual_lights::add_to(&mut methods);
    methods
}
