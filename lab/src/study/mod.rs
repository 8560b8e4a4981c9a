//! `argus-lab study`: the experiments behind the figures, with a file for each study's arguments.

mod arguments;
mod campaign;
mod device;
mod epr;
mod manylods;
mod megaviews;
mod omni_maps;
mod particles;
mod radiosity;
mod rays;
mod reflections;
mod scenes;

use std::path::PathBuf;

use argus::output;
use argus_studies::{
    Report, baseline, bounds, break_even, burst, capacity, cluster, detail, effects, equal_error, history,
    light, overload, service, shadows, soak, throughput, visibility, walk, warp,
};
use indicatif::{ProgressBar, ProgressStyle};

use self::arguments::blocking;

/// Measures on this machine what approximations cost and how large their errors are.
///
/// Each study prints a Markdown table; with --out it also writes Markdown, CSV, JSON and, if it draws any, plots. On the
/// software driver, LP_NUM_THREADS=1 keeps samplers and compositors comparable: only its fragment work uses threads.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  LP_NUM_THREADS=1 argus-lab study baseline --out figures
  argus-lab study baseline --scene model.glb --quick
  LP_NUM_THREADS=1 argus-lab study warp --scene terrain:500000 --out figures
  argus-lab study burst --scene terrain:500000 --views 290
  argus-lab study walk --scene sponza.glb --laps 8
  argus-lab study cluster --simulate --out figures
  argus-lab study service --scene sponza.glb --size 320x240
  argus-lab study soak --sessions 200 --minutes 2 --chaos
  argus-lab study campaign --quick                        the self-test and all studies that need a GPU")]
pub(crate) struct Args {
    #[command(subcommand)]
    study: Study,
    #[command(flatten)]
    form: Form,
}

#[derive(clap::Subcommand)]
enum Study {
    Baseline(baseline::Options),
    Burst(burst::Options),
    Warp(warp::Options),
    Bounds(bounds::Options),
    Walk(walk::Options),
    Visibility(visibility::Options),
    Cluster(cluster::Options),
    Soak(soak::Options),
    Capacity(capacity::Options),
    BreakEven(break_even::Options),
    History(history::Options),
    #[command(name = "megaviews")]
    MegaViews(megaviews::MegaViews),
    #[command(name = "manylods")]
    ManyLods(manylods::ManyLods),
    OmniMaps(omni_maps::OmniMaps),
    Particles(particles::Particles),
    Light(light::Options),
    Radiosity(radiosity::Radiosity),
    Rays(rays::RayStudy),
    Reflections(reflections::ReflectionStudy),
    Overload(overload::Options),
    Scenes(scenes::Scenes),
    Service(service::Options),
    Shadows(shadows::Options),
    Detail(detail::Options),
    Device(device::Device),
    Effects(effects::Options),
    Epr(epr::EprStudy),
    EqualError(equal_error::Options),
    Throughput(throughput::Options),
    Campaign(campaign::Campaign),
}

/// Length of a study, and the form of its output.
#[derive(clap::Args)]
struct Form {
    /// Run a few seconds only, to see that everything works; the figures are noise.
    #[arg(long, global = true)]
    quick: bool,
    /// Print one JSON object: scene, machine, rows (one object per table row)
    #[arg(long, global = true)]
    json: bool,
    /// Folder for the figures as Markdown, CSV and JSON, and for plots
    #[arg(long, global = true, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) async fn run(Args { study, form }: Args) -> anyhow::Result<()> {
    let progress = ProgressBar::no_length();
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos:>3}/{len} {msg} ({elapsed})") {
        progress.set_style(style);
    }
    let program = std::env::current_exe()?;
    let (name, report) = match study {
        Study::Baseline(options) => ("baseline", blocking(options, &progress, baseline::run).await?),
        Study::Burst(options) => ("burst", burst::run(&program, &options, &progress).await?),
        Study::Warp(options) => ("warp", blocking(options, &progress, warp::run).await?),
        Study::Bounds(options) => ("bounds", blocking(options, &progress, bounds::run).await?),
        Study::Walk(options) => ("walk", walk::run(&program, &options, &progress).await?),
        Study::Visibility(options) => ("visibility", blocking(options, &progress, visibility::run).await?),
        Study::Cluster(options) => ("cluster", cluster::run(&program, &options, &progress).await?),
        Study::Capacity(options) => ("capacity", capacity::run(&program, &options, &progress).await?),
        Study::Soak(options) => ("soak", soak::run(&program, &options, &progress).await?),
        Study::History(options) => ("history", blocking(options, &progress, history::run).await?),
        Study::BreakEven(options) => ("break-even", blocking(options, &progress, break_even::run).await?),
        Study::MegaViews(study) => ("megaviews", study.run(form.quick, &progress).await?),
        Study::ManyLods(study) => ("manylods", study.run(form.quick, &progress).await?),
        Study::OmniMaps(study) => ("omni-maps", study.run(form.quick, &progress).await?),
        Study::Particles(study) => ("particles", study.run(form.quick, &progress).await?),
        Study::Light(options) => ("light", blocking(options, &progress, light::run).await?),
        Study::Radiosity(study) => ("radiosity", study.run(form.quick, &progress).await?),
        Study::Rays(study) => ("rays", study.run(form.quick, &progress).await?),
        Study::Reflections(study) => ("reflections", study.run(form.quick, &progress).await?),
        Study::Overload(options) => ("overload", overload::run(&program, &options, &progress).await?),
        Study::Scenes(study) => ("scenes", study.run(form.out.clone(), &progress).await?),
        Study::Service(options) => ("service", service::run(&program, &options, &progress).await?),
        Study::Shadows(options) => ("shadows", blocking(options, &progress, shadows::run).await?),
        Study::Effects(options) => {
            let options = effects::Options { pictures: form.out.clone(), ..options };
            ("effects", blocking(options, &progress, effects::run).await?)
        }
        Study::Detail(options) => ("detail", blocking(options, &progress, detail::run).await?),
        Study::Device(study) => ("device", study.run(form.quick, &progress).await?),
        Study::Epr(study) => ("epr", study.run(form.quick, form.out.clone(), &progress).await?),
        Study::EqualError(options) => ("equal-error", blocking(options, &progress, equal_error::run).await?),
        Study::Throughput(options) => ("throughput", blocking(options, &progress, throughput::run).await?),
        // A campaign writes its own folder.
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
