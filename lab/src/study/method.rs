//! `argus-lab study method`: the papers' methods, each measured by itself.

use argus_studies::papers::{eye_points, manylods, megaviews, omni_maps, particles, probes, virtual_lights};

use super::run::{Named, Run, blocking};

#[derive(clap::Subcommand)]
pub(super) enum Study {
    #[command(name = "megaviews")]
    MegaViews(megaviews::Options),
    #[command(name = "manylods")]
    ManyLods(manylods::Options),
    OmniMaps(omni_maps::Options),
    Particles(particles::Options),
    VirtualLights(virtual_lights::Options),
    Probes(probes::Options),
    EyePoints(eye_points::Options),
}

impl Study {
    pub(super) async fn run(self, run: &Run<'_>) -> anyhow::Result<Named> {
        let progress = run.progress;
        Ok(match self {
            Self::MegaViews(options) => ("megaviews", blocking(options, progress, megaviews::run).await?),
            Self::ManyLods(options) => ("manylods", blocking(options, progress, manylods::run).await?),
            Self::OmniMaps(options) => ("omni-maps", blocking(options, progress, omni_maps::run).await?),
            Self::Particles(options) => ("particles", blocking(options, progress, particles::run).await?),
            Self::VirtualLights(options) => {
                ("virtual-lights", blocking(options, progress, virtual_lights::run).await?)
            }
            Self::Probes(options) => ("probes", blocking(options, progress, probes::run).await?),
            Self::EyePoints(options) => {
                let options = eye_points::Options { images: run.form.out.clone(), ..options };
                ("eye-points", blocking(options, progress, eye_points::run).await?)
            }
        })
    }
}
