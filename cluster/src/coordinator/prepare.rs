//! What a configuration makes of a scene: its sample set, with the light and exposure of all views.
//!
//! A service and a process that renders a view by itself prepare a scene here, so that both show the same.

use argus_scene::{
    EffectPlan, EffectRequest, Exposure, InvalidField, Lighting, ReflectionProbeSet, ReflectionRequest, Rig,
    SampleSetInfo, Sampling, Version, Visibility, check_sub_samples,
};

use tracing::warn;

use super::{Config, ServeError};
use crate::SceneSource;

/// A scene that is ready to be served.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The sample set, in its first version.
    pub set: SampleSetInfo,
    /// The effects of light that the scene calls for, and which of them the set has.
    pub effect_plan: EffectPlan,
}

/// Prepares a scene: chooses its effects of light, and meters its exposure. Takes up to seconds, and may not be called on a
/// thread of asynchronous tasks.
///
/// # Errors
/// An option of the configuration that is invalid, or that does not go with the scene.
pub fn prepare(config: &Config, source: &dyn SceneSource) -> Result<Prepared, ServeError> {
    let scene = source.scene();
    let rig = Rig::for_scene(scene, &config.rig)?;
    config.sampling.validate(&rig).map_err(ServeError::Sampling)?;
    check_sub_samples(config.sub_samples).map_err(ServeError::Sampling)?;
    config.indirect.map_or(Ok(()), |indirect| indirect.validate()).map_err(ServeError::Sampling)?;
    let mut request = EffectRequest {
        effects: config.effects,
        indirect: config.indirect,
        reflections: reflections_with(config.reflections, config.sampling)?,
        exposure: None,
    };
    let is_metered = config.exposure == Exposure::Auto;
    let metered = if is_metered { source.metered(request.metering()) } else { None };
    if is_metered && metered.is_none() {
        warn!(
            "no light reaches a visible surface: views have the scene's own exposure. --light interior lights all"
        );
    }
    let exposure = config.exposure.factor(scene.lighting.exposure, metered);
    request.exposure = Some(exposure);
    // Once for the sample set: its light passes are built from this plan alone.
    let effect_plan = EffectPlan::of(scene, &request, None);
    let (effects, indirect) = (effect_plan.light_effects(), effect_plan.indirect(scene, &request));
    indirect.check_effects(effects).map_err(ServeError::Sampling)?;
    // A scene that stands still has epochs, too, if its lights drift or if it is sampled anew for every so many
    // views.
    let moves = scene.is_animated() || indirect.drifts() || config.core.refresh_views > 0;
    let mut set = SampleSetInfo {
        scene: scene.hash,
        bounds: scene.bounds(),
        extent: scene.extent(),
        rig,
        version: Version::default(),
        epoch_secs: match moves {
            true => epoch_secs(config).map_err(ServeError::Time)?,
            false => 0.0,
        },
        lighting: Lighting { exposure, ..scene.lighting.clone() },
        // The configuration's backend; the core replaces it if it is measured.
        visibility: Visibility::default(),
        sampling: config.sampling,
        sub_samples: config.sub_samples,
        effects,
        indirect,
        reflections: match effect_plan.reflections(scene, &request) {
            Some(settings) => ReflectionProbeSet::of(scene, &rig, settings).map_err(ServeError::Sampling)?,
            None => None,
        },
    };
    set.version.state.light = set.first_light();
    Ok(Prepared { set, effect_plan })
}

/// The reflections that are possible with a sampling.
///
/// # Errors
/// Reflections were asked for by name, and the sampling has none.
fn reflections_with(request: ReflectionRequest, sampling: Sampling) -> Result<ReflectionRequest, ServeError> {
    match (sampling, request) {
        (Sampling::Triangles, request) => Ok(request),
        (Sampling::MegaViews(_), ReflectionRequest::Off | ReflectionRequest::Auto(_)) => {
            Ok(ReflectionRequest::Off)
        }
        (Sampling::MegaViews(_), ReflectionRequest::By(_)) => {
            let reason =
                "maps are looked up by samples from triangles, and megaviews has none: take one of the two";
            Err(ServeError::Sampling(InvalidField::new("reflections", reason)))
        }
    }
}

/// Scene seconds from one epoch to the next.
fn epoch_secs(config: &Config) -> Result<f64, InvalidField> {
    let secs = config.core.epoch.as_secs_f64() * config.time_scale;
    // Written so that NaN is refused.
    match (0.0..=86400.0).contains(&secs) {
        true => Ok(secs),
        false => Err(InvalidField::new("time_scale", format!("must be 0 to a day an epoch, not {secs} s"))),
    }
}
