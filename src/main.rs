//! `argus`: renders a scene once and serves many viewers from it.
//!
//! One binary for every part, with a file for each subcommand. Results go to standard output (with `--json`, exactly
//! one JSON object), everything else to standard error. Exit codes: 0 done, 1 failed, 2 bad arguments.

mod args;
mod browse;
mod certs;
mod compare;
mod config;
mod coordinator;
mod credentials;
mod demo;
mod effect_table;
mod exit;
mod health;
mod load;
mod output;
mod processes;
mod reference;
mod scene;
mod selftest;
mod serve;
mod settings;
mod sheet;
mod shutdown;
mod status;
mod study;
mod telemetry;
mod view;
mod wiring;
mod worker;

use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, Subcommand};

/// Renders a scene once and serves many viewers from it.
///
/// Views are rendered from the triangles, or reconstructed from a few shared depth images, whichever is faster at the same
/// quality. A coordinator assigns the work to worker processes.
#[derive(Parser)]
#[command(version, arg_required_else_help = true, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Log more on standard error: once for progress, twice for details (or set ARGUS_LOG, such as
    /// `argus_cluster=debug`)
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Format of the log on standard error
    #[arg(long, global = true, value_name = "FORMAT", env = "ARGUS_LOG_FORMAT", default_value = "text")]
    log_format: telemetry::LogFormat,
    #[command(flatten)]
    sources: settings::Sources,
}

const EXAMPLES: &str = "\
Examples:
  argus demo                                  sixteen viewers of the built-in scene, start to finish
  argus selftest                              does Argus work correctly on this machine?
  argus serve --scene model.glb               serve a scene on this machine, then, elsewhere:
  argus view --out view.png
  argus view --scene model.glb --out view.png    one picture, without a service
  argus browse                                walk through it, in a browser
  argus load --clients 16 --seconds 10        how many views a second can the server answer?
  argus status                                the workers' roles and costs
  argus config                                the settings in effect, and where they come from

A scene is a file (.glb, .gltf, .obj, .ply) or the built-in `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or
`rooms[:WALL_MM]`, and `+balls:N` after it for mirroring balls, or `+animation:NAME` for what plays.
Exit codes: 0 done, 1 failed, 2 bad arguments.";

#[derive(Subcommand)]
enum Command {
    Demo(demo::Args),
    Serve(serve::Args),
    Coordinator(coordinator::Args),
    Worker(worker::Args),
    View(view::Args),
    Browse(browse::Args),
    Load(load::Args),
    Status(status::Args),
    Health(health::Args),
    Scene(scene::Args),
    Reference(reference::Args),
    Compare(compare::Args),
    Config(config::Args),
    Selftest(selftest::Args),
    Certs(certs::Args),
    Study(study::Args),
}

impl Command {
    /// The name of this part in traces and logs.
    fn part(&self) -> &'static str {
        match self {
            Self::Serve(_) | Self::Coordinator(_) => "coordinator",
            Self::Worker(_) => "worker",
            _ => telemetry::CLIENT,
        }
    }
}

fn main() -> ExitCode {
    silence_device_selection();
    let cli = Cli::parse();
    exit::code(run(cli))
}

/// Turns off Mesa's layer that reorders GPUs for a desktop session. Argus selects its adapter itself, and without a
/// desktop session the layer prints an error for every process.
fn silence_device_selection() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: called first in `main`, when no other thread can be reading the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("cannot start the asynchronous runtime")?;
    let telemetry = {
        let _within = runtime.enter();
        telemetry::start(cli.verbose, cli.log_format, cli.command.part())?
    };
    let sources = &cli.sources;
    let result = match cli.command {
        Command::Demo(args) => runtime.block_on(demo::run(args)),
        Command::Serve(args) => runtime.block_on(serve::run(args, sources)),
        Command::Coordinator(args) => runtime.block_on(coordinator::run(args, sources)),
        Command::Worker(args) => runtime.block_on(worker::run(args, sources)),
        Command::View(args) => runtime.block_on(view::run(args, sources)),
        Command::Browse(args) => runtime.block_on(browse::run(args, sources)),
        Command::Load(args) => runtime.block_on(load::run(args, sources)),
        Command::Status(args) => runtime.block_on(status::run(args, sources)),
        Command::Health(args) => runtime.block_on(health::run(args, sources)),
        Command::Scene(args) => scene::run(&args),
        Command::Reference(args) => reference::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Selftest(args) => runtime.block_on(selftest::run(args)),
        Command::Certs(args) => certs::run(&args),
        Command::Config(args) => config::run(&args, sources),
        Command::Study(args) => runtime.block_on(study::run(args)),
    };
    telemetry.finish();
    // Remaining background tasks have nothing left to report.
    runtime.shutdown_background();
    result
}
