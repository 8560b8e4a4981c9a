//! Simulated network faults: the processes' services over a network whose delays, losses and partitions follow from a
//! seed.
//!
//! Time is turmoil's, and stands still while a process computes, except for render threads, whose fakes take no time:
//! the simulation pauses for them after each step.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use argus_client::{Client, ConnectOptions, Session, SessionEvent, SessionOptions};
use argus_cluster::leadership::LocalRegistry;
use argus_cluster::network::{Accept, Connect, Duplex, Network};
use argus_cluster::worker::Public;
use argus_cluster::{coordinator, worker};
use argus_proto::v1;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::views_client::ViewsClient;
use futures::FutureExt;
use futures::future::{BoxFuture, join_all};
use hyper_util::rt::TokioIo;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tonic::transport::server::TcpConnectInfo;
use tonic::transport::{Channel, Endpoint, Uri};
use tower::service_fn;
use turmoil::{Builder, Sim};

use crate::common;
use crate::common::roles::{Factory, Settings};
use crate::common::{Opener, Source, quick, scene, view};

const COORDINATOR: &str = "coordinator";
const PORT: u16 = 7400;
const WORKERS: [&str; 3] = ["one", "two", "three"];

/// Time between two views of the client.
const PACE: Duration = Duration::from_millis(50);

/// Real time for render threads after each step.
const MOMENT: Duration = Duration::from_micros(100);

struct Simulated;

impl Connect for Simulated {
    fn connect(&self, host: String, port: u16) -> BoxFuture<'static, io::Result<Box<dyn Duplex>>> {
        async move {
            let stream = turmoil::net::TcpStream::connect((host, port)).await?;
            Ok(Box::new(stream) as Box<dyn Duplex>)
        }
        .boxed()
    }
}

struct Listening(turmoil::net::TcpListener);

impl Listening {
    async fn on(port: u16) -> io::Result<Self> {
        turmoil::net::TcpListener::bind(("0.0.0.0", port)).await.map(Self)
    }
}

impl Accept for Listening {
    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.0.local_addr()
    }

    fn accept(&self) -> BoxFuture<'_, io::Result<(Box<dyn Duplex>, TcpConnectInfo)>> {
        async {
            let (stream, remote) = self.0.accept().await?;
            let between = TcpConnectInfo { local_addr: stream.local_addr().ok(), remote_addr: Some(remote) };
            Ok((Box::new(stream) as Box<dyn Duplex>, between))
        }
        .boxed()
    }
}

/// A coordinator and three workers, which have not started yet.
fn cluster<'a>(seed: u64, change: impl FnOnce(&mut Builder)) -> Sim<'a> {
    cluster_of(quick(), seed, change)
}

/// A simulated cluster with another configuration.
fn cluster_of<'a>(config: coordinator::Config, seed: u64, change: impl FnOnce(&mut Builder)) -> Sim<'a> {
    let mut builder = Builder::new();
    builder
        .rng_seed(seed)
        .simulation_duration(Duration::from_secs(120))
        .tick_duration(Duration::from_millis(2))
        .min_message_latency(Duration::from_millis(1))
        .max_message_latency(Duration::from_millis(6))
        .tcp_capacity(1 << 16)
        .enable_random_order();
    change(&mut builder);
    let mut sim = builder.build();
    let config = coordinator::Config { network: Network::simulated(Arc::new(Simulated)), ..config };
    sim.host(COORDINATOR, move || serve(config.clone()));
    for name in WORKERS {
        sim.host(name, move || async move {
            let config = worker::Config {
                id: Some(name.to_owned()),
                advertise: Some(format!("http://{name}:{PORT}")),
                public: Some(Public::AsAdvertised),
                network: Network::simulated(Arc::new(Simulated)),
                join_timeout: Duration::from_secs(60),
                ..worker::Config::new(format!("http://{COORDINATOR}:{PORT}"))
            };
            let factory = Arc::new(Factory { settings: Arc::new(Settings::default()) });
            let listening = Listening::on(PORT).await?;
            let opener = Arc::new(Opener::default());
            worker::run(config, listening, factory, opener, CancellationToken::new()).await?;
            Ok(())
        });
    }
    sim
}

async fn serve(config: coordinator::Config) -> Result<(), Box<dyn std::error::Error>> {
    let source = Arc::new(Source { scene: scene("test"), files: Vec::new() });
    let registry = Arc::new(LocalRegistry::alone());
    let listening = Listening::on(PORT).await?;
    coordinator::serve(config, listening, source, registry, CancellationToken::new()).await?;
    Ok(())
}

fn run(mut sim: Sim<'_>) {
    while !sim.step().unwrap() {
        std::thread::sleep(MOMENT);
    }
}

fn channel() -> Channel {
    let endpoint = Endpoint::from_shared(format!("http://{COORDINATOR}:{PORT}")).unwrap();
    endpoint.connect_with_connector_lazy(service_fn(|uri: Uri| async move {
        let host = uri.host().unwrap_or_default().to_owned();
        Simulated.connect(host, PORT).await.map(TokioIo::new)
    }))
}

/// The client library, over the simulated network.
async fn client() -> Client {
    let network = Network::simulated(Arc::new(Simulated));
    let options = ConnectOptions { network, ..ConnectOptions::default() };
    loop {
        match Client::connect_with(&format!("http://{COORDINATOR}:{PORT}"), &options).await {
            Ok(client) => return client,
            Err(_) => tokio::time::sleep(PACE).await,
        }
    }
}

/// Observations of a session.
#[derive(Debug, Default)]
struct Seen {
    /// The longest wait for a camera's frame.
    gap: Duration,
    /// The time of each frame, and the worker that made it.
    frames: Vec<(Duration, String)>,
    failures: Vec<String>,
}

/// Moves a camera for a time; each position must be answered.
async fn moves(session: &mut Session, time: Duration) -> Seen {
    let began = Instant::now();
    let mut seen = Seen::default();
    let mut i = 0;
    while began.elapsed() < time {
        i += 1;
        let asked = Instant::now();
        session.send(&view(i));
        match session.next().await.expect("the session is kept up") {
            SessionEvent::Frame { frame, meta, .. } => {
                assert_eq!((frame.width, frame.height), (32, 24));
                let waited = asked.elapsed();
                // A millisecond for the transfer of the last byte.
                let age = Duration::from_secs_f64(meta.age_ms * 1e-3);
                assert!(age <= waited + Duration::from_millis(1), "{age:?} old after {waited:?}");
                seen.gap = seen.gap.max(waited);
                seen.frames.push((began.elapsed(), meta.worker));
            }
            SessionEvent::Failed { error, .. } => seen.failures.push(error.to_string()),
        }
        tokio::time::sleep(PACE).await;
    }
    seen
}

/// The workers of a role.
async fn with_role(role: v1::Role) -> Vec<&'static str> {
    let status = there(3).await;
    let of_it = status.workers.iter().filter(|worker| worker.role == role as i32);
    of_it.filter_map(|worker| WORKERS.into_iter().find(|name| *name == worker.id)).collect()
}

/// The compositor that composed most views.
async fn busiest_compositor() -> &'static str {
    let status = there(3).await;
    let composing = status.workers.iter().filter(|worker| worker.role == v1::Role::Compositor as i32);
    let busiest = composing.max_by_key(|worker| worker.views_composed).expect("every role is played");
    WORKERS.into_iter().find(|name| *name == busiest.id).expect("a worker of this test")
}

async fn status() -> v1::StatusResponse {
    ClusterClient::new(channel()).status(v1::StatusRequest {}).await.unwrap().into_inner()
}

/// Waits until this many workers are ready, and returns the status.
async fn there(workers: u32) -> v1::StatusResponse {
    let mut client = ClusterClient::new(channel());
    loop {
        if let Ok(status) = client.status(v1::StatusRequest {}).await {
            let status = status.into_inner();
            if status.processes == workers {
                return status;
            }
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

/// Requests a view every [`PACE`]; all must be answered. Returns the longest time of one.
async fn asks(views: usize) -> Duration {
    let channel = channel();
    let longest = Arc::new(AtomicU64::new(0));
    let asked = (0..views).map(|i| {
        let (channel, longest) = (channel.clone(), longest.clone());
        async move {
            tokio::time::sleep(PACE * i as u32).await;
            let began = Instant::now();
            let (frame, _) = common::render(ViewsClient::new(channel), &view(i), 0).await.unwrap();
            assert_eq!((frame.width, frame.height), (32, 24));
            longest.fetch_max(began.elapsed().as_millis() as u64, Ordering::SeqCst);
        }
    });
    join_all(asked).await;
    Duration::from_millis(longest.load(Ordering::SeqCst))
}

async fn after(secs: f64, act: impl FnOnce()) {
    tokio::time::sleep(Duration::from_secs_f64(secs)).await;
    act();
}

#[test]
fn a_partitioned_worker_loses_no_view_and_rejoins() {
    let mut sim = cluster(1, |_| {});
    sim.client("client", async {
        there(3).await;
        let cut = async {
            after(1.0, || turmoil::partition(COORDINATOR, "one")).await;
            // Longer than its lease.
            after(6.0, || turmoil::repair(COORDINATOR, "one")).await;
        };
        let (longest, ()) = tokio::join!(asks(160), cut);
        assert!(longest < Duration::from_secs(3), "a view took {longest:?}");
        let status = there(3).await;
        let counters = status.counters.unwrap();
        assert_eq!((counters.views_answered, counters.views_failed), (160, 0), "{counters:?}");
        assert_eq!(counters.workers_lost, 1);
        Ok(())
    });
    run(sim);
}

#[test]
fn views_of_a_hanging_worker_are_answered_within_a_second() {
    let waits = Arc::new(std::sync::Mutex::new(Vec::new()));
    for seed in 40..44 {
        let longest_waits = Arc::clone(&waits);
        // The default lease and report interval.
        let mut sim = cluster_of(coordinator::Config::default(), seed, |_| {});
        sim.client("client", async move {
            there(3).await;
            asks(40).await;
            // At a different phase of the report interval each time. Roles may have changed since the first views.
            let hang = async {
                tokio::time::sleep(Duration::from_secs_f64(1.0 + 0.06 * (seed - 40) as f64)).await;
                let hung = busiest_compositor().await;
                let others = [COORDINATOR, "client"].into_iter().chain(WORKERS);
                others.filter(|name| *name != hung).for_each(|name| turmoil::hold(hung, name));
            };
            let (longest, ()) = tokio::join!(asks(60), hang);
            let counters = status().await.counters.unwrap();
            assert_eq!((counters.views_answered, counters.views_failed), (100, 0), "{seed} {counters:?}");
            assert_eq!(counters.workers_lost, 0, "{seed} {counters:?}");
            longest_waits.lock().unwrap().push((longest, counters.views_retried));
            Ok(())
        });
        run(sim);
    }
    // Render threads are real, so that a busy machine may delay one of the four runs; the rule itself holds in each.
    let mut waits = waits.lock().unwrap().clone();
    // A worker that happens to have no view when it hangs is suspected before it gets one.
    assert!(waits.iter().any(|(_, retried)| *retried > 0), "no view was at a hanging worker");
    waits.sort();
    let [.., third, longest] = waits[..] else { panic!("four runs") };
    assert!(third.0 < Duration::from_secs(1) && longest.0 < Duration::from_secs(2), "views took {waits:?}");
}

#[test]
fn a_one_way_partition_of_a_worker_loses_no_view() {
    for (from, to) in [("two", COORDINATOR), (COORDINATOR, "two")] {
        let mut sim = cluster(2, |_| {});
        sim.client("client", async move {
            there(3).await;
            let cut = async {
                after(1.0, || turmoil::partition_oneway(from, to)).await;
                after(8.0, || turmoil::repair_oneway(from, to)).await;
            };
            tokio::join!(asks(160), cut);
            let counters = there(3).await.counters.unwrap();
            assert_eq!((counters.views_answered, counters.views_failed), (160, 0), "{from} {counters:?}");
            Ok(())
        });
        run(sim);
    }
}

#[test]
fn workers_that_cannot_reach_each_other_render_their_samples() {
    let mut sim = cluster(3, |_| {});
    for (one, other) in [("one", "two"), ("one", "three"), ("two", "three")] {
        sim.partition(one, other);
    }
    sim.client("client", async {
        there(3).await;
        asks(40).await;
        Ok(())
    });
    run(sim);
}

#[test]
fn a_far_worker_is_slow_and_not_lost() {
    let mut sim = cluster(4, |_| {});
    sim.set_link_latency(COORDINATOR, "three", Duration::from_millis(400));
    sim.client("client", async {
        there(3).await;
        asks(100).await;
        let status = there(3).await;
        assert_eq!(status.counters.unwrap().workers_lost, 0);
        Ok(())
    });
    run(sim);
}

#[test]
fn lost_messages_cost_only_time() {
    for seed in 10..14 {
        let mut sim = cluster(seed, |builder| {
            builder.repair_rate(0.05);
        });
        for name in WORKERS {
            sim.set_link_fail_rate(COORDINATOR, name, 0.002);
        }
        sim.client("client", async move {
            there(3).await;
            asks(120).await;
            let counters = status().await.counters.unwrap();
            assert_eq!((counters.views_answered, counters.views_failed), (120, 0), "{seed} {counters:?}");
            Ok(())
        });
        run(sim);
    }
}

#[test]
fn every_view_is_answered_in_any_order_of_joining() {
    for seed in 20..28 {
        let mut sim = cluster(seed, |builder| {
            builder.max_message_latency(Duration::from_millis(300));
        });
        sim.client("client", async move {
            asks(60).await;
            let status = there(3).await;
            assert!(status.samplers >= 1 && status.compositors >= 1, "{seed}: {status:#?}");
            let mut names: Vec<_> = status.workers.iter().map(|w| w.id.as_str()).collect();
            names.sort_unstable();
            assert_eq!(names, ["one", "three", "two"]);
            Ok(())
        });
        // One worker restarts while it joins, another one later, each under its old name.
        let (mut steps, mut done) = (0_u64, false);
        while !done {
            steps += 1;
            match steps {
                _ if steps == 20 + seed => sim.bounce("one"),
                _ if steps == 400 + 10 * seed => sim.bounce("two"),
                _ => {}
            }
            done = sim.step().unwrap();
            std::thread::sleep(MOMENT);
        }
    }
}

/// Longest time of a session's frame under any fault of a worker.
const WORST_GAP: Duration = Duration::from_secs(3);

#[test]
fn frames_are_relayed_to_a_client_that_cannot_reach_workers() {
    let mut sim = cluster(30, |_| {});
    sim.client("client", async {
        there(3).await;
        let mut session = client().await.session(SessionOptions::default());
        moves(&mut session, Duration::from_secs(1)).await;
        let fetched = status().await;
        let cut = async {
            after(1.0, || WORKERS.iter().for_each(|name| turmoil::partition("client", *name))).await;
            after(6.0, || WORKERS.iter().for_each(|name| turmoil::repair("client", *name))).await;
        };
        let (seen, ()) = tokio::join!(moves(&mut session, Duration::from_secs(9)), cut);
        assert!(seen.failures.is_empty(), "{:?}", seen.failures);
        assert!(seen.gap < WORST_GAP, "a frame took {:?}", seen.gap);
        assert!(seen.gap > Duration::from_secs(1), "a ticket was out when it was cut off");
        // No other process noticed.
        let counters = status().await.counters.unwrap();
        assert_eq!((counters.workers_lost, counters.views_failed), (0, 0), "{fetched:?} {counters:?}");
        Ok(())
    });
    run(sim);
}

#[test]
fn a_hanging_workers_redirect_is_replaced() {
    let mut sim = cluster(31, |_| {});
    sim.client("client", async {
        there(3).await;
        let mut session = client().await.session(SessionOptions::default());
        let before = moves(&mut session, Duration::from_secs(1)).await;
        let (_, last) = before.frames.last().cloned().expect("there were frames");
        let hung = WORKERS.into_iter().find(|name| *name == last).expect("a worker made it");
        let others = || [COORDINATOR, "client"].into_iter().chain(WORKERS).filter(move |name| *name != hung);
        // Its messages wait, as with a stopped process.
        let hang = async {
            after(0.5, || others().for_each(|name| turmoil::hold(hung, name))).await;
            after(8.0, || others().for_each(|name| turmoil::release(hung, name))).await;
        };
        let (seen, ()) = tokio::join!(moves(&mut session, Duration::from_secs(12)), hang);
        assert!(seen.failures.is_empty(), "{:?}", seen.failures);
        assert!(seen.gap < WORST_GAP, "a frame took {:?}", seen.gap);
        let during = Duration::from_secs(4)..Duration::from_secs(8);
        assert!(seen.frames.iter().any(|(at, worker)| during.contains(at) && *worker != hung));
        assert!(seen.frames.iter().all(|(at, worker)| !during.contains(at) || *worker != hung));
        Ok(())
    });
    run(sim);
}

#[test]
fn sessions_and_redirects_resume_after_a_restart_of_the_coordinator() {
    let mut sim = cluster(32, |_| {});
    sim.client("client", async {
        there(3).await;
        let client = client().await;
        let mut sessions: Vec<Session> = (0..4)
            .map(|i| client.session(SessionOptions { redirect: i % 2 == 0, ..Default::default() }))
            .collect();
        let moving = sessions.iter_mut().map(|session| moves(session, Duration::from_secs(12)));
        for seen in join_all(moving).await {
            // No worker has joined the new coordinator yet: that is an answer, not a loss.
            assert!(seen.failures.len() < 60, "{:?}", seen.failures);
            assert!(seen.gap < Duration::from_secs(5), "a frame took {:?}", seen.gap);
            let (last, _) = seen.frames.last().expect("there were frames");
            assert!(*last > Duration::from_secs(11), "no frame after {last:?}");
        }
        there(3).await;
        Ok(())
    });
    let (mut steps, mut done) = (0_u64, false);
    while !done {
        steps += 1;
        if steps == 3000 {
            sim.bounce(COORDINATOR);
        }
        done = sim.step().unwrap();
        std::thread::sleep(MOMENT);
    }
}

#[test]
fn a_partition_of_the_only_sampler_or_a_compositor_loses_no_frame() {
    for (seed, role) in [(33, v1::Role::Sampler), (34, v1::Role::Compositor)] {
        let mut sim = cluster(seed, |_| {});
        sim.client("client", async move {
            there(3).await;
            let mut session = client().await.session(SessionOptions::default());
            moves(&mut session, Duration::from_secs(2)).await;
            let lost = *with_role(role).await.first().expect("every role is played");
            let others =
                || [COORDINATOR, "client"].into_iter().chain(WORKERS).filter(move |name| *name != lost);
            let cut = async {
                after(0.5, || others().for_each(|name| turmoil::partition(lost, name))).await;
                after(8.0, || others().for_each(|name| turmoil::repair(lost, name))).await;
            };
            let (seen, ()) = tokio::join!(moves(&mut session, Duration::from_secs(12)), cut);
            assert!(seen.failures.is_empty(), "{role:?}: {:?}", seen.failures);
            assert!(seen.gap < WORST_GAP, "{role:?}: a frame took {:?}", seen.gap);
            assert!(status().await.counters.unwrap().workers_lost >= 1);
            Ok(())
        });
        run(sim);
    }
}
