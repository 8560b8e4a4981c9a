//! Objects that reflect the scene, across processes: reflection maps are transferred like samples.

use crate::support::wire::Wire;
use crate::support::{Coordinator, run, stderr};
use argus_scene::{Output, Outputs, Plan, PlanRequest, View};

const SCENE: &str = "mirrors:6";

/// Held still, with a fixed visibility backend: on a busy machine two clusters may measure different ones as cheapest.
const STILL: [&str; 5] =
    ["--time-scale=0", "--face=192", "--cell=1", "--refining-share=0", "--visibility=raster"];

const MAPS: [&str; 3] = ["--reflections=maps", "--reflection-side=32", "--reflection-levels=7"];

fn image(frame: &argus_scene::Frame) -> image::RgbImage {
    let color = frame.images[Output::Color].as_ref().unwrap().to_vec();
    image::RgbImage::from_raw(frame.width, frame.height, color).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn views_show_reflections_and_two_workers_give_the_bytes_of_one() {
    let cluster = Coordinator::start(SCENE, &[&STILL[..], &MAPS].concat());
    let _workers = cluster.workers(2);
    cluster.wait_for_workers(2);
    let mut of_many = Wire::connect(&cluster.url).await;
    let camera = of_many.describe().await.cameras[0].camera;
    let view =
        View::new(camera, [160, 120], PlanRequest { supersampling: Some(2), ..PlanRequest::from_samples() });
    let (frame, _) = of_many.render((&view).into()).await.unwrap();
    let Plan::Warp(warp) = &frame.provenance.plan else { panic!("a warp") };
    let of_probes = warp.samples.iter().filter(|id| id.is_reflection_probe()).count();
    assert_eq!(of_probes, 1, "beside samples of the rig: {:?}", warp.samples);
    let specification = frame.provenance.specification.unwrap().to_string();
    assert!(specification.contains(" maps of 32 from 7 levels, at most 256;"), "{specification}");

    // A direct view uses the same maps.
    let direct = PlanRequest { direct: true, supersampling: Some(2), ..PlanRequest::default() };
    let (exact, _) = of_many.render((&View { plan: direct, ..view.clone() }).into()).await.unwrap();
    let specification = frame.provenance.specification.unwrap();
    assert_eq!(exact.provenance.specification.unwrap().reflections, specification.reflections);
    let flip = |a: &argus_scene::Frame, b: &argus_scene::Frame| {
        argus_scene::metrics::compare(&image(a), &image(b)).unwrap().flip_mean
    };
    let off = flip(&exact, &frame);

    // Without maps, reflectors look different.
    let plain = Coordinator::start(SCENE, &[&STILL[..], &["--reflections=off"]].concat());
    let _worker = plain.worker(&[]);
    plain.wait_for_workers(1);
    let (without, _) = Wire::connect(&plain.url).await.render((&view).into()).await.unwrap();
    let bare = flip(&exact, &without);
    assert!(off < 0.1 && off < 0.6 * bare, "FLIP {off} of the warped view, {bare} without maps");
    let pinned = View { pin: Some(frame.provenance.clone()), plan: PlanRequest::from_samples(), ..view };
    let refused = Wire::connect(&plain.url).await.render((&pinned).into()).await.unwrap_err();
    assert!(refused.message().contains("reflections"), "{refused:?}");

    // One process gives the same bytes.
    let single = Coordinator::start(SCENE, &[&STILL[..], &MAPS].concat());
    let _worker = single.worker(&[]);
    single.wait_for_workers(1);
    let (alone, _) = Wire::connect(&single.url).await.render((&pinned).into()).await.unwrap();
    assert_eq!(alone.provenance, frame.provenance);
    assert!(alone.images[Output::Color] == frame.images[Output::Color]);
}

#[tokio::test(flavor = "multi_thread")]
async fn moving_objects_are_reflected_at_their_positions_by_points() {
    let flags = ["--face=96", "--cell=2", "--refining-share=0", "--visibility=raster", "--epoch-ms=1500"];
    let points = ["--reflections=points", "--reflection-side=32"];
    let cluster = Coordinator::start(SCENE, &[&flags[..], &points].concat());
    let _workers = cluster.workers(2);
    cluster.wait_for_workers(2);
    let mut wire = Wire::connect(&cluster.url).await;
    let camera = wire.describe().await.cameras[0].camera;
    let (width, height) = (64, 48);
    let (outputs, plan) = (Outputs::COLOR, PlanRequest::from_samples());
    let view = View { camera, width, height, outputs, plan, pin: None, flow_to: None, rays: None };
    let mut epochs = Vec::new();
    let until = std::time::Instant::now() + std::time::Duration::from_secs(60);
    while epochs.len() < 3 && std::time::Instant::now() < until {
        let (frame, _) = wire.render((&view).into()).await.unwrap();
        let Plan::Warp(warp) = &frame.provenance.plan else { panic!("a warp") };
        assert!(warp.samples.iter().all(|id| id.version == warp.samples[0].version), "{:?}", warp.samples);
        assert!(warp.samples.iter().any(argus_scene::SampleId::is_reflection_probe));
        let specification = frame.provenance.specification.unwrap().to_string();
        assert!(specification.contains(" maps of 32 from 4194304 points, at most 256, seen by 48 pixels"));
        if epochs.last() != Some(&frame.provenance.state.epoch) {
            epochs.push(frame.provenance.state.epoch);
        }
    }
    assert_eq!(epochs.len(), 3, "time passes: {epochs:?}");
}

#[test]
fn maps_that_cannot_be_rendered_are_refused_at_the_start() {
    let refused = |more: &[&str]| {
        let scene = ["coordinator", "--scene", SCENE, "--listen", "127.0.0.1:0"];
        let output = run(&[&scene[..], more].concat());
        assert!(!output.status.success());
        stderr(&output)
    };
    let side = refused(&["--reflections=maps", "--reflection-side=48"]);
    assert!(side.contains("--reflection-side") && side.contains("64"), "{side}");
    let points = refused(&["--reflections=points", "--reflection-points=7"]);
    assert!(points.contains("--reflection-points") && points.contains("1024"), "{points}");
    let word = refused(&["--set", "coordinator.reflections=waves"]);
    assert!(word.contains("reflections") && word.contains("auto, off, maps, points or rays"), "{word}");
    let both = refused(&["--reflections=maps", "--sampling=megaviews"]);
    assert!(both.contains("reflections") && both.contains("megaviews"), "{both}");
}
