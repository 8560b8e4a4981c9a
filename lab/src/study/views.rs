//! `argus-lab study views`: what images cost, and how far they are from the converged ones.

use argus_studies::views::{baseline, bounds, detail, reprojection, scenes, walk, warp};

use super::run::{Named, Run, blocking};

#[derive(clap::Subcommand)]
pub(super) enum Study {
    Baseline(baseline::Options),
    Warp(warp::Options),
    Bounds(bounds::Options),
    Detail(detail::Options),
    Reprojection(reprojection::Options),
    Walk(walk::Options),
    Scenes(scenes::Options),
}

impl Study {
    pub(super) async fn run(self, run: &Run<'_>) -> anyhow::Result<Named> {
        let progress = run.progress;
        Ok(match self {
            Self::Baseline(options) => ("baseline", blocking(options, progress, baseline::run).await?),
            Self::Warp(options) => ("warp", blocking(options, progress, warp::run).await?),
            Self::Bounds(options) => ("bounds", blocking(options, progress, bounds::run).await?),
            Self::Detail(options) => ("detail", blocking(options, progress, detail::run).await?),
            Self::Reprojection(options) => {
                ("reprojection", blocking(options, progress, reprojection::run).await?)
            }
            Self::Walk(options) => ("walk", walk::run(run.program, &options, progress).await?),
            Self::Scenes(options) => {
                let options = scenes::Options { pictures: run.form.out.clone(), ..options };
                ("scenes", blocking(options, progress, scenes::run).await?)
            }
        })
    }
}
