//! Views in less detail, and without long waits, where more are requested than the cluster can render in full.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_scene::frame::Reason;
use argus_scene::{Detail, Plan, PlanRequest};

use super::sim::Sim;
use crate::core::quality::Cost;
use crate::core::*;

/// Milliseconds of a view in full.
const FULL_MS: f64 = 100.0;

/// Two workers whose views cost their pixels alone.
fn workers() -> Sim {
    let mut sim = Sim::new(Config::default());
    sim.direct_ms = FULL_MS;
    for name in ["a", "b"] {
        let id = sim.join(name);
        let cost = |ms: f64| Some(Cost { fixed_ms: 0.0, ms_per_megapixel: ms / PIXELS * 1e6 });
        let report = &mut sim.workers.get_mut(&id).unwrap().report;
        (report.direct_cost, report.few_rays_cost) = (cost(FULL_MS), cost(0.4 * FULL_MS));
    }
    sim.report_all();
    sim
}

/// Pixels of the views that [`Sim::ask_for`] requests.
const PIXELS: f64 = 200.0 * 150.0;

/// A view of a crowd.
#[derive(Debug)]
struct Answered {
    /// Milliseconds from its request.
    latency_ms: f64,
    detail: Detail,
    reason: Reason,
}

/// Views at a steady rate for some seconds, which each worker renders one after another in the predicted times.
fn crowd(sim: &mut Sim, per_sec: f64, secs: f64) -> Vec<Answered> {
    let began = sim.now;
    let mut free_ms: BTreeMap<WorkerId, f64> = BTreeMap::new();
    let mut in_work: Vec<(f64, ViewId, Answered)> = Vec::new();
    let mut answered = Vec::new();
    let count = (per_sec * secs) as u32;
    for i in 0..=count {
        // The last round answers what is in work.
        let now_ms = if i < count { f64::from(i) / per_sec * 1e3 } else { f64::INFINITY };
        in_work.sort_by(|a, b| a.0.total_cmp(&b.0));
        let done = in_work.partition_point(|(end_ms, ..)| *end_ms <= now_ms);
        for (end_ms, view_id, view) in in_work.drain(..done) {
            sim.now = began.after(Duration::from_secs_f64(end_ms * 1e-3)).max(sim.now);
            sim.answer_taking(view_id, sim.orders[&view_id].decision.unwrap().render_ms);
            answered.push(view);
        }
        if i == count {
            break;
        }
        sim.now = began.after(Duration::from_secs_f64(now_ms * 1e-3)).max(sim.now);
        let view_id = sim.ask_for(PlanRequest::default());
        let Some(order) = sim.orders.get(&view_id) else { continue };
        let (decision, free) = (order.decision.unwrap(), free_ms.entry(order.worker).or_default());
        *free = free.max(now_ms) + decision.render_ms;
        let Plan::Direct { detail, .. } = order.plan else { panic!("no sample is held") };
        in_work.push((
            *free,
            view_id,
            Answered { latency_ms: *free - now_ms, detail, reason: decision.reason },
        ));
        if i % 16 == 0 {
            sim.report_all();
            sim.step(Event::Tick);
        }
    }
    answered
}

fn share(views: &[Answered], such: impl Fn(&Answered) -> bool) -> f64 {
    views.iter().filter(|view| such(view)).count() as f64 / views.len() as f64
}

#[test]
fn what_is_carried_is_rendered_in_full() {
    let views = crowd(&mut workers(), 10.0, 10.0);
    assert_eq!(views.len(), 100);
    assert_eq!(share(&views, |view| view.detail == Detail::Full), 1.0);
}

#[test]
fn under_load_views_have_as_much_detail_as_there_is_time_for_and_short_waits() {
    // 1.2, 4 and 16 times what two processes carry.
    for (times, coarsest) in [(1.2, Detail::FewRays), (4.0, Detail::HalfFewRays), (16.0, Detail::Quarter)] {
        let per_sec = times * 2e3 / FULL_MS;
        let views = crowd(&mut workers(), per_sec, 20.0);
        assert_eq!(views.len(), (per_sec * 20.0) as usize, "all are answered");
        let settled = &views[views.len() / 5..];
        let worst = settled.iter().map(|view| view.latency_ms).fold(0.0, f64::max);
        assert!(worst < 500.0, "{times}: {worst} ms");
        let typical = share(settled, |view| view.detail <= coarsest);
        assert!(typical > 0.95, "{times}: {typical}");
        let labelled = share(settled, |view| view.detail == Detail::Full || view.reason != Reason::NoSamples);
        assert_eq!(labelled, 1.0, "{times}");
    }
}

#[test]
fn once_the_crowd_is_gone_views_are_whole_again() {
    let mut sim = workers();
    crowd(&mut sim, 160.0, 5.0);
    sim.now = sim.now.after(Duration::from_secs(10));
    assert_eq!(crowd(&mut sim, 1.0, 1.0)[0].detail, Detail::Full);
}
