//! Tests of the model and of the choice, with synthetic errors and costs.

use std::sync::LazyLock;

use argus_scene::{Camera, Holes, PlanRequest, Preset, Search};
use glam::DVec3;
use proptest::prelude::*;

use super::choose::{self, MOST_TRIES, QualityTarget, Step};
use super::*;
use crate::core::tests::set_info;

const CHEAP: Setting = warp(1, Holes::Mark);
const FINE: Setting = warp(2, Holes::Mark);
const TRACED: Setting = warp(2, Holes::Trace);
const DIRECT: Setting = Setting::Direct { samples_per_pixel: 1 };
const BEST: Setting = Setting::Direct { samples_per_pixel: 16 };
/// Each setting with its error in a view of average difficulty, and its milliseconds.
const TABLE: [(Setting, f64, f64); 5] =
    [(CHEAP, 0.04, 1.0), (FINE, 0.03, 3.0), (TRACED, 0.025, 9.0), (DIRECT, 0.02, 20.0), (BEST, 0.004, 200.0)];

const fn warp(supersampling: u32, holes: Holes) -> Setting {
    Setting::Warp { search: Search::Splat, steps: 0, supersampling, samples: 4, holes }
}

/// Views from all sides. The difficulty of one shows in the detail of its frames, and not before.
fn trials(count: usize) -> Vec<Trial> {
    trials_of(&TABLE, count, 0.05)
}

/// Trials with errors whose logarithms differ by up to `noise` from what the frames show.
fn trials_of(table: &[(Setting, f64, f64)], count: usize, noise: f64) -> Vec<Trial> {
    let set = set_info();
    let random = |i: usize, k: u64| {
        let x = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ k.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (x >> 40) as f64 / f64::from(1_u32 << 23) - 1.0
    };
    let view = |i: usize| {
        let eye = DVec3::new(8.0 * random(i, 1), 22.0 + 12.0 * random(i, 2), 8.0 * random(i, 3));
        let camera = Camera::look_at(eye, DVec3::new(4.0 * random(i, 4), 0.0, 4.0 * random(i, 5)));
        let difficulty = (0.8 * random(i, 6)).exp();
        let answer = |&(setting, error, ms): &(Setting, f64, f64)| {
            let seed = table.iter().position(|row| row.0 == setting).unwrap_or(0) as u64;
            Answer {
                setting,
                error: error * difficulty * (noise * random(i, 10 + seed)).exp(),
                ms,
                observed: observed(difficulty),
            }
        };
        let situation = Situation::new(&camera, 150, (&set.rig, None), &set.bounds);
        Trial { situation, pixels: 30_000, answers: table.iter().map(answer).collect() }
    };
    (0..count).map(view).collect()
}

/// The statistics of frames of a given difficulty; 1 is average.
pub(in crate::core) fn observed(difficulty: f64) -> Observed {
    let detail = 0.02 * difficulty;
    Observed { detail, coarse_detail: 0.04, edges: 0.1, unresolved: 0.01, agreeing: 0.8, residual: 0.1 }
}

/// A model of the scene in the core's tests, for workers of the device `device`.
pub(in crate::core) fn model() -> Model {
    static MODEL: LazyLock<Model> = LazyLock::new(|| {
        let set = set_info();
        let timings = TABLE.map(|(setting, _, ms)| (setting, 7_500, 0.4 * ms));
        Model::fit(set.scene, set.rig, "device".to_owned(), &trials(120), &timings)
    });
    MODEL.clone()
}

fn bounded(bound: f64) -> PlanRequest {
    PlanRequest { max_error: Some(bound), ..PlanRequest::default() }
}

fn candidates<'a>(model: &'a Model, request: &PlanRequest, trial: &Trial) -> Vec<choose::Candidate<'a>> {
    model.candidates(request, &trial.situation, trial.pixels, &Pace::new(0.3))
}

fn first(model: &Model, request: &PlanRequest, trial: &Trial) -> Option<Setting> {
    let target = QualityTarget::of(request)?;
    match choose::first(&candidates(model, request, trial), &target, |_| 0.0)? {
        Step::Try { setting, .. } => Some(setting),
        Step::Deliver { .. } => None,
    }
}

/// The delivered answer, the milliseconds of all tries, and the predicted error.
fn play(model: &Model, request: &PlanRequest, trial: &Trial) -> (Answer, f64, f64) {
    let target = QualityTarget::of(request).unwrap();
    let before = candidates(model, request, trial);
    let (mut tried, mut ms) = (Vec::new(), 0.0);
    let mut step = choose::first(&before, &target, |_| 0.0).unwrap();
    loop {
        let answer = |setting| *trial.answers.iter().find(|a| a.setting == setting).unwrap();
        match step {
            Step::Deliver { expected } => return (answer(*tried.last().unwrap()), ms, expected.error),
            Step::Try { setting, expected, judged } => {
                tried.push(setting);
                assert!(tried.len() <= MOST_TRIES);
                ms += answer(setting).ms;
                if !judged {
                    return (answer(setting), ms, expected.error);
                }
                let light = model.enlightened(&before, &trial.situation, setting, &answer(setting).observed);
                step = choose::next(&light, &target, &tried, ms, |_| 0.0);
            }
        }
    }
}

#[test]
fn bounds_hold_at_nearly_the_least_cost_in_views_that_were_not_calibrated() {
    let model = model();
    let tests = &trials(520)[120..];
    for bound in [0.014, 0.05, 0.1] {
        let (mut within, mut ours, mut best) = (0, Vec::new(), Vec::new());
        for trial in tests {
            let (answer, ms, _) = play(&model, &bounded(bound), trial);
            within += usize::from(answer.error <= bound);
            ours.push(ms);
            let kept = trial.answers.iter().filter(|a| a.error <= bound).map(|a| a.ms);
            best.push(kept.fold(f64::INFINITY, f64::min));
        }
        assert!(within * 100 >= tests.len() * 95, "{within} of {} within {bound}", tests.len());
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let (ours, best) = (median(ours), median(best));
        assert!(ours <= 2.0 * best, "{ours} ms against {best} at {bound}");
    }
}

#[test]
fn a_setting_that_surely_keeps_the_bound_is_preferred() {
    // Three settings of equal uncertainty, each of which might keep the bound, and two that are better.
    let alike = TABLE.map(|(setting, error, ms)| (setting, if ms < 10.0 { 0.03 } else { 0.5 * error }, ms));
    let (set, trials) = (set_info(), trials_of(&alike, 240, 0.6));
    let model = Model::fit(set.scene, set.rig, "device".to_owned(), &trials[..120], &[]);
    let mut went_on = 0;
    for (trial, bound) in trials[120..].iter().flat_map(|t| [0.015, 0.02, 0.03, 0.04].map(|bound| (t, bound)))
    {
        let target = QualityTarget::of(&bounded(bound)).unwrap();
        let before = candidates(&model, &bounded(bound), trial);
        let Some(Step::Try { setting, judged: true, .. }) = choose::first(&before, &target, |_| 0.0) else {
            continue;
        };
        let seen = trial.answers.iter().find(|a| a.setting == setting).unwrap();
        let light = model.enlightened(&before, &trial.situation, setting, &seen.observed);
        let sure = light.iter().any(|c| c.error.upper() <= bound);
        match choose::next(&light, &target, &[setting], seen.ms, |_| 0.0) {
            Step::Deliver { expected } => {
                assert!(expected.error <= bound || !sure, "{setting:?} {expected:?}")
            }
            Step::Try { .. } => went_on += 1,
        }
    }
    assert!(went_on > 50, "{went_on}");
}

#[test]
fn a_bound_that_no_setting_keeps_gets_the_best_setting() {
    let model = model();
    for trial in &trials(140)[120..] {
        let (answer, _, foretold) = play(&model, &bounded(1e-4), trial);
        assert_eq!(answer.setting, BEST);
        assert!(foretold > 1e-4);
    }
}

#[test]
fn explicit_fields_of_a_request_go_before_its_target() {
    let model = model();
    let trial = &trials(1)[0];
    let with = |change: fn(&mut PlanRequest)| {
        let mut request = bounded(1e-4);
        change(&mut request);
        first(&model, &request, trial)
    };
    assert_eq!(with(|r| r.supersampling = Some(1)), Some(DIRECT), "of the settings with one sub-pixel");
    assert_eq!(with(|r| r.search = Some(Search::Linear)), None, "nothing is known of it");
    assert_eq!(with(|r| r.holes = Some(Holes::Trace)), Some(BEST), "a direct view has no holes");
    let splat = with(|r| (r.search, r.holes) = (Some(Search::Splat), Some(Holes::Mark)));
    assert!(splat.is_some_and(|setting| !setting.is_direct() && !setting.traces()));
    assert_eq!(with(|r| (r.direct, r.supersampling) = (true, Some(4))), Some(BEST));
    assert_eq!(with(|r| r.samples = Some(2)), None);
}

#[test]
fn presets_and_deadlines_choose_as_named() {
    let model = model();
    let trial = &trials(1)[0];
    let choose = |preset, deadline_ms| {
        let request = PlanRequest { preset, deadline_ms, ..PlanRequest::default() };
        first(&model, &request, trial)
    };
    assert_eq!(choose(Some(Preset::Interactive), None), Some(CHEAP));
    assert_eq!(choose(Some(Preset::Balanced), None), Some(CHEAP), "three times the cheapest is too much");
    assert_eq!(choose(Some(Preset::Exact), None), Some(BEST));
    assert_eq!(choose(Some(Preset::Exact), Some(12.0)), Some(TRACED), "nothing is guessed, in time");
    assert_eq!(choose(None, Some(1000.0)), Some(BEST));
    assert_eq!(choose(None, Some(25.0)), Some(DIRECT));
    assert_eq!(choose(None, Some(5.0)), Some(FINE));
    assert_eq!(choose(None, Some(0.01)), Some(CHEAP), "late all the same: what is done first");
    let busy = |setting: Setting| if setting.is_direct() { 900.0 } else { 0.0 };
    let request = PlanRequest { deadline_ms: Some(1000.0), ..PlanRequest::default() };
    let candidates = candidates(&model, &request, trial);
    let step = choose::first(&candidates, &QualityTarget::of(&request).unwrap(), busy).unwrap();
    assert!(matches!(step, Step::Try { setting: DIRECT, judged: false, .. }), "{step:?}");
}

#[test]
fn a_slower_machine_is_taken_into_account() {
    let model = model();
    let trial = &trials(1)[0];
    let request = PlanRequest { deadline_ms: Some(25.0), ..PlanRequest::default() };
    let mut pace = Pace::new(0.3);
    (0..20).for_each(|_| pace.observe(DIRECT, 40.0, 20.0));
    let candidates = model.candidates(&request, &trial.situation, trial.pixels, &pace);
    let step = choose::first(&candidates, &QualityTarget::of(&request).unwrap(), |_| 0.0).unwrap();
    assert!(matches!(step, Step::Try { setting: TRACED, .. }), "{step:?}");
}

#[test]
fn a_model_survives_its_file_and_costs_grow_with_the_view() {
    let model = model();
    assert_eq!(model.settings.len(), TABLE.len());
    let cost = model.of(DIRECT).unwrap().cost;
    assert!((cost.ms(30_000) - 20.0).abs() < 1e-9 && (cost.ms(7_500) - 8.0).abs() < 1e-9, "{cost:?}");
    let set = set_info();
    assert!(model.fits(set.scene, &set.rig));
    assert!(!Model { version: MODEL_VERSION + 1, ..model.clone() }.fits(set.scene, &set.rig));
    assert!(!model.fits(argus_scene::SceneHash([9; 32]), &set.rig));
    let other = Model { device: "another".to_owned(), ..model.clone() };
    assert_ne!(model.file_name(), other.file_name());
    let empty = Model::fit(set.scene, set.rig, String::new(), &[], &[]);
    assert!(!empty.fits(set.scene, &set.rig), "nothing was calibrated");
    assert!(candidates(&empty, &bounded(0.1), &trials(1)[0]).is_empty());
}

proptest! {
    #[test]
    fn a_looser_bound_is_never_expected_to_cost_more(view in 0_usize..60, low in 1e-3_f64..0.2, more in 1.0_f64..5.0) {
        let model = model();
        let trial = &trials(60)[view];
        let cost = |bound| {
            let request = bounded(bound);
            let open = candidates(&model, &request, trial);
            let certain = open.iter().filter(|c| c.error.upper() <= bound).map(|c| c.ms);
            certain.fold(f64::INFINITY, f64::min)
        };
        prop_assert!(cost(low * more) <= cost(low));
    }

    #[test]
    fn a_frame_delivered_for_a_feasible_bound_is_predicted_to_keep_it(
        view in 0_usize..60,
        bound in 0.02_f64..0.5,
    ) {
        let model = model();
        let trial = &trials(60)[view];
        let certain = candidates(&model, &bounded(bound), trial).iter().any(|c| c.error.upper() <= bound);
        let (_, _, foretold) = play(&model, &bounded(bound), trial);
        prop_assert!(!certain || foretold <= bound, "{foretold} for {bound}");
    }

    #[test]
    fn arbitrary_numbers_do_not_break_the_choice(bits in any::<[u64; 6]>(), bound in any::<f64>(), eye in any::<[u64; 3]>()) {
        let model = model();
        let f = f64::from_bits;
        let strange = Observed {
            detail: f(bits[0]), coarse_detail: f(bits[1]), edges: f(bits[2]),
            unresolved: f(bits[3]), agreeing: f(bits[4]), residual: f(bits[5]),
        };
        let set = set_info();
        let camera = Camera::look_at(DVec3::from_array(eye.map(f)), DVec3::ZERO);
        let situation = Situation::new(&camera, 150, (&set.rig, None), &set.bounds);
        let request = bounded(bound);
        let target = QualityTarget::of(&request).unwrap();
        let open = model.candidates(&request, &situation, 30_000, &Pace::new(0.3));
        prop_assert!(open.iter().all(|c| (0.0..=1.0).contains(&c.error.upper())));
        let Some(Step::Try { setting, expected, .. }) = choose::first(&open, &target, |_| f64::NAN) else {
            return Err(TestCaseError::fail("there is something to try"));
        };
        prop_assert!((0.0..=1.0).contains(&expected.error));
        let light = model.enlightened(&open, &situation, setting, &strange);
        match choose::next(&light, &target, &[setting], f64::NAN, |_| 0.0) {
            Step::Try { expected, .. } | Step::Deliver { expected } => {
                prop_assert!((0.0..=1.0).contains(&expected.error));
            }
        }
    }
}

#[test]
fn of_settings_without_a_bound_the_likeliest_is_tried() {
    let rows: Vec<Vec<f64>> = (0..16).map(|i| vec![f64::from(i)]).collect();
    let of_error = |error: f64| super::regression::Regression::fit(&rows, &[error; 16]).unwrap();
    let (bad, good) = (of_error(0.3), of_error(0.05));
    // A view outside of the calibrated range.
    let [bad, good] = [&bad, &good].map(|regression| regression.believe(&[f64::NAN]));
    assert_eq!((bad.upper(), good.upper()), (1.0, 1.0));
    let candidate = |setting, error| choose::Candidate { setting, ms: 1.0, error, judged_factor: 1.0 };
    let target = QualityTarget { max_error: Some(0.01), ..QualityTarget::default() };
    for candidates in
        [[candidate(CHEAP, bad), candidate(FINE, good)], [candidate(FINE, good), candidate(CHEAP, bad)]]
    {
        let step = choose::first(&candidates, &target, |_| 0.0);
        assert!(matches!(step, Some(Step::Try { setting: FINE, .. })), "{step:?}");
    }
}
