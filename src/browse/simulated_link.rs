//! A simulated link between a page and its bridge, to see how a page behaves far away from the service.

use std::str::FromStr;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use futures::{SinkExt as _, Stream, StreamExt as _};
use rand::Rng as _;
use rand::SeedableRng as _;
use rand::rngs::SmallRng;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

/// Most messages on their way in one direction. Further ones wait at their sender.
const MOST: usize = 256;

/// Latency and rate of a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LinkSettings {
    /// Mean time of a round trip.
    round_trip: Duration,
    /// How much a round trip may differ from the mean.
    jitter: Duration,
    /// Bits a second, in each direction; `None`: no limit.
    rate: Option<f64>,
}

impl FromStr for LinkSettings {
    type Err = String;

    /// Parses a round trip, its jitter and a rate: `40ms±20,20mbit`, `40ms+-20`, `40ms` or `40ms,1.5mbit`.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            "must be a round trip in ms, optionally its jitter and a rate, such as 40ms±20,20mbit (or 40ms+-20)".to_owned()
        };
        let (times, rate) = match text.split_once(',') {
            Some((times, rate)) => (times, Some(rate)),
            None => (text, None),
        };
        let (mean, jitter) = match times.split_once("ms") {
            Some((mean, "")) => (mean, "0"),
            Some((mean, rest)) => {
                let jitter = rest.strip_prefix('±').or_else(|| rest.strip_prefix("+-")).ok_or_else(wrong)?;
                (mean, jitter.strip_suffix("ms").unwrap_or(jitter))
            }
            None => return Err(wrong()),
        };
        let number = |text: &str| {
            text.trim().parse::<f64>().ok().filter(|number| number.is_finite()).ok_or_else(wrong)
        };
        let (mean, jitter) = (number(mean)?, number(jitter)?);
        if !(mean >= jitter && jitter >= 0.0 && mean <= 60_000.0) {
            return Err(format!(
                "the jitter must be 0 to the round trip, and that at most 60000 ms, not {mean} ± {jitter}"
            ));
        }
        let rate = match rate {
            Some(rate) => {
                let rate = 1e6 * number(rate.strip_suffix("mbit").ok_or_else(wrong)?)?;
                if !(rate >= 1e3) {
                    return Err(format!("the rate must be at least 0.001 mbit, not {}", rate / 1e6));
                }
                Some(rate)
            }
            None => None,
        };
        let ms = |ms: f64| Duration::from_secs_f64(ms / 1e3);
        Ok(Self { round_trip: ms(mean), jitter: ms(jitter), rate })
    }
}

/// When the messages of one direction arrive: each is sent when the one before it has left, takes half a round trip, and
/// never overtakes another.
struct Schedule {
    settings: LinkSettings,
    random: SmallRng,
    /// When the last message has left.
    free: Instant,
    /// When the last message arrives.
    last: Instant,
}

impl Schedule {
    fn new(settings: LinkSettings) -> Self {
        let now = Instant::now();
        Self { settings, random: SmallRng::from_os_rng(), free: now, last: now }
    }

    fn arrival(&mut self, now: Instant, bytes: usize) -> Instant {
        let LinkSettings { round_trip, jitter, rate } = self.settings;
        let sending = rate.map_or(0.0, |rate| 8.0 * bytes as f64 / rate);
        self.free = self.free.max(now) + Duration::from_secs_f64(sending);
        let aside = jitter.as_secs_f64() * self.random.random_range(-1.0..=1.0);
        let way = (round_trip.as_secs_f64() + aside).max(0.0) / 2.0;
        self.last = self.last.max(self.free + Duration::from_secs_f64(way));
        self.last
    }
}

/// A page's WebSocket, or one at the other end of a simulated link.
pub(super) enum Wire {
    /// The WebSocket itself.
    Near(Box<WebSocket>),
    /// Both directions of the link.
    Far { to_page: mpsc::Sender<Message>, from_page: mpsc::Receiver<Result<Message, axum::Error>> },
}

/// The page can no longer be reached.
#[derive(Debug)]
pub(super) struct Gone(pub(super) String);

impl Wire {
    /// A WebSocket, behind a simulated link if one is set.
    pub(super) fn new(socket: WebSocket, link: Option<LinkSettings>) -> Self {
        let Some(settings) = link else { return Self::Near(Box::new(socket)) };
        let (mut sink, stream) = socket.split();
        let (to_page, leaving) = mpsc::channel::<Message>(1);
        let (arrive, from_page) = mpsc::channel(1);
        tokio::spawn(async move {
            let messages =
                futures::stream::unfold(leaving, async |mut leaving| Some((leaving.recv().await?, leaving)));
            let mut delayed = std::pin::pin!(delayed(messages, settings, size));
            while let Some(message) = delayed.next().await {
                if sink.send(message).await.is_err() {
                    return;
                }
            }
        });
        tokio::spawn(async move {
            let mut delayed =
                std::pin::pin!(delayed(stream, settings, |message| message.as_ref().map_or(0, size)));
            while let Some(message) = delayed.next().await {
                if arrive.send(message).await.is_err() {
                    return;
                }
            }
        });
        Self::Far { to_page, from_page }
    }

    /// The next message of the page; `None` after the last. It may be dropped and called again.
    pub(super) async fn recv(&mut self) -> Option<Result<Message, axum::Error>> {
        match self {
            Self::Near(socket) => socket.recv().await,
            Self::Far { from_page, .. } => from_page.recv().await,
        }
    }

    /// Sends a message.
    ///
    /// # Errors
    /// The page is gone.
    pub(super) async fn send(&mut self, message: Message) -> Result<(), Gone> {
        match self {
            Self::Near(socket) => socket.send(message).await.map_err(|error| Gone(error.to_string())),
            Self::Far { to_page, .. } => {
                to_page.send(message).await.map_err(|_| Gone("the page is gone".to_owned()))
            }
        }
    }
}

fn size(message: &Message) -> usize {
    match message {
        Message::Text(text) => text.len(),
        Message::Binary(bytes) | Message::Ping(bytes) | Message::Pong(bytes) => bytes.len(),
        Message::Close(_) => 2,
    }
}

/// The messages of a stream, each when it arrives at the end of the link. While [`MOST`] are on their way, none is read.
fn delayed<T: Send + 'static>(
    messages: impl Stream<Item = T> + Send + 'static,
    settings: LinkSettings,
    size: impl Fn(&T) -> usize + Send + 'static,
) -> impl Stream<Item = T> {
    let (leave, way) = mpsc::channel(MOST);
    tokio::spawn(async move {
        let mut schedule = Schedule::new(settings);
        let mut messages = std::pin::pin!(messages);
        while let Some(message) = messages.next().await {
            let arrival = schedule.arrival(Instant::now(), size(&message));
            if leave.send((arrival, message)).await.is_err() {
                return;
            }
        }
    });
    futures::stream::unfold(way, async |mut way: mpsc::Receiver<(Instant, T)>| {
        let (arrival, message) = way.recv().await?;
        sleep_until(arrival).await;
        Some((message, way))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(text: &str) -> Result<LinkSettings, String> {
        text.parse()
    }

    #[test]
    fn links_are_parsed_and_wrong_ones_are_refused() {
        let ms = Duration::from_millis;
        let expected = LinkSettings { round_trip: ms(40), jitter: ms(20), rate: Some(20e6) };
        for text in ["40ms±20,20mbit", "40ms+-20ms,20mbit", "40ms±20ms,20.0mbit"] {
            assert_eq!(link(text), Ok(expected), "{text}");
        }
        assert_eq!(link("7ms"), Ok(LinkSettings { round_trip: ms(7), jitter: ms(0), rate: None }));
        for text in [
            "",
            "40",
            "ms",
            "40ms20",
            "20ms±40",
            "-1ms",
            "40ms±-1",
            "nanms",
            "1e9ms",
            "40ms,20",
            "40ms,0mbit",
            "40ms,nanmbit",
        ] {
            assert!(link(text).is_err(), "{text}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn messages_arrive_in_order_after_half_a_round_trip_and_at_the_rate() {
        let settings = link("40ms±20,1mbit").unwrap();
        let begin = Instant::now();
        // 1250 bytes take 10 ms.
        let messages = futures::stream::iter(0..100_u32);
        let mut arrived = std::pin::pin!(delayed(messages, settings, |_| 1250));
        let mut last = begin;
        for expected in 0..100 {
            assert_eq!(arrived.next().await, Some(expected));
            let (after, sent) = (begin.elapsed(), Duration::from_millis(10 * (u64::from(expected) + 1)));
            assert!(Instant::now() >= last, "{expected} overtakes");
            let way = after.saturating_sub(sent);
            assert!(
                way >= Duration::from_millis(9) && way <= Duration::from_millis(31),
                "{expected}: {way:?}"
            );
            last = Instant::now();
        }
        assert_eq!(arrived.next().await, None);
    }

    #[tokio::test(start_paused = true)]
    async fn a_link_without_a_reader_stops_reading() {
        let (send, receive) = mpsc::channel::<u32>(1);
        let messages =
            futures::stream::unfold(receive, async |mut receive| Some((receive.recv().await?, receive)));
        let _arrived = delayed(messages, link("1ms").unwrap(), |_| 1);
        let mut taken = 0;
        while tokio::time::timeout(Duration::from_secs(1), send.send(taken)).await.is_ok() {
            taken += 1;
        }
        assert!((MOST as u32..MOST as u32 + 8).contains(&taken), "{taken}");
    }
}
