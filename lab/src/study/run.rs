//! How a study is run, and what it returns.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use argus_studies::Report;
use indicatif::ProgressBar;

/// Length of a study, and the form of its output.
#[derive(clap::Args)]
pub(super) struct Form {
    /// Run a few seconds only, to see that everything works; the figures are noise.
    #[arg(long, global = true)]
    pub(super) quick: bool,
    /// Print one JSON object: scene, machine, rows (one object per table row)
    #[arg(long, global = true)]
    pub(super) json: bool,
    /// Folder for the figures as Markdown, CSV and JSON, and for plots
    #[arg(long, global = true, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
}

/// What every study gets beside its options.
pub(super) struct Run<'a> {
    /// This program, of which studies start processes.
    pub(super) program: &'a Path,
    pub(super) form: &'a Form,
    pub(super) progress: &'a ProgressBar,
}

/// Name of a study's files, and its result.
pub(super) type Named = (&'static str, Report);

/// Runs a study that waits for the GPU on a blocking thread, away from I/O.
pub(super) async fn blocking<O: Send + 'static>(
    options: O,
    progress: &ProgressBar,
    study: impl FnOnce(&O, &ProgressBar) -> anyhow::Result<Report> + Send + 'static,
) -> anyhow::Result<Report> {
    let bar = progress.clone();
    tokio::task::spawn_blocking(move || study(&options, &bar)).await.context("the study panicked")?
}
