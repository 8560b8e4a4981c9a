//! Arguments of `argus-lab study change`.

use argus_studies::{Report, change};
use indicatif::ProgressBar;

use super::arguments::blocking;
use super::cluster::Costs;

/// Simulates how the cluster's balance follows changes, with the real coordinator core: demand rises and falls; workers
/// differ in speed, join, leave, hang, are killed and restarted
#[derive(clap::Args)]
pub(super) struct Change {
    #[command(flatten)]
    costs: Costs,
}

impl Change {
    pub(super) async fn run(self, progress: &ProgressBar) -> anyhow::Result<Report> {
        blocking(self.costs.parameters()?, progress, change::run).await
    }
}
