//! Arguments of `argus-lab study campaign`.

use std::path::PathBuf;

use argus::{args, output, shutdown};
use argus_studies::device::campaign::{Options, Outcome, PAGE, run};
use indicatif::ProgressBar;

use super::run::Form;

/// Runs the self-test and the studies that need a GPU within a given time, most valuable first, each in its own process
///
/// Results are written to the folder --out (by default out/gpu-campaign) as they come: a JSON object and a log for
/// each step, and the page results.md. A step that fails or takes too long is a row with its reason.
/// `scripts/gpu-campaign` runs this on machines that have only the program and a driver.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study campaign --quick
  argus-lab study campaign --minutes 20 --out gpu --beside software     compares with the campaign in the folder `software`")]
pub(super) struct Campaign {
    /// Time limit in minutes; the least valuable steps are left out first [default: 30, with --quick 10]
    #[arg(long, value_name = "M", value_parser = args::positive)]
    minutes: Option<f64>,
    /// Folder of another campaign, on another device, to compare with
    #[arg(long, value_name = "DIR")]
    beside: Option<PathBuf>,
}

impl Campaign {
    pub(super) async fn run(self, form: &Form, progress: &ProgressBar) -> anyhow::Result<()> {
        let minutes = self.minutes.unwrap_or(if form.quick { 10.0 } else { 30.0 });
        let out = form.out.clone().unwrap_or_else(|| PathBuf::from("out/gpu-campaign"));
        let options = Options { quick: form.quick, minutes, out, beside: self.beside };
        let stop = shutdown::requested(false);
        let results = run(&std::env::current_exe()?, &options, progress, &stop).await?;
        progress.finish_and_clear();
        let page = options.out.join(PAGE);
        if form.json {
            output::json(&results.record)?;
        } else {
            print!("{}", std::fs::read_to_string(&page)?);
        }
        eprintln!("written: {}", page.display());
        let steps = &results.record.steps;
        let failed = |outcome: &Outcome| matches!(outcome, Outcome::Failed { .. } | Outcome::TimedOut);
        let count = steps.iter().filter(|step| failed(&step.outcome)).count();
        anyhow::ensure!(count == 0, "{count} of {} steps failed, see {}", steps.len(), page.display());
        Ok(())
    }
}
