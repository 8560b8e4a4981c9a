//! Arguments that several studies share. Missing arguments keep the study's defaults.

use anyhow::Context as _;
use argus::args;
use argus_studies::Report;
use indicatif::ProgressBar;

/// One scene.
#[derive(clap::Args)]
pub(in crate::study) struct Scene {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N` after it for mirroring
    /// balls
    #[arg(long = "scene", value_name = "S")]
    name: Option<String>,
    #[command(flatten)]
    environment: args::Environment,
}

impl Scene {
    pub(in crate::study) fn replace(self, default: &mut String) {
        if let Some(name) = self.name {
            *default = name;
        }
        *default = self.environment.of(default);
    }
}

/// Scenes, each measured separately.
#[derive(clap::Args)]
pub(in crate::study) struct Scenes {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N` after it for mirroring
    /// balls; may be given more than once
    #[arg(long = "scene", value_name = "S")]
    names: Vec<String>,
    #[command(flatten)]
    environment: args::Environment,
}

impl Scenes {
    pub(in crate::study) fn replace(self, default: &mut Vec<String>) {
        if !self.names.is_empty() {
            *default = self.names;
        }
        default.iter_mut().for_each(|scene| *scene = self.environment.of(scene));
    }
}

/// The size of views.
#[derive(clap::Args)]
pub(in crate::study) struct Size {
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<[u32; 2]>,
}

impl Size {
    pub(in crate::study) fn replace(self, default: &mut [u32; 2]) {
        if let Some(size) = self.size {
            *default = size;
        }
    }
}

/// Runs a study that waits for the GPU on a blocking thread, away from I/O.
pub(in crate::study) async fn blocking<O: Send + 'static>(
    options: O,
    progress: &ProgressBar,
    study: impl FnOnce(&O, &ProgressBar) -> anyhow::Result<Report> + Send + 'static,
) -> anyhow::Result<Report> {
    let bar = progress.clone();
    tokio::task::spawn_blocking(move || study(&options, &bar)).await.context("the study panicked")?
}
