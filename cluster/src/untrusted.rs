//! Entry points for fuzzing: they process messages with the code of production.

use std::sync::Arc;

use argus_proto::trace::continued_from;
use argus_proto::v1;
use argus_proto::v1::worker_report::Body;
use argus_scene::{
    Bounds, Camera, FaceMask, FrameSource, InvalidField, Rig, SampleSetInfo, SceneHash, SceneState, View,
    Visibility,
};
use glam::DVec3;
use prost::Message;

use crate::SceneRef;
use crate::coordinator;
use crate::core::{
    Assignment, Config, Core, Event, HeldSource, Hello, ProbeResult, Purchase, Report, Role, Source,
    SourceNews, Uptime, ViewId, WorkerId,
};
use crate::sealed::{Kind, RedeemedSerials, SealKey};
use crate::wire::{self, Served, ServiceInfo};
use crate::worker;

fn set() -> Arc<SampleSetInfo> {
    let bounds = Bounds { min: DVec3::splat(-10.0), max: DVec3::splat(10.0) };
    Arc::new(SampleSetInfo::plain(
        SceneHash([1; 32]),
        bounds,
        Rig::TileCorners { bounds, tiles: [2, 2], height: 1.0, size: [40, 30] },
    ))
}

fn hello() -> Hello {
    let (name, address) = ("w".to_owned(), "http://127.0.0.1:1".to_owned());
    Hello { name, pid: 1, address, public_address: None, device: "none".to_owned(), cores: 1 }
}

/// A coordinator's core with one ready worker.
fn core() -> Core {
    let mut core = Core::new(Config::default(), set());
    let worker = WorkerId(1);
    core.step(Event::Joined { worker, hello: hello() }, Uptime::default());
    let report = Report { applied: 1, ..Report::default() };
    core.step(Event::Reported { worker, report }, Uptime::default());
    core
}

fn ask(core: &mut Core, view: View, now: Uptime) {
    let event = Event::Requested {
        view_id: ViewId(2),
        client: "c".into(),
        view: Box::new(view),
        deadline: None,
        last: None,
    };
    core.step(event, now);
}

fn pass_time(core: &mut Core) {
    for secs in 1..4 {
        let now = Uptime(std::time::Duration::from_secs(secs));
        core.step(Event::Tick, now);
    }
    core.status();
}

fn service() -> ServiceInfo {
    ServiceInfo {
        scene: SceneRef { name: "s".to_owned(), hash: SceneHash([1; 32]) },
        limits: argus_scene::Limits::default(),
        report_interval: Config::default().report_interval,
    }
}

/// Processes a worker's message as a coordinator, lets time pass, and takes a status.
///
/// # Errors
/// The invalid field.
pub fn report(message: v1::WorkerReport) -> Result<(), InvalidField> {
    let mut core = core();
    match message.body {
        Some(Body::Hello(hello)) => {
            let hello = wire::hello_from(hello, None)?;
            core.step(Event::Joined { worker: WorkerId(3), hello }, Uptime::default());
        }
        Some(Body::Measurements(measurements)) => {
            let report = wire::report_from(measurements);
            core.step(Event::Reported { worker: WorkerId(1), report }, Uptime::default());
        }
        None => {}
    }
    pass_time(&mut core);
    Ok(())
}

/// Processes a validated view as a coordinator.
pub fn view(view: View) {
    let mut core = core();
    ask(&mut core, view, Uptime::default());
    pass_time(&mut core);
}

/// Checks an assignment as a worker.
///
/// # Errors
/// The invalid field.
pub fn assignment(message: v1::Assignment) -> Result<(), InvalidField> {
    worker::checked_assignment(message)
}

/// A fixed key, so that fuzzed bytes pass the seal.
fn key() -> SealKey {
    SealKey::from_bytes(&[7; 32]).expect("32 bytes are a key")
}

/// Processes the body of a correctly sealed ticket as a worker.
///
/// # Errors
/// Why it is refused, before anything is rendered.
pub fn ticket(body: &[u8]) -> Result<(), String> {
    let sealed = key().seal_bytes(Kind::RedirectTicket, body.to_vec());
    assert!(key().open::<v1::Receipt>(Kind::Receipt, &sealed).is_none(), "a ticket passes for a receipt");
    let ticket: v1::RedirectTicket = key().open(Kind::RedirectTicket, &sealed).ok_or("it is no ticket")?;
    let mut redeemed = RedeemedSerials::default();
    let first = redeemed.first_time(ticket.serial);
    assert!(first == (ticket.serial > 0) && !redeemed.first_time(ticket.serial), "a ticket is good twice");
    continued_from(&tracing::Span::none(), &ticket.traceparent);
    let request = ticket.request.ok_or("it holds no request")?;
    let order = request.order.ok_or("it holds no order")?;
    let words = |field: InvalidField| field.to_string();
    let view = View::try_from(request.view.unwrap_or_default()).map_err(words)?;
    view.validate(&argus_scene::Limits::default()).map_err(words)?;
    argus_scene::Plan::try_from(order.plan.unwrap_or_default()).map(drop).map_err(words)
}

/// Processes the body of a correctly sealed receipt as a coordinator.
///
/// # Errors
/// Why it is refused.
pub fn receipt(body: &[u8]) -> Result<(), String> {
    let sealed = key().seal_bytes(Kind::Receipt, body.to_vec());
    assert!(
        key().open::<v1::RedirectTicket>(Kind::RedirectTicket, &sealed).is_none(),
        "a receipt passes for a ticket"
    );
    let receipt: v1::Receipt = key().open(Kind::Receipt, &sealed).ok_or("it is no receipt")?;
    let header = receipt.header.ok_or("it tells of no frame")?;
    let (uncovered, ms) = coordinator::learn(&header);
    let mut core = core();
    let bounds = set().bounds;
    let camera = argus_scene::Camera::look_at(bounds.max, DVec3::ZERO);
    let (outputs, plan) = (argus_scene::Outputs::COLOR, argus_scene::PlanRequest::default());
    ask(
        &mut core,
        View { camera, width: 8, height: 6, outputs, plan, pin: None, flow_to: None, rays: None },
        Uptime::default(),
    );
    let (view_id, attempt) = (ViewId(2), 1);
    let answered =
        Event::Answered { view_id, attempt, uncovered: Some(uncovered), ms: Some(ms), fell_short: false };
    core.step(answered, Uptime::default());
    pass_time(&mut core);
    Ok(())
}

/// Opens a message that was sealed elsewhere, as either process.
///
/// # Errors
/// It is refused.
pub fn sealed(sealed: &v1::Sealed) -> Result<(), String> {
    let ticket: Option<v1::RedirectTicket> = key().open(Kind::RedirectTicket, sealed);
    let receipt: Option<v1::Receipt> = key().open(Kind::Receipt, sealed);
    if ticket.is_some() || receipt.is_some() {
        Ok(())
    } else {
        Err("it was not sealed with the cluster's key".to_owned())
    }
}

/// Processes the messages of a session's client as a coordinator.
pub fn session_messages(requests: Vec<v1::SessionRequest>) {
    coordinator::check_inbox(requests.into_iter());
}

/// Valid messages with the names of their types.
pub fn corpus() -> Vec<(&'static str, Vec<u8>)> {
    let id = argus_scene::SampleId { version: 0, camera: 2 };
    let camera = Camera::look_at(glam::DVec3::new(3.0, 2.0, 5.0), glam::DVec3::ZERO);
    let source =
        FrameSource { camera, width: 80, height: 60, samples_per_pixel: 4, band_rows: 0, light: None };
    let held_id = source.id();
    let held = HeldSource {
        id: held_id,
        source,
        state: SceneState::default(),
        visibility: Visibility::default(),
        ranges: vec![0.25; FrameSource::GRID.iter().product::<u32>() as usize].into(),
        bought: true,
        render_ms: 12.0,
    };
    let measured = Report {
        applied: 1,
        sample_ms: Some(10.0),
        view_ms: Some(1.0),
        samples_rendered: 4,
        views_composed: 9,
        sampling_busy_ms: 40.0,
        held: vec![id],
        partial: vec![(id, FaceMask::only(2))],
        sources: Some(SourceNews { whole: true, added: vec![held], dropped: vec![held_id] }),
        probes: vec![ProbeResult { view_id: ViewId(2), attempt: 1, excess: vec![0.02, f32::NAN] }],
        backend_costs: vec![(Visibility::default(), 3.0)],
        ..Report::default()
    };
    let assignment = Assignment {
        sequence: 1,
        role: Role::Both,
        prefetch: vec![Source {
            id,
            faces: FaceMask::only(2),
            addresses: vec!["http://127.0.0.1:1".to_owned()],
            dispensable: false,
        }],
        purchases: vec![Purchase { source, state: SceneState::default() }],
        kept_from: 0,
        measure_backends: false,
        suspected: vec!["http://127.0.0.1:2".to_owned()],
        cell_holders: vec!["http://127.0.0.1:3".to_owned()],
    };
    let set = set();
    let served = Served { set: &set, versions: &[set.version], visibility_is_open: false };
    vec![
        ("WorkerReport", wire::hello(&hello(), None).encode_to_vec()),
        ("WorkerReport", wire::report(measured, Role::Both).encode_to_vec()),
        ("Assignment", wire::assignment(assignment, 1, &service(), &served, None).encode_to_vec()),
        ("StatusResponse", core().status().encode_to_vec()),
    ]
}
