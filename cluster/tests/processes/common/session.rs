//! A client's side of `Views.Session`.

use argus_proto::chunks::FrameAssembler;
use argus_proto::v1;
use argus_proto::v1::session_request::Body as Asked;
use argus_proto::v1::session_response::Body as Answer;
use argus_scene::{Limits, View};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;

use super::{Cluster, LIMIT};

/// A client's side of a session.
pub struct Session {
    pub requests: mpsc::Sender<v1::SessionRequest>,
    answers: Streaming<v1::SessionResponse>,
    assembler: FrameAssembler,
}

impl Session {
    pub async fn open(cluster: &Cluster) -> Self {
        let (requests, outgoing) = mpsc::channel(64);
        let answers = cluster.views().session(ReceiverStream::new(outgoing)).await.unwrap().into_inner();
        Self { requests, answers, assembler: FrameAssembler::new(Limits::default()) }
    }

    pub async fn ask(&self, camera_seq: u64, view: &View) {
        let view = v1::SessionView { view: Some(view.into()), encoding: v1::Encoding::Zstd as i32 };
        let request = v1::SessionRequest { camera_seq, body: Some(Asked::View(view)) };
        self.requests.send(request).await.unwrap();
    }

    pub async fn acknowledge(&self, camera_seq: u64) {
        let body = Some(Asked::Ack(v1::SessionAck {}));
        self.requests.send(v1::SessionRequest { camera_seq, body }).await.unwrap();
    }

    /// The next frame, whole, or failure: its sequence number and how many cameras were superseded.
    pub async fn answer(&mut self) -> Option<(u64, u64, Result<(), v1::SessionFailure>)> {
        let next = async {
            while let Some(answer) = self.answers.message().await.unwrap() {
                let (seq, superseded) = (answer.camera_seq, answer.superseded);
                match answer.body.unwrap() {
                    Answer::Failure(failure) => return Some((seq, superseded, Err(failure))),
                    Answer::Chunk(chunk) => {
                        if self.assembler.push(chunk).unwrap().is_some() {
                            return Some((seq, superseded, Ok(())));
                        }
                    }
                }
            }
            None
        };
        tokio::time::timeout(LIMIT, next).await.expect("a session must answer")
    }
}
