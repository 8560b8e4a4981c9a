//! Every message of `argus.v1`: decoded, converted to its type in the vocabulary if it has one, and passed to its
//! receiver.

use argus_proto::{Description, v1};
use argus_scene::effects::EffectCost;
use argus_scene::{
    Bounds, Camera, FrameSource, Light, Lighting, Limits, Plan, PlanRequest, Prediction, Provenance, Rig,
    SampleCamera, SampleSetInfo, Specification, Stage, View, frame::Decision, scene::NamedCamera,
};
use prost::Message;

/// Decodes a message, passes it on, and checks that it is unchanged by encoding and decoding.
fn decoded<M: Message + Default + Clone>(
    bytes: &[u8],
    take: impl FnOnce(M) -> Result<(), String>,
) -> Result<(), String> {
    let message = M::decode(bytes).map_err(|error| error.to_string())?;
    let again = message.encode_to_vec();
    let same = M::decode(&again[..]).map(|message| message.encode_to_vec());
    assert_eq!(same.as_ref(), Ok(&again), "a message changes as it is sent on");
    take(message)
}

fn converted<T, E: ToString>(result: Result<T, E>) -> Result<(), String> {
    result.map(drop).map_err(|error| error.to_string())
}

/// A receiver of an encoded message.
type Take = fn(&[u8]) -> Result<(), String>;

macro_rules! messages {
    ($($name:ident $(=> $take:expr)?),* $(,)?) => {
        /// The name of each message, and its receiver.
        pub const ALL: &[(&str, Take)] = &[
            $((stringify!($name), |bytes| decoded::<v1::$name>(bytes, messages!(@ $($take)?)))),*
        ];
    };
    (@) => { |_| Ok(()) };
    (@ $take:expr) => { $take };
}

messages! {
    Vec3, Rgb, PerspectiveCamera, OmniCamera, ReflectionProbesLayout,
    Bounds => |m| converted(Bounds::try_from(m)),
    Camera => |m| converted(Camera::try_from(m)),
    NamedCamera => |m| converted(NamedCamera::try_from(m)),
    SampleCamera => |m| converted(SampleCamera::try_from(m)),
    WorkerReport => |m| converted(argus_cluster::untrusted::report(m)),
    Hello => |m| converted(argus_cluster::untrusted::report(said(v1::worker_report::Body::Hello(m)))),
    Measurements => |m| converted(argus_cluster::untrusted::report(said(v1::worker_report::Body::Measurements(m)))),
    BackendCost,
    Cost => |m| {
        let measured = v1::Measurements { direct_cost: Some(m), ..v1::Measurements::default() };
        converted(argus_cluster::untrusted::report(said(v1::worker_report::Body::Measurements(measured))))
    },
    SourceNews => |m| {
        let measured = v1::Measurements { sources: Some(m), ..v1::Measurements::default() };
        converted(argus_cluster::untrusted::report(said(v1::worker_report::Body::Measurements(measured))))
    },
    HeldSource, ProbeResult,
    Purchase => |m| converted(FrameSource::try_from(m.source.unwrap_or_default())),
    Assignment => |m| converted(argus_cluster::untrusted::assignment(m)),
    StatusRequest,

    StatusResponse, SceneStatus, LightCells, CellsRequest, CellsPage, Refinements, Market, WorkerStatus, Counters,
    SubscribeRequest => |m| converted(argus_proto::convert::scene_hash(&m.scene_hash, "scene_hash")),
    HeldSample, PartialSample, PlaneHeader, SampleHeader,
    SampleChunk => |m| begun(super::chunks::samples, m),
    SampleData,
    TraceRequest => |m| super::chunks::traces(&m.encode_length_delimited_to_vec()),
    TraceHeader,
    TraceChunk => |m| begun(super::chunks::pixels, m),
    TraceData, SceneRef, DirectionalLight, PointLight, SpotLight,
    Light => |m| converted(Light::try_from(m)),
    Sky,
    Lighting => |m| converted(Lighting::try_from(m)),
    TileCornersRig, CellRig,
    Rig => |m| rig(Rig::try_from(m).map_err(|error| error.to_string())?),
    Specification => |m| converted(Specification::try_from(m)),
    MegaViewsSampling, VplIndirect, PointIndirect, PathIndirect, CellIndirect,
    EffectCost => |m| converted(EffectCost::try_from(m)),
    EffectRow, ReflectionProbes, ProbePoints,
    SampleSetInfo => |m| rig(SampleSetInfo::try_from(m).map_err(|error| error.to_string())?.rig),
    SceneState, Version, SampleId,
    Stage => |m| converted(Stage::try_from(m)),
    FetchRequest => |m| converted(argus_proto::convert::scene_hash(&m.scene_hash, "scene_hash")),
    SceneChunk => |m| begun(super::chunks::scenes, m),
    BundleHeader, FileBundle, FileHeader,
    PlanRequest => |m| converted(PlanRequest::try_from(m)),
    DirectPlan, WarpPlan,
    FrameSource => |m| converted(FrameSource::try_from(m)),
    Plan => |m| converted(Plan::try_from(m)),
    Provenance => |m| converted(Provenance::try_from(m)),
    View => view,
    Limits => |m| converted(Limits::try_from(m)),
    ImageHeader, Served,
    Prediction => |m| converted(Prediction::try_from(m)),
    Decision => |m| converted(Decision::try_from(m)),
    FrameHeader => |m| begun(super::chunks::frames, v1::FrameChunk { body: Some(v1::frame_chunk::Body::Header(m)) }),
    Observed,
    FrameChunk => |m| begun(super::chunks::frames, m),
    FrameData, FrameTrailer, NamesRequest, NamesResponse, Intrinsics, OpenCvDistortion, FisheyeDistortion, Equirectangular, ListedRays,
    DescribeRequest,
    DescribeResponse => |m| converted(Description::try_from(m)),
    RenderRequest => |m| view(m.view.unwrap_or_default()),
    Fallback, Probe,
    ViewOrder => |m| converted(Plan::try_from(m.plan.unwrap_or_default())),
    SampleSource,
    RenderBatchRequest => |m| {
        let v1::RenderBatchRequest { width, height, outputs, plan, .. } = m;
        let of = |camera| v1::View { camera: Some(camera), width, height, outputs: outputs.clone(), plan, pin: None, flow_to: None, rays: Default::default() };
        m.cameras.into_iter().try_for_each(|camera| view(of(camera)))
    },
    RenderBatchResponse,
    Transforms => |m| converted(argus_scene::Transforms::try_from(m)),
    NodeTransform => |m| converted(argus_proto::convert::affine(&m.parent_from_node)),
    SetTransform => |m| converted(argus_proto::convert::affine(&m.matrix)),
    SetTransformsRequest => |m| m.nodes.iter().try_for_each(|node| converted(argus_proto::convert::affine(&node.matrix))),
    SetTransformsResponse, NodeSetter,
    SessionRequest => |m| { argus_cluster::untrusted::session_messages(vec![m]); Ok(()) },
    SessionView => |m| view(m.view.unwrap_or_default()),
    SessionAck, SessionMissed, SessionResponse, SessionFailure,
    Redirect => |m| argus_cluster::untrusted::sealed(&m.ticket.unwrap_or_default()),
    Sealed => |m| argus_cluster::untrusted::sealed(&m),
    RedirectTicket => |m| argus_cluster::untrusted::ticket(&m.encode_to_vec()),
    RedeemRequest => |m| argus_cluster::untrusted::sealed(&m.ticket.unwrap_or_default()),
    RedeemResponse, Working,
    Receipt => |m| argus_cluster::untrusted::receipt(&m.encode_to_vec()),
}

/// The first chunk of a stream, without the rest.
fn begun(take: Take, chunk: impl Message) -> Result<(), String> {
    let _ = take(&chunk.encode_length_delimited_to_vec());
    Ok(())
}

fn said(body: v1::worker_report::Body) -> v1::WorkerReport {
    v1::WorkerReport { body: Some(body) }
}

/// An accepted view can be planned.
fn view(wire: v1::View) -> Result<(), String> {
    let view = View::try_from(wire).map_err(|error| error.to_string())?;
    view.validate(&Limits::default()).map_err(|error| error.to_string())?;
    argus_cluster::untrusted::view(view);
    Ok(())
}

/// An accepted rig has camera positions for any number of cameras.
fn rig(rig: Rig) -> Result<(), String> {
    for index in [0, 1, 1000, u64::MAX / 2, u64::MAX] {
        if let Ok(camera) = rig.camera(index) {
            assert!(camera.size().iter().all(|&side| side > 0), "a sample without texels");
        }
    }
    Ok(())
}

/// A plan of a view from samples.
fn warp_plan() -> v1::WarpPlan {
    v1::WarpPlan {
        samples: vec![v1::SampleId { version: 0, camera: 3 }],
        supersampling: 1,
        search: v1::Search::Splat as i32,
        ..Default::default()
    }
}

/// Valid messages, each with the index of its kind in [`ALL`].
pub fn corpus() -> Vec<(usize, Vec<u8>)> {
    let camera = || v1::Camera {
        eye: Some(v1::Vec3 { x: 3.0, y: 2.0, z: 5.0 }),
        target: Some(v1::Vec3 { x: 0.0, y: 1.0, z: 0.0 }),
        up: Some(v1::Vec3 { x: 0.0, y: 1.0, z: 0.0 }),
        fov_deg: Some(45.0),
        lens: None,
    };
    let mut messages: Vec<(&str, Vec<u8>)> = Vec::new();
    let mut wire = v1::View {
        camera: Some(camera()),
        width: 64,
        height: 48,
        outputs: vec![v1::Output::Color as i32, v1::Output::Range as i32],
        ..Default::default()
    };
    wire.plan = Some(v1::PlanRequest { max_error: Some(0.1), supersampling: Some(2), ..Default::default() });
    messages.push(("View", wire.encode_to_vec()));
    messages.push(("Camera", camera().encode_to_vec()));
    let k = v1::OpenCvDistortion { k1: -0.2, p1: 0.01, ..Default::default() };
    let distortion = Some(v1::intrinsics::Distortion::Opencv(k));
    let intrinsics =
        v1::Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, pixel_center: Some(0.5), distortion };
    let lens = Some(v1::camera::Lens::Intrinsics(intrinsics));
    messages.push(("Camera", v1::Camera { fov_deg: None, lens, ..camera() }.encode_to_vec()));
    let plan = v1::Plan { kind: Some(v1::plan::Kind::Warp(warp_plan())) };
    messages.push(("Plan", plan.encode_to_vec()));
    let source = v1::FrameSource {
        camera: wire.camera,
        width: 64,
        height: 48,
        samples_per_pixel: 1,
        ..v1::FrameSource::default()
    };
    messages.push(("FrameSource", source.encode_to_vec()));
    let frames = v1::WarpPlan { frames: vec![source], samples: Vec::new(), ..warp_plan() };
    let frames = v1::Plan { kind: Some(v1::plan::Kind::Warp(frames)) };
    messages.push(("Plan", frames.encode_to_vec()));
    let history = "0f1e2d3c".to_owned();
    let order = v1::ViewOrder { term: 1, plan: Some(plan), age_ms: 2.0, history, ..Default::default() };
    let ordered = v1::RenderRequest { view: Some(wire.clone()), order: Some(order), ..Default::default() };
    let traceparent = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01".to_owned();
    let ticket = v1::RedirectTicket { serial: 5, request: Some(ordered), traceparent };
    messages.push(("RedirectTicket", ticket.encode_to_vec()));
    let chunk = v1::FrameChunk::decode(&first(super::chunks::frames_corpus())[..]).unwrap_or_default();
    if let Some(v1::frame_chunk::Body::Header(header)) = chunk.body {
        messages.push(("FrameHeader", header.encode_to_vec()));
        messages.push(("Receipt", v1::Receipt { serial: 5, header: Some(header) }.encode_to_vec()));
    }
    let request = v1::RenderRequest {
        view_id: "a view".to_owned(),
        view: Some(wire.clone()),
        deadline_ms: 1000,
        ..Default::default()
    };
    messages.push(("RenderRequest", request.encode_to_vec()));
    let session = v1::SessionView {
        view: Some(wire),
        encoding: v1::Encoding::Zstd as i32,
        redirectable: true,
        history: true,
        ..Default::default()
    };
    messages.push(("SessionView", session.encode_to_vec()));
    messages.extend(argus_cluster::untrusted::corpus());
    messages.extend([
        ("TraceRequest", first(super::chunks::traces_corpus())),
        ("FrameChunk", first(super::chunks::frames_corpus())),
        ("SampleChunk", first(super::chunks::samples_corpus())),
        ("SceneChunk", first(super::chunks::scenes_corpus())),
        ("TraceChunk", first(super::chunks::pixels_corpus())),
    ]);
    let place = |name: &str| ALL.iter().position(|(known, _)| *known == name);
    messages.into_iter().filter_map(|(name, bytes)| Some((place(name)?, bytes))).collect()
}

/// The first message of a stream.
fn first(streams: Vec<Vec<u8>>) -> Vec<u8> {
    let stream = streams.into_iter().next().unwrap_or_default();
    let mut rest = &stream[..];
    let length = prost::decode_length_delimiter(&mut rest).unwrap_or_default();
    rest.get(..length).unwrap_or_default().to_vec()
}
