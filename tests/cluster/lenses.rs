//! Calibrated, distorted and equirectangular cameras over gRPC, in every way to answer a view.

use std::time::{Duration, Instant};

use argus_client::{Batch, Client, Encoding, RenderOptions};
use argus_proto::status::invalid_field;
use argus_proto::v1;
use argus_scene::{
    Camera, Distortion, Frame, Intrinsics, Lens, Output, Outputs, Plan, PlanRequest, RayList, View, metrics,
};
use futures::StreamExt;
use glam::{DVec2, Vec3};
use image::RgbImage;
use tonic::Code;

use crate::support::wire::{Wire, small_view};
use crate::support::{Coordinator, SMALL};

/// Nothing is refined, and light does not depend on which pixels share it.
const FIXED: [&str; 4] = ["--refining-share", "0", "--effects", "none"];
const PATIENCE: Duration = Duration::from_secs(120);

fn calibrated(camera: Camera, distortion: Distortion) -> Camera {
    let (focal, center) = (DVec2::new(80.0, 90.0), DVec2::new(30.0, 60.0));
    Camera { lens: Some(Lens::Intrinsics(Intrinsics { focal, center, distortion })), ..camera }
}

fn lenses(camera: Camera) -> [(&'static str, Camera); 4] {
    [
        ("off-centre", calibrated(camera, Distortion::None)),
        ("distorted", calibrated(camera, Distortion::Rational([-0.2, 0.03, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]))),
        ("fisheye", calibrated(camera, Distortion::Fisheye([0.01, 0.0, 0.0, 0.0]))),
        ("equirectangular", Camera { lens: Some(Lens::Equirectangular), ..camera }),
    ]
}

fn view(camera: Camera, plan: PlanRequest) -> View {
    let outputs = Outputs::COLOR.with(Output::Range);
    View { outputs, plan, ..small_view(camera) }
}

fn image_of(frame: &Frame) -> RgbImage {
    RgbImage::from_raw(frame.width, frame.height, frame.images[Output::Color].as_ref().unwrap().to_vec())
        .unwrap()
}

async fn rendered(client: &Client, view: &View) -> Frame {
    client.render(view, &RenderOptions::default()).await.unwrap().frame
}

#[tokio::test(flavor = "multi_thread")]
async fn every_lens_is_answered_alike_by_views_pins_and_batches() {
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _workers = coordinator.workers(2);
    coordinator.wait_for_workers(2);
    let client = Client::connect(&coordinator.url).await.unwrap();
    let usual = client.description().cameras[0].camera;
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    let mut alone = Vec::new();
    for (name, camera) in lenses(usual) {
        let frame = rendered(&client, &view(camera, direct)).await;
        let colours: std::collections::BTreeSet<_> = image_of(&frame).pixels().map(|p| p.0).collect();
        assert!(colours.len() > 50, "{name}: {} colours", colours.len());
        let pinned = View { pin: Some(frame.provenance.clone()), ..view(camera, PlanRequest::default()) };
        let again = rendered(&client, &pinned).await;
        assert!(again.images == frame.images, "{name}");
        if !camera.is_pinhole() {
            // The planner offers nothing but triangles.
            let open = rendered(&client, &view(camera, PlanRequest::default())).await;
            assert_eq!(open.provenance.plan, Plan::direct(1), "{name}");
            assert!(open.images[Output::Color] == frame.images[Output::Color], "{name}");
        }
        alone.push(frame);
    }
    let batch = Batch {
        cameras: lenses(usual).map(|(_, camera)| camera).to_vec(),
        width: alone[0].width,
        height: alone[0].height,
        outputs: Outputs::COLOR,
        plan: direct,
    };
    let frames: Vec<_> = client.render_batch(batch, Encoding::Unspecified).collect().await;
    assert_eq!(frames.len(), 4);
    for (index, result) in frames {
        let (frame, _) = result.unwrap();
        assert!(
            frame.images[Output::Color] == alone[index].images[Output::Color],
            "camera {index} of the batch"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn off_centre_views_come_from_samples_and_from_frames_like_any_pinhole() {
    // Views are warped from frames only where light makes triangles dear.
    let coordinator =
        Coordinator::start(SMALL, &["--effects", "all", "--indirect", "off", "--exposure", "0"]);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let client = Client::connect(&coordinator.url).await.unwrap();
    let usual = client.description().cameras[0].camera;
    let camera = calibrated(usual, Distortion::None);
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    let truth = image_of(&rendered(&client, &view(camera, direct)).await);
    let sampled = rendered(&client, &view(camera, PlanRequest::from_samples())).await;
    let flip = metrics::flip_mean(&truth, &image_of(&sampled)).unwrap();
    assert!(flip < 0.12, "from samples: FLIP {flip}");

    // A walk, until a view is warped from frames of others.
    let began = Instant::now();
    for step in 0.. {
        let ahead = usual.target - usual.eye;
        let right = ahead.cross(usual.up).normalize() * ahead.length();
        let aside = right * 0.02 * (f64::from(step) * 0.3).sin();
        let near = wide(Camera { eye: usual.eye + aside, target: usual.target + aside, ..usual });
        let view =
            View { width: 320, height: 240, outputs: Outputs::COLOR, ..view(near, PlanRequest::default()) };
        let frame = rendered(&client, &view).await;
        if !frame.provenance.plan.frames().is_empty() {
            let exact = View { plan: direct, ..view.clone() };
            let truth = image_of(&rendered(&client, &exact).await);
            let flip = metrics::flip_mean(&truth, &image_of(&frame)).unwrap();
            assert!(flip < 0.05, "from frames: FLIP {flip}");
            let pinned = View { pin: Some(frame.provenance.clone()), ..view };
            assert!(rendered(&client, &pinned).await.images == frame.images, "its pin repeats it");
            return;
        }
        assert!(began.elapsed() < PATIENCE, "no view is warped from frames");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// A view of rays listed as those of a camera, in another length each.
fn listed(view: View) -> View {
    let rays = view.camera.rays(view.width, view.height);
    let direction = |at: u32| {
        let pixel = DVec2::new((at % view.width).into(), (at / view.width).into()) + 0.5;
        rays.direction(pixel).map_or(Vec3::ZERO, |direction| direction.as_vec3() * (1.0 + at as f32))
    };
    let list = RayList::new((0..view.width * view.height).map(direction).collect()).unwrap();
    let lens = Lens::Rays { spacing_deg: list.spacing_deg(view.width) };
    View { camera: Camera { lens: Some(lens), ..view.camera }, rays: Some(list), ..view }
}

#[tokio::test(flavor = "multi_thread")]
async fn listed_rays_show_what_a_lens_with_the_same_rays_shows() {
    let coordinator = Coordinator::start(SMALL, &FIXED);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let client = Client::connect(&coordinator.url).await.unwrap();
    let usual = client.description().cameras[0].camera;
    let outputs = Outputs::COLOR.with(Output::Range).with(Output::Depth).with(Output::Instance);
    for (name, camera) in lenses(usual) {
        let lens = View { outputs, ..view(camera, PlanRequest { direct: true, ..PlanRequest::default() }) };
        let truth = rendered(&client, &lens).await;
        let list = View { plan: PlanRequest::default(), ..listed(lens.clone()) };
        let frame = rendered(&client, &list).await;
        assert_eq!(frame.provenance.plan, Plan::direct(1), "{name}");
        for output in [Output::Range, Output::Depth] {
            let metres = |frame: &Frame| -> Vec<f32> {
                let image = frame.images[output].as_ref().unwrap();
                image.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
            };
            let off = metres(&truth).into_iter().zip(metres(&frame));
            // At silhouettes a ray that is rounded differently may see something else.
            let off = off.filter(|(a, b)| a != b && (a / b - 1.0).abs() > 1e-4).count();
            assert!(off <= 20, "{name}, {output:?}: {off} pixels differ");
        }
        let flip = metrics::flip_mean(&image_of(&truth), &image_of(&frame)).unwrap();
        assert!(flip < 0.02, "{name}: FLIP {flip}");
        let pinned = View { pin: Some(frame.provenance.clone()), ..list };
        assert!(rendered(&client, &pinned).await.images == frame.images, "{name}: its pin repeats it");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn lists_of_rays_that_fit_no_image_are_refused_by_field() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let mut wire = Wire::connect(&coordinator.url).await;
    let usual = wire.describe().await.cameras[0].camera;
    let good = v1::View::from(&listed(view(usual, PlanRequest::default())));
    // Spacing is found, and a pixel without a ray sees nothing.
    let mut open = good.clone();
    open.camera.as_mut().unwrap().lens = Some(v1::camera::Lens::ListedRays(v1::ListedRays::default()));
    open.rays = [&[0; 12], &good.rays[12..]].concat().into();
    let (frame, _) = wire.render(open).await.unwrap();
    assert_eq!(frame.images[Output::Range].as_ref().unwrap()[..4], f32::INFINITY.to_le_bytes());
    let direct = v1::PlanRequest { direct: true, ..v1::PlanRequest::default() };
    for (field, wrong) in [
        ("rays", v1::View { rays: Default::default(), ..good.clone() }),
        ("rays", v1::View { rays: good.rays.slice(1..), ..good.clone() }),
        ("rays", v1::View { rays: good.rays.slice(12..), ..good.clone() }),
        (
            "rays",
            v1::View { rays: [&f32::NAN.to_le_bytes(), &good.rays[4..]].concat().into(), ..good.clone() },
        ),
        ("rays", v1::View { rays: vec![0; 12 * (RayList::MOST + 1)].into(), ..good.clone() }),
        ("rays", v1::View { camera: Some((&usual).into()), ..good.clone() }),
        (
            "plan.supersampling",
            v1::View { plan: Some(v1::PlanRequest { supersampling: Some(2), ..direct }), ..good.clone() },
        ),
    ] {
        let status = wire.render(wrong).await.expect_err(field);
        assert_eq!(invalid_field(&status).map(|(field, _)| field).as_deref(), Some(field), "{status}");
    }
    wire.render(good).await.expect("the server goes on");
}

/// The same intrinsics for an image of 320 × 240 pixels.
fn wide(camera: Camera) -> Camera {
    let (focal, center) = (DVec2::splat(280.0), DVec2::new(100.0, 170.0));
    Camera { lens: Some(Lens::Intrinsics(Intrinsics::pinhole(focal, center))), ..camera }
}

#[tokio::test(flavor = "multi_thread")]
async fn lenses_that_show_nothing_are_refused_by_field() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let _workers = coordinator.workers(1);
    coordinator.wait_for_workers(1);
    let mut wire = Wire::connect(&coordinator.url).await;
    let usual = wire.describe().await.cameras[0].camera;
    let direct = PlanRequest { direct: true, ..PlanRequest::default() };
    let good = v1::View::from(&view(lenses(usual)[2].1, direct));
    wire.render(good.clone()).await.unwrap();

    type Spoil = fn(&mut v1::View);
    fn lens(view: &mut v1::View) -> &mut v1::Intrinsics {
        match view.camera.as_mut().unwrap().lens.as_mut().unwrap() {
            v1::camera::Lens::Intrinsics(intrinsics) => intrinsics,
            v1::camera::Lens::Equirectangular(_) | v1::camera::Lens::ListedRays(_) => panic!("intrinsics"),
        }
    }
    fn plan(view: &mut v1::View) -> &mut v1::PlanRequest {
        view.plan.get_or_insert_default()
    }
    use v1::intrinsics::Distortion as Wired;
    let cases: &[(&str, Spoil)] = &[
        ("camera.intrinsics.fx", |v| lens(v).fx = 0.0),
        ("camera.intrinsics.fx", |v| lens(v).fx = f64::NAN),
        ("camera.intrinsics.fy", |v| lens(v).fy = -1.0),
        ("camera.intrinsics.cx", |v| lens(v).cx = f64::INFINITY),
        ("camera.intrinsics.cy", |v| lens(v).cy = 1e9),
        ("camera.intrinsics.pixel_center", |v| lens(v).pixel_center = Some(1.0)),
        ("camera.intrinsics.fisheye.k2", |v| {
            let k = v1::FisheyeDistortion { k2: f64::NAN, ..Default::default() };
            lens(v).distortion = Some(Wired::Fisheye(k));
        }),
        ("camera.intrinsics.opencv.k3", |v| {
            let k = v1::OpenCvDistortion { k3: f64::INFINITY, ..Default::default() };
            lens(v).distortion = Some(Wired::Opencv(k));
        }),
        ("camera.fov_deg", |v| v.camera.as_mut().unwrap().fov_deg = Some(45.0)),
        ("plan.search", |v| plan(v).search = Some(v1::Search::Splat as i32)),
        ("plan.samples", |v| plan(v).samples = Some(2)),
        ("plan.holes", |v| plan(v).holes = Some(v1::Holes::Trace as i32)),
        ("plan.detail", |v| plan(v).detail = Some(v1::Detail::Half as i32)),
    ];
    for (i, (field, spoil)) in cases.iter().enumerate() {
        let mut view = good.clone();
        spoil(&mut view);
        let status = wire.render(view).await.expect_err(field);
        assert_eq!(status.code(), Code::InvalidArgument, "case {i}, {field}: {status}");
        let (at, reason) = invalid_field(&status).unwrap_or_else(|| panic!("case {i}, {field}: no details"));
        assert_eq!(at, *field, "case {i}");
        assert!(!reason.is_empty(), "case {i}, {field}");
    }
    wire.render(good).await.expect("the server goes on");
}
