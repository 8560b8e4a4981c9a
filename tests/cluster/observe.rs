//! Observation of a cluster of processes: probes, a live table, and a view's trace through all processes.

use std::collections::BTreeSet;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::support::{Coordinator, PATIENCE, Process, SMALL, argus, run, stderr};
use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{
    TraceService, TraceServiceServer,
};
use opentelemetry_proto::tonic::collector::trace::v1::{
    ExportTraceServiceRequest, ExportTraceServiceResponse,
};
use opentelemetry_proto::tonic::trace::v1::Span;
use tokio::net::TcpListener;
use tokio::sync::Mutex;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::{Request, Response, Status};

/// The name of a service, and one of its spans.
type Received = (String, Span);

/// A collector that keeps received spans.
#[derive(Clone, Default)]
struct Collector(Arc<Mutex<Vec<Received>>>);

#[tonic::async_trait]
impl TraceService for Collector {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        for resource in request.into_inner().resource_spans {
            let service = resource.resource.iter().flat_map(|resource| &resource.attributes);
            let service = service.filter(|attribute| attribute.key == "service.name");
            let service = format!("{:?}", service.map(|attribute| &attribute.value).next());
            let spans = resource.scope_spans.into_iter().flat_map(|scope| scope.spans);
            self.0.lock().await.extend(spans.map(|span| (service.clone(), span)));
        }
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

/// Makes a process export to `url` soon after each span ends.
fn exporting(command: &mut Command, url: &str) {
    command.env("OTEL_EXPORTER_OTLP_ENDPOINT", url).env("OTEL_BSP_SCHEDULE_DELAY", "100");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_views_trace_includes_client_coordinator_compositor_and_sampler() {
    let collector = Collector::default();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let service = TraceServiceServer::new(collector.clone());
    let server = tonic::transport::Server::builder().add_service(service);
    tokio::spawn(server.serve_with_incoming(TcpListenerStream::new(listener)));

    let coordinator = Coordinator::start_with(SMALL, &["--samplers-composite=false"], |c| exporting(c, &url));
    let mut workers = Vec::new();
    for _ in 0..2 {
        let mut command = argus(&["worker", "--coordinator", &coordinator.url, "--listen", "127.0.0.1:0"]);
        exporting(&mut command, &url);
        workers.push(Process::start(command));
    }
    // A worker with both roles fetches no sample.
    let roles = |status: &serde_json::Value| status["samplers"] == 1 && status["compositors"] == 1;
    coordinator.wait_until("a sampler and a compositor", roles);
    // While the compositor measures what its views cost, the sampler composes.
    let is_priced = |status: &serde_json::Value| {
        let workers = status["workers"].as_array();
        workers.is_some_and(|workers| workers.iter().all(|worker| worker["warp_cost"].is_object()))
    };
    coordinator.wait_until("prices", is_priced);
    let mut view = argus(&["view", "--server", &coordinator.url, "--eye", "0,200,300", "--target", "0,0,0"]);
    let folder = tempfile::tempdir().unwrap();
    view.args(["--size", "96x72", "--search", "splat", "--out"]).arg(folder.path().join("view.png"));
    exporting(&mut view, &url);
    let output = view.stdin(Stdio::null()).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));

    // The view's trace holds a span of every process, down to the passes.
    let wanted = ["view", "relay", "render", "queue"];
    let of_it = trace_with(&collector, |names| {
        let pass = |beginning: &str| names.iter().any(|name| name.starts_with(beginning));
        wanted.iter().all(|name| names.contains(name)) && pass("splat ")
    })
    .await;
    let services: BTreeSet<&String> = of_it.iter().map(|(service, _)| service).collect();
    assert_eq!(services.len(), 3, "client, coordinator and workers: {services:?}");

    // The transfer of a sample between workers is one trace: the view's, or its own if it was fetched before the view.
    let begin = Instant::now();
    while !has_trace(&collector, &["fetch sample", "serve samples", "sample", "render sample"]).await {
        assert!(begin.elapsed() < PATIENCE, "no sample has a trace through both workers");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }

    // A session's camera has a trace too, from the client on.
    let mut load =
        argus(&["load", "--server", &coordinator.url, "--clients", "1", "--seconds", "2", "--sessions"]);
    exporting(&mut load, &url);
    let output = load.stdin(Stdio::null()).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let of_a_camera = |(_, span): &Received| {
        span.name == "view" && span.attributes.iter().any(|attribute| attribute.key == "camera")
    };
    let begin = Instant::now();
    loop {
        let spans = collector.0.lock().await.clone();
        let traces: BTreeSet<&Vec<u8>> =
            spans.iter().filter(|received| of_a_camera(received)).map(|(_, span)| &span.trace_id).collect();
        let whole = |trace: &Vec<u8>| {
            ["relay", "render", "queue"]
                .iter()
                .all(|name| spans.iter().any(|(_, span)| span.trace_id == *trace && span.name == *name))
        };
        if traces.into_iter().any(whole) {
            break;
        }
        assert!(begin.elapsed() < PATIENCE, "no camera of the session has a trace through all processes");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

/// Whether some trace has spans of all these names.
async fn has_trace(collector: &Collector, wanted: &[&str]) -> bool {
    let spans = collector.0.lock().await.clone();
    let has = |trace: &[u8], name: &str| spans.iter().any(|(_, s)| s.trace_id == trace && s.name == name);
    spans.iter().any(|(_, span)| wanted.iter().all(|name| has(&span.trace_id, name)))
}

/// The spans of a view's trace once it has the wanted names; all of them have their parents.
async fn trace_with(collector: &Collector, wanted: impl Fn(&BTreeSet<&str>) -> bool) -> Vec<Received> {
    let begin = Instant::now();
    let mut lacking = String::new();
    loop {
        let spans = collector.0.lock().await.clone();
        if let Some((_, root)) = spans.iter().find(|(_, span)| span.name == "view") {
            let of_it: Vec<Received> =
                spans.iter().filter(|(_, s)| s.trace_id == root.trace_id).cloned().collect();
            let names: BTreeSet<&str> = of_it.iter().map(|(_, span)| span.name.as_str()).collect();
            let ids: BTreeSet<&Vec<u8>> = of_it.iter().map(|(_, span)| &span.span_id).collect();
            // A parent may be exported after its children.
            let has_parent = |span: &Span| span.name == "view" || ids.contains(&span.parent_span_id);
            if wanted(&names) && of_it.iter().all(|(_, span)| has_parent(span)) {
                for (_, span) in &of_it {
                    assert!(span.end_time_unix_nano >= span.start_time_unix_nano, "{}", span.name);
                }
                return of_it;
            }
            let orphans = of_it.iter().filter(|(_, span)| !has_parent(span));
            let orphans: Vec<&str> = orphans.map(|(_, span)| span.name.as_str()).collect();
            lacking = format!("its trace has {names:?}, of which without a parent: {orphans:?}");
        }
        assert!(begin.elapsed() < PATIENCE, "not all spans of the view came: {lacking}");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

#[test]
fn health_tells_by_its_exit_code_whether_views_can_be_answered() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let health = |more: &[&str]| run(&[&["health", "--server", &coordinator.url], more].concat());
    let live = health(&["--live"]);
    assert!(live.status.success(), "{}", stderr(&live));
    let unready = health(&[]);
    assert_eq!(unready.status.code(), Some(1), "{}", stderr(&unready));
    assert!(stderr(&unready).contains("is not ready"), "{}", stderr(&unready));
    let _worker = coordinator.worker(&[]);
    coordinator.wait_for_workers(1);
    let begin = Instant::now();
    while !health(&["--json"]).status.success() {
        assert!(begin.elapsed() < PATIENCE);
    }
    let nobody = run(&["health", "--server", "http://127.0.0.1:9", "--timeout", "2"]);
    assert_eq!(nobody.status.code(), Some(1));
    assert!(stderr(&nobody).contains("no server answers"), "{}", stderr(&nobody));
}

#[test]
fn watching_prints_the_table_repeatedly_and_logs_are_json_on_request() {
    let coordinator = Coordinator::start(SMALL, &[]);
    let mut command = argus(&["status", "--server", &coordinator.url, "--watch", "0.05"]);
    let mut watching = command.stdout(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(1500));
    watching.kill().unwrap();
    let shown = watching.wait_with_output().unwrap();
    let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
    assert!(shown.matches(" processes = K ").count() >= 2, "{shown}");
    assert!(shown.contains("views a second"), "{shown}");

    let mut command = argus(&["worker", "--coordinator", "http://127.0.0.1:9", "--log-format", "json"]);
    command.arg("--set=worker.coordinator_wait_secs=1");
    let output = command.stdin(Stdio::null()).output().unwrap();
    for line in stderr(&output).lines().filter(|line| line.starts_with('{')) {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        assert!(line["level"].is_string() && line["message"].is_string(), "{line}");
    }
    assert!(stderr(&output).lines().any(|line| line.starts_with('{')), "{}", stderr(&output));
}
