//! The `Cluster` service: workers join it, and tools ask it for the status.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::status::{check_version, invalid};
use argus_proto::v1;
use argus_proto::v1::cluster_server::Cluster;
use argus_proto::v1::worker_report::Body;
use argus_scene::InvalidField;
use futures::{Stream, StreamExt};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

use super::shared_core::{JoinedWorker, SharedCore};
use crate::core::{Event, WorkerId};
use crate::wire;

/// How long a new stream may take to send its hello.
const HELLO_TIMEOUT: Duration = Duration::from_secs(5);

/// The gRPC service.
pub(super) struct ClusterService {
    pub(super) shared: Arc<SharedCore>,
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
        let hello = wire::hello_from(hello, self.shared.channels.security().as_deref()).map_err(invalid)?;
        let JoinedWorker { worker, assignments, expelled } = self.shared.join(hello)?;
        let shared = self.shared.clone();
        tokio::spawn(async move {
            let _leave = LeaveOnDrop { shared: shared.clone(), worker };
            loop {
                let report = tokio::select! {
                    report = reports.message() => report,
                    () = expelled.cancelled() => break,
                };
                match report.ok().flatten().and_then(|report| report.body) {
                    Some(Body::Measurements(measurements)) => {
                        let report = wire::report_from(measurements);
                        shared.step(Event::Reported { worker, report });
                    }
                    // A second hello is ignored. An empty report ends the stream.
                    Some(Body::Hello(_)) => {}
                    None => break,
                }
            }
        });
        let closing = self.shared.closing.clone().cancelled_owned();
        let assignments = ReceiverStream::new(assignments).take_until(closing);
        Ok(Response::new(Box::pin(assignments)))
    }

    async fn status(
        &self,
        _request: Request<v1::StatusRequest>,
    ) -> Result<Response<v1::StatusResponse>, Status> {
        Ok(Response::new(self.shared.status()))
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
