//! `argus-lab`: the experiments behind the figures, `argus-lab study NAME`.
//!
//! It also has the subcommands of `argus`, from the same library: a study starts services as processes of this program,
//! so that it measures what it was built with.

mod study;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Experiments with Argus: what it costs, and how large its errors are.
#[derive(Parser)]
#[command(name = "argus-lab", version, arg_required_else_help = true, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: argus::Common,
}

const EXAMPLES: &str = "\
Examples:
  argus-lab study load service --scene model.glb       the service as its users meet it
  argus-lab study campaign --quick                the self-test and all studies that need a GPU
  argus-lab study --help                          all studies

Every subcommand of `argus` works here too: studies start services as processes of this program.
Exit codes: 0 done, 1 failed, 2 bad arguments.";

#[derive(Subcommand)]
enum Command {
    Study(Box<study::Args>),
    /// A subcommand of `argus`, which parses the arguments anew
    #[command(external_subcommand)]
    Product(#[expect(dead_code, reason = "`argus` reads them from the process")] Vec<OsString>),
}

fn main() -> ExitCode {
    argus::silence_device_selection();
    // The short form of a study has other defaults.
    argus_studies::set_quick(std::env::args_os().any(|word| word == "--quick"));
    let Cli { command, common } = Cli::parse();
    match command {
        Command::Study(args) => argus::run_experiment(&common, |runtime| runtime.block_on(study::run(*args))),
        Command::Product(_) => argus::main(),
    }
}
