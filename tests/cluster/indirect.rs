//! Indirect light across processes: it is in samples and in direct views.

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, SMALL, run, stderr};
use argus_scene::{Frame, Outputs, PlanRequest, View};

fn brightness(frame: &Frame) -> f64 {
    let color = frame.color.as_ref().unwrap();
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
        let cluster = Coordinator::start(SMALL, &["--rig=cell", "--face=64", "--refining-share=0"]);
        let _worker = cluster.worker(light);
        cluster.wait_for_workers(1);
        let mut wire = Wire::connect(&cluster.url).await;
        let camera = wire.describe().await.cameras[0].camera;
        let view = View { outputs: Outputs::COLOR, ..small_view(camera) };
        let direct = View { plan: PlanRequest { direct: true, ..PlanRequest::default() }, ..view.clone() };
        let (warped, _) = wire.render((&view).into()).await.unwrap();
        let (direct, _) = wire.render((&direct).into()).await.unwrap();
        let device = &direct.provenance.device;
        assert_eq!(device.contains("indirect light by"), says.is_some(), "{device}");
        assert!(device.contains(says.unwrap_or_default()), "{device}");
        shown.push([brightness(&warped), brightness(&direct)]);
    }
    let [off, vpl, points] = shown[..] else { panic!("three") };
    for way in [0, 1] {
        let (vpl, points) = (vpl[way] - off[way], points[way] - off[way]);
        assert!(vpl > 0.0 && points > 0.0, "{vpl} by VPLs, {points} by points, of {off:?}");
    }
}

#[test]
fn particles_without_indirect_light_are_refused_at_the_start() {
    for command in ["serve", "worker"] {
        let mut arguments = vec![command, "--indirect", "points", "--particles", "8"];
        if command == "worker" {
            arguments.extend(["--coordinator", "http://127.0.0.1:9"]);
        }
        let output = run(&arguments);
        assert!(!output.status.success());
        assert!(stderr(&output).contains("--particles"), "{}", stderr(&output));
    }
}
