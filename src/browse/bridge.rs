//! The bridge between one page's WebSocket and one session of the service.
//!
//! The newest camera wins: a waiting camera is replaced, here and in the session. A page acknowledges each image that
//! it has shown, and at most two images are in flight to it. So a slow page gets fewer images and never old ones, and
//! a page that reads nothing uses bounded memory.

mod flow;

use std::sync::Arc;
use std::time::Duration;

use argus_client::{ClientError, FrameMeta, Session, SessionEvent, SessionOptions};
use argus_scene::Frame;
use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use serde_json::{Map, Value, json};
use tokio::task::JoinHandle;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until, timeout};

use self::flow::{Flow, Image};
use super::messages::{self, Message as Said};
use super::site::{Site, jpeg};

/// Longest message of a page in bytes. A camera takes about 200.
pub(super) const MAX_MESSAGE_BYTES: usize = 4096;

/// Time for a session to reach the service again before its page is told of trouble.
const PATIENCE: Duration = Duration::from_secs(3);

/// Pause between two failed sessions.
const PAUSE: Duration = Duration::from_secs(1);

/// A page that takes longer than this to receive a message is closed.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

/// Interval between pings. Browsers answer them automatically.
const PING: Duration = Duration::from_secs(20);

/// A page without a message or pong for this long is closed.
const SILENCE: Duration = Duration::from_secs(60);

/// Longest time to close a WebSocket, for a page that does not answer.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// A running encoding of an image.
type Encoding = JoinHandle<anyhow::Result<Image>>;

/// Serves a page until it closes its WebSocket, stops answering, or this process stops.
pub(super) async fn run(mut socket: WebSocket, site: Arc<Site>) {
    let (code, reason) = Bridge::new(site).serve(&mut socket).await;
    close(&mut socket, code, &reason).await;
}

/// Closes a WebSocket with a reason, of which at most 123 bytes fit.
pub(super) async fn close(socket: &mut WebSocket, code: u16, reason: &str) {
    let frame = CloseFrame { code, reason: reason.into() };
    let told = async {
        // Closing a connection with unread bytes resets it, and the page may miss the reason. So read until the page
        // closes too.
        if socket.send(Message::Close(Some(frame))).await.is_ok() {
            while let Some(Ok(_)) = socket.recv().await {}
        }
    };
    // A page that is gone needs no reason.
    let _ = timeout(CLOSE_TIMEOUT, told).await;
}

/// Why a bridge ends: a close code of RFC 6455, section 7.4.1, and a reason for the page.
type End = (u16, String);

struct Bridge {
    site: Arc<Site>,
    session: Session,
    flow: Flow,
    encoding: Option<Encoding>,
    /// No request is sent to the service before this time.
    paused_until: Instant,
}

/// The next event of a bridge.
enum Step {
    Message(Option<Result<Message, axum::Error>>),
    Event(Result<SessionEvent, ClientError>),
    Encoded(anyhow::Result<Image>),
    Ping,
    Resume,
    Stop,
}

impl Bridge {
    fn new(site: Arc<Site>) -> Self {
        let session = open(&site);
        Self { site, session, flow: Flow::default(), encoding: None, paused_until: Instant::now() }
    }

    async fn serve(&mut self, socket: &mut WebSocket) -> End {
        let mut pings = interval(PING);
        pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut heard = Instant::now();
        loop {
            let paused = Instant::now() < self.paused_until;
            if !paused && let Some(view) = self.flow.to_ask() {
                let view = view.clone();
                self.flow.asked(self.session.send(&view));
            }
            if let Some(image) = self.flow.next_to_send()
                && let Err(end) = send(socket, Message::Binary(image.into())).await
            {
                return end;
            }
            let listens = !paused && self.flow.is_waiting() && self.encoding.is_none();
            let step = tokio::select! {
                message = socket.recv() => Step::Message(message),
                event = self.session.next(), if listens => Step::Event(event),
                image = encoded(&mut self.encoding) => Step::Encoded(image),
                () = sleep_until(self.paused_until), if paused => Step::Resume,
                _ = pings.tick() => Step::Ping,
                () = self.site.closing.cancelled() => Step::Stop,
            };
            let answer = match step {
                Step::Message(message) => {
                    heard = Instant::now();
                    match self.hear(message) {
                        Ok(answer) => answer,
                        Err(end) => return end,
                    }
                }
                Step::Event(event) => self.take(event),
                Step::Encoded(image) => {
                    self.encoding = None;
                    self.encoded(image)
                }
                Step::Resume => None,
                Step::Ping if heard.elapsed() > SILENCE => {
                    return (close_code::POLICY, "the page does not answer".to_owned());
                }
                Step::Ping => Some(Message::Ping(Vec::new().into())),
                Step::Stop => return (close_code::AWAY, "argus browse was stopped".to_owned()),
            };
            if let Some(answer) = answer
                && let Err(end) = send(socket, answer).await
            {
                return end;
            }
        }
    }

    /// Handles a message of the page. Returns the reply, if any.
    fn hear(&mut self, message: Option<Result<Message, axum::Error>>) -> Result<Option<Message>, End> {
        let text = match message {
            Some(Ok(Message::Text(text))) => text,
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => return Ok(None),
            Some(Ok(Message::Binary(_))) => {
                let error = argus_scene::InvalidField::new("message", "must be text, not binary");
                return Ok(Some(Message::Text(messages::refused(&error).into())));
            }
            Some(Ok(Message::Close(_))) | None => return Err((close_code::NORMAL, String::new())),
            Some(Err(error)) => {
                // After a message that is too long or malformed, the following bytes cannot be parsed.
                let reason = format!("no message of at most {MAX_MESSAGE_BYTES} bytes: {error}");
                return Err((close_code::SIZE, reason.chars().take(120).collect()));
            }
        };
        let site = &self.site;
        let read = messages::read(&text, site.usual_camera(), &site.plan).and_then(|said| match said {
            Said::Shown(number) => {
                self.flow.shown(number);
                Ok(())
            }
            Said::Camera { number, view } => {
                view.validate(&site.client.description().limits)?;
                self.flow.wants(number, *view, Instant::now())
            }
        });
        Ok(read.err().map(|error| Message::Text(messages::refused(&error).into())))
    }

    /// Handles an event of the session. Returns the message for the page, if any.
    fn take(&mut self, event: Result<SessionEvent, ClientError>) -> Option<Message> {
        match event {
            Ok(SessionEvent::Frame { camera_seq, frame, meta }) => {
                if let Some((number, since)) = self.flow.answered(camera_seq) {
                    let bridge_ms = since.elapsed().as_secs_f64() * 1e3;
                    self.encoding =
                        Some(tokio::task::spawn_blocking(move || encode(number, bridge_ms, &frame, &meta)));
                }
                None
            }
            Ok(SessionEvent::Failed { camera_seq, error }) => {
                let (number, _) = self.flow.answered(camera_seq)?;
                let again = !matches!(error, ClientError::Invalid { .. });
                Some(Message::Text(messages::failed(number, &error.to_string(), again).into()))
            }
            Err(error) => {
                self.session = open(&self.site);
                self.flow.ask_again();
                self.paused_until = Instant::now() + PAUSE;
                Some(Message::Text(messages::trouble(&error.to_string()).into()))
            }
        }
    }

    fn encoded(&mut self, image: anyhow::Result<Image>) -> Option<Message> {
        match image {
            Ok(image) => {
                self.flow.made(image);
                None
            }
            Err(error) => Some(Message::Text(messages::trouble(&format!("{error:#}")).into())),
        }
    }
}

fn open(site: &Site) -> Session {
    site.client.session(SessionOptions { patience: PATIENCE, ..SessionOptions::default() })
}

/// Waits for the running encoding; forever if there is none.
async fn encoded(encoding: &mut Option<Encoding>) -> anyhow::Result<Image> {
    match encoding {
        Some(encoding) => encoding.await?,
        None => std::future::pending().await,
    }
}

/// Encodes an image's message. Adds to its description what only this process knows: the page's number of the camera, the
/// milliseconds from the camera's arrival to the frame's (`bridge_ms`), and those of encoding (`jpeg_ms`).
fn encode(number: u64, bridge_ms: f64, frame: &Frame, meta: &FrameMeta) -> anyhow::Result<Image> {
    let begin = std::time::Instant::now();
    let jpeg = jpeg(frame)?;
    let mut about: Map<String, Value> = messages::about(frame, meta);
    about.insert("camera_seq".to_owned(), json!(number));
    about.insert("bridge_ms".to_owned(), json!(bridge_ms));
    about.insert("jpeg_ms".to_owned(), json!(begin.elapsed().as_secs_f64() * 1e3));
    Ok(Image { number, message: messages::image(&about, &jpeg) })
}

async fn send(socket: &mut WebSocket, message: Message) -> Result<(), End> {
    match timeout(SEND_TIMEOUT, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err((close_code::ABNORMAL, error.to_string())),
        Err(_) => Err((close_code::POLICY, "the page does not read".to_owned())),
    }
}
