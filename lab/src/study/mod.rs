//! `argus-lab study`: the experiments behind the figures, with a file for each study's arguments.

mod arguments;
mod baseline;
mod bounds;
mod break_even;
mod burst;
mod campaign;
mod capacity;
mod cells;
mod change;
mod cluster;
mod detail;
mod device;
mod effects;
mod epr;
mod equal_error;
mod hard_cases;
mod history;
mod light;
mod manylods;
mod megaviews;
mod omni_maps;
mod overload;
mod particles;
mod radiosity;
mod rays;
mod reflections;
mod scenes;
mod service;
mod shadows;
mod soak;
mod throughput;
mod visibility;
mod walk;
mod warp;

use std::path::PathBuf;

use argus::output;
use argus_studies::Report;
use indicatif::{ProgressBar, ProgressStyle};

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
    Baseline(baseline::Baseline),
    Burst(burst::Burst),
    Warp(warp::Warp),
    Bounds(bounds::Bounds),
    Walk(walk::Walk),
    Visibility(visibility::Visibility),
    Cells(cells::Cells),
    Cluster(cluster::Cluster),
    Change(change::Change),
    Soak(soak::Soak),
    Capacity(capacity::Capacity),
    BreakEven(break_even::BreakEven),
    HardCases(hard_cases::HardCases),
    History(history::History),
    #[command(name = "megaviews")]
    MegaViews(megaviews::MegaViews),
    #[command(name = "manylods")]
    ManyLods(manylods::ManyLods),
    OmniMaps(omni_maps::OmniMaps),
    Particles(particles::Particles),
    Light(light::Light),
    Radiosity(radiosity::Radiosity),
    Rays(rays::RayStudy),
    Reflections(reflections::ReflectionStudy),
    Overload(overload::Overload),
    Scenes(scenes::Scenes),
    Service(service::Service),
    Shadows(shadows::ShadowStudy),
    Detail(detail::DetailStudy),
    Device(device::Device),
    Effects(effects::EffectStudy),
    Epr(epr::EprStudy),
    EqualError(equal_error::EqualError),
    Throughput(throughput::Throughput),
    Campaign(campaign::Campaign),
}

/// Length of a study, and the form of its output.
#[derive(clap::Args)]
struct Form {
    /// Run a few seconds only, to see that everything works; the figures are noise. No effect on `change` and
    /// `hard-cases`
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
    let (name, report) = match study {
        Study::Baseline(study) => ("baseline", study.run(form.quick, &progress).await?),
        Study::Burst(study) => ("burst", study.run(form.quick, &progress).await?),
        Study::Warp(study) => ("warp", study.run(form.quick, &progress).await?),
        Study::Bounds(study) => ("bounds", study.run(form.quick, &progress).await?),
        Study::Walk(study) => ("walk", study.run(form.quick, &progress).await?),
        Study::Visibility(study) => ("visibility", study.run(form.quick, &progress).await?),
        Study::Cells(study) => ("cells", study.run(form.quick, &progress).await?),
        Study::Cluster(study) => ("cluster", study.run(form.quick, &progress).await?),
        Study::Change(study) => ("change", study.run(&progress).await?),
        Study::Capacity(study) => ("capacity", study.run(form.quick, &progress).await?),
        Study::Soak(study) => ("soak", study.run(form.quick, &progress).await?),
        Study::History(study) => ("history", study.run(form.quick, &progress).await?),
        Study::BreakEven(study) => ("break-even", study.run(form.quick, &progress).await?),
        Study::MegaViews(study) => ("megaviews", study.run(form.quick, &progress).await?),
        Study::ManyLods(study) => ("manylods", study.run(form.quick, &progress).await?),
        Study::OmniMaps(study) => ("omni-maps", study.run(form.quick, &progress).await?),
        Study::Particles(study) => ("particles", study.run(form.quick, &progress).await?),
        Study::Light(study) => ("light", study.run(form.quick, &progress).await?),
        Study::Radiosity(study) => ("radiosity", study.run(form.quick, &progress).await?),
        Study::Rays(study) => ("rays", study.run(form.quick, &progress).await?),
        Study::Reflections(study) => ("reflections", study.run(form.quick, &progress).await?),
        Study::Overload(study) => ("overload", study.run(form.quick, &progress).await?),
        Study::Scenes(study) => ("scenes", study.run(form.out.clone(), &progress).await?),
        Study::Service(study) => ("service", study.run(form.quick, &progress).await?),
        Study::Shadows(study) => ("shadows", study.run(form.quick, &progress).await?),
        Study::Effects(study) => ("effects", study.run(form.quick, form.out.clone(), &progress).await?),
        Study::Detail(study) => ("detail", study.run(form.quick, &progress).await?),
        Study::Device(study) => ("device", study.run(form.quick, &progress).await?),
        Study::Epr(study) => ("epr", study.run(form.quick, form.out.clone(), &progress).await?),
        Study::EqualError(study) => ("equal-error", study.run(form.quick, &progress).await?),
        Study::Throughput(study) => ("throughput", study.run(form.quick, &progress).await?),
        Study::HardCases(study) => ("hard-cases", study.run(&progress).await?),
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
