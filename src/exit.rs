//! Exit codes: 0 done, 1 failed, 2 bad arguments. A failure is one line on standard error.

use std::fmt;
use std::io::Write as _;
use std::process::ExitCode;

use argus_client::ClientError;
use argus_scene::InvalidField;

/// Invalid arguments: exit code 2.
#[derive(Debug)]
pub(crate) struct BadArguments(pub(crate) String);

impl fmt::Display for BadArguments {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadArguments {}

/// An error that ends the run with exit code 2.
pub(crate) fn bad_arguments(reason: impl Into<String>) -> anyhow::Error {
    BadArguments(reason.into()).into()
}

/// Reports a failure, if any, and returns the exit code.
pub(crate) fn code(result: anyhow::Result<()>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    // Causes are joined into one line; messages of several lines (from a driver, for example) are folded.
    let line = format!("{error:#}").split_whitespace().collect::<Vec<_>>().join(" ");
    // If standard error is closed, only the exit code remains.
    let _ = writeln!(std::io::stderr(), "argus: {line}");
    ExitCode::from(if error.chain().any(is_misuse) { 2 } else { 1 })
}

/// Whether the arguments are at fault, according to this program, the vocabulary or the service.
fn is_misuse(cause: &(dyn std::error::Error + 'static)) -> bool {
    let by_client = cause.downcast_ref::<ClientError>();
    cause.is::<BadArguments>()
        || cause.is::<InvalidField>()
        || by_client.is_some_and(|e| matches!(e, ClientError::Invalid { .. } | ClientError::Address { .. }))
}
