//! Watches the service between loads: the samples it has rendered and holds.

use std::time::Duration;

use anyhow::Result;
use argus_client::{Client, ClusterStatus};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};

/// Longest interval between workers' reports, and longest wait for a metrics page.
const REPORTS: Duration = Duration::from_millis(500);
const PAGE: Duration = Duration::from_secs(2);
/// Largest size of a metrics page.
const MOST_PAGE_BYTES: u64 = 1 << 20;

fn samples_rendered(status: &ClusterStatus) -> u64 {
    status.workers.iter().map(|worker| worker.samples_rendered).sum()
}

/// Samples of all workers together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Samples {
    /// Samples rendered since the workers started.
    pub(super) rendered: u64,
    /// MiB of held texels; `None` if a worker does not report it.
    pub(super) mib: Option<f64>,
}

impl Samples {
    /// The samples now.
    ///
    /// # Errors
    /// The service's status cannot be read.
    pub(super) async fn of(client: &Client) -> Result<Self> {
        sleep(REPORTS).await;
        let status = client.status().await?;
        let mut bytes = Some(0.0);
        for worker in &status.workers {
            let held = timeout(PAGE, held_bytes(&worker.address)).await.ok().flatten();
            bytes = bytes.zip(held).map(|(sum, held)| sum + held);
        }
        Ok(Self { rendered: samples_rendered(&status), mib: bytes.map(|bytes| bytes / f64::from(1 << 20)) })
    }
}

/// Bytes of texels that the worker at an address such as `http://127.0.0.1:7401` holds, from its metrics page; `None`
/// if the page cannot be read.
async fn held_bytes(address: &str) -> Option<f64> {
    let host = address.strip_prefix("http://")?.trim_end_matches('/');
    let mut stream = TcpStream::connect(host).await.ok()?;
    let request = format!("GET /metrics HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.ok()?;
    let mut page = String::new();
    stream.take(MOST_PAGE_BYTES).read_to_string(&mut page).await.ok()?;
    gauge(&page, "argus_worker_held_bytes")
}

/// The value of a gauge without labels.
fn gauge(page: &str, name: &str) -> Option<f64> {
    let value = page.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '))?;
    value.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use tokio::net::TcpListener;

    use super::*;

    #[test]
    fn a_gauge_is_found_by_its_full_name() {
        let page = "# HELP argus_held x\nargus_held_bytes 7\nargus_held 12.5\nargus_odd{a=\"b\"} 3\n";
        assert_eq!(gauge(page, "argus_held"), Some(12.5));
        assert_eq!((gauge(page, "argus_odd"), gauge(page, "argus_hel"), gauge("", "a")), (None, None, None));
    }

    #[tokio::test]
    async fn held_bytes_are_read_from_the_metrics_page_and_missing_without_one() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let answering = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut asked = Vec::new();
            while !asked.ends_with(b"\r\n\r\n") {
                asked.push(stream.read_u8().await.unwrap());
            }
            assert!(asked.starts_with(b"GET /metrics HTTP/1.1\r\n"));
            let page = "HTTP/1.1 200 OK\r\n\r\nargus_worker_held_bytes 4194304\n# EOF\n";
            stream.write_all(page.as_bytes()).await.unwrap();
        });
        assert_eq!(held_bytes(&address).await, Some(4_194_304.0));
        answering.await.unwrap();
        assert_eq!(held_bytes(&address).await, None, "the address is closed");
        assert_eq!(held_bytes("https://127.0.0.1:1").await, None);
    }
}
