//! Scenes with the exposure that the service chooses for them.

use std::sync::Arc;

use anyhow::Result;
use argus_sampler::PacketSight;
use argus_scene::exposure::Metering;
use argus_scene::{Exposure, LightEffects, LightRequest, Scene};

/// Opens a scene in the light that the service chooses for it, with automatic exposure for all effects of light and light
/// between surfaces.
///
/// # Errors
/// The errors of [`argus_scene::open`].
pub(crate) fn open_metered(spec: &str) -> Result<Arc<Scene>> {
    let scene = Arc::new(argus_scene::open(spec)?);
    let metering = Metering { effects: LightEffects::ALL, indirect: true };
    let sight = PacketSight::new(&scene);
    let (choice, metered) = match argus_scene::is_procedural(spec) {
        true => (scene.opened_light(), sight.metered(metering)),
        false => {
            let light = sight.resolve_light(LightRequest::Auto, metering);
            (light.choice, light.metered)
        }
    };
    drop(sight);
    let mut scene = Arc::unwrap_or_clone(scene).in_light(choice);
    scene.lighting.exposure = Exposure::Auto.factor(scene.lighting.exposure, metered);
    Ok(Arc::new(scene))
}
