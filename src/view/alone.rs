//! Flags of a view that is rendered without a service.

use argus_cluster::coordinator::Config;
use argus_scene::{Effects, Exposure, LightRequest};

use crate::args;
use crate::settings::{Flags, Sources};

/// A view of a scene that this process renders itself: from triangles, in all the light that `argus serve` would give, by rays.
/// Equal to a view of a service by --direct that is lit by rays, too, once its light is full.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Without a service")]
pub(super) struct AloneArgs {
    /// Render this scene in this process: a file (.glb, .gltf, .obj, .ply) or a built-in scene, as of `argus serve`. Flags
    /// of services and of samples cannot be used with it
    #[arg(
        long,
        value_name = "S",
        conflicts_with_all = [
            "server", "ca", "token_file", "scene_name", "timeout", "search", "steps", "samples", "holes", "preset", "max_error", "deadline_ms"
        ]
    )]
    pub(super) scene: Option<String>,
    /// Environment map in place of the scene's sky, as of `argus serve`
    #[arg(long, value_name = "FILE", requires = "scene")]
    environment: Option<String>,
    /// Light of the scene, as of `argus serve`: auto, file, sky or interior [default: auto]
    #[arg(long, value_name = "LIGHT", requires = "scene", value_parser = args::light)]
    light: Option<LightRequest>,
    /// Effects of light, as of `argus serve` [default: auto]
    #[arg(long, value_name = "LIST", requires = "scene", value_parser = args::effects)]
    effects: Option<Effects>,
    /// Brightness, as of `argus serve`: auto or stops [default: auto]
    #[arg(long, value_name = "EV", requires = "scene", allow_negative_numbers = true, value_parser = args::exposure)]
    exposure: Option<Exposure>,
    /// Indirect light, as of `argus serve`: auto or off [default: auto]
    #[arg(long, value_name = "METHOD", requires = "scene", value_parser = ["auto", "off"])]
    indirect: Option<String>,
}

impl AloneArgs {
    /// The scene's specification, in its environment.
    pub(super) fn spec(&self) -> String {
        let scene = self.scene.clone().unwrap_or_default();
        match &self.environment {
            Some(file) => argus_scene::in_environment(&scene, file),
            None => scene,
        }
    }

    /// The configuration of a service with these flags, and otherwise by the settings.
    ///
    /// # Errors
    /// Settings that are invalid.
    pub(super) fn config(&self, sources: &Sources) -> anyhow::Result<Config> {
        let settings = sources.load(Flags::default())?.settings;
        Ok(Config {
            light: self.light.unwrap_or_default(),
            effects: self.effects.unwrap_or_default(),
            exposure: self.exposure.unwrap_or_default(),
            indirect: (self.indirect.as_deref() == Some("off")).then_some(argus_scene::Indirect::Off),
            ..settings.coordinator.config(&settings.limits)
        })
    }
}
