//! Several coordinators: one leads, the others are on standby, and one of them takes over.

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use argus_client::{Client, Session, SessionEvent, SessionOptions};
use argus_cluster::leadership::{
    HeldLease, LazyRegistry, LocalRegistry, NatsAccess, NatsRegistry, NatsSecret, NatsTls, Registry,
    RegistryError,
};
use argus_cluster::worker::Public;
use argus_proto::v1;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use tonic::Code;

use crate::common;
use crate::common::{
    Authority, Coordinator, LIMIT, Opener, Source, channel, quick, scene, start_coordinator_of, view,
};
use crate::watching::page;

const LEASE: Duration = Duration::from_millis(600);

fn coordinator(registry: Arc<dyn Registry>) -> Coordinator {
    start_coordinator_of(quick(), None, Source { scene: scene("test"), files: Vec::new() }, registry)
}

async fn status(coordinator: &Coordinator) -> v1::StatusResponse {
    let mut client = ClusterClient::new(channel(&coordinator.url()));
    client.status(v1::StatusRequest {}).await.unwrap().into_inner()
}

/// Waits until the coordinator leads this many workers, and returns its status.
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

/// Kills the leader. The standby must lead its workers and answer views within five seconds.
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

    // The standby names the leader, and assigns nothing.
    let refused = common::render(ViewsClient::new(channel(&second.url())), &view(1), 0).await.unwrap_err();
    assert_eq!(refused.code(), Code::Unavailable, "{refused}");
    assert!(refused.message().contains("is on standby"), "{refused}");
    assert_eq!(status(&second).await.term, 0);
    common::render(ViewsClient::new(channel(&first.url())), &view(1), 0).await.unwrap();

    // The names of the workers are recorded a moment after they joined.
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

/// Requests one view after the other in a session until `until`; each must be answered. Returns the longest wait.
async fn moves(session: &mut Session, until: impl Fn() -> bool) -> Duration {
    let mut longest = Duration::ZERO;
    for i in 0.. {
        let began = Instant::now();
        session.send(&view(i));
        match tokio::time::timeout(LIMIT, session.next()).await.expect("a camera is answered").unwrap() {
            SessionEvent::Frame { .. } => longest = longest.max(began.elapsed()),
            // A new leader has no workers yet.
            SessionEvent::Failed { error, .. } => eprintln!("{error}"),
        }
        if until() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    longest
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_standby_takes_over_from_a_leader_that_hangs_with_sessions_open() {
    for redirect in [false, true] {
        let registry = LocalRegistry::shared(7, LEASE);
        let mut first = coordinator(Arc::new(registry.clone()));
        leads(&first, 0).await;
        let second = coordinator(Arc::new(registry));
        let both = format!("{},{}", first.url(), second.url());
        let public = redirect.then_some(Public::AsAdvertised);
        let config = argus_cluster::worker::Config { public, ..argus_cluster::worker::Config::new(&both) };
        let workers: Vec<_> = (0..2)
            .map(|_| common::start_worker_with(config.clone(), &Default::default(), Opener::default().into()))
            .collect();
        leads(&first, 2).await;
        let client = Client::connect(&both).await.unwrap();
        let options = SessionOptions { redirect, ..SessionOptions::default() };
        let mut session = client.session(options);
        moves(&mut session, || true).await;
        tokio::time::sleep(LEASE / 2).await;
        let began = Instant::now();
        let hung = first.hang();
        let longest = moves(&mut session, || began.elapsed() > Duration::from_secs(6)).await;
        eprintln!("the longest of a session that is redirected ({redirect}): {longest:?}");
        assert!(longest < Duration::from_secs(5), "it took {longest:?}");
        assert_eq!(status(&second).await.processes, 2);
        // When it continues it steps down.
        drop(hung);
        assert_eq!(steps_down(&first).await.term, 0);
        drop(workers);
    }
}

async fn steps_down(coordinator: &Coordinator) -> v1::StatusResponse {
    let reached = async {
        loop {
            let status = status(coordinator).await;
            if status.term == 0 {
                return status;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    tokio::time::timeout(LIMIT, reached).await.expect("another one leads")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_orderly_stop_releases_the_lease_at_once() {
    let long = Duration::from_secs(3600);
    let registry = LocalRegistry::shared(1, long);
    let mut first = coordinator(Arc::new(registry.clone()));
    leads(&first, 0).await;
    // A standby retries after an eighth of the lease. With an equal lease, this registry's state between would never
    // be seen.
    first.stop().await.unwrap();
    let held = registry.acquire("another").await.unwrap().expect("the lease was given up");
    assert_eq!(held.term, 2);
}

/// A registry that tests can cut off.
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

    async fn acquire(&self, address: &str) -> Result<Option<HeldLease>, RegistryError> {
        self.check()?;
        self.inner.acquire(address).await
    }

    async fn renew(&self, held: HeldLease, address: &str) -> Result<Option<HeldLease>, RegistryError> {
        self.check()?;
        self.inner.renew(held, address).await
    }

    async fn release(&self, held: HeldLease) {
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
async fn a_leader_without_its_registry_steps_down_before_its_lease_lapses() {
    let shared = LocalRegistry::shared(1, LEASE);
    let flaky = Arc::new(Flaky { inner: shared.clone(), cut_off: AtomicBool::new(false) });
    let first = coordinator(flaky.clone());
    leads(&first, 0).await;
    flaky.cut_off.store(true, Ordering::SeqCst);
    // When the lease becomes free, the old leader has already stepped down.
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
async fn terms_ascend_and_a_lapsed_lease_cannot_be_renewed() {
    let registry = LocalRegistry::shared(5, Duration::from_millis(30));
    let first = registry.acquire("a").await.unwrap().unwrap();
    assert_eq!(registry.acquire("b").await.unwrap(), None);
    let renewed = registry.renew(first, "a").await.unwrap().unwrap();
    assert_eq!(renewed.term, first.term);
    // A renewed lease is valid only with its newest revision.
    assert_eq!(registry.renew(first, "a").await.unwrap(), None);
    tokio::time::sleep(Duration::from_millis(40)).await;
    assert_eq!(registry.renew(renewed, "a").await.unwrap(), None);
    let second = registry.acquire("b").await.unwrap().unwrap();
    assert!(second.term > first.term);
    registry.release(renewed).await;
    assert_eq!(registry.leader().await.as_deref(), Some("b"), "only the holder gives it up");
}

/// A NATS server with JetStream, which ends when it is dropped.
struct Nats {
    server: Child,
    url: String,
    _folder: tempfile::TempDir,
}

impl Nats {
    /// Starts a server; `None`, with a message, if none is installed.
    fn start() -> Option<Self> {
        Self::start_with(&[])
    }

    fn start_with(more: &[&str]) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut command = Command::new("nats-server");
        command
            .args(["-a", "127.0.0.1", "-js", "-p", &port.to_string(), "-sd"])
            .arg(folder.path())
            .args(more);
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
                let why = format!("nats-server, a package of Debian, cannot be started: {error}");
                common::skip("ARGUS_REQUIRE_NATS", &why);
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
    // The existing bucket's lease is used, whatever the second coordinator was told.
    let two = NatsRegistry::connect(&nats.url, Duration::from_secs(60)).await.unwrap();
    assert_eq!(two.lease(), Some(lease));
    a_standby_takes_over([Arc::new(one), Arc::new(two)]).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_renewal_whose_answer_was_lost_is_recognised() {
    let Some(nats) = Nats::start() else { return };
    let alone = LocalRegistry::alone().acquire("a").await.unwrap().unwrap();
    tokio::time::sleep(Duration::from_millis(5)).await;
    let lease = Duration::from_secs(30);
    let one = NatsRegistry::connect(&nats.url, lease).await.unwrap();
    let held = one.acquire("a").await.unwrap().unwrap();
    assert!(held.term > alone.term, "a successor of a single coordinator has a higher term");
    let renewed = one.renew(held, "a").await.unwrap().unwrap();
    // It got no answer, and still presents the old revision.
    let again = one.renew(held, "a").await.unwrap().unwrap();
    assert!(again.revision > renewed.revision && again.term == held.term);
    // Another process at the same address does not hold the lease.
    let two = NatsRegistry::connect(&nats.url, lease).await.unwrap();
    assert_eq!(two.renew(held, "a").await.unwrap(), None);
    assert_eq!(two.leader().await.as_deref(), Some("a"));
}

#[tokio::test]
async fn an_unreachable_registry_is_an_error_with_its_address() {
    let error = NatsRegistry::connect("nats://127.0.0.1:9", Duration::from_secs(1)).await.unwrap_err();
    assert!(error.to_string().contains("nats://127.0.0.1:9"), "{error}");
}

/// Writes files of an authority, and of a member that it certified for 127.0.0.1.
fn certify(folder: &std::path::Path, prefix: &str) {
    let authority = Authority::new();
    let [certificate, key] = authority.certify(&["cluster.argus.internal", "127.0.0.1"]);
    for (name, text) in [("ca.pem", authority.pem()), ("server.pem", certificate), ("server.key", key)] {
        std::fs::write(folder.join(format!("{prefix}{name}")), text).unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_registry_with_tls_accepts_only_members_with_its_credentials() {
    let folder = tempfile::tempdir().unwrap();
    certify(folder.path(), "");
    certify(folder.path(), "other-");
    let file = |name: &str| folder.path().join(name);
    let paths = ["ca.pem", "server.pem", "server.key"].map(|name| file(name).display().to_string());
    let [ca, certificate, key] = paths.each_ref().map(String::as_str);
    let tls = |prefix: &str| {
        let [ca, certificate, key] =
            ["ca.pem", "server.pem", "server.key"].map(|name| file(&format!("{prefix}{name}")));
        Some(NatsTls { ca, certificate, key })
    };
    let (own, others) = (tls(""), tls("other-"));
    let others_certificate = Some(NatsTls { ca: ca.into(), ..others.clone().unwrap() });
    let secret = NatsSecret::parse("argus a-password").ok();
    let more = ["--tls", "--tlsverify", "--tlscacert", ca, "--tlscert", certificate, "--tlskey", key];
    let more = [&more[..], &["--user", "argus", "--pass", "a-password"]].concat();
    let Some(nats) = Nats::start_with(&more) else { return };
    let lease = Duration::from_millis(1500);
    let connect = |tls: &Option<NatsTls>, secret: &Option<NatsSecret>| {
        let access = NatsAccess { tls: tls.clone(), secret: secret.clone() };
        NatsRegistry::connect_as(&nats.url, lease, access)
    };
    for (tls, secret, why) in [
        (&None, &secret, "without a certificate"),
        (&others, &secret, "where it does not trust the server"),
        (&others_certificate, &secret, "with a stranger's certificate"),
        (&own, &None, "without credentials"),
        (&own, &NatsSecret::parse("argus another").ok(), "with another password"),
    ] {
        let error = connect(tls, secret).await.expect_err(why).to_string();
        assert!(!error.contains("another") && !error.contains("a-password"), "{error}");
    }
    let (one, two) = (connect(&own, &secret).await.unwrap(), connect(&own, &secret).await.unwrap());
    a_standby_takes_over([Arc::new(one), Arc::new(two)]).await;
    // With a certificate it does not connect to a plaintext server.
    let Some(plain) = Nats::start() else { return };
    let access = NatsAccess { tls: own, secret: None };
    NatsRegistry::connect_as(&plain.url, lease, access).await.expect_err("by plaintext");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_is_on_standby_until_its_registry_answers() {
    let registry =
        Arc::new(LazyRegistry::new("nats://127.0.0.1:9", Duration::from_secs(1), NatsAccess::default()));
    let source = Source { scene: scene("test"), files: Vec::new() };
    let coordinator = start_coordinator_of(quick(), None, source, registry);
    assert_eq!(page(coordinator.address, "/livez").await.0, 200);
    let (code, reason) = page(coordinator.address, "/readyz").await;
    assert_eq!(code, 503);
    assert!(reason.contains("is on standby"), "{reason}");
    let Some(nats) = Nats::start() else { return };
    let late = LazyRegistry::new(&nats.url, Duration::from_secs(30), NatsAccess::default());
    let held = late.acquire("a").await.unwrap().unwrap();
    assert!(late.renew(held, "a").await.unwrap().is_some());
    assert_eq!(late.leader().await.as_deref(), Some("a"));
}
