//! Direct views against the CPU reference, over the same scenes.

mod common;

use std::sync::Arc;

use argus_scene::procedural::terrain;
use common::*;

/// What the issue promises of 16 samples a pixel.
const MAX_FLIP: f64 = 0.01;

#[test]
fn terrain_is_as_the_reference_has_it() {
    let scene = Arc::new(terrain(50_000));
    let mut sampler = sampler(&scene);
    for named in &scene.cameras {
        let size = [200, 150];
        let frame = direct(&mut sampler, &view_job(named.camera, size, 16));
        let truth = reference(&scene, &named.camera, size, 16);
        let flip = flip(
            &format!("terrain-{}", named.name),
            &image_of(&frame),
            &truth.display(scene.lighting.exposure),
        );
        println!("{}: FLIP {flip:.5} {:?}", named.name, frame.stages);
        assert!(flip <= MAX_FLIP, "{}: FLIP {flip}", named.name);
    }
}
