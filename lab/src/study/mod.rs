//! `argus-lab study`: the experiments behind the figures. A file for each kind, with the arguments of its studies.

mod campaign;
mod device;
mod light;
mod load;
mod method;
mod run;
mod views;

use std::path::Path;

use argus::{output, shutdown};
use argus_studies::Report;
use argus_studies::papers::page;
use indicatif::{ProgressBar, ProgressStyle};

use self::run::{Form, Run};

/// Measures on this machine what approximations cost and how large their errors are.
///
/// Each study prints a Markdown table; with --out it also writes Markdown, CSV, JSON and, if it draws any, plots. On the
/// software driver, LP_NUM_THREADS=1 keeps samplers and compositors comparable: only its fragment work uses threads.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  LP_NUM_THREADS=1 argus-lab study views baseline --out figures
  argus-lab study views walk --scene sponza.glb --laps 8
  argus-lab study light indirect --scene sponza.glb
  argus-lab study load service --scene sponza.glb --size 320x240
  argus-lab study load cluster --simulate --out figures
  argus-lab study paper megaviews --quick                 all figures of a paper, on one page
  argus-lab study campaign --quick                        the self-test and all studies that need a GPU")]
pub(crate) struct Args {
    #[command(subcommand)]
    study: Study,
    #[command(flatten)]
    form: Form,
}

#[derive(clap::Subcommand)]
enum Study {
    /// Images: what each way of making a view costs, and how far it is from the converged one
    Views {
        #[command(subcommand)]
        study: views::Study,
    },
    /// Light: what shadows, sky and indirect light cost, and their error
    Light {
        #[command(subcommand)]
        study: light::Study,
    },
    /// Load: services of several processes, real or simulated, under many clients
    Load {
        #[command(subcommand)]
        study: load::Study,
    },
    /// Devices: how fast this machine's GPU and CPU do what a frame is made of
    Device {
        #[command(subcommand)]
        study: device::Study,
    },
    /// Methods of the papers, each measured by itself
    Method {
        #[command(subcommand)]
        study: Box<method::Study>,
    },
    /// All figures and tables of a paper on one page, README.md, beside the paper's own numbers [--out: out/PAPER]
    Paper(page::Options),
    Campaign(campaign::Campaign),
}

pub(crate) async fn run(Args { study, form }: Args) -> anyhow::Result<()> {
    let progress = ProgressBar::no_length();
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos:>3}/{len} {msg} ({elapsed})") {
        progress.set_style(style);
    }
    let program = std::env::current_exe()?;
    let run = Run { program: &program, form: &form, progress: &progress };
    let (name, report) = match study {
        Study::Views { study } => study.run(&run).await?,
        Study::Light { study } => study.run(&run).await?,
        Study::Load { study } => study.run(&run).await?,
        Study::Device { study } => study.run(&run).await?,
        Study::Method { study } => study.run(&run).await?,
        // These write their own folders.
        Study::Paper(options) => return paper(&options, &run).await,
        Study::Campaign(campaign) => return campaign.run(&form, &progress).await,
    };
    progress.finish_and_clear();
    publish(name, &form, &report)?;
    let (no, failed) = (false.into(), "failed".into());
    let rows = report.rows.iter();
    let failed =
        rows.filter(|row| row.get("passed") == Some(&no) || row.get("outcome") == Some(&failed)).count();
    anyhow::ensure!(failed == 0, "{failed} of {} cases are out of bounds", report.rows.len());
    Ok(())
}

/// Makes the page of a paper.
async fn paper(options: &page::Options, run: &Run<'_>) -> anyhow::Result<()> {
    let name = clap::ValueEnum::to_possible_value(&options.paper);
    let folder = Path::new("out").join(name.as_ref().map_or("paper", clap::builder::PossibleValue::get_name));
    let out = run.form.out.as_deref().unwrap_or(&folder);
    let stop = shutdown::requested(false);
    let written = page::run(run.program, options, (run.form.quick, out), run.progress, &stop).await?;
    run.progress.finish_and_clear();
    let page::Written { page, made, missing, failed } = written;
    eprintln!("{made} figures and tables, {missing} not made; written: {}", page.display());
    anyhow::ensure!(failed == 0, "{failed} studies failed, see {}", page.display());
    Ok(())
}

fn publish(name: &str, form: &Form, report: &Report) -> anyhow::Result<()> {
    if let Some(folder) = &form.out {
        for path in report.write(folder, name)? {
            eprintln!("written: {}", path.display());
        }
    }
    if form.json {
        return output::json(report);
    }
    let machine = &report.machine;
    println!(
        "{} ({} cores), {}, LP_NUM_THREADS={}\n",
        machine.cpu, machine.cores, machine.gpu, machine.driver_threads
    );
    print!("{}", report.markdown());
    Ok(())
}
