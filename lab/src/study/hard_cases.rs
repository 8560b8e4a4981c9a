//! Arguments of `argus-lab study hard-cases`.

use std::path::PathBuf;

use anyhow::Context as _;
use argus_studies::Report;
use argus_studies::hard_cases::{page, run};
use indicatif::ProgressBar;

use super::arguments::blocking;

/// Runs difficult cases of image reconstruction: error and limit of every search. Fails if one exceeds its limit
#[derive(clap::Args)]
pub(super) struct HardCases {
    /// Also write the table as a documentation page
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

impl HardCases {
    pub(super) async fn run(self, progress: &ProgressBar) -> anyhow::Result<Report> {
        let report = blocking((), progress, |(), bar| run(bar)).await?;
        if let Some(path) = self.page {
            std::fs::write(&path, page(&report))
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(report)
    }
}
