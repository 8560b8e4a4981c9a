//! Batches: one decision for all views, whatever the load.

use argus_scene::rig::{CoverageEstimate, Target, VisibilityQuery};
use argus_scene::{
    Camera, LightLevel, Plan, PlanRequest, Preset, Rig, SampleSetInfo, SceneState, Version, View,
};
use glam::DVec3;

use super::sim::Sim;
use crate::core::quality::Cost;
use crate::core::*;

/// A scene in which every camera sees everything, ten metres from the viewer.
#[derive(Debug)]
struct Open;

impl VisibilityQuery for Open {
    fn sees(&self, _: DVec3, _: DVec3) -> bool {
        true
    }

    fn targets(&self, eye: DVec3, directions: &[DVec3], _: f64) -> Vec<Target> {
        directions.iter().map(|direction| Target::Surface(eye + *direction * 10.0)).collect()
    }

    fn shows(&self, _: DVec3, targets: &[Target], _: f64) -> Vec<bool> {
        vec![true; targets.len()]
    }
}

/// A worker whose prices are known, in a scene of cells in this light.
fn priced(direct_ms: f64, warp_ms: f64, light: LightLevel) -> Sim {
    let rig = Rig::Cell { origin: DVec3::ZERO, spacing: 4.0, face: 512 };
    let version = Version { number: 0, state: SceneState { light, ..SceneState::default() } };
    let set = SampleSetInfo { rig, version, ..crate::core::tests::set_info() };
    let mut sim = Sim::with_set(Config::default(), set);
    let id = sim.join("a");
    report(&mut sim, id, direct_ms, warp_ms);
    sim
}

fn report(sim: &mut Sim, id: WorkerId, direct_ms: f64, warp_ms: f64) {
    let report = &mut sim.workers.get_mut(&id).unwrap().report;
    let cost = |ms: f64| Some(Cost { fixed_ms: 0.0, ms_per_megapixel: ms / 0.03 });
    (report.direct_cost, report.warp_cost) = (cost(direct_ms), cost(warp_ms));
    sim.report(id);
}

/// Views around one place, with their estimates.
fn views(sim: &Sim, count: u32) -> Vec<(View, Option<CoverageEstimate>)> {
    let view = |i: u32| {
        let eye = DVec3::new(0.5 + f64::from(i % 7) * 0.1, 1.0, 0.7);
        let camera = Camera::look_at(eye, eye + DVec3::X);
        let plan = PlanRequest::default();
        View::new(camera, [200, 150], plan)
    };
    let estimated = |view: View| {
        let estimate = sim.core.batch_estimate_wanted(&view).map(|wanted| wanted.make(&view, &Open));
        (view, estimate)
    };
    (0..count).map(view).map(estimated).collect()
}

#[test]
fn a_batch_comes_from_samples_once_its_views_save_more_than_they_cost() {
    let sim = priced(100.0, 5.0, LightLevel::Full);
    let pins = |count| sim.core.batch_pins(&views(&sim, count));
    assert!(pins(2).iter().all(Option::is_none), "two views save nothing");
    let many = pins(2000);
    assert!(many.iter().all(Option::is_some));
    let plans: Vec<&Plan> = many.iter().flatten().map(|pin| &pin.plan).collect();
    assert!(plans.iter().all(|plan| matches!(plan, Plan::Warp(warp) if !warp.samples.is_empty())));
}

#[test]
fn a_batch_is_as_fine_and_as_exact_as_its_request_asks() {
    let sim = priced(100.0, 5.0, LightLevel::Full);
    let pins = |plan: PlanRequest| {
        let of = |(view, estimate): (View, Option<CoverageEstimate>)| (View { plan, ..view }, estimate);
        sim.core.batch_pins(&views(&sim, 2000).into_iter().map(of).collect::<Vec<_>>())
    };
    let finer = pins(PlanRequest { supersampling: Some(2), ..PlanRequest::default() });
    let is_fine = |pin: &Option<argus_scene::Provenance>| match pin.as_ref().map(|pin| &pin.plan) {
        Some(Plan::Warp(warp)) => warp.supersampling == 2,
        _ => false,
    };
    assert!(finer.iter().all(is_fine));
    let exact = pins(PlanRequest { preset: Some(Preset::Exact), ..PlanRequest::default() });
    assert!(exact.iter().all(Option::is_none), "samples err more than an exact view may");
}

#[test]
fn the_decision_is_the_same_at_any_load_and_whatever_is_held() {
    let mut sim = priced(100.0, 5.0, LightLevel::Full);
    let before = sim.core.batch_pins(&views(&sim, 2000));
    for _ in 0..50 {
        sim.ask_for(PlanRequest::default());
    }
    // Under load, views take longer and samples would seem to pay more or less.
    let id = *sim.workers.keys().next().unwrap();
    report(&mut sim, id, 10.0, 50.0);
    let held = before.iter().flatten().flat_map(|pin| match &pin.plan {
        Plan::Warp(warp) => warp.samples.clone(),
        Plan::Direct { .. } => Vec::new(),
    });
    sim.workers.get_mut(&id).unwrap().report.held = held.collect();
    sim.report(id);
    assert_eq!(sim.core.batch_pins(&views(&sim, 2000)), before);
}

#[test]
fn samples_that_are_dearer_or_do_not_last_serve_no_batch() {
    let dear = priced(5.0, 100.0, LightLevel::Full);
    assert!(dear.core.batch_pins(&views(&dear, 2000)).iter().all(Option::is_none));
    let rising = priced(100.0, 5.0, LightLevel::Coarse);
    assert!(rising.core.batch_pins(&views(&rising, 2000)).iter().all(Option::is_none));
    let unpriced = Sim::new(Config::default());
    assert!(!unpriced.core.has_prices());
    assert!(unpriced.core.batch_pins(&views(&unpriced, 2000)).iter().all(Option::is_none));
}
