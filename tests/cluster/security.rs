//! A cluster by TLS, each part in its own process: access, and messages for refused clients.

use std::future::poll_fn;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::process::{Output, Stdio};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use crate::support::{PATIENCE, Process, SMALL, argus, run, stderr};
use argus_client::{Client, ConnectOptions, Credentials, SessionEvent, SessionOptions, Token};
use argus_proto::v1;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::samples_client::SamplesClient;
use argus_proto::v1::scenes_client::ScenesClient;
use argus_proto::v1::views_client::ViewsClient;
use argus_scene::{Output as Image, Outputs, PlanRequest, View};
use base64::Engine;
use tonic::body::Body;
use tonic::codegen::{Body as _, Service as _, http};
use tonic::metadata::MetadataValue;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Identity};
use tonic::{Code, Request, Status};

/// Folders from `argus certs`: one for all tests, and one of another authority.
static CERTS: LazyLock<(tempfile::TempDir, tempfile::TempDir)> = LazyLock::new(|| (certs(), certs()));

fn certs() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let made = run(&["certs", folder.path().to_str().unwrap()]);
    assert!(made.status.success(), "{}", stderr(&made));
    folder
}

fn ours(file: &str) -> PathBuf {
    CERTS.0.path().join(file)
}

fn strangers(file: &str) -> PathBuf {
    CERTS.1.path().join(file)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Flags of a member with these files.
fn member(certificate: &Path, key: &Path, ca: &Path) -> Vec<String> {
    [("--certificate", certificate), ("--key", key), ("--ca", ca)]
        .into_iter()
        .flat_map(|(flag, path)| [flag.to_owned(), text(path).to_owned()])
        .collect()
}

/// A cluster by TLS: `argus serve` with two workers.
struct Cluster {
    process: Process,
    url: String,
}

impl Cluster {
    fn start(more: &[&str]) -> Self {
        let config = ours("argus.toml");
        let mut command = argus(&["serve", "--config", text(&config), "--listen", "127.0.0.1:0", "--json"]);
        command.args(["--scene", SMALL, "--workers", "2"]).args(more).stdout(Stdio::piped());
        let mut process = Process::start(command);
        let mut objects =
            serde_json::Deserializer::from_reader(process.take_stdout()).into_iter::<serde_json::Value>();
        let url = objects.next().unwrap().unwrap()["url"].as_str().unwrap().to_owned();
        assert!(url.starts_with("https://127.0.0.1:"), "{url}");
        Self { process, url }
    }

    /// Output of a client's command with this authority and this token.
    fn client(&self, command: &[&str], ca: Option<&Path>, token: Option<&Path>) -> Output {
        let mut all = [command, &["--server", &self.url]].concat();
        for (flag, path) in [("--ca", ca), ("--token-file", token)] {
            if let Some(path) = path {
                all.extend([flag, text(path)]);
            }
        }
        run(&all)
    }

    /// A connection without the checks of our own client.
    async fn raw(&self, identity: Option<(&Path, &Path)>) -> Channel {
        raw(&self.url, identity).await.unwrap()
    }
}

async fn raw(url: &str, identity: Option<(&Path, &Path)>) -> Result<Channel, tonic::transport::Error> {
    let read = |path: &Path| std::fs::read(path).unwrap();
    let mut tls = ClientTlsConfig::new().ca_certificate(Certificate::from_pem(read(&ours("ca.pem"))));
    if let Some((certificate, key)) = identity {
        tls = tls.identity(Identity::from_pem(read(certificate), read(key)));
    }
    Endpoint::from_shared(url.to_owned()).unwrap().tls_config(tls).unwrap().connect().await
}

/// A request with a token.
fn with_token<T>(message: T, file: &Path) -> Request<T> {
    let token = std::fs::read_to_string(file).unwrap();
    let mut request = Request::new(message);
    let header = MetadataValue::try_from(format!("Bearer {}", token.trim())).unwrap();
    request.metadata_mut().insert("authorization", header);
    request
}

/// A page: its status code and its text.
async fn page(channel: &Channel, path: &str, token: Option<&Path>) -> (u16, String) {
    let mut request = http::Request::get(path).body(Body::empty()).unwrap();
    let dressed = token.map(|token| with_token((), token).into_parts().0.into_headers());
    request.headers_mut().extend(dressed.unwrap_or_default());
    let mut channel = channel.clone();
    poll_fn(|cx| channel.poll_ready(cx)).await.unwrap();
    let (head, mut body) = channel.call(request).await.unwrap().into_parts();
    let mut text = Vec::new();
    while let Some(frame) = poll_fn(|cx| Pin::new(&mut body).poll_frame(cx)).await {
        text.extend(frame.unwrap().into_data().unwrap_or_default());
    }
    (head.status.as_u16(), String::from_utf8(text).unwrap())
}

const VIEW: [&str; 9] =
    ["view", "--eye", "60,40,60", "--target", "0,5,0", "--size", "48x32", "--out", "/dev/null"];

fn refused(output: &Output, words: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    for word in words {
        assert!(message.contains(word), "`{word}` is not said: {message}");
    }
}

#[test]
fn a_cluster_by_tls_answers_known_clients_and_gives_others_a_reason() {
    let mut cluster = Cluster::start(&[]);
    let (ca, view, admin) = (ours("ca.pem"), ours("view.token"), ours("admin.token"));
    let seen = cluster.client(&VIEW, Some(&ca), Some(&view));
    assert!(seen.status.success(), "{}", stderr(&seen));
    // The first view is answered as soon as one of the two workers is ready.
    let begin = Instant::now();
    let status = loop {
        let status = cluster.client(&["status", "--json"], Some(&ca), Some(&admin));
        assert!(status.status.success(), "{}", stderr(&status));
        let status: serde_json::Value = serde_json::from_slice(&status.stdout).unwrap();
        if status["processes"] == 2 {
            break status;
        }
        assert!(begin.elapsed() < PATIENCE, "{status:#}");
    };
    for worker in status["workers"].as_array().unwrap() {
        assert!(worker["address"].as_str().unwrap().starts_with("https://127.0.0.1:"), "{worker:#}");
    }
    let load = ["load", "--views", "6", "--size", "48x32", "--json"];
    let load = cluster.client(&load, Some(&ca), Some(&view));
    assert!(load.status.success(), "{}", stderr(&load));

    let wrong = cluster.process.pid().to_string() + "-is-no-token-at-all-but-long-enough";
    let folder = tempfile::tempdir().unwrap();
    let wrong_token = folder.path().join("token");
    std::fs::write(&wrong_token, &wrong).unwrap();
    refused(&cluster.client(&VIEW, Some(&ca), None), &["not allowed", "--token-file"]);
    refused(&cluster.client(&VIEW, Some(&ca), Some(&wrong_token)), &["not allowed", "not one that is known"]);
    refused(&cluster.client(&["status"], Some(&ca), Some(&view)), &["not allowed", "admin", "viewer"]);
    refused(
        &cluster.client(&VIEW, Some(&strangers("ca.pem")), Some(&view)),
        &["trust", "certificate", "--ca"],
    );
    let said = stderr(&cluster.client(&VIEW, Some(&ca), Some(&wrong_token)));
    assert!(!said.contains(&wrong), "a token is printed: {said}");
    // A request that makes no sense has another error than a refused one.
    let plain = cluster.url.replace("https", "http");
    for (arguments, word) in [
        (["--server", &cluster.url, "--token-file", text(&view)], "--ca"),
        (["--server", &plain, "--token-file", text(&view)], "https:// only"),
    ] {
        let output = run(&[&VIEW[..], &arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains(word), "{}", stderr(&output));
    }
    let output = run(&[&VIEW[..], &["--server", &plain]].concat());
    refused(&output, &["https://"]);
    assert!(cluster.process.stop().success());
}

#[tokio::test(flavor = "multi_thread")]
async fn only_members_reach_the_services_within_a_cluster() {
    let cluster = Cluster::start(&[]);
    let admin = ours("admin.token");
    let hash = vec![0; 32];
    let stranger = cluster.raw(None).await;
    let client = cluster.raw(Some((&ours("client.pem"), &ours("client.key")))).await;
    for channel in [stranger, client] {
        // Health is for probes, which have neither certificate nor token.
        let mut health = tonic_health::pb::health_client::HealthClient::new(channel.clone());
        let asked = tonic_health::pb::HealthCheckRequest { service: String::new() };
        assert!(health.check(asked).await.is_ok());
        for token in [None, Some(&admin)] {
            fn dressed<T>(message: T, token: Option<&PathBuf>) -> Request<T> {
                match token {
                    Some(file) => with_token(message, file),
                    None => Request::new(message),
                }
            }
            let denied = |status: Status| {
                assert_eq!(status.code(), Code::PermissionDenied, "{status}");
                assert!(status.message().contains("cluster.argus.internal"), "{status}");
            };
            let mut members = ClusterClient::new(channel.clone());
            let hello = futures::stream::iter([v1::WorkerReport::default()]);
            denied(members.join(dressed(hello, token)).await.err().unwrap());
            let fetch = v1::FetchRequest { scene_hash: hash.clone().into() };
            denied(ScenesClient::new(channel.clone()).fetch(dressed(fetch, token)).await.err().unwrap());
        }
    }
    // A worker's own services are closed to clients.
    let ca = std::fs::read(ours("ca.pem")).unwrap();
    let token = Token::parse(&std::fs::read_to_string(&admin).unwrap()).unwrap();
    let credentials = Credentials { ca: Some(ca), token: Some(token), identity: None };
    let options = ConnectOptions { credentials, ..ConnectOptions::default() };
    let operator = Client::connect_with(&cluster.url, &options).await.unwrap();
    let joined = async {
        loop {
            if let [worker, ..] = &operator.status().await.unwrap().workers[..] {
                return worker.address.clone();
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    let worker = tokio::time::timeout(PATIENCE, joined).await.unwrap();
    // Metrics are for operators and members: workers know no tokens. Probes need neither.
    let (stranger, of_worker) = (cluster.raw(None).await, raw(&worker, None).await.unwrap());
    assert_eq!(page(&stranger, "/metrics", Some(&ours("view.token"))).await.0, 403);
    assert_eq!(page(&of_worker, "/metrics", Some(&admin)).await.0, 401);
    for channel in [&stranger, &of_worker] {
        assert_eq!(page(channel, "/livez", None).await.0, 200);
        assert_eq!(page(channel, "/metrics", None).await.0, 401);
    }
    let member = raw(&worker, Some((&ours("worker.pem"), &ours("worker.key")))).await.unwrap();
    for (channel, token) in [(&stranger, Some(admin.as_path())), (&member, None)] {
        let (code, metrics) = page(channel, "/metrics", token).await;
        assert!(code == 200 && metrics.contains("# TYPE argus_"), "{code}: {metrics}");
    }
    let channel = raw(&worker, None).await.unwrap();
    let subscribe = v1::SubscribeRequest { scene_hash: hash.clone().into(), ..Default::default() };
    let status = SamplesClient::new(channel.clone()).subscribe(with_token(subscribe, &admin)).await;
    assert_eq!(status.err().unwrap().code(), Code::PermissionDenied);
    let render = v1::RenderRequest::default();
    let status = ViewsClient::new(channel).render(with_token(render, &admin)).await;
    assert_eq!(status.err().unwrap().code(), Code::PermissionDenied);
    // A member passes to the check of the request itself.
    let channel = raw(&worker, Some((&ours("worker.pem"), &ours("worker.key")))).await.unwrap();
    let subscribe = v1::SubscribeRequest { scene_hash: hash.into(), ..Default::default() };
    let status = SamplesClient::new(channel).subscribe(subscribe).await.err().unwrap();
    assert_ne!(status.code(), Code::PermissionDenied, "{status}");

    let camera = operator.description().cameras[0].camera;
    let (outputs, plan) = (Outputs::COLOR, PlanRequest::default());
    let view = View { camera, width: 48, height: 32, outputs, plan, pin: None, flow_to: None, rays: None };
    let answer = operator.render(&view, &Default::default()).await.unwrap();
    assert_eq!((answer.frame.width, answer.frame.height), (48, 32));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_fetches_frames_from_a_worker_that_refuses_its_other_requests() {
    let cluster = Cluster::start(&["--redirect"]);
    let read = |file: &str| std::fs::read(ours(file)).unwrap();
    let token = Token::parse(&String::from_utf8(read("view.token")).unwrap()).unwrap();
    let credentials = Credentials { ca: Some(read("ca.pem")), token: Some(token), identity: None };
    let options = ConnectOptions { credentials, ..ConnectOptions::default() };
    let client = Client::connect_with(&cluster.url, &options).await.unwrap();
    let camera = client.description().cameras[0].camera;
    let (outputs, plan) = (Outputs::COLOR, PlanRequest::default());
    let view = View { camera, width: 48, height: 32, outputs, plan, pin: None, flow_to: None, rays: None };
    let mut colors = Vec::new();
    for redirect in [true, false] {
        let mut session = client.session(SessionOptions { redirect, ..SessionOptions::default() });
        let frame = tokio::time::timeout(PATIENCE, async {
            loop {
                session.send(&view);
                match session.next().await.unwrap() {
                    SessionEvent::Frame { frame, .. } => return frame,
                    // Workers are still starting.
                    SessionEvent::Failed { .. } => tokio::time::sleep(Duration::from_millis(200)).await,
                }
            }
        });
        let frame = frame.await.unwrap();
        let relayed = frame.stages.iter().any(|stage| stage.name == "relay");
        assert_eq!(relayed, !redirect, "{:?}", frame.stages);
        colors.push(frame.images[Image::Color].clone().unwrap());
    }
    assert_eq!(colors[0], colors[1], "it does not show which way a frame came");
}

#[test]
fn a_worker_without_a_members_certificate_cannot_join() {
    let cluster = Cluster::start(&[]);
    let join = |flags: &[String]| {
        let mut command = argus(&["worker", "--coordinator", &cluster.url, "--config="]);
        let output = command.args(flags).stdin(Stdio::null()).output().unwrap();
        assert!(!output.status.success());
        stderr(&output)
    };
    let without = join(&[]);
    assert!(without.contains("TLS needs a certificate"), "{without}");
    // Signed by the same authority, but for clients.
    let client = join(&member(&ours("client.pem"), &ours("client.key"), &ours("ca.pem")));
    assert!(client.contains("refused this worker"), "{client}");
    assert!(client.contains("cluster.argus.internal"), "{client}");
    // Signed by another authority, on either side.
    for ca in [ours("ca.pem"), strangers("ca.pem")] {
        let stranger = join(&member(&strangers("worker.pem"), &strangers("worker.key"), &ca));
        assert!(stranger.contains("do not trust each other"), "{stranger}");
    }
    // A member refuses a coordinator of another authority.
    let impostor = member(&ours("worker.pem"), &ours("worker.key"), &strangers("ca.pem"));
    assert!(join(&impostor).contains("do not trust each other"));
}

#[test]
fn without_tls_a_service_listens_only_on_this_machine_unless_allowed() {
    for command in
        [&["coordinator", "--scene", SMALL][..], &["worker", "--coordinator", "http://127.0.0.1:9"]]
    {
        let output = run(&[command, &["--listen", "0.0.0.0:0"]].concat());
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{message}");
        for word in ["without TLS", "argus certs", "--insecure", "127.0.0.1"] {
            assert!(message.contains(word), "`{word}` is not said: {message}");
        }
    }
    let coordinator = ["--scene", SMALL, "--listen", "0.0.0.0:0", "--insecure", "--json"];
    let mut command = argus(&[&["coordinator"][..], &coordinator].concat());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut process = Process::start(command);
    let mut objects =
        serde_json::Deserializer::from_reader(process.take_stdout()).into_iter::<serde_json::Value>();
    assert!(objects.next().unwrap().is_ok());
    let mut said = process.take_stderr();
    assert!(process.stop().success());
    let mut message = String::new();
    std::io::Read::read_to_string(&mut said, &mut message).unwrap();
    assert!(message.contains("WARN") && message.contains("without TLS"), "{message}");
}

#[test]
fn contradictory_settings_are_refused() {
    let (certificate, key, ca) = (ours("server.pem"), ours("server.key"), ours("ca.pem"));
    let all = member(&certificate, &key, &ca);
    let says = |flags: &[String], word: &str| {
        let coordinator = ["coordinator", "--scene", SMALL, "--listen", "127.0.0.1:0", "--config="];
        let output = argus(&coordinator).args(flags).stdin(Stdio::null()).output().unwrap();
        let message = stderr(&output);
        assert!(!output.status.success() && message.contains(word), "`{word}` is not said: {message}");
    };
    says(&all, "security.tokens");
    says(&all[..4], "security.ca");
    says(&all[..2], "security.key");
    says(&all[2..], "security.certificate");
    let tokens = |path: &Path| [&all[..], &["--tokens".to_owned(), text(path).to_owned()]].concat();
    says(&tokens(&ca), "ROLE NAME TOKEN");
    says(&tokens(Path::new("/nowhere")), "/nowhere cannot be read");
    let swapped = member(&key, &certificate, &ca);
    says(&[&swapped[..], &["--tokens".to_owned(), text(&ours("tokens")).to_owned()]].concat(), "PEM block");
}

#[test]
fn certificates_are_made_only_once_and_secrets_are_readable_only_by_the_owner() {
    let again = run(&["certs", text(CERTS.0.path())]);
    assert_eq!(again.status.code(), Some(2));
    assert!(stderr(&again).contains("is there already"), "{}", stderr(&again));
    let bad = tempfile::tempdir().unwrap();
    let bad = run(&["certs", text(&bad.path().join("x")), "--host", "not a name"]);
    assert!(stderr(&bad).contains("--host"), "{}", stderr(&bad));
    #[cfg(unix)]
    for secret in [
        "ca.key",
        "server.key",
        "worker.key",
        "client.key",
        "tokens",
        "view.token",
        "author.token",
        "admin.token",
    ] {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(ours(secret)).unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0, "{secret} has mode {mode:o}");
    }
}

#[test]
fn with_required_client_certificates_a_token_is_not_enough() {
    let cluster = Cluster::start(&["--set", "security.require_client_certificates=true"]);
    let (ca, view) = (ours("ca.pem"), ours("view.token"));
    refused(&cluster.client(&VIEW, Some(&ca), Some(&view)), &["trust"]);
    let (certificate, key) = (ours("client.pem"), ours("client.key"));
    let identity = [
        format!("--set=client.certificate={}", text(&certificate)),
        format!("--set=client.key={}", text(&key)),
    ];
    let with = [&VIEW[..], &[&identity[0], &identity[1]]].concat();
    let seen = cluster.client(&with, Some(&ca), Some(&view));
    assert!(seen.status.success(), "{}", stderr(&seen));
}

#[test]
fn a_workers_certificate_lacks_the_coordinators_host_names() {
    let folder = tempfile::tempdir().unwrap();
    let made = run(&["certs", text(folder.path()), "--host", "render.example.org"]);
    assert!(made.status.success(), "{}", stderr(&made));
    let holds = |file: &str, name: &str| {
        let pem = std::fs::read_to_string(folder.path().join(file)).unwrap();
        let packed: String = pem.lines().filter(|line| !line.starts_with("-----")).collect();
        let der = base64::engine::general_purpose::STANDARD.decode(packed).unwrap();
        der.windows(name.len()).any(|window| window == name.as_bytes())
    };
    for (file, coordinators, members) in
        [("server.pem", true, true), ("worker.pem", false, true), ("client.pem", false, false)]
    {
        assert_eq!(holds(file, "render.example.org"), coordinators, "{file}");
        assert_eq!(holds(file, "cluster.argus.internal"), members, "{file}");
    }
}

#[test]
fn a_remote_registry_needs_tls_and_an_address_without_a_password() {
    for (url, word) in [
        ("nats://nats.example.org:4222", "--insecure"),
        ("nats://argus:s3cret@127.0.0.1:4222", "coordinator.registry_credentials"),
    ] {
        let output = run(&["coordinator", "--scene", SMALL, "--listen", "127.0.0.1:0", "--registry", url]);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(word) && !message.contains("s3cret"), "{message}");
    }
}
