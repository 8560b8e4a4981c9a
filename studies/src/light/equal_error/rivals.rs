//! Ways to render a view that share no samples.

use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_scene::reference::{DirectLight, Indirect as Paths, Tracer};
use argus_scene::{Plan, ViewJob};
use image::RgbImage;
use indicatif::ProgressBar;

use super::curve::Curve;
use super::mitsuba::Mitsuba;
use super::subject::{Errors, Subject, light};
use crate::bench::{Bench, image_of};
use crate::light::radiance::RadianceError;
use crate::median::{mean, median};

/// A way, and its measured settings.
pub(super) struct Rival {
    pub(super) way: &'static str,
    pub(super) settings: Vec<Setting>,
}

/// A setting's time and error.
pub(super) struct Setting {
    pub(super) name: String,
    pub(super) view_ms: f64,
    /// Mean FLIP against the way's reference.
    pub(super) flip: f64,
    /// Errors of radiance against our reference; `None` for Mitsuba, which has its own.
    pub(super) radiance: Option<RadianceError>,
}

impl Rival {
    /// Error against time.
    pub(super) fn curve(&self) -> Curve {
        Curve::new(self.settings.iter().map(|setting| [setting.view_ms, setting.flip]).collect())
    }

    /// What this way takes for an error, beside the time of a view from samples.
    pub(super) fn times_of(&self, flip: f64, samples_view_ms: f64) -> String {
        let times = |ms: f64| format!("{ms:.1} ms, {:.1} times", ms / samples_view_ms);
        match (self.curve().ms_at(flip), self.curve().last()) {
            (Some(ms), _) => format!("{} {}", self.way, times(ms)),
            (None, Some([ms, error])) => {
                format!("{} more than {} (FLIP {error:.3} there)", self.way, times(ms))
            }
            (None, None) => format!("{} was not measured", self.way),
        }
    }
}

impl Subject<'_> {
    /// Views from triangles, which look up light between surfaces in the same leaf sides as samples.
    ///
    /// Returns the errors of the first setting, too.
    pub(super) fn direct(&self, bench: &mut Bench, progress: &ProgressBar) -> Result<(Rival, Errors)> {
        let (mut settings, mut first) = (Vec::new(), None);
        for &samples_per_pixel in &self.options.direct {
            let name = format!("{samples_per_pixel} a pixel");
            progress.set_message(format!("direct views, {name}"));
            let jobs: Vec<ViewJob> = self.jobs(bench, |_| Plan::direct(samples_per_pixel));
            // The first lights the leaf sides and compiles pipelines.
            bench.time(&jobs[..1])?;
            let (mut times, mut frames) = (Vec::new(), Vec::new());
            for _ in 0..self.options.rounds.max(1) {
                let (ms, found) = bench.time(&jobs)?;
                times.push(ms / jobs.len() as f64);
                frames = found;
            }
            let images = frames.iter().map(image_of).collect::<Result<Vec<_>>>()?;
            let errors = self.judge(&format!("direct {name}"), &images)?;
            let Errors { flip, radiance, .. } = errors;
            settings.push(Setting { name, view_ms: median(&times), flip, radiance: Some(radiance) });
            first.get_or_insert(errors);
            progress.inc(1);
        }
        Ok((Rival { way: "direct", settings }, first.context("no direct view is measured")?))
    }

    /// Views by the reference tracer: rays to the lights and paths from every sample of a pixel.
    pub(super) fn paths(&self, progress: &ProgressBar) -> Result<Rival> {
        let (effects, of_paths) = light();
        let tracer = Tracer::new(self.scene.clone()).with_direct_light(DirectLight { effects, rays: 1 });
        let exposure = self.scene.lighting.exposure;
        let mut settings: Vec<Setting> = Vec::new();
        for &[samples, paths] in &self.options.tracer {
            let name = format!("{samples} a pixel, {paths} paths each");
            progress.set_message(format!("paths without a cache, {name}"));
            progress.inc(1);
            if settings.last().is_some_and(|before| before.view_ms > self.options.patience_secs * 1e3) {
                continue;
            }
            let indirect = Some(Paths { paths, bounces: of_paths.bounces });
            let (mut times, mut images) = (Vec::new(), Vec::<RgbImage>::new());
            for view in &self.views {
                let begin = Instant::now();
                let image = tracer.render_with(view, self.options.size, samples, indirect, |_| ());
                times.push(begin.elapsed().as_secs_f64() * 1e3);
                images.push(image.display(exposure));
            }
            let Errors { flip, radiance, .. } = self.judge(&format!("paths {name}"), &images)?;
            settings.push(Setting { name, view_ms: mean(times), flip, radiance: Some(radiance) });
        }
        Ok(Rival { way: "paths", settings })
    }

    /// Views by Mitsuba.
    pub(super) fn mitsuba(&self, mitsuba: &Mitsuba, progress: &ProgressBar) -> Result<Rival> {
        progress.set_message("Mitsuba");
        let folder = tempfile::tempdir().context("there is no folder for Mitsuba's scene")?;
        let bounces = light().1.bounces;
        let timed = mitsuba.measure(&self.scene, &self.views, self.options.size, bounces, folder.path())?;
        let setting = |timed: super::mitsuba::Timed| Setting {
            name: format!("{} paths a pixel", timed.paths),
            view_ms: timed.view_ms,
            flip: timed.flip,
            radiance: None,
        };
        Ok(Rival { way: "mitsuba", settings: timed.into_iter().map(setting).collect() })
    }
}
