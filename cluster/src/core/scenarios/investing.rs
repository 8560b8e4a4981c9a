//! Samples that are rendered at once, since views lack time.

use std::time::Duration;

use argus_scene::{Camera, View};
use glam::DVec3;

use super::open::{ask, measured, view};
use super::sim::Sim;
use crate::core::quality::Cost;
use crate::core::*;

/// A view from another place, whose samples are others.
fn view_from(place: usize) -> View {
    let eye = DVec3::new(0.5 + 40.0 * place as f64, 1.0, 0.7);
    View { camera: Camera::look_at(eye, eye + DVec3::X), ..view() }
}

/// Two workers, of which one carries the crowd in little detail.
fn workers() -> Sim {
    let mut sim = measured(40.0, 10.0);
    let few_rays = Some(Cost { fixed_ms: 5.0, ms_per_megapixel: 0.0 });
    sim.workers.values_mut().for_each(|worker| worker.report.few_rays_cost = few_rays);
    sim.report_all();
    sim
}

/// Views of a quarter of a second from three places, of which each takes 40 ms from triangles.
fn quarter(sim: &mut Sim, count: usize) {
    for i in 0..count {
        let view_id = ask(sim, &view_from(i % 3));
        sim.answer_taking(view_id, 40.0);
    }
    sim.now = sim.now.after(Duration::from_millis(250));
    sim.step(Event::Tick);
}

/// Workers that are assigned samples that they neither hold nor find elsewhere.
fn rendering(sim: &Sim) -> Vec<WorkerId> {
    let renders = |id: &WorkerId| {
        let worker = &sim.workers[id];
        let prefetch = worker.assignments.last().map(|assignment| &assignment.prefetch);
        prefetch.is_some_and(|prefetch| {
            prefetch
                .iter()
                .any(|source| source.addresses.is_empty() && !worker.report.held.contains(&source.id))
        })
    };
    sim.workers.keys().copied().filter(renders).collect()
}

#[test]
fn under_load_all_samples_that_pay_are_rendered_at_once_and_views_are_left_to_the_others() {
    let mut sim = workers();
    let pressure = |sim: &Sim| sim.core.status().pressure.unwrap();
    // 100 views a second of 40 ms: four processes, where there are two.
    let quarters = (0..40).find(|_| {
        quarter(&mut sim, 25);
        let coming = pressure(&sim).samples_coming > 0;
        if !coming {
            sim.report_all();
        }
        coming
    });
    assert!(quarters.is_some_and(|quarters| quarters <= 16), "{quarters:?} quarters of a second");
    let begun = pressure(&sim);
    assert!(begun.lacking > 0.5 && begun.asked > 2.0, "{begun:?}");
    assert!(begun.carried_in_ms.is_some_and(|ms| ms > 0.0), "{begun:?}");
    assert!(begun.samples_coming >= 2, "of several camera sets: {begun:?}");
    let samplers = rendering(&sim);
    assert_eq!(samplers.len(), 1, "K_fd is one of two");
    for place in 0..6 {
        let view_id = ask(&mut sim, &view_from(place % 3));
        assert_ne!(sim.orders[&view_id].worker, samplers[0], "it leaves views to the other worker");
    }
    sim.answer_all();
    // They are there; the rest of what pays follows.
    for _ in 0..20 {
        sim.report_all();
        quarter(&mut sim, 25);
    }
    sim.report_all();
    let carried = pressure(&sim);
    assert_eq!((carried.lacking, carried.samples_coming), (0.0, 0), "{carried:?}");
    let workers: Vec<WorkerId> = (0..4)
        .map(|place| {
            let view_id = ask(&mut sim, &view_from(place % 3));
            sim.orders[&view_id].worker
        })
        .collect();
    assert!(sim.workers.keys().all(|id| workers.contains(id)), "both answer again: {workers:?}");
}

#[test]
fn samples_that_do_not_come_keep_no_worker_from_answering() {
    let mut sim = workers();
    for _ in 0..40 {
        quarter(&mut sim, 25);
        if !rendering(&sim).is_empty() {
            break;
        }
        sim.report_all();
    }
    let sampler = rendering(&sim)[0];
    // It goes on reporting, but never what it shall hold.
    sim.workers.get_mut(&sampler).unwrap().obedient = false;
    for _ in 0..120 {
        sim.report_all();
        quarter(&mut sim, 25);
    }
    let workers: Vec<WorkerId> = (0..6)
        .map(|place| {
            let view_id = ask(&mut sim, &view_from(place % 3));
            sim.orders[&view_id].worker
        })
        .collect();
    assert!(workers.contains(&sampler), "{workers:?}");
}

#[test]
fn if_the_others_cannot_carry_the_views_samples_are_rendered_in_gaps() {
    let mut sim = measured(40.0, 10.0);
    for _ in 0..40 {
        quarter(&mut sim, 25);
        if !rendering(&sim).is_empty() {
            break;
        }
        sim.report_all();
    }
    assert_eq!(sim.core.status().pressure.unwrap().carried_in_ms, None);
    let workers: Vec<WorkerId> = (0..6)
        .map(|place| {
            let view_id = ask(&mut sim, &view_from(place % 3));
            sim.orders[&view_id].worker
        })
        .collect();
    assert!(sim.workers.keys().all(|id| workers.contains(id)), "both answer: {workers:?}");
}
