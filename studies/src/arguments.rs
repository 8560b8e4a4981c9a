//! Arguments of studies. Each study's `Options` are its arguments, with a default for `--quick` beside the usual one.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

pub(crate) use argus::args::{positive, size};

static QUICK: AtomicBool = AtomicBool::new(false);

/// From now on arguments that are not given are those of the short form, which takes seconds; its figures are noise. To
/// be called before arguments are parsed.
pub fn set_quick(quick: bool) {
    QUICK.store(quick, Ordering::Relaxed);
}

/// Whether this is the short form.
pub(crate) fn is_quick() -> bool {
    QUICK.load(Ordering::Relaxed)
}

/// The default of an argument: the usual one, or that of the short form.
pub(crate) fn or_quick(usual: &'static str, quick: &'static str) -> &'static str {
    if is_quick() { quick } else { usual }
}

/// Parses a whole number of at least 1.
pub(crate) fn count(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count > 0 => Ok(count),
        _ => Err("must be a whole number of at least 1".to_owned()),
    }
}

/// Parses seconds above 0.
pub(crate) fn seconds(text: &str) -> Result<Duration, String> {
    Duration::try_from_secs_f64(positive(text)?).map_err(|error| error.to_string())
}

/// The options of a study's short form.
#[cfg(test)]
pub(crate) fn quick<T: clap::Args>() -> T {
    set_quick(true);
    let matches = T::augment_args(clap::Command::new("study")).get_matches_from(["study"]);
    T::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}
