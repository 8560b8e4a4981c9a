//! Samples at refinements of the rig: holes vanish, the budget is kept, and placements are stable.

use std::collections::BTreeSet;
use std::time::Duration;

use argus_scene::{Camera, Plan, PlanRequest, Preset, Rig, SampleId, SampleSetInfo};
use glam::DVec3;

use super::sim::Sim;
use crate::core::tests::set_info;
use crate::core::*;

const PIXELS: f64 = 200.0 * 150.0;

/// Cells of 2 m; a sample has 6 · 64² texels of 8 bytes.
fn interior() -> SampleSetInfo {
    SampleSetInfo { rig: Rig::Cell { origin: DVec3::ZERO, spacing: 2.0, face: 64 }, ..set_info() }
}

const SAMPLE_BYTES: u64 = 6 * 64 * 64 * 8;

/// Viewpoints along a line, half a metre apart.
fn walk(count: usize) -> Vec<Camera> {
    (0..count)
        .map(|i| {
            let eye = DVec3::new(0.5 * i as f64 + 0.13, 1.7, 0.3);
            Camera::look_at(eye, eye + DVec3::new(1.0, 0.1, 0.2))
        })
        .collect()
}

/// A simple model of an interior: a tenth of the pixels is uncovered for each metre to the nearest sample.
fn uncovered(set: &SampleSetInfo, camera: &Camera, plan: &Plan) -> u64 {
    let Plan::Warp(warp) = plan else { return 0 };
    let far = |index| (set.rig.camera(index).unwrap().center() - camera.eye).length();
    let nearest = warp.samples.iter().map(|id| far(id.camera)).fold(f64::INFINITY, f64::min);
    // The last decimetre costs nothing.
    (PIXELS * (0.02 * (nearest - 0.1)).clamp(0.0, 1.0)) as u64
}

/// The result of a lap.
#[derive(Debug, Clone, PartialEq)]
struct Lap {
    plans: Vec<Plan>,
    uncovered: u64,
    refined: usize,
}

/// Requests a view from each viewpoint, four a second.
fn lap(sim: &mut Sim, views: &[Camera]) -> Lap {
    let set = sim.core.set().clone();
    let (mut plans, mut sum) = (Vec::new(), 0);
    for camera in views {
        let view_id = sim.ask_from(*camera, PlanRequest::from_samples(), None);
        let plan = sim.orders[&view_id].plan.clone();
        let missing = uncovered(&set, camera, &plan);
        sum += missing;
        sim.answer_with(view_id, missing);
        plans.push(plan);
        sim.now = sim.now.after(Duration::from_millis(250));
        sim.report_all();
        sim.step(Event::Tick);
    }
    Lap { plans, uncovered: sum, refined: refined(sim).len() }
}

/// Refinements in any worker's prefetch list.
fn refined(sim: &Sim) -> BTreeSet<u64> {
    let newest = sim.workers.values().filter_map(|worker| worker.assignments.last());
    let is_refined = |index: &u64| sim.core.set().rig.level(*index) != Some(0);
    newest
        .flat_map(|newest| newest.prefetch.iter().map(|source| source.id.camera))
        .filter(is_refined)
        .collect()
}

fn rendered(sim: &Sim) -> u64 {
    sim.workers.values().map(|worker| worker.report.samples_rendered).sum()
}

fn cluster(config: Config, workers: usize) -> Sim {
    let mut sim = Sim::with_set(config, interior());
    for i in 0..workers {
        sim.join(&format!("w{i}"));
        sim.report_all();
    }
    sim
}

fn share(lap: &Lap) -> f64 {
    lap.uncovered as f64 / PIXELS / lap.plans.len() as f64
}

#[test]
fn holes_vanish_lap_by_lap_and_placements_settle() {
    for workers in [1, 2, 4] {
        let views = walk(40);
        let mut sim = cluster(Config::default(), workers);
        let first = lap(&mut sim, &views);
        assert!(share(&first) > 0.01, "{}", share(&first));
        let laps: Vec<Lap> = (0..30).map(|_| lap(&mut sim, &views)).collect();
        let settled = laps.last().unwrap();
        assert!(share(settled) < 0.0025, "{workers} workers: {}", share(settled));
        let (placed, roles) = (refined(&sim), sim.roles_changed());
        for _ in 0..10 {
            assert_eq!(&lap(&mut sim, &views), settled, "{workers} workers: nothing moves any more");
        }
        assert_eq!(refined(&sim), placed);
        assert_eq!(sim.roles_changed(), roles);
        assert_eq!(rendered(&sim), placed.len() as u64, "each is rendered once");
    }
}

#[test]
fn a_plan_uses_more_held_samples_unless_the_request_fixes_their_number() {
    let mut sim = cluster(Config::default(), 2);
    let camera = walk(1)[0];
    let set = sim.core.set().clone();
    let count = |sim: &mut Sim, request| {
        let view_id = sim.ask_from(camera, request, None);
        let Plan::Warp(warp) = sim.orders[&view_id].plan.clone() else { panic!("a warp") };
        sim.answer(view_id);
        warp.samples
    };
    let first = count(&mut sim, PlanRequest::from_samples());
    assert_eq!(first.len(), 4, "no worker holds any");
    let held: Vec<SampleId> =
        set.rig.nearest(&camera, 7).into_iter().map(|i| SampleId { camera: i, ..first[0] }).collect();
    for worker in sim.workers.values_mut() {
        worker.report.held.extend(held.iter().copied());
    }
    sim.report_all();
    assert_eq!(count(&mut sim, PlanRequest::from_samples()), held, "the eighth would have to be rendered");
    assert_eq!(count(&mut sim, PlanRequest { samples: Some(4), ..PlanRequest::default() }), first);
    let interactive = PlanRequest { preset: Some(Preset::Interactive), ..PlanRequest::from_samples() };
    assert_eq!(count(&mut sim, interactive), first[..2]);
}

#[test]
fn the_same_views_place_the_same_samples() {
    let run = || {
        let mut sim = cluster(Config::default(), 3);
        (0..10).map(|_| lap(&mut sim, &walk(30))).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn samplers_spend_no_more_than_their_share() {
    let config = Config { refining_share: 0.25, ..Config::default() };
    let mut sim = cluster(config, 2);
    sim.direct_ms = 500.0;
    let views = walk(40);
    let began = sim.now;
    for _ in 0..6 {
        lap(&mut sim, &views);
        // A quarter of one sampler's time at half a second each: one in two seconds, and four at the start.
        let secs = sim.now.since(began).as_secs_f64();
        let most = 4.0 + 0.5 * secs;
        assert!(rendered(&sim) as f64 <= most + 1.0, "{} in {secs} s", rendered(&sim));
    }
    assert!(rendered(&sim) > 10);
    // S counts them like all samples.
    assert!(sim.core.status().samples_per_tick > 0.1);
}

#[test]
fn a_refining_sampler_composes_once_queues_are_as_long_as_a_sample_takes() {
    let mut sim = cluster(Config { samplers_composite: true, ..Config::default() }, 2);
    (sim.direct_ms, sim.view_ms) = (100.0, 10.0);
    let views = walk(8);
    (0..3).for_each(|_| drop(lap(&mut sim, &views)));
    let sampler = sim.sampler();
    // It has rendered what views need.
    let view_id = sim.ask_from(views[0], PlanRequest::from_samples(), None);
    let Plan::Warp(warp) = sim.orders[&view_id].plan.clone() else { panic!("a warp") };
    sim.answer(view_id);
    sim.workers.get_mut(&sampler).unwrap().report.held.extend(warp.samples);
    // A view needs samples that no worker holds: the sampler is asked to render them, and has not reported since.
    let place = Camera::look_at(DVec3::new(3.9, 1.7, 0.9), DVec3::new(9.0, 1.0, 3.0));
    for _ in 0..20 {
        let view_id = sim.ask_from(place, PlanRequest::from_samples(), None);
        sim.answer_with(view_id, PIXELS as u64 / 5);
    }
    let listed =
        |sim: &Sim| sim.workers[&sampler].assignments.last().map_or(0, |newest| newest.prefetch.len());
    let before = listed(&sim);
    sim.now = sim.now.after(Duration::from_secs(2));
    sim.report_all();
    sim.step(Event::Tick);
    assert!(listed(&sim) > before, "a sample is placed");
    let asked: Vec<ViewId> =
        (0..40).map(|_| sim.ask_from(views[0], PlanRequest::from_samples(), None)).collect();
    let to_it: Vec<bool> = asked.iter().map(|view_id| sim.orders[view_id].worker == sampler).collect();
    // A sample takes as long as ten views; from then on they alternate.
    assert!(to_it.iter().take(9).all(|is| !is), "{to_it:?}");
    let count = to_it.iter().filter(|is| **is).count();
    assert!((10..=20).contains(&count), "{count}: {to_it:?}");
}

#[test]
fn busy_workers_refine_less_than_idle_ones() {
    let rendered_in_a_minute = |view_ms: f64| {
        let mut sim = cluster(Config { samplers_composite: true, ..Config::default() }, 2);
        (sim.direct_ms, sim.view_ms) = (250.0, view_ms);
        for _ in 0..3 {
            // Four views a second, and more viewpoints than time for samples.
            lap(&mut sim, &walk(80));
        }
        rendered(&sim)
    };
    let [idle, busy] = [1.0, 480.0].map(rendered_in_a_minute);
    assert!(busy > 0 && busy * 2 < idle, "{busy} samples where views keep workers busy, {idle} where not");
}

#[test]
fn without_a_share_there_are_no_refinements() {
    let mut sim = cluster(Config { refining_share: 0.0, ..Config::default() }, 2);
    (0..5).for_each(|_| drop(lap(&mut sim, &walk(20))));
    assert!(refined(&sim).is_empty());
}

#[test]
fn a_full_memory_keeps_the_most_useful_and_does_not_churn() {
    let config = Config { refining_bytes: 10 * SAMPLE_BYTES, ..Config::default() };
    let mut sim = cluster(config, 2);
    let views = walk(60);
    let laps: Vec<Lap> = (0..20).map(|_| lap(&mut sim, &views)).collect();
    assert!(laps.iter().all(|lap| lap.refined <= 10));
    let before = rendered(&sim);
    for _ in 0..10 {
        assert_eq!(lap(&mut sim, &views).refined, 10);
    }
    assert_eq!(rendered(&sim), before, "what serves as many as any other stays");

    // Viewers move elsewhere: unused samples are replaced.
    let elsewhere: Vec<Camera> =
        walk(12).into_iter().map(|c| Camera::look_at(c.eye + DVec3::Z * 9.0, c.target)).collect();
    let there = lap(&mut sim, &elsewhere);
    let later: Vec<Lap> = (0..120).map(|_| lap(&mut sim, &elsewhere)).collect();
    let settled = later.last().unwrap();
    assert!(settled.refined <= 10 && settled.uncovered * 2 < there.uncovered, "{}", share(settled));
}

#[test]
fn fewer_large_samples_fit_into_memory() {
    let config = Config { refining_bytes: 20 * SAMPLE_BYTES, ..Config::default() };
    let mut sim = cluster(config, 2);
    for worker in sim.workers.values_mut() {
        // With planes for effects that are shaded per view.
        worker.report.sample_bytes = 2 * SAMPLE_BYTES;
    }
    let laps: Vec<Lap> = (0..20).map(|_| lap(&mut sim, &walk(60))).collect();
    assert!(laps.iter().all(|lap| lap.refined <= 10));
    assert_eq!(laps.last().unwrap().refined, 10);
}

#[test]
fn plans_use_only_samples_that_compositors_hold() {
    let mut sim = cluster(Config::default(), 4);
    let views = walk(20);
    for round in 0..12 {
        for camera in &views {
            let view_id = sim.ask_from(*camera, PlanRequest::from_samples(), None);
            let order = sim.orders[&view_id].clone();
            let Plan::Warp(warp) = &order.plan else { panic!("a warp") };
            for id in warp.samples.iter().filter(|id| interior().rig.level(id.camera) != Some(0)) {
                let holders = sim.workers.values().filter(|w| w.report.held.contains(id)).count();
                assert!(holders > 0, "round {round}: {id} is nowhere");
            }
            sim.answer_with(view_id, uncovered(&interior(), camera, &order.plan));
        }
        sim.second(0, 0);
        if round == 6 {
            // A compositor that joins lacks them, but they stay usable for the others.
            let usable = sim.core.samples().placement().usable().to_vec();
            let newcomer = sim.join("late");
            sim.report(newcomer);
            assert!(!usable.is_empty());
            assert_eq!(sim.core.samples().placement().usable(), usable);
        }
    }
    // If no worker holds them any more, plans use the rig's own cameras at once.
    for id in sim.workers.keys().copied().collect::<Vec<_>>() {
        sim.leave(id);
    }
    let id = sim.join("fresh");
    sim.report(id);
    sim.step(Event::Tick);
    let view_id = sim.ask_from(views[0], PlanRequest::from_samples(), None);
    let Plan::Warp(warp) = &sim.orders[&view_id].plan else { panic!("a warp") };
    assert!(warp.samples.iter().all(|id| interior().rig.level(id.camera) == Some(0)));
}

/// The refinements among a plan's samples.
fn refinements(order: &Order) -> Vec<SampleId> {
    let Plan::Warp(warp) = &order.plan else { panic!("a warp") };
    let refined = |id: &&SampleId| interior().rig.level(id.camera) > Some(0);
    warp.samples.iter().filter(refined).copied().collect()
}

#[test]
fn no_view_waits_for_a_lost_refinement() {
    let mut sim = cluster(Config::default(), 5);
    let views = walk(20);
    (0..12).for_each(|_| drop(lap(&mut sim, &views)));
    for camera in views.iter().cycle().take(60) {
        sim.ask_from(*camera, PlanRequest::from_samples(), None);
    }
    let before = sim.orders.clone();
    assert!(before.values().any(|order| !refinements(order).is_empty()));
    // Workers leave one after the other, until one sampler is left that holds a third of the samples.
    let last = sim.sampler();
    sim.workers.get_mut(&last).unwrap().report.held.retain(|id| id.camera % 3 == 0);
    sim.report(last);
    let (mut sent_again, mut kept) = (0, 0);
    for gone in sim.workers.keys().copied().filter(|id| *id != last).collect::<Vec<_>>() {
        let before = sim.orders.clone();
        sim.leave(gone);
        for (view_id, order) in &sim.orders {
            if before.get(view_id).is_some_and(|before| before.attempt == order.attempt) {
                continue;
            }
            sent_again += 1;
            for id in refinements(order) {
                kept += 1;
                let has = |id| sim.workers.iter().filter(move |(_, w)| w.report.held.contains(id));
                assert!(has(&id).count() > 0, "{id} is nowhere");
                let source = order.sources.iter().find(|source| source.id == id).unwrap();
                let itself = has(&id).any(|(worker, _)| *worker == order.worker);
                assert!(itself || !source.addresses.is_empty(), "{source:?}");
                assert!(itself || source.dispensable || order.attempt > 3, "{source:?}");
            }
        }
    }
    assert!(sent_again > 40 && kept > 0, "{sent_again} views were sent again, with {kept} refinements");
    assert_eq!(sim.orders.len() + sim.workers.len(), before.len() + 1, "all are still in work");
}

#[test]
fn a_view_is_not_sent_back_and_forth_for_a_lost_refinement() {
    let mut sim = cluster(Config::default(), 3);
    let views = walk(20);
    (0..12).for_each(|_| drop(lap(&mut sim, &views)));
    // A new worker holds none of them, and finds no holder.
    let newcomer = sim.join("late");
    sim.report(newcomer);
    let lacks = |order: &Order| order.worker == newcomer && !refinements(order).is_empty();
    let asked = (0..400).map(|i| sim.ask_from(views[i % 20], PlanRequest::from_samples(), None));
    let asked: Vec<ViewId> = asked.collect();
    let view_id = *asked.iter().find(|view_id| lacks(&sim.orders[view_id])).unwrap();
    assert!(sim.orders[&view_id].sources.iter().any(|source| source.dispensable));
    for _ in 0..6 {
        let order = sim.orders[&view_id].clone();
        let goes_back = order.sources.iter().any(|source| source.dispensable);
        assert!(!goes_back || order.attempt <= 3, "attempt {}", order.attempt);
        sim.step(Event::Failed { view_id, attempt: order.attempt, failure: Failure::TryElsewhere });
    }
    assert!(sim.orders.contains_key(&view_id), "it is still in work");
}

#[test]
fn tiles_are_refined_near_their_viewers() {
    let mut sim = Sim::with_workers(2);
    let rig = sim.core.set().rig;
    let camera = Camera::look_at(DVec3::new(40.0, 16.0, 9.0), DVec3::new(5.0, 0.0, 5.0));
    for _ in 0..12 {
        let view_id = sim.ask_from(camera, PlanRequest::from_samples(), None);
        sim.answer_with(view_id, 600);
        sim.second(0, 0);
    }
    let view_id = sim.ask_from(camera, PlanRequest::from_samples(), None);
    let Plan::Warp(warp) = &sim.orders[&view_id].plan else { panic!("a warp") };
    assert!(rig.level(warp.samples[0].camera) > Some(0), "{warp:?}");
}
