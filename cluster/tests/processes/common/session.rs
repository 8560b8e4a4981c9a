//! A client's side of `Views.Session`.

use argus_proto::chunks::FrameAssembler;
use argus_proto::v1;
use argus_proto::v1::session_request::Body as Asked;
use argus_proto::v1::session_response::Body as Answer;
use argus_proto::v1::views_client::ViewsClient;
use argus_scene::{Limits, View};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;
use tonic::transport::Channel;

use super::{Cluster, LIMIT};

/// A client's side of a session.
pub struct Session {
    pub requests: mpsc::Sender<v1::SessionRequest>,
    answers: Streaming<v1::SessionResponse>,
    assembler: FrameAssembler,
    /// Whether it supports redirects.
    pub redirectable: bool,
    /// Whether its frames may be reprojected.
    pub history: bool,
}

impl Session {
    pub async fn open(cluster: &Cluster) -> Self {
        Self::open_by(cluster.views()).await
    }

    /// Opens a session on its own connection: an unread session blocks others on the same connection.
    pub async fn open_by(mut views: ViewsClient<Channel>) -> Self {
        let (requests, outgoing) = mpsc::channel(64);
        let answers = views.session(ReceiverStream::new(outgoing)).await.unwrap().into_inner();
        let assembler = FrameAssembler::new(Limits::default());
        Self { requests, answers, assembler, redirectable: false, history: false }
    }

    pub async fn ask(&self, camera_seq: u64, view: &View) {
        let encoding = v1::Encoding::Zstd as i32;
        let (view, redirectable, history) = (Some(view.into()), self.redirectable, self.history);
        let view = v1::SessionView { view, encoding, redirectable, history, ..Default::default() };
        self.say(camera_seq, Asked::View(view)).await;
    }

    pub async fn acknowledge(&self, camera_seq: u64) {
        self.say(camera_seq, Asked::Ack(v1::SessionAck::default())).await;
    }

    pub async fn say(&self, camera_seq: u64, body: Asked) {
        self.requests.send(v1::SessionRequest { camera_seq, body: Some(body) }).await.unwrap();
    }

    /// The next answer, which must be a redirect.
    pub async fn redirect(&mut self) -> (u64, v1::Redirect) {
        let answer =
            tokio::time::timeout(LIMIT, self.answers.message()).await.expect("a session must answer");
        let answer = answer.unwrap().unwrap();
        match answer.body.unwrap() {
            Answer::Redirect(redirect) => (answer.camera_seq, redirect),
            other => panic!("a frame is to be fetched, not {other:?}"),
        }
    }

    /// The next chunk of a frame.
    pub async fn chunk(&mut self) -> v1::FrameChunk {
        let answer =
            tokio::time::timeout(LIMIT, self.answers.message()).await.expect("a session must answer");
        match answer.unwrap().unwrap().body.unwrap() {
            Answer::Chunk(chunk) => chunk,
            other => panic!("a frame is to arrive, not {other:?}"),
        }
    }

    /// The next whole frame or failure, its sequence number, and the number of superseded cameras.
    pub async fn answer(&mut self) -> Option<(u64, u64, Result<(), v1::SessionFailure>)> {
        let next = async {
            while let Some(answer) = self.answers.message().await.unwrap() {
                let (seq, superseded) = (answer.camera_seq, answer.superseded);
                match answer.body.unwrap() {
                    Answer::Redirect(redirect) => {
                        panic!("unexpected redirect to {}", redirect.address)
                    }
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
