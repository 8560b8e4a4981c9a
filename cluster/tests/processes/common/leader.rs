//! A coordinator without a core, whose assignments a test writes.

use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::PROTOCOL_VERSION;
use argus_proto::v1::cluster_client::ClusterClient;
use argus_proto::v1::cluster_server::{Cluster, ClusterServer};
use argus_proto::v1::worker_report::Body;
use argus_proto::v1::{self, Assignment, Hello, Measurements, WorkerReport};
use futures::{Stream, StreamExt};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio_stream::wrappers::{TcpListenerStream, WatchStream};
use tonic::{Request, Response, Status, Streaming};

use super::{LIMIT, channel, quick, roles, start_coordinator};

/// What a worker reported, by its id.
type Reports = parking_lot::Mutex<Vec<(String, Measurements)>>;

/// A coordinator that sends all workers the same assignment.
pub struct Leader {
    address: SocketAddr,
    assignment: watch::Sender<Assignment>,
    reports: Arc<Reports>,
    /// Ends all streams when it changes.
    ended: watch::Sender<u32>,
}

struct Service {
    assignment: watch::Sender<Assignment>,
    reports: Arc<Reports>,
    ended: watch::Sender<u32>,
}

#[tonic::async_trait]
impl Cluster for Service {
    type JoinStream = Pin<Box<dyn Stream<Item = Result<Assignment, Status>> + Send>>;

    async fn join(
        &self,
        request: Request<Streaming<WorkerReport>>,
    ) -> Result<Response<Self::JoinStream>, Status> {
        let (mut incoming, reports) = (request.into_inner(), self.reports.clone());
        tokio::spawn(async move {
            let mut name = String::new();
            while let Ok(Some(report)) = incoming.message().await {
                match report.body {
                    Some(Body::Hello(hello)) => name = hello.worker_id,
                    Some(Body::Measurements(measured)) => reports.lock().push((name.clone(), measured)),
                    None => {}
                }
            }
        });
        let assignments = WatchStream::new(self.assignment.subscribe()).map(Ok);
        let mut ended = self.ended.subscribe();
        let end = async move { drop(ended.changed().await) };
        Ok(Response::new(Box::pin(assignments.take_until(Box::pin(end)))))
    }

    async fn status(&self, _: Request<v1::StatusRequest>) -> Result<Response<v1::StatusResponse>, Status> {
        Err(Status::unimplemented("a test's coordinator"))
    }
}

impl Leader {
    /// Leads with the first assignment of a real coordinator.
    pub async fn start() -> Self {
        let coordinator = start_coordinator(quick());
        let (reports, outgoing) = tokio::sync::mpsc::channel(1);
        let hello = Hello {
            protocol_version: PROTOCOL_VERSION,
            worker_id: "asks".to_owned(),
            pid: 1,
            address: "http://127.0.0.1:1".to_owned(),
            device: roles::DEVICE.to_owned(),
            cores: 1,
            ..Hello::default()
        };
        reports.send(WorkerReport { body: Some(Body::Hello(hello)) }).await.unwrap();
        let mut client = ClusterClient::new(channel(&coordinator.url()));
        let joined = client.join(tokio_stream::wrappers::ReceiverStream::new(outgoing)).await.unwrap();
        let first = joined.into_inner().message().await.unwrap().unwrap();
        let first = Assignment { term: 1, visibility_is_open: false, ..first };
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let leader = Self {
            address: listener.local_addr().unwrap(),
            assignment: watch::Sender::new(first),
            reports: Arc::default(),
            ended: watch::Sender::new(0),
        };
        let service = Service {
            assignment: leader.assignment.clone(),
            reports: leader.reports.clone(),
            ended: leader.ended.clone(),
        };
        let served = tonic::transport::Server::builder()
            .add_service(ClusterServer::new(service))
            .serve_with_incoming(TcpListenerStream::new(listener));
        tokio::spawn(served);
        leader
    }

    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Changes the assignment of all workers.
    pub fn assign(&self, change: impl FnOnce(&mut Assignment)) {
        self.assignment.send_modify(|assignment| {
            assignment.sequence += 1;
            change(assignment);
        });
    }

    /// Ends all streams, as if another coordinator led.
    pub fn step_down(&self) {
        self.ended.send_modify(|count| *count += 1);
    }

    /// Waits for reports of a worker since this call began, until `found` finds something in one.
    pub async fn report<T>(&self, found: impl Fn(&str, &Measurements) -> Option<T>) -> T {
        let found = async {
            loop {
                let reports: Vec<_> = std::mem::take(&mut *self.reports.lock());
                if let Some(found) = reports.iter().find_map(|(name, measured)| found(name, measured)) {
                    return found;
                }
                tokio::time::sleep(Duration::from_millis(2)).await;
            }
        };
        tokio::time::timeout(LIMIT, found).await.expect("it must be reported")
    }
}
