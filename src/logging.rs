//! Logs, on standard error.

use std::io::IsTerminal;

use tracing_subscriber::EnvFilter;

/// Starts logging: what Argus does by default, more with each `-v`; `ARGUS_LOG` has the last word.
pub(crate) fn start(verbosity: u8) {
    let default = match verbosity {
        0 => "warn,argus=info,wgpu_hal=error",
        1 => "info,argus_cluster=debug,wgpu_core=warn,wgpu_hal=warn,naga=warn",
        _ => "debug",
    };
    let filter = EnvFilter::try_from_env("ARGUS_LOG").unwrap_or_else(|_| EnvFilter::new(default));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .compact()
        .init();
}
