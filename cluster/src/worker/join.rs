//! A worker's life with its coordinator: join, report, do as told, join again.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::convert::scene_hash;
use argus_proto::transport::replaceable;
use argus_proto::v1;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_scene::{FaceMask, InvalidField, Limits, SampleId, SampleSetInfo, Version};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::CancellationToken;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Status};
use tracing::{debug, info, warn};

use super::bringing::Told;
use super::config::RunError;
use super::node::Node;
use super::{ahead, policy, scene};
use crate::core::Role;
use crate::rate_limited_log::RateLimitedLog;
use crate::sealed::SealKey;
use crate::{SceneOpener, SceneRef, net, wire};

/// Pause before the first attempt to join again; it doubles up to [`super::Config::rejoin_pause`].
const FIRST_PAUSE: Duration = Duration::from_millis(100);

/// How often a worker that drains looks whether it is done.
const DRAIN_LOOK: Duration = Duration::from_millis(5);

/// Between two reports until the coordinator has said how often it wants them.
const FIRST_INTERVAL: Duration = Duration::from_millis(250);

/// An assignment, checked.
#[derive(Debug, Clone)]
struct Duty {
    sequence: u64,
    role: Role,
    scene: SceneRef,
    set: SampleSetInfo,
    limits: Limits,
    /// What the versions show that those samples may be of.
    versions: Vec<Version>,
    /// Samples to have at hand, with where to fetch each; without an address, rendered here.
    ahead: Vec<Told>,
    /// Samples of versions with a lower number are of no use any more.
    kept_from: u64,
    /// What each way to see triangles costs is to be measured.
    measure_ways: bool,
    /// It is not settled how triangles are seen.
    visibility_is_open: bool,
}

/// Stays with the coordinator until `shutdown`.
///
/// # Errors
/// As [`super::run`].
pub(super) async fn stay(
    node: Arc<Node>,
    opener: Arc<dyn SceneOpener>,
    shutdown: CancellationToken,
) -> Result<(), RunError> {
    let url = node.config.coordinator.clone();
    let address = |reason| RunError::Address { what: "the coordinator's URL", reason };
    let endpoints = url
        .split(',')
        .map(|url| net::endpoint(url.trim(), node.config.connect_timeout, node.config.security.as_deref()));
    let mut endpoints: Vec<Endpoint> = endpoints.collect::<Result<_, _>>().map_err(address)?;
    if endpoints.len() > 1 {
        // One that hangs has a standby, who can lead as soon as workers are there.
        endpoints = endpoints.into_iter().map(replaceable).collect();
    }
    // In turns, beginning anew at each attempt: whoever leads now is found within as many as there are.
    let mut turn = endpoints.iter().cycle();
    let began = Instant::now();
    let mut joined_once = false;
    let mut pause = FIRST_PAUSE;
    loop {
        let Some(endpoint) = turn.next() else { return Err(address("none is given".to_owned())) };
        let attempt = async {
            let channel =
                node.config.network.connect(endpoint).await.map_err(|e| Ended::Lost(net::root_cause(&e)))?;
            once(&node, opener.clone(), channel, &mut joined_once, &mut pause).await
        };
        let ended = tokio::select! {
            ended = attempt => ended,
            () = shutdown.cancelled() => return Ok(()),
        };
        node.lose_coordinator();
        // A stream that the coordinator ended by itself is its shutdown, and no trouble yet.
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
            (true, true) => info!(url, "coordinator gone, joining again"),
            (true, false) => warn!(url, reason, "coordinator lost, joining again"),
            (false, _) => {
                static ABSENT: RateLimitedLog = RateLimitedLog::new();
                if let Some(left_out) = ABSENT.now() {
                    warn!(url, reason, left_out, "no coordinator answers yet, trying on");
                }
            }
        }
        tokio::select! {
            () = tokio::time::sleep(pause) => {}
            () = shutdown.cancelled() => return Ok(()),
        }
        // While another coordinator may already lead, it is not worth waiting long.
        let longest = node.config.rejoin_pause / endpoints.len() as u32;
        pause = (pause * 2).min(longest.max(FIRST_PAUSE));
    }
}

/// How a stream ended.
enum Ended {
    /// Joining again may help.
    Lost(String),
    /// It will not.
    Fatal(RunError),
}

/// One stream, from hello to its end.
async fn once(
    node: &Arc<Node>,
    opener: Arc<dyn SceneOpener>,
    channel: Channel,
    joined_once: &mut bool,
    pause: &mut Duration,
) -> Result<(), Ended> {
    let (reports, outgoing) = mpsc::channel(4);
    // The channel is empty, so this cannot fail.
    let _ = reports.try_send(wire::hello(&node.hello));
    node.act(None, 0);
    let mut client = ClusterClient::new(channel.clone());
    // Something may listen there that never answers.
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
        loop {
            let message = assignments.message().await;
            let Some(assignment) = message.map_err(|status| Ended::Lost(status.message().to_owned()))? else {
                return Ok(());
            };
            node.check_term(assignment.term).map_err(|fault| Ended::Lost(fault.to_string()))?;
            if assignment.report_interval_ms > 0 {
                interval.send_replace(Duration::from_millis(assignment.report_interval_ms.into()));
            }
            node.open_door(SealKey::from_bytes(&assignment.seal_key));
            let suspected = assignment.suspected.iter().cloned().collect();
            let news =
                node.suspected.send_if_modified(|before| std::mem::replace(before, suspected) != *before);
            if news {
                debug!(suspected = ?*node.suspected.borrow(), "workers that seem to hang");
            }
            let duty = duty(assignment).map_err(|at| Ended::Lost(format!("a malformed assignment: {at}")))?;
            duties.send_replace(Some(duty));
        }
    };
    tokio::select! {
        ended = listen => ended,
        ended = obey(node, opener, channel, newest) => ended,
        () = report(node, reports, interval.subscribe()) => Err(Ended::Lost("the stream broke".to_owned())),
    }
}

fn turned_away(node: &Node, status: &Status) -> Ended {
    // A transport that broke says more than "transport error" further down.
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
    let mut ahead = Vec::with_capacity(wire.sources.len());
    for source in wire.sources {
        let id = SampleId::from(source.id.ok_or_else(|| missing("sources.id"))?);
        set.camera(id.camera)?;
        let faces = FaceMask::new(source.faces, "sources.faces")?;
        ahead.push(Told { id, faces, addresses: source.addresses });
    }
    Ok(Duty {
        sequence: wire.sequence,
        role: wire::role_from(wire.role)?,
        scene: SceneRef { hash: scene_hash(&scene.hash, "scene.hash")?, name: scene.name },
        set,
        versions: wire.versions.into_iter().map(Version::from).collect(),
        ahead,
        kept_from: wire.kept_from,
        measure_ways: wire.measure_ways,
        visibility_is_open: wire.visibility_is_open,
        limits: wire.limits.ok_or_else(|| missing("limits"))?.try_into()?,
    })
}

/// Reports at each interval, and at once where there is news.
async fn report(
    node: &Node,
    reports: mpsc::Sender<v1::WorkerReport>,
    mut interval: watch::Receiver<Duration>,
) {
    loop {
        let pause = *interval.borrow_and_update();
        tokio::select! {
            () = tokio::time::sleep(pause) => {}
            () = node.news.notified() => {}
            changed = interval.changed() => if changed.is_err() { return },
        }
        node.channels.close_unused();
        let acting = node.acting().unwrap_or(Role::Both);
        if reports.send(wire::report(node.report(), acting)).await.is_err() {
            return;
        }
    }
}

/// Does what the newest assignment says; one that comes before an older one has taken effect replaces it.
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
                Some(duty) => take_up(node, opener.clone(), channel.clone(), duty).await,
                None => Ok(()),
            }
        };
        tokio::select! {
            // An assignment that is done waits for the next one.
            done = async { done.await?; std::future::pending().await } => return done,
            changed = newest.changed() => if changed.is_err() { return Ok(()) },
        }
    }
}

/// Takes a role up: has the scene, finishes what the old role gave it, is ready for the new one.
async fn take_up(
    node: &Arc<Node>,
    opener: Arc<dyn SceneOpener>,
    channel: Channel,
    duty: Duty,
) -> Result<(), Ended> {
    let scene = scene::obtain(node, opener, duty.scene, channel).await.map_err(Ended::Fatal)?;
    node.settle_visibility(duty.visibility_is_open);
    let new_sampler = node.serve_set(&scene, duty.set, duty.limits);
    if new_sampler || node.acting() != Some(duty.role) {
        node.prepare(duty.role).await.map_err(|error| Ended::Fatal(RunError::Device(error)))?;
    }
    match duty.measure_ways {
        true => node
            .measure(duty.visibility_is_open)
            .await
            .map_err(|error| Ended::Fatal(RunError::Device(error)))?,
        false => node.forget_ways(),
    }
    if let Some(before) = node.acting() {
        while !policy::may_change_role(before, duty.role, &node.backlog()) {
            tokio::time::sleep(DRAIN_LOOK).await;
        }
    }
    if node.acting() != Some(duty.role) {
        info!(role = ?duty.role, "role taken up");
    }
    node.act(Some(duty.role), duty.sequence);
    ahead::want(node, duty.ahead, &duty.versions, duty.role == Role::Sampler);
    node.store.retire(duty.kept_from);
    Ok(())
}
