//! The services as seen by clients: invalid input, sessions, health, reflection, versions, terms.

use std::time::Duration;

use argus_proto::status::invalid_field;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use argus_proto::{Description, PROTOCOL_VERSION, v1};
use argus_scene::{Limits, Output, Outputs, Plan, PlanRequest, Provenance, SceneHash, View};
use glam::DVec3;
use tokio::sync::mpsc;
use tonic::Code;

use crate::common;
use crate::common::session::Session;
use crate::common::{Cluster, channel, direct, pinned, request, view};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn invalid_input_is_rejected_by_field() {
    let cluster = Cluster::start(2).await;
    let rejected = async |change: &dyn Fn(&mut v1::RenderRequest)| {
        let mut request = request(&view(1), 0);
        change(&mut request);
        let status = cluster.views().render(request).await.expect_err("must be rejected");
        assert_eq!(status.code(), Code::InvalidArgument, "{status}");
        let (field, reason) = invalid_field(&status).expect("field and reason");
        assert!(!reason.is_empty() && !reason.contains('\n'));
        field
    };
    fn camera(request: &mut v1::RenderRequest) -> &mut v1::Camera {
        request.view.as_mut().unwrap().camera.as_mut().unwrap()
    }
    fn view_of(request: &mut v1::RenderRequest) -> &mut v1::View {
        request.view.as_mut().unwrap()
    }
    let nan = v1::Vec3 { x: f64::NAN, y: 0.0, z: 0.0 };
    let infinite = v1::Vec3 { x: 0.0, y: f64::INFINITY, z: 0.0 };
    assert_eq!(rejected(&|r| camera(r).eye = Some(nan)).await, "camera.eye");
    assert_eq!(rejected(&|r| camera(r).target = Some(infinite)).await, "camera.target");
    assert_eq!(rejected(&|r| camera(r).target = camera(r).eye).await, "camera.target");
    let straight_up = |r: &mut v1::RenderRequest| {
        camera(r).eye = Some(DVec3::ZERO.into());
        camera(r).target = Some(DVec3::Y.into());
        camera(r).up = Some(DVec3::Y.into());
    };
    assert_eq!(rejected(&straight_up).await, "camera.up");
    for fov in [0.0, 180.0, -3.0, f64::NAN, f64::INFINITY] {
        assert_eq!(rejected(&|r| camera(r).fov_deg = Some(fov)).await, "camera.fov_deg");
    }
    assert_eq!(rejected(&|r| view_of(r).width = 0).await, "width");
    assert_eq!(rejected(&|r| view_of(r).height = 8193).await, "height");
    assert_eq!(rejected(&|r| (view_of(r).width, view_of(r).height) = (8192, 4096)).await, "width");
    assert_eq!(rejected(&|r| view_of(r).outputs.clear()).await, "outputs");
    assert_eq!(rejected(&|r| view_of(r).outputs.push(77)).await, "outputs");
    let plan = |plan: v1::PlanRequest| move |r: &mut v1::RenderRequest| view_of(r).plan = Some(plan);
    let free = v1::PlanRequest::default();
    assert_eq!(rejected(&plan(v1::PlanRequest { search: Some(99), ..free })).await, "plan.search");
    assert_eq!(rejected(&plan(v1::PlanRequest { steps: Some(0), ..free })).await, "plan.steps");
    assert_eq!(rejected(&plan(v1::PlanRequest { samples: Some(9), ..free })).await, "plan.samples");
    assert_eq!(rejected(&|r| r.view = None).await, "view");
    assert_eq!(rejected(&|r| view_of(r).camera = None).await, "camera");
    assert_eq!(rejected(&|r| r.encoding = 12).await, "encoding");
    assert_eq!(rejected(&|r| r.view_id = "x".repeat(200)).await, "view_id");
    assert_eq!(rejected(&|r| r.order = Some(v1::ViewOrder::default())).await, "order");
    cluster.render(&view(1)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_pin_that_cannot_be_met_is_a_failed_precondition_with_a_reason() {
    let cluster = Cluster::start(2).await;
    let (frame, _) = cluster.render(&view(1)).await.unwrap();
    let refused = async |change: &dyn Fn(&mut Provenance)| {
        let mut pin = frame.provenance.clone();
        change(&mut pin);
        let status = cluster.render(&pinned(1, pin)).await.unwrap_err();
        assert_eq!(status.code(), Code::FailedPrecondition, "{status}");
        status.message().to_owned()
    };
    assert!(refused(&|p| p.scene = SceneHash([9; 32])).await.contains("scene"));
    assert!(refused(&|p| p.state.epoch = 5).await.contains("epoch 5"));
    let of_version_7 = |p: &mut Provenance| {
        let Plan::Warp(warp) = &mut p.plan else { panic!("a warp") };
        warp.samples.iter_mut().for_each(|id| id.version = 7);
    };
    assert!(refused(&of_version_7).await.contains("version 7"));
    assert!(refused(&|p| p.device = "another".to_owned()).await.contains("another"));
    let any = Provenance { device: String::new(), ..frame.provenance.clone() };
    assert_eq!(
        cluster.render(&pinned(1, any)).await.unwrap().0.images[Output::Color],
        frame.images[Output::Color]
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn describe_returns_the_service_and_checks_the_version() {
    let cluster = Cluster::start(1).await;
    for protocol_version in [0, PROTOCOL_VERSION] {
        let described = cluster.views().describe(v1::DescribeRequest { protocol_version }).await.unwrap();
        let description = Description::try_from(described.into_inner()).unwrap();
        assert_eq!((description.scene_name.as_str(), description.triangles), ("test", 1));
        assert_eq!(description.limits, Limits::default());
        assert_eq!(description.defaults.samples, Some(4));
        assert_eq!(description.cameras.len(), 1);
    }
    let wrong = v1::DescribeRequest { protocol_version: 999 };
    let status = cluster.views().describe(wrong).await.unwrap_err();
    assert_eq!(status.code(), Code::FailedPrecondition);
    assert!(status.message().contains("999"), "{status}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_accepts_orders_only_from_its_coordinator() {
    let cluster = Cluster::start(1).await;
    let mut worker = ViewsClient::new(channel(&cluster.workers[0].url()));
    let status = worker.render(request(&view(1), 0)).await.unwrap_err();
    assert_eq!(invalid_field(&status).unwrap().0, "order");
    assert!(worker.describe(v1::DescribeRequest::default()).await.is_err());
    let order = v1::ViewOrder { term: 3, ..v1::ViewOrder::default() };
    let stale = v1::RenderRequest { order: Some(order), ..request(&view(1), 0) };
    let status = worker.render(stale).await.unwrap_err();
    assert_eq!(status.code(), Code::FailedPrecondition);
    assert!(status.message().contains("term 3 is over"), "{status}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_of_another_version_or_without_a_hello_is_refused() {
    let cluster = Cluster::start(1).await;
    let join = async |first: v1::WorkerReport| {
        let mut client = ClusterClient::new(cluster.channel.clone());
        client.join(tokio_stream::iter([first])).await.map(|_| ()).unwrap_err()
    };
    let hello = |hello| v1::WorkerReport { body: Some(v1::worker_report::Body::Hello(hello)) };
    let good = v1::Hello {
        protocol_version: PROTOCOL_VERSION,
        worker_id: "w".to_owned(),
        address: "http://127.0.0.1:9".to_owned(),
        ..v1::Hello::default()
    };
    let version = join(hello(v1::Hello { protocol_version: 42, ..good.clone() })).await;
    assert_eq!(version.code(), Code::FailedPrecondition);
    let nameless = join(hello(v1::Hello { worker_id: String::new(), ..good.clone() })).await;
    assert_eq!(invalid_field(&nameless).unwrap().0, "hello.worker_id");
    let nowhere = join(hello(v1::Hello { address: "nowhere".to_owned(), ..good })).await;
    assert_eq!(invalid_field(&nowhere).unwrap().0, "hello.address");
    let silent = join(v1::WorkerReport { body: None }).await;
    assert_eq!(invalid_field(&silent).unwrap().0, "hello");
    cluster.render(&view(1)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn in_a_session_the_newest_camera_wins() {
    let cluster = Cluster::start(1).await;
    cluster.render(&view(0)).await.unwrap();
    cluster.settings.set(60_000, 0);
    let mut session = Session::open(&cluster).await;
    session.ask(1, &view(1)).await;
    tokio::time::sleep(Duration::from_millis(30)).await;
    for seq in 2..=9 {
        session.ask(seq, &view(seq as usize)).await;
    }
    let (first, _, ok) = session.answer().await.unwrap();
    assert_eq!((first, ok), (1, Ok(())));
    session.acknowledge(1).await;
    let (second, superseded, ok) = session.answer().await.unwrap();
    assert_eq!((second, superseded, ok), (9, 7, Ok(())));
    assert_eq!(cluster.status().await.counters.unwrap().cameras_superseded, 7);
    assert_eq!(cluster.status().await.counters.unwrap().sessions_open, 1);
    // Invalid cameras get failures, and the session continues.
    session.ask(10, &View { width: 0, ..view(10) }).await;
    let (third, _, failure) = session.answer().await.unwrap();
    let failure = failure.unwrap_err();
    assert_eq!((third, failure.code, failure.field.as_str()), (10, Code::InvalidArgument as i32, "width"));
    session.ask(11, &direct(11)).await;
    assert_eq!(session.answer().await.unwrap().0, 11);
    // The newest camera of a client that closes its side is still answered.
    session.acknowledge(11).await;
    session.ask(12, &view(12)).await;
    let (closed, _) = mpsc::channel(1);
    session.requests = closed;
    assert_eq!(session.answer().await.unwrap().0, 12);
    assert!(session.answer().await.is_none());
    cluster.wait_for(|s| s.counters.unwrap().sessions_open == 0).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_that_acknowledges_late_gets_the_newest_frame_next() {
    let cluster = Cluster::start(1).await;
    let mut session = Session::open(&cluster).await;
    for seq in 1..=2 {
        session.ask(seq, &view(1)).await;
        assert_eq!(session.answer().await.unwrap().0, seq);
    }
    for seq in 3..=5 {
        session.ask(seq, &view(1)).await;
    }
    tokio::time::timeout(Duration::from_millis(150), session.answer()).await.unwrap_err();
    session.acknowledge(2).await;
    let (newest, superseded, _) = session.answer().await.unwrap();
    assert_eq!((newest, superseded), (5, 2));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn both_kinds_of_process_serve_health_and_reflection() {
    use tonic_health::pb::HealthCheckRequest;
    use tonic_health::pb::health_check_response::ServingStatus;
    use tonic_health::pb::health_client::HealthClient;
    use tonic_reflection::pb::v1::server_reflection_client::ServerReflectionClient;
    use tonic_reflection::pb::v1::server_reflection_request::MessageRequest;
    use tonic_reflection::pb::v1::server_reflection_response::MessageResponse;
    use tonic_reflection::pb::v1::{ServerReflectionRequest, ServerReflectionResponse};
    let cluster = Cluster::start(1).await;
    let processes = [
        (channel(&cluster.coordinator.url()), vec!["argus.v1.Views", "argus.v1.Cluster", "argus.v1.Scenes"]),
        (channel(&cluster.workers[0].url()), vec!["argus.v1.Views", "argus.v1.Samples"]),
    ];
    for (channel, services) in processes {
        for service in services.iter().copied().chain(["", argus_cluster::LIVE]) {
            // Readiness is updated ten times a second.
            let mut client = HealthClient::new(channel.clone());
            let health = client.watch(HealthCheckRequest { service: service.to_owned() });
            let mut states = health.await.unwrap().into_inner();
            let serving = async {
                while states.message().await.unwrap().unwrap().status() != ServingStatus::Serving {}
            };
            tokio::time::timeout(common::LIMIT, serving).await.expect(service);
        }
        let list = ServerReflectionRequest {
            host: String::new(),
            message_request: Some(MessageRequest::ListServices(String::new())),
        };
        let mut reflection = ServerReflectionClient::new(channel);
        let answers = reflection.server_reflection_info(tokio_stream::iter([list])).await.unwrap();
        let answer: ServerReflectionResponse = answers.into_inner().message().await.unwrap().unwrap();
        let Some(MessageResponse::ListServicesResponse(listed)) = answer.message_response else {
            panic!("a list of services")
        };
        let names: Vec<String> = listed.service.into_iter().map(|service| service.name).collect();
        for service in services {
            assert!(names.iter().any(|name| name == service), "{names:?}");
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn outputs_and_plans_of_every_kind_are_answered() {
    let cluster = Cluster::start(2).await;
    let outputs = Outputs::COLOR.with(Output::Range).with(Output::Source);
    let plan =
        PlanRequest { steps: Some(16), samples: Some(2), supersampling: Some(2), ..PlanRequest::default() };
    let plan = PlanRequest { search: Some(argus_scene::Search::Linear), ..plan };
    let (frame, _) = cluster.render(&View { outputs, plan, ..view(1) }).await.unwrap();
    assert!(
        frame.images[Output::Color].is_some()
            && frame.images[Output::Range].is_some()
            && frame.images[Output::Mask].is_none()
    );
    let argus_scene::Plan::Warp(argus_scene::Warp { search, steps, supersampling, samples, .. }) =
        frame.provenance.plan
    else {
        panic!("a warp")
    };
    assert_eq!((search, steps, supersampling), (argus_scene::Search::Linear, 16, 2));
    assert_eq!(samples.len(), 2);
}
