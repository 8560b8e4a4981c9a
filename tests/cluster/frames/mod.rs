//! Views that are warped from recent direct frames, through a service and by hand.

mod hard_cases;

use std::time::{Duration, Instant};

use argus_client::{Client, RenderOptions};
use argus_scene::{Camera, Frame, Output, Outputs, Plan, PlanRequest, View, metrics};
use glam::DVec3;
use image::RgbImage;

use crate::support::{Coordinator, SMALL};

/// Steady light and exposure, so that views of two clusters can be compared.
const FIXED: [&str; 6] = ["--effects", "all", "--indirect", "off", "--exposure", "0"];

/// Longest wait until a worker has measured what views from frames cost.
const PATIENCE: Duration = Duration::from_secs(90);

fn view(camera: Camera) -> View {
    let (outputs, plan) = (Outputs::COLOR, PlanRequest::default());
    View { camera, width: 320, height: 240, outputs, plan, pin: None, flow_to: None, rays: None }
}

/// The camera, moved to its right by a share of its distance from its target.
fn aside(camera: &Camera, share: f64) -> Camera {
    let ahead = camera.target - camera.eye;
    let step = ahead.cross(camera.up).normalize() * ahead.length() * share;
    Camera { eye: camera.eye + step, target: camera.target + step, ..*camera }
}

fn image_of(frame: &Frame) -> RgbImage {
    RgbImage::from_raw(frame.width, frame.height, frame.images[Output::Color].as_ref().unwrap().to_vec())
        .unwrap()
}

async fn rendered(client: &Client, view: &View) -> Frame {
    client.render(view, &RenderOptions::default()).await.unwrap().frame
}

/// Walks until a view is warped from frames. Returns the view and its frame.
async fn warped(client: &Client) -> (View, Frame) {
    let camera = client.description().cameras[0].camera;
    let began = Instant::now();
    for step in 0.. {
        let share = 0.02 * (f64::from(step) * 0.3).sin();
        let view = view(aside(&camera, share));
        let frame = rendered(client, &view).await;
        if !frame.provenance.plan.frames().is_empty() {
            return (view, frame);
        }
        assert!(began.elapsed() < PATIENCE, "no view is warped from frames");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    unreachable!("the loop ends by its deadline")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_view_near_a_direct_frame_is_warped_from_it_and_its_pin_repeats_it_on_another_cluster() {
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let client = Client::connect(&coordinator.url).await.unwrap();
    let (view, frame) = warped(&client).await;
    let Plan::Warp(warp) = &frame.provenance.plan else { panic!("a warp") };
    assert!(warp.samples.is_empty() && (1..=4).contains(&warp.frames.len()));
    assert!(frame.unresolved_fraction < 0.03, "{} is guessed", frame.unresolved_fraction);
    let (pixels, served) = (u64::from(frame.width) * u64::from(frame.height), frame.served);
    assert_eq!(served.warped + served.other_sample + served.traced + served.unresolved, pixels);

    // It is nearly as near the truth as a direct view.
    let by = |supersampling| {
        let plan = PlanRequest { direct: true, supersampling, ..PlanRequest::default() };
        View { plan, ..view.clone() }
    };
    let truth = image_of(&rendered(&client, &by(Some(4))).await);
    let direct = image_of(&rendered(&client, &by(None)).await);
    let error = |image: &RgbImage| metrics::flip_mean(&truth, image).unwrap();
    let (warped, direct) = (error(&image_of(&frame)), error(&direct));
    assert!(warped - direct < 0.03, "{warped} against {direct}");

    // The status and the provenance say what it was made of.
    let holds_frames = |status: &serde_json::Value| status["workers"][0]["frames_held"].as_u64() > Some(0);
    coordinator.wait_until("a report of held frames", holds_frames);
    let status = coordinator.status();
    assert_eq!(frame.provenance.device, workers_device(&status));

    // A cluster that holds nothing renders the frames of the pin again.
    drop(workers);
    let other = Coordinator::start(SMALL, &FIXED);
    let _workers = other.workers(2);
    other.wait_for_workers(2);
    let fresh = Client::connect(&other.url).await.unwrap();
    let pinned = View { pin: Some(frame.provenance.clone()), ..view };
    let again = rendered(&fresh, &pinned).await;
    assert_eq!(again.provenance, frame.provenance);
    assert!(again.images[Output::Color] == frame.images[Output::Color], "equal bytes");
}

fn workers_device(status: &serde_json::Value) -> &str {
    status["workers"][0]["device"].as_str().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn pinned_frames_much_larger_or_finer_than_the_view_are_refused_by_field() {
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let client = Client::connect(&coordinator.url).await.unwrap();
    let camera = client.description().cameras[0].camera;
    let frame = rendered(&client, &view(camera)).await;
    let source = argus_scene::FrameSource {
        camera,
        width: 320,
        height: 240,
        samples_per_pixel: 1,
        band_rows: 0,
        light: None,
    };
    let pin = |source| {
        let plan = Plan::Warp(argus_scene::Warp { frames: vec![source], ..argus_scene::Warp::default() });
        let provenance = argus_scene::Provenance { plan, ..frame.provenance.clone() };
        View { pin: Some(provenance), ..view(camera) }
    };
    let refused = |view: View| {
        let client = &client;
        async move { client.render(&view, &RenderOptions::default()).await.unwrap_err().to_string() }
    };
    let larger = argus_scene::FrameSource { width: 641, height: 480, ..source };
    assert!(refused(pin(larger)).await.contains("pin.plan.warp.frames"));
    let finer = argus_scene::FrameSource { samples_per_pixel: 64, ..source };
    assert!(refused(pin(finer)).await.contains("pin.plan.warp.frames"));
    // A frame of the view's own camera is the view itself, to within rounding.
    let again = rendered(&client, &pin(source)).await;
    let most = |a: &Frame, b: &Frame| {
        let pairs = a.images[Output::Color]
            .as_ref()
            .unwrap()
            .iter()
            .zip(b.images[Output::Color].as_ref().unwrap().iter());
        pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
    };
    assert!(most(&again, &frame) <= 1, "{}", most(&again, &frame));
    let away = Camera { target: camera.eye + DVec3::Y * 2.0 + (camera.eye - camera.target), ..camera };
    let beyond = View { camera: away, ..pin(source) };
    let frame = rendered(&client, &beyond).await;
    assert_eq!(frame.unresolved_fraction, 0.0, "a view that no frame saw is traced as a whole");
}
