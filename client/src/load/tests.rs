use argus_scene::scene::NamedCamera;
use argus_scene::{Bounds, Camera, Limits, PlanRequest, Rig, SceneHash};
use glam::DVec3;

use super::*;
use argus_proto::Description;

pub(super) fn description(eyes: &[DVec3]) -> Description {
    let camera = |eye: &DVec3| NamedCamera {
        name: String::new(),
        camera: Camera::look_at(*eye, DVec3::new(0.0, 1.0, 0.5)),
    };
    let bounds = Bounds { min: DVec3::splat(-10.0), max: DVec3::splat(10.0) };
    Description {
        scene_name: "room".to_owned(),
        scene_hash: SceneHash([0; 32]),
        bounds,
        triangles: 12,
        effects: Vec::new(),
        effect_plan: argus_scene::EffectPlan::default(),
        cameras: eyes.iter().map(camera).collect(),
        limits: Limits::default(),
        rig: Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 },
        defaults: PlanRequest::default(),
        epoch_secs: 0.0,
        first_light: argus_scene::LightLevel::Full,
        light: String::new(),
        scenes: Vec::new(),
    }
}

#[test]
fn camera_paths_are_deterministic_valid_and_distinct() {
    let description = description(&[DVec3::new(4.0, 1.0, 3.0), DVec3::new(30.0, 20.0, 40.0)]);
    let mut seen = Vec::new();
    for index in 0..100 {
        let path = CameraPath::new(&description, index);
        assert_eq!(path, CameraPath::new(&description, index));
        for secs in [0.0, 0.1, 3.3, 1e6] {
            let camera = path.camera(secs);
            camera.validate().unwrap();
            assert_eq!(camera, path.camera(secs));
            assert!(!seen.contains(&camera), "client {index} at {secs} s repeats a camera");
            seen.push(camera);
        }
    }
}

#[test]
fn paths_inside_stay_inside_and_paths_outside_keep_their_target() {
    let (inside, outside) = (DVec3::new(9.7, 0.0, 9.7), DVec3::new(0.0, 25.0, 40.0));
    let description = description(&[inside, outside]);
    for secs in (0..200).map(|i| f64::from(i) * 0.1) {
        let camera = CameraPath::new(&description, 0).camera(secs);
        assert!(description.bounds.contains(camera.eye));
        let camera = CameraPath::new(&description, 1).camera(secs);
        assert!(!description.bounds.contains(camera.eye));
        assert_eq!(camera.target, description.cameras[1].camera.target);
    }
}

#[test]
fn a_camera_that_looks_almost_straight_down_has_a_valid_path() {
    let down = DVec3::new(1e-5, 30.0, 0.5);
    let description = description(&[down]);
    for secs in [0.0, 1.0, 2.0] {
        CameraPath::new(&description, 0).camera(secs).validate().unwrap();
    }
}

#[test]
fn schedules_are_fixed_and_spread_the_clients_over_an_interval() {
    let description = description(&[DVec3::new(4.0, 1.0, 3.0)]);
    let schedule = Schedule {
        client: 0,
        cameras: Arc::new(move |index, secs| CameraPath::new(&description, index).camera(secs)),
        size: [20, 10],
        plan: PlanRequest::default(),
        phase: Duration::from_millis(5),
        rate: 4.0,
        views: 3,
    };
    let due: Vec<u128> = schedule.due().map(|(due, _)| due.as_millis()).collect();
    assert_eq!(due, [5, 255, 505]);
}

#[test]
fn merged_tallies_add_up_and_a_load_without_answers_has_no_nan() {
    let (mut a, mut b) = (Tally::new(), Tally::new());
    a.answer(Duration::from_millis(10), Duration::from_millis(30));
    a.sent = 1;
    b.sent = 2;
    b.fail(&ClientError::Overloaded { message: "full".to_owned(), retry_after: None });
    b.answer(Duration::from_millis(10), Duration::from_millis(2010));
    a.merge(&b);
    let report = a.report(Duration::from_secs(1));
    assert_eq!((report.sent, report.answered, report.rejected), (3, 2, 1));
    assert!((report.latency_ms.max - 2000.0).abs() < 2.0, "{:?}", report.latency_ms);
    assert!((report.latency_ms.p50 - 20.0).abs() < 0.1);
    assert!((report.views_per_sec - 2.0 / 2.01).abs() < 1e-9);
    let nothing = Tally::new().report(Duration::ZERO);
    assert_eq!((nothing.views_per_sec, nothing.latency_ms), (0.0, LatencyMs::default()));
}
