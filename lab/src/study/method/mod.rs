//! `argus-lab study method`: the papers' methods, each measured by itself.

mod eye_points;
mod manylods;
mod megaviews;
mod omni_maps;
mod particles;
mod probes;
mod virtual_lights;

use super::{Named, Run};

#[derive(clap::Subcommand)]
pub(super) enum Study {
    #[command(name = "megaviews")]
    MegaViews(megaviews::MegaViews),
    #[command(name = "manylods")]
    ManyLods(manylods::ManyLods),
    OmniMaps(omni_maps::OmniMaps),
    Particles(particles::Particles),
    VirtualLights(virtual_lights::VirtualLights),
    Probes(probes::Probes),
    EyePoints(eye_points::EyePoints),
}

impl Study {
    pub(super) async fn run(self, run: &Run<'_>) -> anyhow::Result<Named> {
        let (quick, progress) = (run.form.quick, run.progress);
        Ok(match self {
            Self::MegaViews(study) => ("megaviews", study.run(quick, progress).await?),
            Self::ManyLods(study) => ("manylods", study.run(quick, progress).await?),
            Self::OmniMaps(study) => ("omni-maps", study.run(quick, progress).await?),
            Self::Particles(study) => ("particles", study.run(quick, progress).await?),
            Self::VirtualLights(study) => ("virtual-lights", study.run(quick, progress).await?),
            Self::Probes(study) => ("probes", study.run(quick, progress).await?),
            Self::EyePoints(study) => ("eye-points", study.run(quick, run.form.out.clone(), progress).await?),
        })
    }
}
