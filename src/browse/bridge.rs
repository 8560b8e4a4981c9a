//! The bridge between one page's WebSocket and one session of the service.
//!
//! The newest camera wins: a waiting camera is replaced, here and in the session. A page acknowledges each image that
//! it has shown, and at most two images are in flight to it. So a slow page gets fewer images and never old ones, and
//! a page that reads nothing uses bounded memory.

mod flow;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use argus_client::{Client, ClientError, FrameMeta, Session, SessionEvent, SessionOptions};
use argus_proto::relief::{self, Relief};
use argus_scene::{Camera, Frame, Output};
use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use serde_json::{Map, Value, json};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until, timeout};

use self::flow::{Asked, Flow, Image};
use super::messages::{self, Message as Said};
use super::simulated_link::{Gone, Wire};
use super::site::{Site, jpeg, usual_camera};
use super::viewers::{self, Seen};

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

/// Interval between two messages about where other viewers are.
const OTHERS: Duration = Duration::from_millis(200);

/// Longest time to close a WebSocket, for a page that does not answer.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// A running encoding of an image.
type Encoding = JoinHandle<anyhow::Result<Image>>;

/// Serves a page until it closes its WebSocket, stops answering, or this process stops.
pub(super) async fn run(socket: WebSocket, site: Arc<Site>, client: Client) {
    let mut wire = Wire::new(socket, site.link);
    let (code, reason) = Bridge::new(site, client).serve(&mut wire).await;
    close(&mut wire, code, &reason).await;
}

/// Closes a WebSocket with a reason, of which at most 123 bytes fit.
pub(super) async fn close(socket: &mut Wire, code: u16, reason: &str) {
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
    client: Client,
    session: Session,
    flow: Flow,
    encoding: Option<Encoding>,
    /// The viewer's number among all.
    viewer: u64,
    /// Where other viewers are, while this one is seen.
    others: Option<watch::Receiver<BTreeMap<u64, Seen>>>,
    /// No request is sent to the service before this time.
    paused_until: Instant,
}

/// The next event of a bridge.
enum Step {
    Message(Option<Result<Message, axum::Error>>),
    Event(Result<SessionEvent, ClientError>),
    Encoded(anyhow::Result<Image>),
    Ping,
    Others,
    Resume,
    Stop,
}

impl Bridge {
    fn new(site: Arc<Site>, client: Client) -> Self {
        let session = open(&client);
        let viewer = site.viewers.enter();
        let (flow, paused_until) = (Flow::default(), Instant::now());
        Self { site, client, session, flow, encoding: None, viewer, others: None, paused_until }
    }

    async fn serve(&mut self, socket: &mut Wire) -> End {
        let mut pings = interval(PING);
        pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut others = interval(OTHERS);
        others.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut heard = Instant::now();
        loop {
            if self.flow.is_held_up() {
                // A new session cancels the full image in work, which may take seconds, and which is no longer wanted.
                self.session = open(&self.client);
                self.flow.ask_again();
            }
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
                _ = others.tick(), if self.others.is_some() => Step::Others,
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
                Step::Others => self.others_moved(),
                Step::Resume => None,
                Step::Ping if heard.elapsed() > SILENCE => {
                    return (close_code::POLICY, "the page does not answer".to_owned());
                }
                Step::Ping => Some(Message::Ping(Vec::new().into())),
                Step::Stop => return (close_code::AWAY, "the page's server was stopped".to_owned()),
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
        let read =
            messages::read(&text, usual_camera(&self.client), &self.site.plan).and_then(|said| match said {
                Said::Shown(number) => {
                    self.flow.shown(number);
                    Ok(())
                }
                Said::Seen(camera) => {
                    camera.map_or(Ok(()), |camera| camera.validate())?;
                    self.is_seen(camera);
                    Ok(())
                }
                Said::Camera { number, view, form } => {
                    view.validate(&self.client.description().limits)?;
                    self.flow.wants(number, *view, form, Instant::now())
                }
            });
        Ok(read.err().map(|error| Message::Text(messages::refused(&error).into())))
    }

    fn is_seen(&mut self, camera: Option<Camera>) {
        let scene = self.client.description().scene_hash;
        self.site.viewers.is_at(self.viewer, camera.map(|camera| (scene, camera)));
        match camera {
            None => self.others = None,
            Some(_) if self.others.is_none() => {
                let mut others = self.site.viewers.follow();
                others.mark_changed();
                self.others = Some(others);
            }
            Some(_) => {}
        }
    }

    /// The message about where other viewers are, if one of them moved.
    fn others_moved(&mut self) -> Option<Message> {
        let seen = self.others.as_mut().filter(|others| others.has_changed().unwrap_or(false))?;
        let others =
            viewers::others(&seen.borrow_and_update(), self.viewer, self.client.description().scene_hash);
        Some(Message::Text(messages::viewers(&others).into()))
    }

    /// Handles an event of the session. Returns the message for the page, if any.
    fn take(&mut self, event: Result<SessionEvent, ClientError>) -> Option<Message> {
        match event {
            Ok(SessionEvent::Frame { camera_seq, frame, meta }) => {
                if let Some(asked) = self.flow.answered(camera_seq) {
                    self.encoding = Some(tokio::task::spawn_blocking(move || encode(&asked, &frame, &meta)));
                }
                None
            }
            Ok(SessionEvent::Failed { camera_seq, error }) => {
                let number = self.flow.answered(camera_seq)?.number;
                let again = !matches!(error, ClientError::Invalid { .. });
                Some(Message::Text(messages::failed(number, &error.to_string(), again).into()))
            }
            Err(error) => {
                self.session = open(&self.client);
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

impl Drop for Bridge {
    fn drop(&mut self) {
        self.site.viewers.is_at(self.viewer, None);
    }
}

fn open(client: &Client) -> Session {
    client.session(SessionOptions { patience: PATIENCE, ..SessionOptions::default() })
}

/// Waits for the running encoding; forever if there is none.
async fn encoded(encoding: &mut Option<Encoding>) -> anyhow::Result<Image> {
    match encoding {
        Some(encoding) => encoding.await?,
        None => std::future::pending().await,
    }
}

/// Encodes an image's message. Adds to its description what only this process knows: the page's number of the camera, the
/// milliseconds from the camera's arrival to the frame's (`bridge_ms`), and those of encoding the JPEG (`jpeg_ms`) and the
/// relief (`relief_ms`).
fn encode(asked: &Asked, frame: &Frame, meta: &FrameMeta) -> anyhow::Result<Image> {
    let mut about: Map<String, Value> = messages::about(frame, meta);
    let ms = |since: std::time::Duration| json!(since.as_secs_f64() * 1e3);
    about.insert("camera_seq".to_owned(), json!(asked.number));
    about.insert("bridge_ms".to_owned(), ms(asked.since.elapsed()));
    let begin = std::time::Instant::now();
    let jpeg = jpeg(frame, asked.form.quality)?;
    about.insert("jpeg_ms".to_owned(), ms(begin.elapsed()));
    let begin = std::time::Instant::now();
    let relief = relief_of(frame, asked);
    about.insert("relief_ms".to_owned(), ms(begin.elapsed()));
    Ok(Image { number: asked.number, message: messages::image(about, &jpeg, relief.as_ref()) })
}

/// The relief of a frame, if it was asked for: off by half a pixel once the viewer has moved as far as asked.
fn relief_of(frame: &Frame, Asked { camera, form, .. }: &Asked) -> Option<Relief> {
    let (reach, range) = (form.reach?, frame.images[Output::Range].as_ref()?);
    let range: Vec<f32> = range.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    let tan_half = camera.tan_half_fov(frame.width, frame.height);
    let focal_pixels = f64::from(frame.height) / 2.0 / tan_half.y;
    relief::encode(&range, frame.width, frame.height, tan_half.to_array(), 0.5 / (focal_pixels * reach))
}

async fn send(socket: &mut Wire, message: Message) -> Result<(), End> {
    match timeout(SEND_TIMEOUT, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(Gone(error))) => Err((close_code::ABNORMAL, error)),
        Err(_) => Err((close_code::POLICY, "the page does not read".to_owned())),
    }
}
