//! The connection to the coordinator: joins, reports, carries out assignments, and joins again.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::convert::{scene_hash, shared_transforms};
use argus_proto::transport::replaceable;
use argus_proto::v1;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_scene::{FaceMask, InvalidField, Limits, SampleId, SampleSetInfo, Version};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::transport::Channel;
use tonic::{Code, Status};
use tracing::{debug, info, warn};

use super::config::RunError;
use super::node::Node;
use super::prefetches::WantedSample;
use super::queue::BackendCosts;
use super::{policy, prefetch, purchase, scene};
use crate::core::{Purchase, Report, Role};
use crate::rate_limited_log::RateLimitedLog;
use crate::sealed::SealKey;
use crate::{SceneOpener, SceneRef, net, wire};

/// Pause before the first attempt to join again. It doubles with each attempt, up to [`super::Config::rejoin_pause`].
const FIRST_PAUSE: Duration = Duration::from_millis(100);

/// Interval at which a draining worker checks whether its old role's work is done.
const DRAIN_INTERVAL: Duration = Duration::from_millis(5);

/// Interval between reports until the coordinator sets one.
const FIRST_INTERVAL: Duration = Duration::from_millis(250);

/// Least time between two reports.
const LEAST_INTERVAL: Duration = Duration::from_millis(20);

/// A validated assignment.
#[derive(Debug, Clone)]
struct Duty {
    sequence: u64,
    role: Role,
    scene: SceneRef,
    set: SampleSetInfo,
    limits: Limits,
    /// Versions of the samples in `prefetch`.
    versions: Vec<Version>,
    /// Samples to hold, each with its addresses. The worker renders a sample without addresses.
    prefetch: Vec<WantedSample>,
    /// Sources to render in spare time.
    purchases: Vec<Purchase>,
    /// Samples of versions below this number can be dropped.
    kept_from: u64,
    /// Measure the cost of each visibility backend.
    measure_backends: bool,
    /// The cluster has not chosen the visibility backend of samples.
    visibility_is_open: bool,
}

/// Keeps the worker joined to a coordinator until `shutdown`.
///
/// # Errors
/// [`RunError`] if the worker cannot join, is refused, or cannot create its role.
pub(super) async fn stay(
    node: Arc<Node>,
    opener: Arc<dyn SceneOpener>,
    shutdown: CancellationToken,
) -> Result<(), RunError> {
    let url = node.config.coordinator.clone();
    let address = |reason| RunError::Address { what: "the coordinator's URL", reason };
    let several = url.contains(',');
    // Made anew for each attempt, since certificates may have been replaced.
    let endpoint = |url: &str| {
        let security = node.config.security.as_ref().map(|security| security.current());
        let endpoint = net::endpoint(url.trim(), node.config.connect_timeout, security.as_deref());
        // If a coordinator hangs, a standby can lead as soon as workers join it.
        endpoint.map(|endpoint| if several { replaceable(endpoint) } else { endpoint }).map_err(address)
    };
    let urls: Vec<&str> = url.split(',').collect();
    for url in &urls {
        endpoint(url)?;
    }
    // Tries the addresses in turn. The leader is found within one attempt per address.
    let mut turn = urls.iter().cycle();
    let began = Instant::now();
    let mut joined_once = false;
    let mut pause = FIRST_PAUSE;
    loop {
        let Some(next) = turn.next() else { return Err(address("no address is given".to_owned())) };
        let endpoint = endpoint(next)?;
        let attempt = async {
            let channel =
                node.config.network.connect(&endpoint).await.map_err(|e| Ended::Lost(net::root_cause(&e)))?;
            once(&node, opener.clone(), channel, &mut joined_once, &mut pause).await
        };
        let ended = tokio::select! {
            ended = attempt => ended,
            () = shutdown.cancelled() => return Ok(()),
        };
        node.status.lose_coordinator();
        // A coordinator ends the stream when it shuts down, and to move the worker to another scene. Neither is an error.
        let (orderly, reason) = match ended {
            Ok(()) => (true, "the coordinator ended the stream".to_owned()),
            Err(Ended::Fatal(error)) => return Err(error),
            Err(Ended::Lost(reason)) => (false, reason),
        };
        if !joined_once && net::is_distrust(&reason) {
            return Err(RunError::Untrusted { url, reason });
        }
        if !joined_once && node.config.give_up_after.is_some_and(|most| began.elapsed() >= most) {
            return Err(RunError::Unreachable { url, reason });
        }
        match (joined_once, orderly) {
            (true, true) => info!(url, "the coordinator ended the stream, joining again"),
            (true, false) => warn!(url, reason, "the coordinator is lost, joining again"),
            (false, _) => {
                static ABSENT: RateLimitedLog = RateLimitedLog::new();
                if let Some(left_out) = ABSENT.now() {
                    warn!(url, reason, left_out, "no coordinator answers yet, trying again");
                }
            }
        }
        tokio::select! {
            () = tokio::time::sleep(pause) => {}
            () = shutdown.cancelled() => return Ok(()),
        }
        // With several coordinators, another one may already lead, so pauses are shorter.
        let longest = node.config.rejoin_pause / urls.len() as u32;
        pause = (pause * 2).min(longest.max(FIRST_PAUSE));
    }
}

/// How a stream ended.
enum Ended {
    /// Joining again may help.
    Lost(String),
    /// Joining again cannot help.
    Fatal(RunError),
}

/// Joins once, and stays until the stream ends.
async fn once(
    node: &Arc<Node>,
    opener: Arc<dyn SceneOpener>,
    channel: Channel,
    joined_once: &mut bool,
    pause: &mut Duration,
) -> Result<(), Ended> {
    let (reports, outgoing) = mpsc::channel(4);
    let held = node.served.scene().map(|scene| scene.hash);
    // The coordinator sends the states that it keeps again. Those that are known may be of another scene.
    node.transforms.forget();
    node.probes.forget();
    node.sources.report_all();
    node.purchases.want(Vec::new());
    // The channel is empty, so this cannot fail.
    let _ = reports.try_send(wire::hello(&node.hello, held));
    node.status.join_coordinator();
    let mut client = ClusterClient::new(channel.clone());
    // A process may accept the connection and never answer.
    let joined = tokio::time::timeout(node.config.join_timeout, client.join(ReceiverStream::new(outgoing)))
        .await
        .map_err(|_| Ended::Lost("it accepts connections but does not answer".to_owned()))?;
    let mut assignments = joined.map_err(|status| turned_away(node, &status))?.into_inner();
    info!(url = node.config.coordinator, "joined the coordinator");
    *joined_once = true;
    *pause = FIRST_PAUSE;
    let (interval, _) = watch::channel(FIRST_INTERVAL);
    let (duties, newest) = watch::channel(None);
    let listen = async {
        // The transforms that come are those of this scene, also while another one is still open.
        let mut assigned = None;
        loop {
            let message = assignments.message().await;
            let Some(assignment) = message.map_err(|status| Ended::Lost(status.message().to_owned()))? else {
                return Ok(());
            };
            node.check_term(assignment.term).map_err(|fault| Ended::Lost(fault.to_string()))?;
            if let Some(transforms) = assignment.transforms {
                let malformed = |at| Ended::Lost(format!("malformed transforms: {at}"));
                let transforms = shared_transforms(transforms).map_err(malformed)?;
                let scene = node.served.scene().filter(|scene| assigned == Some(scene.hash));
                node.transforms.learn(transforms, scene.as_deref());
                continue;
            }
            if assignment.report_interval_ms > 0 {
                interval.send_replace(Duration::from_millis(assignment.report_interval_ms.into()));
            }
            node.cell_holders.send_replace(assignment.cell_holders.clone());
            node.redirects.set_key(SealKey::from_bytes(&assignment.seal_key));
            let suspected = assignment.suspected.iter().cloned().collect();
            let news =
                node.suspected.send_if_modified(|before| std::mem::replace(before, suspected) != *before);
            if news {
                debug!(suspected = ?*node.suspected.borrow(), "suspected workers");
            }
            let duty = duty(assignment).map_err(|at| Ended::Lost(format!("a malformed assignment: {at}")))?;
            assigned = Some(duty.scene.hash);
            duties.send_replace(Some(duty));
        }
    };
    tokio::select! {
        ended = listen => ended,
        ended = obey(node, opener, channel, newest) => ended,
        () = purchase::carry_out(node) => Err(Ended::Lost("sources are no longer rendered".to_owned())),
        () = super::cells::take(node) => Err(Ended::Lost("light cells are no longer taken".to_owned())),
        () = report(node, reports, interval.subscribe()) => Err(Ended::Lost("reports cannot be sent".to_owned())),
    }
}

/// The end of a stream that the coordinator refused.
fn turned_away(node: &Node, status: &Status) -> Ended {
    // The root cause of a broken connection says more than the outer "transport error".
    let broke = std::error::Error::source(status).map(net::root_cause);
    let reason = broke.unwrap_or_else(|| status.message().to_owned());
    match status.code() {
        Code::FailedPrecondition
        | Code::InvalidArgument
        | Code::Unimplemented
        | Code::Unauthenticated
        | Code::PermissionDenied => {
            Ended::Fatal(RunError::TurnedAway { url: node.config.coordinator.clone(), reason })
        }
        _ => Ended::Lost(reason),
    }
}

/// Checks an assignment, for fuzzing.
///
/// # Errors
/// The invalid field.
#[cfg(feature = "fuzzing")]
pub(crate) fn checked_assignment(wire: v1::Assignment) -> Result<(), InvalidField> {
    duty(wire).map(drop)
}

fn duty(wire: v1::Assignment) -> Result<Duty, InvalidField> {
    let missing = |field| InvalidField::new(field, "must be given");
    let scene = wire.scene.ok_or_else(|| missing("scene"))?;
    let set: SampleSetInfo = wire.set.ok_or_else(|| missing("set"))?.try_into()?;
    let mut prefetch = Vec::with_capacity(wire.sources.len());
    for source in wire.sources {
        let id = SampleId::from(source.id.ok_or_else(|| missing("sources.id"))?);
        set.camera(id.camera)?;
        let faces = FaceMask::new(source.faces, "sources.faces")?;
        prefetch.push(WantedSample { id, faces, addresses: source.addresses });
    }
    let limits = wire.limits.ok_or_else(|| missing("limits"))?.try_into()?;
    Ok(Duty {
        sequence: wire.sequence,
        role: wire::role_from(wire.role)?,
        scene: SceneRef { hash: scene_hash(&scene.hash, "scene.hash")?, name: scene.name },
        set,
        versions: wire.versions.into_iter().map(Version::try_from).collect::<Result<_, _>>()?,
        prefetch,
        purchases: wire::purchases(wire.purchases, &limits)?,
        kept_from: wire.kept_from,
        measure_backends: wire.measure_backends,
        visibility_is_open: wire.visibility_is_open,
        limits,
    })
}

/// Sends a report at each interval, and early reports on request.
async fn report(
    node: &Node,
    reports: mpsc::Sender<v1::WorkerReport>,
    mut interval: watch::Receiver<Duration>,
) {
    let mut reported = Instant::now();
    loop {
        let pause = *interval.borrow_and_update();
        tokio::select! {
            () = tokio::time::sleep(pause) => {}
            () = early(node, reported) => {}
            changed = interval.changed() => if changed.is_err() { return },
        }
        reported = Instant::now();
        node.channels.close_unused();
        let acting = node.status.role().unwrap_or(Role::Both);
        // The rest of the report first: a view that drops a source afterwards is of the next report.
        let report = node.report();
        let report = Report { sources: node.sources.take_news(), probes: node.probes.take(), ..report };
        if reports.send(wire::report(report, acting)).await.is_err() {
            return;
        }
        if node.sources.has_news() {
            node.news.notify_one();
        }
    }
}

/// Waits until an early report is requested and the last report is not too recent: it may be requested with every view.
async fn early(node: &Node, reported: Instant) {
    node.news.notified().await;
    tokio::time::sleep_until(reported + LEAST_INTERVAL).await;
}

/// Carries out the newest assignment. A newer assignment replaces one that is not in effect yet.
async fn obey(
    node: &Arc<Node>,
    opener: Arc<dyn SceneOpener>,
    channel: Channel,
    mut newest: watch::Receiver<Option<Duty>>,
) -> Result<(), Ended> {
    loop {
        let duty = newest.borrow_and_update().clone();
        let done = async {
            match duty {
                Some(duty) => carry_out(node, opener.clone(), channel.clone(), duty).await,
                None => Ok(()),
            }
        };
        tokio::select! {
            // After an assignment is in effect, waits for the next one.
            done = async { done.await?; std::future::pending().await } => return done,
            changed = newest.changed() => if changed.is_err() { return Ok(()) },
        }
    }
}

/// Carries out an assignment: opens the scene, prepares the role, and finishes the old role's work.
async fn carry_out(
    node: &Arc<Node>,
    opener: Arc<dyn SceneOpener>,
    channel: Channel,
    duty: Duty,
) -> Result<(), Ended> {
    let scene = scene::obtain(node, opener, duty.scene, channel).await.map_err(Ended::Fatal)?;
    node.transforms.tell(&scene);
    if node.served.scene().is_some_and(|before| before.hash != scene.hash) {
        node.probes.forget();
    }
    node.served.set_visibility_is_open(duty.visibility_is_open);
    // What a scene shows once clients have moved nodes is mostly what it showed before.
    let has_moved = duty.set.version.state.revision > 0 && duty.set.epoch_secs == 0.0;
    let new_sampler = node.served.serve(&scene, duty.set, duty.limits);
    // Those that came meanwhile.
    node.transforms.tell(&scene);
    if new_sampler || node.status.role() != Some(duty.role) {
        node.render_thread.prepare(duty.role).await.map_err(|error| Ended::Fatal(RunError::Device(error)))?;
    }
    let backend_costs = match duty.measure_backends {
        true => {
            let measured = node.render_thread.measure(duty.visibility_is_open).await;
            measured.map_err(|error| Ended::Fatal(RunError::Device(error)))?
        }
        false => BackendCosts::new(),
    };
    node.status.set_backend_costs(backend_costs);
    if let Some(before) = node.status.role() {
        while !policy::may_change_role(before, duty.role, &node.render_thread.backlog()) {
            tokio::time::sleep(DRAIN_INTERVAL).await;
        }
    }
    if node.status.role() != Some(duty.role) {
        info!(role = ?duty.role, "role in effect");
    }
    node.status.set_role(duty.role, duty.sequence);
    prefetch::want(node, duty.prefetch, &duty.versions, duty.role == Role::Sampler);
    node.purchases.want(duty.purchases);
    node.store.retire(duty.kept_from, has_moved);
    Ok(())
}
