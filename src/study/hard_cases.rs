//! Arguments of `argus study hard-cases`.

use std::path::PathBuf;

use anyhow::Context as _;
use argus_studies::Report;
use argus_studies::hard_cases::{page, run};
use indicatif::ProgressBar;

use super::arguments::blocking;

/// What makes a reconstruction go wrong, case by case: oracle error and tolerance of every search. Fails if one
/// is out of bounds
#[derive(clap::Args)]
pub(super) struct HardCases {
    /// Also write the table as a page of the documentation
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
