//! Direct views against the CPU reference, over the same scenes.

use std::io::Write;
use std::sync::Arc;

use argus_scene::procedural::terrain;
use argus_scene::{Camera, Scene};
use glam::DVec3;

use crate::common::*;

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

/// A scene file below `ARGUS_SCENES`, or `None` with a loud line where that is unset.
pub(crate) fn real_scene(path: &str) -> Option<Arc<Scene>> {
    let Some(folder) = std::env::var_os("ARGUS_SCENES") else {
        assert!(std::env::var_os("ARGUS_REQUIRE_SCENES").is_none(), "ARGUS_SCENES is not set");
        // What print macros say in a test that passes is shown to nobody.
        let _ = writeln!(std::io::stderr(), "SKIPPED, LOUDLY: ARGUS_SCENES is not set");
        return None;
    };
    let path = std::path::Path::new(&folder).join(path);
    Some(Arc::new(argus_scene::open(&path.to_string_lossy()).expect("a scene that is known to load")))
}

#[test]
fn sponza_is_as_the_reference_has_it() {
    let Some(scene) = real_scene("sponza/sponza.glb") else { return };
    let camera = Camera::look_at(DVec3::new(-11.0, 3.0, 0.0), DVec3::new(0.0, 4.0, 0.0));
    let size = [200, 150];
    let frame = direct(&mut sampler(&scene), &view_job(camera, size, 16));
    let truth = reference(&scene, &camera, size, 16);
    let flip = flip("sponza", &image_of(&frame), &truth.display(scene.lighting.exposure));
    println!("Sponza: FLIP {flip:.5} {:?}", frame.stages);
    assert!(flip <= MAX_FLIP, "FLIP {flip}");
}
