//! The `Cluster` service: workers join it, and tools ask it for the status.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::convert::scene_hash;
use argus_proto::status::{check_version, invalid};
use argus_proto::v1;
use argus_proto::v1::cluster_server::Cluster;
use argus_proto::v1::worker_report::Body;
use argus_scene::InvalidField;
use futures::{Stream, StreamExt};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

use super::scene_table::SceneTable;
use super::shared_core::{JoinedWorker, SharedCore};
use crate::core::WorkerId;
use crate::wire;

/// How long a new stream may take to send its hello.
const HELLO_TIMEOUT: Duration = Duration::from_secs(5);

/// The gRPC service.
pub(super) struct ClusterService {
    pub(super) scenes: Arc<SceneTable>,
}

#[tonic::async_trait]
impl Cluster for ClusterService {
    type JoinStream = Pin<Box<dyn Stream<Item = Result<v1::Assignment, Status>> + Send>>;

    async fn join(
        &self,
        request: Request<Streaming<v1::WorkerReport>>,
    ) -> Result<Response<Self::JoinStream>, Status> {
        let mut reports = request.into_inner();
        let first = tokio::time::timeout(HELLO_TIMEOUT, reports.message())
            .await
            .map_err(|_| Status::deadline_exceeded("no hello came"))??;
        let Some(Body::Hello(hello)) = first.and_then(|report| report.body) else {
            return Err(invalid(InvalidField::new("hello", "must be the first message")));
        };
        check_version(hello.protocol_version)?;
        let held = match hello.scene_hash.is_empty() {
            true => None,
            false => Some(scene_hash(&hello.scene_hash, "hello.scene_hash").map_err(invalid)?),
        };
        let security = self.scenes.first().shared.channels.security();
        let hello = wire::hello_from(hello, security.as_deref()).map_err(invalid)?;
        let (shared, JoinedWorker { worker, assignments, expelled }) = self.scenes.join(hello, held)?;
        let closing = shared.closing.clone().cancelled_owned();
        tokio::spawn(async move {
            let _leave = LeaveOnDrop { shared: shared.clone(), worker };
            loop {
                let report = tokio::select! {
                    report = reports.message() => report,
                    () = expelled.cancelled() => break,
                };
                match report.ok().flatten().and_then(|report| report.body) {
                    Some(Body::Measurements(measurements)) => {
                        // A worker that leaves for another scene joins again when its stream has ended.
                        if shared.report(worker, wire::report_from(measurements)) {
                            break;
                        }
                    }
                    // A second hello is ignored. An empty report ends the stream.
                    Some(Body::Hello(_)) => {}
                    None => break,
                }
            }
        });
        let assignments = ReceiverStream::new(assignments).take_until(closing);
        Ok(Response::new(Box::pin(assignments)))
    }

    async fn status(
        &self,
        request: Request<v1::StatusRequest>,
    ) -> Result<Response<v1::StatusResponse>, Status> {
        Ok(Response::new(self.scenes.status(self.scenes.of(request.metadata())?)))
    }
}

/// Tells the core that a worker left when its stream ends, for whatever reason.
struct LeaveOnDrop {
    shared: Arc<SharedCore>,
    worker: WorkerId,
}

impl Drop for LeaveOnDrop {
    fn drop(&mut self) {
        self.shared.leave(self.worker);
    }
}
