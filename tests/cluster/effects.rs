//! What effects of light cost, as a service says it.

use std::time::Instant;

use argus_scene::effects::{EffectKind, EffectRow};
use argus_scene::{EffectPlan, PlanRequest, View};

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, PATIENCE, SMALL};

/// The milliseconds of a row: predicted, measured and saved.
fn ms(row: &EffectRow) -> [Option<f64>; 3] {
    [row.predicted_ms, row.measured_ms, row.saved_ms]
}

/// The service's plan once it satisfies a condition.
async fn plan_with(wire: &mut Wire, what: &str, condition: impl Fn(&EffectPlan) -> bool) -> EffectPlan {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let plan = wire.describe().await.effect_plan;
        if condition(&plan) {
            return plan;
        }
        assert!(Instant::now() < deadline, "not in time: {what}; {plan:#?}");
        tokio::time::sleep(std::time::Duration::from_millis(200)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_says_what_its_effects_cost_and_what_those_that_are_off_would() {
    let coordinator = Coordinator::start(SMALL, &["--effects=shadows"]);
    let mut wire = Wire::connect(&coordinator.url).await;
    let before = wire.describe().await.effect_plan;
    assert_eq!(
        ms(before.row(EffectKind::Shadows).unwrap()),
        [None; 3],
        "nothing is measured without a worker"
    );
    let _worker = coordinator.worker(&[]);
    coordinator.wait_until("the price of views", |status| status["workers"][0]["direct_cost"].is_object());
    let has = |plan: &EffectPlan, effect, which: usize| {
        ms(plan.row(effect).unwrap())[which].is_some_and(|ms| ms > 0.0)
    };
    assert!(
        has(&wire.describe().await.effect_plan, EffectKind::Shadows, 0),
        "known as soon as the price of views"
    );

    let plan = plan_with(&mut wire, "the sky's cost", |plan| has(plan, EffectKind::SkyVisibility, 2)).await;
    let [predicted, measured, saved] = ms(plan.row(EffectKind::SkyVisibility).unwrap());
    assert_eq!((predicted, measured), (saved, None), "it is off, so no view shows it");
    for row in plan.rows.iter().filter(|row| !row.on && row.causes.is_empty()) {
        assert_eq!(ms(row), [None; 3], "{row:?}");
    }

    let camera = wire.describe().await.cameras[0].camera;
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    wire.render((&View { plan: direct, ..small_view(camera) }).into()).await.unwrap();
    plan_with(&mut wire, "the cost in answered views", |plan| has(plan, EffectKind::Shadows, 1)).await;
}
