//! The program `argus`; the library beside it holds its subcommands.

use std::process::ExitCode;

fn main() -> ExitCode {
    argus::main()
}
