//! Arguments of studies. Each study's `Options` are its arguments, with a default for `--quick` beside the usual one.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

pub(crate) use argus::args::{point, positive, size};
use argus_scene::{Camera, Scene};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;

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

/// A default: the usual one, or that of the short form.
pub(crate) fn or_quick<T>(usual: T, quick: T) -> T {
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

/// Parses a percentage above 0 into a share.
pub(crate) fn percent(text: &str) -> Result<f64, String> {
    Ok(positive(text)? / 100.0)
}

/// Parses one of some names.
pub(crate) fn one_of<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let find = move |text: String| all.iter().copied().find(|one| name(*one) == text);
    PossibleValuesParser::new(all.iter().map(|one| name(*one)))
        .try_map(move |text| find(text).ok_or("must be one of these names"))
}

/// The viewer of a study of one view.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Viewer {
    /// Position of the viewer in metres [default: the scene's first camera]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "target")]
    eye: Option<DVec3>,
    /// Point that the viewer looks at
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "eye")]
    target: Option<DVec3>,
}

impl Viewer {
    /// The viewer's camera in a scene.
    ///
    /// # Errors
    /// A viewer that looks at its own position, or an infinite number.
    pub(crate) fn camera(&self, scene: &Scene) -> anyhow::Result<Camera> {
        let (Some(eye), Some(target)) = (self.eye, self.target) else { return Ok(scene.default_camera()) };
        let camera = Camera { fov_deg: 60.0, ..Camera::look_at(eye, target) };
        camera.validate()?;
        Ok(camera)
    }
}

/// The options of a study without any argument. One test at a time parses them, since the form is the process's.
#[cfg(test)]
pub(crate) fn options<T: clap::Args>(quick: bool) -> T {
    static ONE_AT_A_TIME: parking_lot::Mutex<()> = parking_lot::Mutex::new(());
    let _one = ONE_AT_A_TIME.lock();
    set_quick(quick);
    let matches = T::augment_args(clap::Command::new("study")).get_matches_from(["study"]);
    T::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}
