//! Monitoring: pages over plain HTTP on the port of the gRPC services, and the health service.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;

use argus_cluster::security::{CLUSTER_NAME, ReloadableSecurity, Security, Tokens};
use argus_proto::v1::views_client::ViewsClient;
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, ServerName};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::{ClientConfig, RootCertStore, crypto};

use crate::common;
use crate::common::roles::{FakeCells, Settings};
use crate::common::{
    Authority, Cluster, Opener, quick, start_coordinator, start_worker, start_worker_with, view,
};

/// Fetches a page like a probe or Prometheus: status code and body.
pub(crate) async fn page(address: SocketAddr, path: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).await.unwrap();
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    let code = answer.split(' ').nth(1).unwrap().parse().unwrap();
    let body = answer.split_once("\r\n\r\n").unwrap().1.to_owned();
    (code, body)
}

/// The value of a metric with exactly these labels.
pub(crate) fn value(metrics: &str, name: &str) -> f64 {
    let line = metrics.lines().find(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(' ')));
    let line = line.unwrap_or_else(|| panic!("no {name} in\n{metrics}"));
    line.rsplit(' ').next().unwrap().parse().unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_is_live_at_once_and_ready_with_its_first_worker() {
    let coordinator = start_coordinator(quick());
    assert_eq!(page(coordinator.address, "/livez").await.0, 200);
    let (code, reason) = page(coordinator.address, "/readyz").await;
    assert_eq!(code, 503);
    assert!(reason.contains("no worker"), "{reason}");
    let config = argus_cluster::worker::Config::new(coordinator.url());
    let worker = start_worker_with(config, &Default::default(), Opener::default().into());
    for address in [coordinator.address, worker.address] {
        tokio::time::timeout(common::LIMIT, async {
            while page(address, "/readyz").await.0 != 200 {
                tokio::time::sleep(std::time::Duration::from_millis(20)).await;
            }
        })
        .await
        .expect("ready in the end");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn metrics_count_work_and_end_as_the_format_demands() {
    let cluster = Cluster::start(2).await;
    for i in 0..3 {
        cluster.render(&view(i)).await.unwrap();
    }
    let (code, metrics) = page(cluster.coordinator.address, "/metrics").await;
    assert_eq!(code, 200);
    assert!(metrics.ends_with("# EOF\n"), "{metrics}");
    assert_eq!(value(&metrics, "argus_views_total{outcome=\"answered\"}"), 3.0);
    assert_eq!(value(&metrics, "argus_view_seconds_count"), 3.0);
    assert_eq!(value(&metrics, "argus_workers_joined_total"), 2.0);
    let pixels: f64 = ["sample", "traced", "guessed"]
        .map(|how| value(&metrics, &format!("argus_pixels_total{{served=\"{how}\"}}")))
        .iter()
        .sum();
    let size = view(0);
    assert_eq!(pixels, 3.0 * f64::from(size.width) * f64::from(size.height));
    let mut composed = 0.0;
    for worker in &cluster.workers {
        let (_, metrics) = page(worker.address, "/metrics").await;
        composed += value(&metrics, "argus_worker_rendered_total{kind=\"view\"}");
        assert!(metrics.ends_with("# EOF\n"), "{metrics}");
    }
    assert_eq!(composed, 3.0);
}

/// The metrics of a coordinator by TLS.
async fn of_certificates() -> String {
    let authority = Authority::new();
    let [certificate, key] = authority.certify(&[CLUSTER_NAME, "127.0.0.1"]).map(String::into_bytes);
    let token = "a-token-of-the-tests-0123456789";
    let tokens = Tokens::parse(&format!("admin tester {token}\n")).unwrap();
    let ca = authority.pem().into_bytes();
    let security = Security { certificate, key, ca: ca.clone(), tokens, require_client_certificates: false };
    let security = Some(Arc::new(ReloadableSecurity::new(security).unwrap()));
    let coordinator = start_coordinator(argus_cluster::coordinator::Config { security, ..quick() });
    let (code, page) = page_by_tls(coordinator.address, "/metrics", &ca, token).await;
    assert_eq!(code, 200, "{page}");
    page
}

/// Fetches a page by TLS and HTTP/1.1.
async fn page_by_tls(address: SocketAddr, path: &str, ca: &[u8], token: &str) -> (u16, String) {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(ca).unwrap()).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let tcp = TcpStream::connect(address).await.unwrap();
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let mut stream = TlsConnector::from(Arc::new(config)).connect(name, tcp).await.unwrap();
    let request = format!(
        "GET {path} HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {token}\r\nConnection: close\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    // A server may end TCP without the end of TLS.
    let _ = stream.read_to_end(&mut answer).await;
    let answer = String::from_utf8(answer).unwrap();
    let code = answer.split(' ').nth(1).unwrap().parse().unwrap();
    (code, answer.split_once("\r\n\r\n").unwrap().1.to_owned())
}

/// Labels that Prometheus adds to whatever it collects as deploy/ says.
const ADDED: [&str; 4] = ["instance", "job", "namespace", "pod"];

/// The Prometheus queries in `deploy/`: names of files, and their contents.
fn queries(folder: &Path) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(queries(&path));
        } else if path.extension().is_some_and(|kind| kind == "json" || kind == "yaml") {
            // As it stands in JSON's quotes or without.
            let text = std::fs::read_to_string(&path).unwrap().replace("\\\"", "\"");
            found.push((path.file_name().unwrap().to_string_lossy().into_owned(), text));
        }
    }
    found
}

/// Parses the metric at the start of a text, and its labels: in a row of a page or in a query.
fn metric(text: &str) -> (&str, Vec<&str>) {
    let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let (name, rest) = text.split_at(text.find(|c| !word(c)).unwrap_or(text.len()));
    let Some(rest) = rest.strip_prefix('{') else { return (name, Vec::new()) };
    // Every second piece is a value; the pieces between values are labels, until the brace closes.
    let between = rest.split('"').step_by(2).take_while(|piece| !piece.starts_with('}'));
    (name, between.map(|piece| piece.trim_matches(|c| !word(c))).collect())
}

/// The labels that a query or a legend groups by:
fn groups(text: &str) -> Vec<&str> {
    let within = |open: &'static str, close: char| {
        text.split(open).skip(1).map(move |rest| rest.split(close).next().unwrap_or(rest))
    };
    let named = within("by (", ')').chain(within("{{", '}')).flat_map(|list| list.split(',')).map(str::trim);
    // An alert names a label as `$labels.instance`, and its value as `$value`.
    named.map(|name| name.trim_start_matches("$labels.")).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn dashboards_and_scaling_use_only_exported_metrics_and_labels() {
    let cluster = Cluster::start(1).await;
    // A worker with light cells has metrics of them.
    let settings = Arc::new(Settings::default());
    *settings.cells.lock() = Some(FakeCells::of(&[1], &[]));
    let with_cells = start_worker(&cluster.coordinator.url(), &settings);
    // Histograms of frames appear with the first one.
    cluster.render(&view(0)).await.unwrap();
    let mut pages = vec![of_certificates().await];
    let has_cells = async {
        loop {
            let (_, page) = page(with_cells.address, "/metrics").await;
            if page.contains("argus_worker_light_cell_pages") {
                return page;
            }
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
    };
    pages.push(tokio::time::timeout(common::LIMIT, has_cells).await.expect("its sampler is made"));
    for address in [cluster.coordinator.address, cluster.workers[0].address] {
        pages.push(page(address, "/metrics").await.1);
    }
    let mut exported = BTreeMap::<String, BTreeSet<String>>::new();
    for page in pages {
        for row in page.lines().filter(|row| row.starts_with("argus_")) {
            let (name, labels) = metric(row);
            exported.entry(name.to_owned()).or_default().extend(labels.into_iter().map(str::to_owned));
        }
    }
    let anywhere: BTreeSet<&String> = exported.values().flatten().collect();

    let mut asked = BTreeMap::<String, usize>::new();
    for (file, text) in queries(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy")) {
        for (at, _) in text.match_indices("argus_") {
            let (name, labels) = metric(&text[at..]);
            let of_it = exported.get(name).unwrap_or_else(|| panic!("{file}: nothing exports {name}"));
            for label in labels {
                assert!(of_it.contains(label) || ADDED.contains(&label), "{file}: {name} has no {label}");
            }
            *asked.entry(file.clone()).or_default() += 1;
        }
        for label in groups(&text) {
            let known = anywhere.contains(&label.to_owned()) || ADDED.contains(&label);
            assert!(known || !asked.contains_key(&file), "{file}: nothing exports the label {label}");
        }
    }
    assert!(asked["argus.json"] > 10 && asked["scaledobject.yaml"] == 1, "{asked:?}");
    for rules in ["prometheus.rules.yaml", "prometheusrule.yaml"] {
        assert!(asked[rules] > 12, "{asked:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn unknown_pages_are_not_found() {
    let cluster = Cluster::start(1).await;
    let (code, _) = page(cluster.coordinator.address, "/etc/passwd").await;
    assert_ne!(code, 500);
    cluster.render(&view(1)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_listens_on_all_addresses_advertises_a_reachable_one() {
    let coordinator = start_coordinator(quick());
    let config = argus_cluster::worker::Config::new(coordinator.url());
    let everywhere = "0.0.0.0:0".parse().unwrap();
    let _worker =
        common::start_worker_at(Some(everywhere), config, &Default::default(), Opener::default().into());
    let views = ViewsClient::new(common::channel(&coordinator.url()));
    let answered = tokio::time::timeout(common::LIMIT, async {
        loop {
            match common::render(views.clone(), &view(1), 0).await {
                Ok(answer) => return answer,
                Err(_) => tokio::time::sleep(std::time::Duration::from_millis(20)).await,
            }
        }
    });
    answered.await.expect("the coordinator reaches the worker");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_is_not_ready_while_its_coordinator_is_gone() {
    let mut cluster = Cluster::start(1).await;
    let worker = cluster.workers[0].address;
    let reaches = async |wanted: u16| {
        tokio::time::timeout(common::LIMIT, async {
            loop {
                let (code, reason) = page(worker, "/readyz").await;
                if code == wanted {
                    return reason;
                }
                tokio::time::sleep(std::time::Duration::from_millis(20)).await;
            }
        })
        .await
        .unwrap_or_else(|_| panic!("never {wanted}"))
    };
    reaches(200).await;
    cluster.coordinator.kill();
    let reason = reaches(503).await;
    assert!(reason.contains("lost its coordinator"), "{reason}");
    let source = common::Source { scene: common::scene("test"), files: Vec::new() };
    let again = common::start_coordinator_at(quick(), Some(cluster.coordinator.address), source);
    reaches(200).await;
    drop(again);
}
