//! `argus-lab study load`: services of several processes under many clients.

use argus_studies::load::{break_even, burst, capacity, cluster, overload, repeats, service, soak};

use super::run::{Named, Run, blocking};

#[derive(clap::Subcommand)]
pub(super) enum Study {
    Service(service::Options),
    Burst(burst::Options),
    Cluster(cluster::Options),
    Capacity(capacity::Options),
    Overload(overload::Options),
    BreakEven(break_even::Options),
    Soak(soak::Options),
    Repeats(repeats::Options),
}

impl Study {
    pub(super) async fn run(self, run: &Run<'_>) -> anyhow::Result<Named> {
        let Run { program, progress, .. } = *run;
        Ok(match self {
            Self::Service(options) => ("service", service::run(program, &options, progress).await?),
            Self::Burst(options) => ("burst", burst::run(program, &options, progress).await?),
            Self::Cluster(options) => ("cluster", cluster::run(program, &options, progress).await?),
            Self::Capacity(options) => ("capacity", capacity::run(program, &options, progress).await?),
            Self::Overload(options) => ("overload", overload::run(program, &options, progress).await?),
            Self::BreakEven(options) => ("break-even", blocking(options, progress, break_even::run).await?),
            Self::Repeats(options) => ("repeats", repeats::run(program, &options, progress).await?),
            Self::Soak(options) => ("soak", soak::run(program, &options, progress).await?),
        })
    }
}
