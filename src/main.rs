//! `argus`: renders a scene once and serves many viewers from it.
//!
//! One binary for every part: each subcommand has a file of its own, and this one says what they share.
//! Standard output is for results (with `--json`, for exactly one JSON object), standard error for
//! everything else. Exit codes: 0 done, 1 failed, 2 bad arguments.

mod args;
mod compare;
mod coordinator;
mod demo;
mod exit;
mod load;
mod logging;
mod output;
mod processes;
mod scene;
mod serve;
mod shutdown;
mod status;
mod study;
mod view;
mod wiring;
mod worker;

use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, Subcommand};

/// Renders a scene once and serves many viewers from it.
///
/// Samplers render the scene, with all of its shading, into a few depth images; compositors reconstruct any
/// number of views from those, without the triangles; a coordinator splits the processes between the two.
#[derive(Parser)]
#[command(version, arg_required_else_help = true, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Say more on standard error: once for progress, twice for details (or set ARGUS_LOG, such as
    /// `argus_cluster=debug`)
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

const EXAMPLES: &str = "\
Examples:
  argus demo                                  sixteen viewers of the built-in scene, start to finish
  argus serve --scene model.glb               serve a scene on this machine, then, elsewhere:
  argus view --eye 3,2,5 --target 0,1,0 --out view.png
  argus load --clients 16 --seconds 10        how many views a second does the server manage?
  argus status                                who does what, and what it costs

A scene is a file (.glb, .gltf, .obj, .ply) or the built-in `terrain[:TRIANGLES]`.
Exit codes: 0 done, 1 failed, 2 bad arguments.";

#[derive(Subcommand)]
enum Command {
    Demo(demo::Args),
    Serve(serve::Args),
    Coordinator(coordinator::Args),
    Worker(worker::Args),
    View(view::Args),
    Load(load::Args),
    Status(status::Args),
    Scene(scene::Args),
    Compare(compare::Args),
    Study(study::Args),
}

fn main() -> ExitCode {
    silence_device_selection();
    let cli = Cli::parse();
    logging::start(cli.verbose);
    exit::code(run(cli.command))
}

/// Turns off Mesa's layer that reorders GPUs for a desktop session: Argus chooses its adapter itself, and where
/// there is no session the layer prints an error for every process.
fn silence_device_selection() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: called first in `main`, when no other thread can be reading the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("cannot start the asynchronous runtime")?;
    let result = match command {
        Command::Demo(args) => runtime.block_on(demo::run(args)),
        Command::Serve(args) => runtime.block_on(serve::run(args)),
        Command::Coordinator(args) => runtime.block_on(coordinator::run(args)),
        Command::Worker(args) => runtime.block_on(worker::run(args)),
        Command::View(args) => runtime.block_on(view::run(args)),
        Command::Load(args) => runtime.block_on(load::run(args)),
        Command::Status(args) => runtime.block_on(status::run(args)),
        Command::Scene(args) => scene::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Study(args) => runtime.block_on(study::run(args)),
    };
    // What still runs in the background has nobody to report to.
    runtime.shutdown_background();
    result
}
