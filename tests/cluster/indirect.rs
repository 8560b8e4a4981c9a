//! Indirect light across processes: samples and direct views show that of the coordinator.

use std::time::{Duration, Instant};

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, SMALL, run, stderr};
use argus_scene::{Frame, Indirect, LightLevel, Output, Outputs, PlanRequest, Provenance, SceneState, View};

fn brightness(frame: &Frame) -> f64 {
    let color = frame.images[Output::Color].as_ref().unwrap();
    color.iter().map(|&byte| f64::from(byte)).sum::<f64>() / color.len() as f64
}

#[tokio::test(flavor = "multi_thread")]
async fn light_from_surface_to_surface_is_in_samples_and_in_direct_views() {
    let mut shown = Vec::new();
    for (light, says) in [
        (&["--indirect=off"] as &[&str], None),
        (&["--indirect=vpl", "--vpls=256"], Some("256 VPLs of 1 bounces")),
        (&["--indirect=points", "--point-levels=5", "--point-block=16"], Some("points of 5 levels")),
    ] {
        let flags = ["--rig=cell", "--face=64", "--refining-share=0", "--effects=none", "--exposure=0"];
        let cluster = Coordinator::start(SMALL, &[&flags[..], light].concat());
        let _worker = cluster.worker(&[]);
        cluster.wait_for_workers(1);
        let mut wire = Wire::connect(&cluster.url).await;
        let camera = wire.describe().await.cameras[0].camera;
        let view = View { outputs: Outputs::COLOR, ..small_view(camera) };
        let direct = View { plan: PlanRequest { direct: true, ..PlanRequest::default() }, ..view.clone() };
        let (warped, _) = wire.render((&view).into()).await.unwrap();
        let (direct, _) = wire.render((&direct).into()).await.unwrap();
        for frame in [&warped, &direct] {
            let specification = frame.provenance.specification.unwrap();
            assert_eq!(specification.indirect != Indirect::Off, says.is_some(), "{specification}");
            assert!(specification.to_string().contains(says.unwrap_or_default()), "{specification}");
            assert!(!frame.provenance.device.contains(';'), "{}", frame.provenance.device);
        }
        shown.push([brightness(&warped), brightness(&direct)]);
    }
    let [off, vpl, points] = shown[..] else { panic!("three") };
    for way in [0, 1] {
        let (vpl, points) = (vpl[way] - off[way], points[way] - off[way]);
        assert!(vpl > 0.0 && points > 0.0, "{vpl} by VPLs, {points} by points, of {off:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn light_rises_while_views_are_answered_and_a_pin_shows_an_earlier_level() {
    let flags = ["--indirect=paths", "--rig=cell", "--face=64", "--refining-share=0", "--exposure=0"];
    let cluster = Coordinator::start(SMALL, &flags);
    let _workers = [cluster.worker(&[]), cluster.worker(&[])];
    cluster.wait_for_workers(2);
    let mut wire = Wire::connect(&cluster.url).await;
    let camera = wire.describe().await.cameras[0].camera;
    let view = View { outputs: Outputs::COLOR, ..small_view(camera) };
    let direct_view = View { plan: PlanRequest { direct: true, ..PlanRequest::default() }, ..view.clone() };
    let mut shown: Vec<Frame> = Vec::new();
    let began = Instant::now();
    loop {
        let (warped, _) = wire.render((&view).into()).await.unwrap();
        let (direct, _) = wire.render((&direct_view).into()).await.unwrap();
        let light = direct.provenance.state.light;
        assert!(warped.provenance.state.light <= light, "light does not fall");
        match shown.last().filter(|last| last.provenance.state.light == light) {
            Some(last) => {
                assert_eq!(last.images[Output::Color], direct.images[Output::Color], "a level has one image")
            }
            None => shown.push(direct),
        }
        if warped.provenance.state.light == LightLevel::Full {
            break;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "light stays {light}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let levels: Vec<LightLevel> = shown.iter().map(|frame| frame.provenance.state.light).collect();
    assert!(levels.is_sorted(), "{levels:?}");
    let full = shown.last().unwrap();
    let state = SceneState { light: LightLevel::Direct, ..full.provenance.state };
    let pin = Some(Provenance { state, ..full.provenance.clone() });
    let (pinned, _) = wire.render((&View { pin, ..direct_view }).into()).await.unwrap();
    assert_eq!(pinned.provenance.state, state);
    assert!(brightness(full) > brightness(&pinned), "surfaces light one another");
}

#[test]
fn particles_without_indirect_light_are_refused_at_the_start() {
    for command in ["serve", "coordinator"] {
        let output = run(&[command, "--scene", SMALL, "--indirect", "points", "--particles", "8"]);
        assert!(!output.status.success());
        assert!(stderr(&output).contains("--particles"), "{}", stderr(&output));
    }
}

#[test]
fn a_worker_does_not_choose_its_own_light() {
    for flag in ["--indirect=vpl", "--particles=8", "--sub-samples=1", "--reflections=maps"] {
        let output = run(&["worker", "--coordinator", "http://127.0.0.1:9", flag]);
        assert_eq!(output.status.code(), Some(2));
        let name = flag.split('=').next().unwrap();
        assert!(stderr(&output).contains(name), "{}", stderr(&output));
    }
}
