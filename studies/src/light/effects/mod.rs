//! Effects: what each effect of direct light costs, and how much it changes, beside the bound of the effect plan.
//!
//! Each scene is rendered with the effects that `auto`, `all` and `none` give, with each effect of `auto` switched off, and
//! with each other one switched on. All of them are measured in the same rounds, in turn. A row compares a rendering with
//! that of `auto`, and says:
//!
//! - `within`: no byte changed by more than the plan's bound. A bound of 1 says nothing, and is not judged.
//! - `moves`: effects that are switched off change some byte.
//! - `cheap`: effects of `auto` that changed no byte cost at most 5% of the frame.
//!
//! # Texels that several triangles share
//! Without rays, a texel of a sample is lit once for each of its triangles; with rays, once, at one of them. This changes
//! texels where triangles meet, and is no effect's. So a sample without effects is judged by its rendering with rays that
//! light nothing: with emitters, where the plan says that nothing emits. `path_bytes` is how far the two are apart. Views
//! are lit at each sub-sample either way.
//!
//! # Noise
//! Bounds are those of converged light. Light of the sky and of emitters is a mean over few rays. Shared rays are no
//! noise here: two renderings cast the same rays for the effects that both have. What an effect of few rays adds is judged
//! in renderings with many rays ([`Options::many_rays`]). Their noise is estimated by their largest difference from
//! renderings with half as many: for independent rays, half the rays are as far from all of them as all of them are from
//! the converged light. At most two bytes of it are added to the bound, and only where emitters are switched: what is seen
//! of the sky and of lights is a share between 0 and 1, whose noise never leaves the bound.

mod judgement;
mod options;
mod rendering;
mod rows;
mod scenes;
mod stages;
mod subject;
mod switches;

use anyhow::Result;
use argus_gpu::{Gpu, GpuOptions};
use argus_scene::Effects;
use indicatif::ProgressBar;

use self::judgement::{IDLE_SHARE, MOST_NOISE};
pub use self::options::Options;
use self::subject::Subject;
use crate::{Machine, Report};

/// Runs the study; `progress` counts scenes.
///
/// # Errors
/// A scene that cannot be opened, no GPU, a render that fails, or a folder that cannot be written to.
pub fn run(options: &Options, progress: &ProgressBar) -> Result<Report> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    progress.set_length(options.scenes.len() as u64);
    let mut rows = Vec::new();
    for spec in &options.scenes {
        progress.set_message(spec.clone());
        let mut subject = Subject::new(options, &gpu, spec, Effects::Auto)?;
        let costs = subject.costs()?;
        let plan = subject.plan(subject.base, Some(&costs));
        subject.measure()?;
        if let Some(folder) = &options.pictures {
            subject.save(folder)?;
        }
        rows.extend(subject.rows(plan)?);
        progress.inc(1);
    }
    let Options { size: [width, height], views, samples_per_pixel: samples, face, rounds, .. } = *options;
    let mut report = Report::new(options.scenes.join(" "), Machine::here(gpu.kind()), rows);
    report.notes.push(format!(
        "Up to {views} views of {width}×{height} pixels with {samples} samples a pixel, and a sample of six faces of {face}² texels, stored \
        as half floats. Times are medians of {rounds} rounds in which the rows alternate; times_auto is a time divided by that of \
        auto. Indirect light and reflection probes are off."
    ));
    report.notes.push(format!(
        "changed_bytes, mean_bytes, flip: views with the usual rays, against those of auto. judged_bytes: views and sample \
        with {} rays to the sky and to emitters; noise_bytes: their largest difference from half as many rays, of which up to \
        {MOST_NOISE} are added to the bound. within: judged_bytes are within bound_bytes (– where the bound says nothing). \
        path_bytes: by how much more a sample's texels differ where one \
        of the two has no rays at all, and so lights each triangle of a texel; it is not judged. moves: what is switched off \
        changes a byte. cheap: what changes none costs at most {} of the frame.",
        options.many_rays, IDLE_SHARE
    ));
    report.notes.push(
        "predicted_ms: of the switched effect in a view, from a view with a quarter of the pixels and all effects. \
        measured_ms: the effect's own stages in views of auto, or saved_ms, in views with the effect, where auto leaves it \
        out. light_ms: reading surfaces back, which all effects share."
            .to_owned(),
    );
    Ok(report)
}

#[cfg(test)]
mod tests {
    use argus_scene::{EffectPlan, LightEffects};
    use serde_json::{Map, Value};

    use super::*;
    use crate::arguments::options;

    /// Rows of a quick run. `wrong` falsifies the plan.
    fn rows(spec: &str, base: Effects, wrong: impl Fn(&mut EffectPlan)) -> Vec<Map<String, Value>> {
        let options = Options { size: [32, 24], face: 16, many_rays: 4, rounds: 1, ..options(true) };
        let gpu = Gpu::new(&GpuOptions::default()).unwrap();
        let mut subject = Subject::new(&options, &gpu, spec, base).unwrap();
        let costs = subject.costs().unwrap();
        let mut plan = subject.plan(base, Some(&costs));
        wrong(&mut plan);
        subject.measure().unwrap();
        subject.rows(plan).unwrap()
    }

    fn of<'a>(rows: &'a [Map<String, Value>], name: &str) -> &'a Map<String, Value> {
        rows.iter().find(|row| row["row"] == name).unwrap()
    }

    #[test]
    fn a_wrong_bound_is_found_out() {
        let name = "auto without emitters";
        assert_eq!(of(&rows("room", Effects::Auto, |_| {}), name)["passed"], true);
        let rows = rows("room", Effects::Auto, |plan| {
            plan.rows.iter_mut().for_each(|row| row.bound = 1e-6);
        });
        assert_eq!((&of(&rows, name)["within"], &of(&rows, name)["passed"]), (&false.into(), &false.into()));
    }

    #[test]
    fn an_effect_that_changes_nothing_is_found_out() {
        // Penumbras of the moon's shadows, in a closed room.
        let effects = LightEffects { sky_visibility: false, ..LightEffects::ALL };
        let rows = rows("room", Effects::List(effects), |_| {});
        let row = of(&rows, "auto without soft-shadows");
        assert_eq!(
            (&row["changed_bytes"], &row["moves"], &row["passed"]),
            (&0.into(), &false.into(), &false.into())
        );
        assert!(row["share"].as_f64().unwrap() >= 0.0 && row["cheap"].is_boolean());
    }
}
