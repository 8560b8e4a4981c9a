//! What processes are watched by: pages over plain HTTP on the port of the gRPC services, and the health service.

use std::net::SocketAddr;

use argus_proto::v1::views_client::ViewsClient;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::common;
use crate::common::{Cluster, Opener, quick, start_coordinator, start_worker_with, view};

/// A page, as a probe or Prometheus asks for it: status code and body.
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
async fn a_coordinator_is_alive_at_once_and_ready_with_its_first_worker() {
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
async fn metrics_count_what_was_done_and_end_as_the_format_demands() {
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

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_no_page_is_no_page_and_the_services_go_on() {
    let cluster = Cluster::start(1).await;
    let (code, _) = page(cluster.coordinator.address, "/etc/passwd").await;
    assert_ne!(code, 500);
    cluster.render(&view(1)).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_listens_everywhere_says_where_it_is_reached() {
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
