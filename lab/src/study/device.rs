//! `argus-lab study device`: how fast this machine's GPU and CPU do what a frame is made of.

use argus_studies::device::{parts, rays, throughput, visibility};

use super::run::{Named, Run, blocking};

#[derive(clap::Subcommand)]
pub(super) enum Study {
    Parts(parts::Options),
    Rays(rays::Options),
    Throughput(throughput::Options),
    Visibility(visibility::Options),
}

impl Study {
    pub(super) async fn run(self, run: &Run<'_>) -> anyhow::Result<Named> {
        let progress = run.progress;
        Ok(match self {
            Self::Parts(options) => ("parts", blocking(options, progress, parts::run).await?),
            Self::Rays(options) => ("rays", blocking(options, progress, rays::run).await?),
            Self::Throughput(options) => ("throughput", blocking(options, progress, throughput::run).await?),
            Self::Visibility(options) => ("visibility", blocking(options, progress, visibility::run).await?),
        })
    }
}
