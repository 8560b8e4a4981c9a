//! Plans of explicit requests, and checks of pins.

use argus_proto::Fault;
use argus_scene::{
    Difference, FaceMasks, FrameSource, Holes, InvalidField, Limits, Plan, PlanRequest, Preset, Provenance,
    SampleId, SampleSetInfo, View, Warp,
};

use crate::core::config::Config;
use crate::core::samples::MOST_SAMPLES;

/// Samples per pixel that count as exact where no model of the scene's errors exists.
const NEAR_THE_TRUTH: u32 = 16;
/// Samples of an interactive view: the pair from which the splat takes its depth.
const INTERACTIVE_SAMPLES: u32 = 2;

/// The plan of a validated view by its request alone; a model of the scene may choose another
/// ([`crate::core::quality`]). Without a model, a bound on the error is kept by rendering from triangles, unless the
/// request names a search. `nearest` returns the given number of best samples.
///
/// # Errors
/// [`Fault::Pin`] for a pin of another scene or specification; `Samples::check_version` checks its version.
/// [`Fault::Invalid`] for a malformed pinned plan.
pub fn plan(
    view: &View,
    set: &SampleSetInfo,
    nearest: impl FnOnce(usize) -> Vec<SampleId>,
    config: &Config,
) -> Result<Plan, Fault> {
    if let Some(pin) = &view.pin {
        check_pin(pin, view, set)?;
        return Ok(pin.plan.clone());
    }
    let request = &view.plan;
    if request.leaves_way_open() {
        // Until the planner chooses by the samples that workers hold.
        return Ok(Plan::direct(samples_per_pixel(request)));
    }
    let exact = request.preset == Some(Preset::Exact);
    let side = request.supersampling.unwrap_or(if exact { 2 } else { 1 });
    if request.direct {
        let detail = request.detail.unwrap_or_default();
        return Ok(Plan::Direct { samples_per_pixel: side * side, detail, light: None });
    }
    let open = (request.search, request.steps, request.samples, request.holes) == (None, None, None, None);
    if request.max_error.is_some() && open {
        let samples_per_pixel = request.supersampling.map_or(NEAR_THE_TRUTH, |side| side * side);
        return Ok(Plan::direct(samples_per_pixel));
    }
    let samples = match request.preset {
        Some(Preset::Interactive) => config.samples_per_view.min(INTERACTIVE_SAMPLES),
        Some(Preset::Exact) => MOST_SAMPLES as u32,
        Some(Preset::Balanced) | None => config.samples_per_view,
    };
    let count = request.samples.unwrap_or(samples) as usize;
    let search = request.search.unwrap_or_default();
    Ok(Plan::Warp(Warp {
        search,
        steps: request.steps.unwrap_or(config.steps_of(search)),
        supersampling: side,
        holes: request.holes.unwrap_or(if exact { Holes::Trace } else { Holes::Mark }),
        samples: nearest(count),
        frames: Vec::new(),
        faces: FaceMasks::default(),
    }))
}

/// Samples per pixel from triangles, for a request that leaves the way open.
pub(super) fn samples_per_pixel(request: &PlanRequest) -> u32 {
    let usual = if request.preset == Some(Preset::Exact) { 2 } else { 1 };
    request.supersampling.unwrap_or(usual).pow(2)
}

/// Checks that this cluster can repeat a pinned provenance. The device is not checked here: it decides which workers
/// may answer.
fn check_pin(pin: &Provenance, view: &View, set: &SampleSetInfo) -> Result<(), Fault> {
    let differs = |what: &str, theirs: String, ours: String| {
        Err(Fault::Pin(format!("{what} {theirs} is not served here, {what} {ours} is")))
    };
    if pin.scene != set.scene {
        return differs("scene", pin.scene.to_string(), set.scene.to_string());
    }
    // Views from triangles and from direct frames use no samples, so their bytes do not depend on the sampling options.
    let sampled = pin.plan.needs_samples();
    if let Some(theirs) = pin.specification {
        let mut ours = set.specification();
        if !sampled {
            // A view from triangles uses the backend of its pin.
            ours.visibility = theirs.visibility;
        }
        if let Some(Difference { field, first, second }) = theirs.difference(&ours, &pin.plan) {
            return differs(field, first, second);
        }
    }
    check_frames(&pin.plan, view)?;
    Ok(check_plan(&pin.plan, set)?)
}

/// Largest side of a pinned plan's frame, over that of the view, and most samples a pixel: they limit what one request can cost.
const MOST_SOURCE_SIDE: u32 = 2;
const MOST_SOURCE_SAMPLES: u32 = 16;

/// Checks the frames of a pinned plan.
fn check_frames(plan: &Plan, view: &View) -> Result<(), InvalidField> {
    const FIELD: &str = "pin.plan.warp.frames";
    let Plan::Warp(warp) = plan else { return Ok(()) };
    let frames = &warp.frames;
    if frames.len() > FrameSource::MOST || !(frames.is_empty() || warp.samples.is_empty()) {
        let reason = format!("must be at most {} and without samples beside them", FrameSource::MOST);
        return Err(InvalidField::new(FIELD, reason));
    }
    for frame in frames {
        frame
            .validate(&Limits { max_side: u32::MAX, max_pixels: u64::MAX })
            .map_err(|at| InvalidField::new(FIELD, format!("{}: {}", at.field, at.reason)))?;
        let [width, height] = [view.width, view.height].map(|side| side.saturating_mul(MOST_SOURCE_SIDE));
        if frame.width > width || frame.height > height || frame.samples_per_pixel > MOST_SOURCE_SAMPLES {
            let reason = format!(
                "must have at most {MOST_SOURCE_SIDE} times the view's size and {MOST_SOURCE_SAMPLES} samples a pixel"
            );
            return Err(InvalidField::new(FIELD, reason));
        }
    }
    Ok(())
}

/// Checks a pinned plan, which comes from outside, by the rules of [`View::validate`].
fn check_plan(plan: &Plan, set: &SampleSetInfo) -> Result<(), InvalidField> {
    let within = |field, n: u32, most| InvalidField::within(field, n, 1..=most);
    match plan {
        Plan::Direct { samples_per_pixel: n, .. } => {
            within("pin.plan.direct.samples_per_pixel", *n, 256)?;
            let side = n.isqrt();
            match side * side == *n {
                true => Ok(()),
                false => {
                    let reason = format!("must be a square number, not {n}");
                    Err(InvalidField::new("pin.plan.direct.samples_per_pixel", reason))
                }
            }
        }
        Plan::Warp(Warp { search, steps, supersampling, samples, frames, .. }) => {
            if search.takes_steps() {
                within("pin.plan.warp.steps", *steps, 4096)?;
            }
            within("pin.plan.warp.supersampling", *supersampling, 8)?;
            let field = "pin.plan.warp.samples";
            let of_rig = samples.iter().filter(|id| !id.is_reflection_probe()).count();
            if frames.is_empty() && !(1..=MOST_SAMPLES).contains(&of_rig) {
                return Err(InvalidField::new(field, format!("must be 1 to 8 samples, not {of_rig}")));
            }
            if set.reflections.is_some() && frames.is_empty() && of_rig == samples.len() {
                return Err(InvalidField::new(
                    field,
                    "must end with the sample of the reflection probes, since the set has reflections",
                ));
            }
            for (i, id) in samples.iter().enumerate() {
                if id.version != samples[0].version {
                    let reason = format!("sample {id} is not of version {}", samples[0].version);
                    return Err(InvalidField::new(field, reason));
                }
                set.camera(id.camera).map_err(|e| InvalidField::new(field, e.reason))?;
                if samples[..i].contains(id) {
                    return Err(InvalidField::new(field, format!("sample {id} is named twice")));
                }
            }
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{
        Camera, Indirect, MegaViews, PointSettings, Sampling, SceneHash, Search, Specification, Visibility,
    };
    use glam::DVec3;

    use super::*;
    use crate::core::tests::set_info;

    fn view() -> View {
        View::new(Camera::look_at(DVec3::new(3.0, 4.0, 5.0), DVec3::ZERO), [200, 150], PlanRequest::default())
    }

    /// A view whose request names a search.
    fn searched() -> View {
        let search = PlanRequest { search: Some(Search::Splat), ..PlanRequest::default() };
        View { plan: search, ..view() }
    }

    /// The plan of a view without a model.
    fn plan(view: &View) -> Result<Plan, Fault> {
        let set = set_info();
        let id = |camera| SampleId { version: set.version.number, camera };
        let nearest = |count| set.rig.nearest(&view.camera, count).into_iter().map(id).collect();
        super::plan(view, &set, nearest, &Config::default())
    }

    fn pinned(change: impl FnOnce(&mut Provenance)) -> Result<Plan, Fault> {
        let set = set_info();
        let free = plan(&searched()).unwrap();
        let mut pin = Provenance::of_plan(set.scene, set.version.state, free);
        change(&mut pin);
        plan(&View { pin: Some(pin), ..view() })
    }

    #[test]
    fn a_request_that_leaves_the_way_open_begins_as_a_direct_view() {
        let samples = |request| match plan(&View { plan: request, ..view() }).unwrap() {
            Plan::Direct { samples_per_pixel, .. } => samples_per_pixel,
            Plan::Warp(_) => panic!("a direct view"),
        };
        let open = PlanRequest::default();
        assert_eq!(samples(open), 1);
        assert_eq!(samples(PlanRequest { preset: Some(Preset::Exact), ..open }), 4);
        assert_eq!(samples(PlanRequest { supersampling: Some(3), ..open }), 9);
    }

    #[test]
    fn a_request_of_a_search_alone_uses_the_four_nearest_samples() {
        let set = set_info();
        let search = PlanRequest { search: Some(Search::Splat), ..PlanRequest::default() };
        let plan = plan(&View { plan: search, ..view() }).unwrap();
        let Plan::Warp(Warp { search, steps, supersampling, samples, .. }) = plan else { panic!("a warp") };
        assert_eq!((search, steps, supersampling), (Search::Splat, 64, 1));
        let indices: Vec<u64> = samples.iter().map(|s| s.camera).collect();
        assert_eq!(indices, set.rig.nearest(&view().camera, 4));
        assert!(samples.iter().all(|s| s.version == set.version.number));
    }

    #[test]
    fn a_direct_view_has_the_square_of_its_supersampling_as_samples_per_pixel() {
        let request = PlanRequest { direct: true, supersampling: Some(4), ..PlanRequest::default() };
        let plan = plan(&View { plan: request, ..view() }).unwrap();
        assert_eq!(plan, Plan::direct(16));
    }

    #[test]
    fn presets_of_explicit_searches_have_fixed_plans_without_a_model() {
        let plan = |request| plan(&View { plan: request, ..view() }).unwrap();
        let search = Some(Search::Splat);
        let preset =
            |preset| match plan(PlanRequest { preset: Some(preset), search, ..PlanRequest::default() }) {
                Plan::Warp(warp) => (warp.supersampling, warp.samples.len(), warp.holes),
                Plan::Direct { .. } => panic!("a warp"),
            };
        assert_eq!(preset(Preset::Interactive), (1, 2, Holes::Mark));
        assert_eq!(preset(Preset::Balanced), (1, 4, Holes::Mark));
        assert_eq!(preset(Preset::Exact), (2, 4, Holes::Trace), "a tile has four cameras");
        let bounded = PlanRequest { max_error: Some(0.01), ..PlanRequest::default() };
        assert_eq!(plan(bounded), Plan::direct(16));
        let warped = plan(PlanRequest { search: Some(Search::Linear), ..bounded });
        assert!(
            matches!(warped, Plan::Warp(warp) if warp.search == Search::Linear),
            "what is said goes first"
        );
    }

    #[test]
    fn a_pinned_plan_is_not_changed() {
        let free = plan(&searched()).unwrap();
        assert_eq!(pinned(|_| ()).unwrap(), free);
        let direct = Plan::direct(9);
        assert_eq!(pinned(|p| p.plan = direct.clone()).unwrap(), direct);
    }

    #[test]
    fn the_sampling_of_a_pin_matters_only_if_its_plan_uses_samples() {
        let usual = set_info().specification();
        let mapped = Specification { sampling: Sampling::MegaViews(MegaViews::default()), ..usual };
        let refused = pinned(|p| p.specification = Some(mapped)).unwrap_err();
        assert!(matches!(&refused, Fault::Pin(text) if text.contains("sampling megaviews")), "{refused:?}");
        pinned(|p| p.specification = Some(usual)).unwrap();
        let direct = Plan::direct(1);
        pinned(|p| (p.plan, p.specification) = (direct, Some(mapped))).unwrap();
    }

    #[test]
    fn a_pin_of_another_specification_is_refused_with_the_field_that_differs() {
        let usual = set_info().specification();
        let indirect = Indirect::Points(PointSettings::default());
        let others = [
            ("visibility", Specification { visibility: Visibility::Cpu, ..usual }),
            ("sub_samples", Specification { sub_samples: 16, ..usual }),
            ("indirect", Specification { indirect, ..usual }),
            ("exposure", Specification { exposure: 0.25, ..usual }),
        ];
        for (field, other) in others {
            let refused = pinned(|p| p.specification = Some(other)).unwrap_err();
            assert!(matches!(&refused, Fault::Pin(text) if text.starts_with(field)), "{refused:?}");
        }
        // The pin of a view from triangles may name another backend, but no other indirect light.
        let direct = |specification| {
            pinned(|p| {
                let plan = Plan::direct(1);
                (p.plan, p.specification) = (plan, Some(specification));
            })
        };
        direct(Specification { visibility: Visibility::Cpu, ..usual }).unwrap();
        let refused = direct(Specification { indirect, ..usual }).unwrap_err();
        assert!(matches!(&refused, Fault::Pin(text) if text.contains("indirect off is")), "{refused:?}");
    }

    #[test]
    fn a_pin_that_cannot_be_repeated_is_rejected_by_field() {
        assert!(matches!(pinned(|p| p.scene = SceneHash([9; 32])), Err(Fault::Pin(_))));
        let reject = |plan: Plan| match pinned(|p| p.plan = plan) {
            Err(Fault::Invalid(at)) => at.field,
            other => panic!("must be rejected by field, not {other:?}"),
        };
        for n in [0, 2, 63, 289] {
            let field = reject(Plan::direct(n));
            assert_eq!(field, "pin.plan.direct.samples_per_pixel", "{n}");
        }
        let warp = |ids: &[(u64, u64)], steps, supersampling| {
            let id = |&(version, camera): &(u64, u64)| SampleId { version, camera };
            let samples = ids.iter().map(id).collect();
            Plan::Warp(Warp { search: Search::Linear, steps, supersampling, samples, ..Warp::default() })
        };
        assert_eq!(reject(warp(&[(1, 0)], 0, 1)), "pin.plan.warp.steps");
        assert_eq!(reject(warp(&[(1, 0)], 64, 9)), "pin.plan.warp.supersampling");
        assert_eq!(reject(warp(&[], 64, 1)), "pin.plan.warp.samples");
        assert_eq!(reject(warp(&[(1, u64::MAX)], 64, 1)), "pin.plan.warp.samples");
        assert_eq!(reject(warp(&[(1, 0), (2, 1)], 64, 1)), "pin.plan.warp.samples");
        assert_eq!(reject(warp(&[(1, 0), (1, 0)], 64, 1)), "pin.plan.warp.samples");
    }
}
