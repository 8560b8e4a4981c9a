//! Random events in any order.

use std::collections::BTreeMap;
use std::time::Duration;

use argus_scene::SampleSetInfo;
use proptest::prelude::*;

use super::sim::Sim;
use crate::core::tests::set_info;
use crate::core::*;

/// A random event.
#[derive(Debug, Clone)]
enum Step {
    Join(u8),
    Leave(usize),
    Report,
    Ask(bool),
    Answer(usize),
    Fail(usize, bool),
    Cancel(usize),
    Pass(u16),
}

fn any_step() -> impl Strategy<Value = Step> {
    prop_oneof![
        2 => (0u8..6).prop_map(Step::Join),
        1 => any::<usize>().prop_map(Step::Leave),
        4 => Just(Step::Report),
        8 => any::<bool>().prop_map(Step::Ask),
        6 => any::<usize>().prop_map(Step::Answer),
        2 => (any::<usize>(), any::<bool>()).prop_map(|(i, f)| Step::Fail(i, f)),
        1 => any::<usize>().prop_map(Step::Cancel),
        3 => (0u16..3000).prop_map(Step::Pass),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Every view ends in exactly one of: answered, failed, refused, cancelled, in flight. Two or more ready workers
    /// always cover both roles, unless all render directly.
    #[test]
    fn no_view_is_lost_or_answered_twice(
        moves in any::<bool>(),
        steps in prop::collection::vec(any_step(), 1..200),
    ) {
        let config = Config { max_views: 50, max_views_per_worker: 5, ..Config::default() };
        let epoch_secs = if moves { 0.1 } else { 0.0 };
        let mut sim = Sim::with_set(config, SampleSetInfo { epoch_secs, ..set_info() });
        let (mut asked, mut ended) = (0_usize, 0_usize);
        let nth = |orders: &BTreeMap<ViewId, Order>, i: usize| {
            let count = orders.len().max(1);
            orders.keys().nth(i % count).copied()
        };
        for step in steps {
            match step {
                Step::Join(name) => drop(sim.join(&format!("w{name}"))),
                Step::Leave(i) => {
                    let count = sim.workers.len().max(1);
                    if let Some(worker) = sim.workers.keys().nth(i % count).copied() {
                        sim.leave(worker);
                    }
                }
                Step::Report => sim.report_all(),
                Step::Ask(direct) => {
                    asked += 1;
                    sim.ask(direct);
                }
                Step::Answer(i) => {
                    if let Some(view_id) = nth(&sim.orders, i) {
                        sim.answer(view_id);
                    }
                }
                Step::Fail(i, last) => {
                    if let Some(view_id) = nth(&sim.orders, i) {
                        let attempt = sim.orders[&view_id].attempt;
                        let failure = if last { Failure::Final } else { Failure::TryElsewhere };
                        sim.orders.remove(&view_id);
                        ended += usize::from(last);
                        sim.step(Event::Failed { view_id, attempt, failure });
                    }
                }
                Step::Cancel(i) => {
                    if let Some(view_id) = nth(&sim.orders, i) {
                        sim.orders.remove(&view_id);
                        ended += 1;
                        sim.step(Event::Cancelled { view_id });
                    }
                }
                Step::Pass(ms) => {
                    sim.now = sim.now.after(Duration::from_millis(ms.into()));
                    sim.step(Event::Tick);
                }
            }
            let closed = sim.answered.len() + sim.refused.len() + ended;
            prop_assert_eq!(asked, closed + sim.core.views_in_flight());
            let status = sim.core.status();
            if status.processes >= 2 && sim.core.workers().split() != balance::Split::AllDirect {
                prop_assert!(status.samplers >= 1 && status.compositors >= 1, "{:?}", status.workers);
            }
        }
        // With workers and enough time, all views in flight are answered or refused.
        for round in 0..20 {
            if sim.workers.is_empty() {
                sim.join(&format!("late{round}"));
            }
            sim.report_all();
            sim.answer_all();
        }
        prop_assert_eq!(sim.core.views_in_flight(), 0);
    }
}
