//! Several coordinators: one leads, the others stand by, and one of them takes over.

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use argus_cluster::leadership::{Held, LateRegistry, LocalRegistry, NatsRegistry, Registry, RegistryError};
use argus_proto::v1;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use tonic::Code;

use crate::common;
use crate::common::{Coordinator, LIMIT, Opener, Source, channel, quick, scene, start_coordinator_of, view};
use crate::watching::page;

const LEASE: Duration = Duration::from_millis(600);

fn coordinator(registry: Arc<dyn Registry>) -> Coordinator {
    start_coordinator_of(quick(), None, Source { scene: scene("test"), files: Vec::new() }, registry)
}

async fn status(coordinator: &Coordinator) -> v1::StatusResponse {
    let mut client = ClusterClient::new(channel(&coordinator.url()));
    client.status(v1::StatusRequest {}).await.unwrap().into_inner()
}

/// Waits until the coordinator leads so many workers; its status then.
async fn leads(coordinator: &Coordinator, workers: u32) -> v1::StatusResponse {
    let reached = async {
        loop {
            let status = status(coordinator).await;
            if status.term > 0 && status.processes == workers {
                return status;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    tokio::time::timeout(LIMIT, reached).await.expect("it leads in the end")
}

/// A coordinator that leads is killed; the standby must lead its workers and answer views within five seconds.
async fn a_standby_takes_over(registries: [Arc<dyn Registry>; 2]) {
    let [one, two] = registries;
    let mut first = coordinator(one);
    let led = leads(&first, 0).await;
    let second = coordinator(two);
    let both = format!("{},{}", second.url(), first.url());
    let config = argus_cluster::worker::Config::new(both);
    let workers: Vec<_> = (0..2)
        .map(|_| common::start_worker_with(config.clone(), &Default::default(), Opener::default().into()))
        .collect();
    leads(&first, 2).await;

    // The standby says who leads, and assigns nothing.
    let refused = common::render(ViewsClient::new(channel(&second.url())), &view(1), 0).await.unwrap_err();
    assert_eq!(refused.code(), Code::Unavailable, "{refused}");
    assert!(refused.message().contains("stands by"), "{refused}");
    assert_eq!(status(&second).await.term, 0);
    common::render(ViewsClient::new(channel(&first.url())), &view(1), 0).await.unwrap();

    // The names of the workers are written down a moment after they joined.
    tokio::time::sleep(LEASE / 2).await;
    let began = Instant::now();
    first.kill();
    let status = leads(&second, 2).await;
    common::render(ViewsClient::new(channel(&second.url())), &view(2), 0).await.unwrap();
    assert!(began.elapsed() < Duration::from_secs(5), "it took {:?}", began.elapsed());
    assert!(status.term > led.term, "{} after {}", status.term, led.term);
    drop(workers);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_standby_takes_over_within_five_seconds() {
    let registry = LocalRegistry::shared(7, LEASE);
    a_standby_takes_over([Arc::new(registry.clone()), Arc::new(registry)]).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_that_stops_in_order_leaves_at_once() {
    let long = Duration::from_secs(3600);
    let registry = LocalRegistry::shared(1, long);
    let mut first = coordinator(Arc::new(registry.clone()));
    leads(&first, 0).await;
    // A standby asks again after an eighth of the lease: as long as this one's, it would never be seen to lead.
    first.stop().await.unwrap();
    let held = registry.acquire("another").await.unwrap().expect("the lease was given up");
    assert_eq!(held.term, 2);
}

/// A registry that can be cut off.
#[derive(Debug)]
struct Flaky {
    inner: LocalRegistry,
    cut_off: AtomicBool,
}

#[tonic::async_trait]
impl Registry for Flaky {
    fn lease(&self) -> Option<Duration> {
        self.inner.lease()
    }

    async fn acquire(&self, address: &str) -> Result<Option<Held>, RegistryError> {
        self.check()?;
        self.inner.acquire(address).await
    }

    async fn renew(&self, held: Held, address: &str) -> Result<Option<Held>, RegistryError> {
        self.check()?;
        self.inner.renew(held, address).await
    }

    async fn release(&self, held: Held) {
        if self.check().is_ok() {
            self.inner.release(held).await;
        }
    }

    async fn leader(&self) -> Option<String> {
        self.inner.leader().await
    }

    async fn note_workers(&self, names: &[String]) {
        self.inner.note_workers(names).await;
    }

    async fn noted_workers(&self) -> Vec<String> {
        self.inner.noted_workers().await
    }
}

impl Flaky {
    fn check(&self) -> Result<(), RegistryError> {
        match self.cut_off.load(Ordering::SeqCst) {
            true => Err(RegistryError { url: "test".to_owned(), reason: "cut off".to_owned() }),
            false => Ok(()),
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_leader_that_is_cut_off_from_the_registry_stops_before_another_one_can_lead() {
    let shared = LocalRegistry::shared(1, LEASE);
    let flaky = Arc::new(Flaky { inner: shared.clone(), cut_off: AtomicBool::new(false) });
    let first = coordinator(flaky.clone());
    leads(&first, 0).await;
    flaky.cut_off.store(true, Ordering::SeqCst);
    // Whoever takes the lease at the first moment that it is free finds the old leader leading no more.
    let taken = async {
        loop {
            if let Some(held) = shared.acquire("another").await.unwrap() {
                return held;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    };
    let held = tokio::time::timeout(LIMIT, taken).await.unwrap();
    assert_eq!(held.term, 2);
    assert_eq!(status(&first).await.term, 0, "two lead");
    let refused = common::render(ViewsClient::new(channel(&first.url())), &view(1), 0).await.unwrap_err();
    assert_eq!(refused.code(), Code::Unavailable);
}

#[tokio::test]
async fn terms_ascend_and_a_lease_that_lapsed_is_not_renewed() {
    let registry = LocalRegistry::shared(5, Duration::from_millis(30));
    let first = registry.acquire("a").await.unwrap().unwrap();
    assert_eq!(registry.acquire("b").await.unwrap(), None);
    let renewed = registry.renew(first, "a").await.unwrap().unwrap();
    assert_eq!(renewed.term, first.term);
    // What was renewed is known by its newest revision alone.
    assert_eq!(registry.renew(first, "a").await.unwrap(), None);
    tokio::time::sleep(Duration::from_millis(40)).await;
    assert_eq!(registry.renew(renewed, "a").await.unwrap(), None);
    let second = registry.acquire("b").await.unwrap().unwrap();
    assert!(second.term > first.term);
    registry.release(renewed).await;
    assert_eq!(registry.leader().await.as_deref(), Some("b"), "only the holder gives it up");
}

/// A NATS server with JetStream, ended with its owner.
struct Nats {
    server: Child,
    url: String,
    _folder: tempfile::TempDir,
}

impl Nats {
    /// `None`, and a line that says so, where none is installed.
    fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut command = Command::new("nats-server");
        command.args(["-a", "127.0.0.1", "-js", "-p", &port.to_string(), "-sd"]).arg(folder.path());
        match command.stdout(Stdio::null()).stderr(Stdio::null()).spawn() {
            Ok(server) => {
                let url = format!("nats://127.0.0.1:{port}");
                let begin = Instant::now();
                while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
                    assert!(begin.elapsed() < LIMIT, "nats-server does not listen");
                    std::thread::sleep(Duration::from_millis(10));
                }
                Some(Self { server, url, _folder: folder })
            }
            Err(error) => {
                let required = std::env::var("ARGUS_REQUIRE_NATS").is_ok_and(|value| value == "1");
                assert!(!required, "ARGUS_REQUIRE_NATS=1, yet nats-server cannot be started: {error}");
                eprintln!(
                    "SKIPPED, LOUDLY: nats-server cannot be started ({error}); it is a package of Debian"
                );
                None
            }
        }
    }
}

impl Drop for Nats {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_standby_takes_over_through_nats() {
    let Some(nats) = Nats::start() else { return };
    let lease = Duration::from_millis(1500);
    let one = NatsRegistry::connect(&nats.url, lease).await.unwrap();
    // The bucket is there: its lease counts, whatever the second one was told.
    let two = NatsRegistry::connect(&nats.url, Duration::from_secs(60)).await.unwrap();
    assert_eq!(two.lease(), Some(lease));
    a_standby_takes_over([Arc::new(one), Arc::new(two)]).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_renewal_whose_answer_was_lost_is_known_for_ones_own() {
    let Some(nats) = Nats::start() else { return };
    let alone = LocalRegistry::alone().acquire("a").await.unwrap().unwrap();
    tokio::time::sleep(Duration::from_millis(5)).await;
    let lease = Duration::from_secs(30);
    let one = NatsRegistry::connect(&nats.url, lease).await.unwrap();
    let held = one.acquire("a").await.unwrap().unwrap();
    assert!(held.term > alone.term, "whoever comes after a coordinator that was alone has a higher term");
    let renewed = one.renew(held, "a").await.unwrap().unwrap();
    // Of that it never heard, and says what it held before.
    let again = one.renew(held, "a").await.unwrap().unwrap();
    assert!(again.revision > renewed.revision && again.term == held.term);
    // Another process at the same address is another one.
    let two = NatsRegistry::connect(&nats.url, lease).await.unwrap();
    assert_eq!(two.renew(held, "a").await.unwrap(), None);
    assert_eq!(two.leader().await.as_deref(), Some("a"));
}

#[tokio::test]
async fn a_registry_that_is_not_there_is_an_error_that_names_it() {
    let error = NatsRegistry::connect("nats://127.0.0.1:9", Duration::from_secs(1)).await.unwrap_err();
    assert!(error.to_string().contains("nats://127.0.0.1:9"), "{error}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_stands_by_until_its_registry_is_there() {
    let registry = Arc::new(LateRegistry::new("nats://127.0.0.1:9", Duration::from_secs(1)));
    let source = Source { scene: scene("test"), files: Vec::new() };
    let coordinator = start_coordinator_of(quick(), None, source, registry);
    assert_eq!(page(coordinator.address, "/livez").await.0, 200);
    let (code, reason) = page(coordinator.address, "/readyz").await;
    assert_eq!(code, 503);
    assert!(reason.contains("stands by"), "{reason}");
    let Some(nats) = Nats::start() else { return };
    let late = LateRegistry::new(&nats.url, Duration::from_secs(30));
    let held = late.acquire("a").await.unwrap().unwrap();
    assert!(late.renew(held, "a").await.unwrap().is_some());
    assert_eq!(late.leader().await.as_deref(), Some("a"));
}
