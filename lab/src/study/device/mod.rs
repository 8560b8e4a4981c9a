//! `argus-lab study device`: how fast this machine's GPU and CPU do what a frame is made of.

mod parts;
mod rays;

use argus_studies::device::{throughput, visibility};

use super::arguments::blocking;
use super::{Named, Run};

#[derive(clap::Subcommand)]
pub(super) enum Study {
    Parts(parts::Parts),
    Rays(rays::RayStudy),
    Throughput(throughput::Options),
    Visibility(visibility::Options),
}

impl Study {
    pub(super) async fn run(self, run: &Run<'_>) -> anyhow::Result<Named> {
        let (quick, progress) = (run.form.quick, run.progress);
        Ok(match self {
            Self::Parts(study) => ("parts", study.run(quick, progress).await?),
            Self::Rays(study) => ("rays", study.run(quick, progress).await?),
            Self::Throughput(options) => ("throughput", blocking(options, progress, throughput::run).await?),
            Self::Visibility(options) => ("visibility", blocking(options, progress, visibility::run).await?),
        })
    }
}
