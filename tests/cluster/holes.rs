//! Pixels that no sample saw, across processes: they are traced on request, and never cost a frame.

use std::process::Stdio;
use std::time::Duration;

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, SMALL, argus, json};
use argus_scene::{Camera, Frame, Holes, Output, Outputs, Plan, PlanRequest, View};
use glam::DVec3;
use serde_json::Value;

/// Mask values of pixels that no sample saw: guessed, and traced.
const GUESSED: u8 = 255;
const TRACED: u8 = 128;

/// A view of the side of the terrain that a single sample from above the far corner does not see.
fn low_view(plan: PlanRequest) -> View {
    let camera = Camera::look_at(DVec3::new(60.0, 12.0, 60.0), DVec3::new(0.0, 4.0, 0.0));
    let view = View { plan: PlanRequest { samples: Some(1), ..plan }, ..small_view(camera) };
    View { outputs: view.outputs.with(Output::Confidence), ..view }
}

fn bytes(frame: &Frame, output: Output) -> Vec<u8> {
    frame.images[output].as_ref().unwrap().to_vec()
}

fn pixels_of(frame: &Frame) -> u64 {
    u64::from(frame.width) * u64::from(frame.height)
}

#[tokio::test(flavor = "multi_thread")]
async fn traced_holes_equal_the_direct_view_and_other_pixels_stay_the_same() {
    // Frames are compared, so no sample may be added between them for the holes of the first. Neighbours of a view share rays
    // to the sky, which single pixels cast alone: without them both have the same light.
    let coordinator = Coordinator::start(SMALL, &["--refining-share", "0", "--effects", "none"]);
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    let mut wire = Wire::connect(&coordinator.url).await;
    for supersampling in [1, 2] {
        let plan = PlanRequest { supersampling: Some(supersampling), ..PlanRequest::from_samples() };
        let marked = PlanRequest { holes: Some(Holes::Mark), ..plan };
        let trace = PlanRequest { holes: Some(Holes::Trace), ..plan };
        let (marked, _) = wire.render((&low_view(marked)).into()).await.unwrap();
        let (traced, meta) = wire.render((&low_view(trace)).into()).await.unwrap();
        let direct = PlanRequest { direct: true, ..plan };
        let direct = View { outputs: Outputs::COLOR.with(Output::Range), ..low_view(direct) };
        let (direct, _) = wire.render((&direct).into()).await.unwrap();

        let holes = bytes(&marked, Output::Mask).iter().filter(|value| **value == GUESSED).count();
        assert!(holes > 20, "only {holes} pixels to trace");
        assert_eq!(traced.unresolved_fraction, 0.0);
        assert_eq!((traced.served.traced, traced.served.unresolved), (holes as u64, 0));
        let ways = traced.served;
        assert_eq!(ways.warped + ways.other_sample + ways.traced, pixels_of(&traced));
        let Plan::Warp(warp) = &traced.provenance.plan else { panic!("a warp") };
        assert_eq!(warp.holes, Holes::Trace, "made by {}", meta.worker);
        assert!(traced.stages.iter().any(|stage| stage.name == "trace holes" && stage.ms > 0.0));

        let (was, is) = (bytes(&marked, Output::Mask), bytes(&traced, Output::Mask));
        let (mut equal, mut same_range) = (0, 0);
        for pixel in 0..was.len() {
            let part = |frame: &Frame, output: Output| {
                let n = output.pixel_bytes();
                bytes(frame, output)[pixel * n..(pixel + 1) * n].to_vec()
            };
            if was[pixel] == GUESSED {
                assert_eq!(is[pixel], TRACED);
                assert_eq!(part(&traced, Output::Confidence), [255]);
                assert_eq!(part(&traced, Output::Source), [0]);
                let near = |(a, b): (&u8, &u8)| a.abs_diff(*b) <= 2;
                let (a, b) = (part(&traced, Output::Color), part(&direct, Output::Color));
                equal += usize::from(a.iter().zip(&b).all(near));
                let metres = |frame| f32::from_le_bytes(part(frame, Output::Range).try_into().unwrap());
                let (a, b): (f32, f32) = (metres(&traced), metres(&direct));
                same_range += usize::from(a == b || (a - b).abs() <= 1e-3 * b);
            } else {
                for output in marked.images.iter().map(|(output, _)| output) {
                    assert_eq!(part(&traced, output), part(&marked, output), "{output:?} of {pixel}");
                }
            }
        }
        // Another visibility backend may find another triangle along an edge.
        assert!(equal * 100 >= holes * 97, "{equal} of {holes} have the direct view's colour");
        assert!(same_range * 100 >= holes * 97, "{same_range} of {holes} have the direct view's range");
    }
    // Demand is counted at once, its cost with the worker's next report.
    let is_some = |status: &Value, key: &str| status[key].as_f64() > Some(0.0);
    let rays = |status: &Value| is_some(status, "rays_per_tick") && is_some(status, "ray_ms");
    coordinator.wait_until("the rays are accounted for", rays);

    // The same by the command, without the mask.
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("view.png");
    let place = ["--eye", "60,12,60", "--target", "0,4,0", "--size", "96x72", "--samples", "1"];
    let more = ["--holes", "trace", "--json", "--out", out.to_str().unwrap()];
    let view = json(&[&["view", "--server", &coordinator.url][..], &place, &more].concat());
    assert_eq!(view["holes"], "trace", "{view:#}");
    assert_eq!(view["served"]["unresolved"], 0, "{view:#}");
    assert!(view["served"]["traced"].as_u64() > Some(20), "{view:#}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_single_worker_traces_its_own_holes() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _worker = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let mut wire = Wire::connect(&coordinator.url).await;
    let trace = PlanRequest { holes: Some(Holes::Trace), ..PlanRequest::default() };
    let (frame, _) = wire.render((&low_view(trace)).into()).await.unwrap();
    assert_eq!(frame.unresolved_fraction, 0.0);
    assert!(frame.served.traced > 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sampler_killed_while_tracing_costs_no_frame() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let mut workers = coordinator.workers(3);
    let sampler = |status: &Value| {
        let there = status["processes"] == 3;
        let workers = status["workers"].as_array().filter(|_| there)?;
        workers.iter().find(|worker| worker["role"] == "sampler").cloned()
    };
    let status = coordinator.wait_until("three workers, one of them a sampler", |s| sampler(s).is_some());
    let pid = sampler(&status).unwrap()["pid"].as_u64().unwrap() as u32;
    let mut command = argus(&["load", "--server", &coordinator.url, "--json", "--size", "96x72"]);
    command.args(["--clients", "3", "--seconds", "6", "--rate", "8", "--samples", "1", "--holes", "trace"]);
    let load = command.stdout(Stdio::piped()).spawn().unwrap();
    tokio::time::sleep(Duration::from_secs(2)).await;
    workers.iter_mut().find(|worker| worker.pid() == pid).unwrap().kill();
    let output = load.wait_with_output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["sent"].as_u64() > Some(0), "{report:#}");
    assert_eq!(report["answered"], report["sent"], "{report:#}");
    assert_eq!(report["failed"], 0, "{report:#}");
}
