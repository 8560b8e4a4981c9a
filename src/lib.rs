//! `argus`: renders a scene once and serves many viewers from it.
//!
//! One binary for every part, with a file for each subcommand. This library holds them, so that `argus-lab` (the folder
//! `lab/`), the program of the studies, shares arguments and output, and can start the same services. Results go to standard output (with `--json`, exactly
//! one JSON object), everything else to standard error. Exit codes: 0 done, 1 failed, 2 bad arguments.

pub mod args;
mod browse;
mod certs;
mod compare;
mod config;
mod coordinator;
mod credentials;
mod dataset;
mod demo;
mod effect_table;
mod exit;
mod health;
mod load;
mod move_nodes;
pub mod output;
mod processes;
mod reference;
mod replay;
mod scene;
mod selftest;
mod serve;
mod served_scenes;
mod settings;
pub mod sheet;
pub mod shutdown;
mod status;
mod telemetry;
mod view;
pub mod wiring;
mod worker;

use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, Subcommand};
use tokio::runtime::Runtime;

/// Renders a scene once and serves many viewers from it.
///
/// Views are rendered from the triangles, or reconstructed from a few shared depth images, whichever is faster at the same
/// quality. A coordinator assigns the work to worker processes.
#[derive(Parser)]
#[command(version, arg_required_else_help = true, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: Common,
}

/// Arguments of every subcommand: the log, and the sources of settings.
#[derive(clap::Args)]
pub struct Common {
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
  argus dataset --cameras transforms.json --out set    many images, from a file of cameras
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
    Replay(replay::Args),
    Dataset(dataset::Args),
    Browse(browse::Args),
    Load(load::Args),
    Status(status::Args),
    #[command(name = "move")]
    Move(move_nodes::Args),
    Health(health::Args),
    Scene(scene::Args),
    Reference(reference::Args),
    Compare(compare::Args),
    Config(config::Args),
    Selftest(selftest::Args),
    Certs(certs::Args),
    /// Studies are in another program: `argus-lab study`
    #[command(hide = true, disable_help_flag = true)]
    Study {
        /// What the study was called with
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
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

impl Command {
    /// Runs to the end of the command.
    fn run(self, runtime: &Runtime, sources: &settings::Sources) -> anyhow::Result<()> {
        match self {
            Self::Demo(args) => runtime.block_on(demo::run(args)),
            Self::Serve(args) => runtime.block_on(serve::run(args, sources)),
            Self::Coordinator(args) => runtime.block_on(coordinator::run(args, sources)),
            Self::Worker(args) => runtime.block_on(worker::run(args, sources)),
            Self::View(args) => runtime.block_on(view::run(args, sources)),
            Self::Replay(args) => runtime.block_on(replay::run(args, sources)),
            Self::Dataset(args) => runtime.block_on(dataset::run(args, sources)),
            Self::Browse(args) => runtime.block_on(browse::run(args, sources)),
            Self::Load(args) => runtime.block_on(load::run(args, sources)),
            Self::Status(args) => runtime.block_on(status::run(args, sources)),
            Self::Move(args) => runtime.block_on(move_nodes::run(args, sources)),
            Self::Health(args) => runtime.block_on(health::run(args, sources)),
            Self::Scene(args) => scene::run(&args),
            Self::Reference(args) => reference::run(&args),
            Self::Compare(args) => compare::run(&args),
            Self::Selftest(args) => runtime.block_on(selftest::run(args)),
            Self::Certs(args) => certs::run(&args),
            Self::Config(args) => config::run(&args, sources),
            Self::Study { arguments } => {
                let words = [&["argus-lab study".to_owned()], &arguments[..]].concat().join(" ");
                Err(exit::bad_arguments(format!("studies are in another program: `{words}`")))
            }
        }
    }
}

/// The program `argus`: runs the command that the arguments of this process name.
pub fn main() -> ExitCode {
    silence_device_selection();
    let Cli { command, common } = Cli::parse();
    exit::code(run(&common, command.part(), |runtime| command.run(runtime, &common.sources)))
}

/// Turns off Mesa's layer that reorders GPUs for a desktop session. Argus selects its adapter itself, and without a
/// desktop session the layer prints an error for every process. Must be called first in `main`.
pub fn silence_device_selection() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: called first in `main`, when no other thread can be reading the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

/// Starts the log and the asynchronous runtime, and runs a command of an experiment. Returns the exit code.
pub fn run_experiment(common: &Common, command: impl FnOnce(&Runtime) -> anyhow::Result<()>) -> ExitCode {
    exit::code(run(common, telemetry::CLIENT, command))
}

fn run(
    common: &Common,
    part: &str,
    command: impl FnOnce(&Runtime) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let runtime = Runtime::new().context("cannot start the asynchronous runtime")?;
    let telemetry = {
        let _within = runtime.enter();
        telemetry::start(common.verbose, common.log_format, part)?
    };
    let result = command(&runtime);
    telemetry.finish();
    // Remaining background tasks have nothing left to report.
    runtime.shutdown_background();
    result
}
