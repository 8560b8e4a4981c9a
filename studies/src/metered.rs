//! Scenes with the exposure that the service chooses for them.

use std::sync::Arc;

use anyhow::Result;
use argus_sampler::PacketSight;
use argus_scene::exposure::Metering;
use argus_scene::{Exposure, LightEffects, Scene};

/// Opens a scene, with automatic exposure for all effects of light and light between surfaces.
///
/// # Errors
/// The errors of [`argus_scene::open`].
pub(crate) fn open_metered(spec: &str) -> Result<Arc<Scene>> {
    let mut scene = argus_scene::open(spec)?;
    let metering = Metering { effects: LightEffects::ALL, indirect: true };
    let metered = PacketSight::new(&Arc::new(scene.clone())).metered(metering);
    scene.lighting.exposure = Exposure::Auto.factor(scene.lighting.exposure, metered);
    Ok(Arc::new(scene))
}
