//! How processes of a cluster talk: servers, and channels to others, one an address, connected when first used
//! and reconnected by themselves.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::Fault;
use argus_proto::transport::{relayed, tuned};
use parking_lot::Mutex;
use tokio::time::Instant;
use tonic::transport::{Channel, Endpoint, Server};
use tower::layer::util::{Identity, Stack};

use crate::network::Network;
use crate::security::Security;
use crate::security::guard::{Guard, Guarded};

/// Both ends probe an idle connection this often, so that a machine that vanished is noticed.
const KEEPALIVE: Duration = Duration::from_secs(10);

/// Channels that were used so long ago are closed: a connection is made anew within milliseconds.
const UNUSED: Duration = Duration::from_secs(30);

/// Requests on one connection: as many as a coordinator has sessions by default, all of which a load balancer, or one that
/// tries how much a service bears, may put on one connection (`argus load` takes four). What is too many is the core's
/// decision, and it says so at once, while a request over this limit would silently wait in the client; each that is open
/// takes memory whatever becomes of it, so that it is no larger.
const MAX_STREAMS: u32 = 1 << 14;

/// Bytes of what strangers may ask: a service's name, or that of a symbol.
pub(crate) const MOST_QUESTION_BYTES: usize = 4 << 10;

/// Requests that were cancelled before they were looked at, on one connection: a client that gives up on all
/// of its views at once is no attack.
const MAX_RESETS: usize = 1 << 12;

/// Bytes that may be on their way to a server on one connection. Fixed and large: h2 (0.4.20) ends a
/// connection with ENHANCE_YOUR_CALM once small DATA frames that nobody has read yet take up half of it, and
/// an adaptive window begins at 64 KiB, where three hundred requests sent at once do.
const CONNECTION_WINDOW: u32 = 64 << 20;

/// How an address is connected to: by TLS, and to a member of the cluster alone, where there is security.
///
/// # Errors
/// What is wrong with the address, or with the certificates, in one line.
pub(crate) fn endpoint(
    address: &str,
    connect_timeout: Duration,
    security: Option<&Security>,
) -> Result<Endpoint, String> {
    let scheme = scheme(security);
    let endpoint =
        Endpoint::from_shared(address.to_owned()).map_err(|_| format!("{address} is not a URL"))?;
    if endpoint.uri().scheme_str() != Some(scheme) || endpoint.uri().authority().is_none() {
        let why = match (security, endpoint.uri().scheme_str()) {
            (Some(_), Some("http")) => ": this process has a certificate, so that its connections are TLS",
            (None, Some("https")) => {
                ": TLS needs a certificate of the cluster, in [security] of the configuration"
            }
            _ => "",
        };
        return Err(format!("{address} is not of the form {scheme}://HOST:PORT{why}"));
    }
    let endpoint = tuned(endpoint).connect_timeout(connect_timeout);
    match security {
        None => Ok(endpoint),
        Some(security) => endpoint.tls_config(security.of_connection()).map_err(|error| root_cause(&error)),
    }
}

/// How addresses of members begin.
pub(crate) fn scheme(security: Option<&Security>) -> &'static str {
    if security.is_some() { "https" } else { "http" }
}

/// The innermost reason, which is the one that says something ("connection refused").
pub(crate) fn root_cause(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}

/// How both kinds of process serve.
///
/// # Errors
/// Certificates that are none.
pub(crate) fn server(
    guarded: Guarded,
    security: Option<&Arc<Security>>,
) -> Result<Server<Stack<Guard, Identity>>, tonic::transport::Error> {
    let mut server = Server::builder();
    if let Some(security) = security {
        server = server.tls_config(security.of_listener())?;
    }
    Ok(server
        // Metrics and probes are asked for over plain HTTP.
        .accept_http1(true)
        .initial_connection_window_size(CONNECTION_WINDOW)
        .http2_keepalive_interval(Some(KEEPALIVE))
        .max_concurrent_streams(Some(MAX_STREAMS))
        .http2_max_pending_accept_reset_streams(Some(MAX_RESETS))
        .layer(Guard::new(guarded, security.cloned())))
}

/// Whether what a connection broke with is that one side's certificate is not one that the other trusts, or that it
/// does not speak TLS. The transport keeps the words alone.
pub(crate) fn is_distrust(reason: &str) -> bool {
    ["certificate", "fatal alert", "corrupt message"].iter().any(|word| reason.contains(word))
}

/// The channels of a process.
#[derive(Debug)]
pub(crate) struct Channels {
    connect_timeout: Duration,
    security: Option<Arc<Security>>,
    network: Network,
    /// Answers of one address at the same time that are passed on; `None` where all are read here.
    relays: Option<usize>,
    by_address: Mutex<HashMap<String, Known>>,
}

/// A channel that was made.
#[derive(Debug)]
struct Known {
    channel: Channel,
    used: Instant,
}

impl Channels {
    pub(crate) fn new(connect_timeout: Duration, security: Option<Arc<Security>>, network: Network) -> Self {
        Self { connect_timeout, security, network, relays: None, by_address: Mutex::default() }
    }

    /// Channels for answers that are passed on, up to `most` of one address at the same time: answers that are not read never
    /// stop the others.
    pub(crate) fn for_relays(self, most: usize) -> Self {
        Self { relays: Some(most), ..self }
    }

    /// By which they are secured.
    pub(crate) fn security(&self) -> Option<&Security> {
        self.security.as_deref()
    }

    /// The channel to an address.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] if the address is none.
    pub(crate) fn to(&self, address: &str) -> Result<Channel, Fault> {
        let now = Instant::now();
        if let Some(known) = self.by_address.lock().get_mut(address) {
            known.used = now;
            return Ok(known.channel.clone());
        }
        let endpoint = endpoint(address, self.connect_timeout, self.security.as_deref());
        let endpoint = endpoint.map_err(Fault::Unavailable)?;
        let endpoint = match self.relays {
            Some(most) => relayed(endpoint, most),
            None => endpoint,
        };
        let mut channels = self.by_address.lock();
        let made = || Known { channel: self.network.channel(&endpoint), used: now };
        Ok(channels.entry(address.to_owned()).or_insert_with(made).channel.clone())
    }

    /// Closes channels that nobody has asked for in a while, once nobody uses them: each keeps a place at its other end, and
    /// in a large cluster everybody talks to everybody sooner or later.
    pub(crate) fn close_unused(&self) {
        let now = Instant::now();
        self.by_address.lock().retain(|_, known| now < known.used + UNUSED);
    }

    /// Closes the channel to an address once nobody uses it.
    pub(crate) fn forget(&self, address: &str) {
        self.by_address.lock().remove(address);
    }
}

#[cfg(test)]
mod tests {
    use std::pin::Pin;

    use argus_proto::v1;
    use argus_proto::v1::scenes_client::ScenesClient;
    use argus_proto::v1::scenes_server::{Scenes, ScenesServer};
    use futures::Stream;
    use tokio::net::{TcpListener, TcpStream};
    use tokio::sync::{Semaphore, mpsc};
    use tokio_stream::wrappers::TcpListenerStream;
    use tonic::{Request, Response, Status};

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn channels_that_nobody_uses_are_closed() {
        let channels = Channels::new(Duration::from_secs(1), None, Network::default());
        let count = || channels.by_address.lock().len();
        channels.to("http://127.0.0.1:1").unwrap();
        tokio::time::advance(UNUSED / 2).await;
        channels.to("http://127.0.0.1:2").unwrap();
        channels.close_unused();
        assert_eq!(count(), 2);
        tokio::time::advance(UNUSED / 2).await;
        channels.close_unused();
        assert_eq!(count(), 1);
        channels.to("http://127.0.0.1:2").unwrap();
        tokio::time::advance(UNUSED - Duration::from_secs(1)).await;
        channels.close_unused();
        assert_eq!(count(), 1, "it was used since");
    }

    /// Answers when it is told to, and then sends a chunk each time that it is told to.
    struct Told {
        answer: Arc<Semaphore>,
        chunk: Arc<Semaphore>,
    }

    const CHUNKS: usize = 4;

    #[tonic::async_trait]
    impl Scenes for Told {
        type FetchStream = Pin<Box<dyn Stream<Item = Result<v1::SceneChunk, Status>> + Send>>;

        async fn fetch(&self, _: Request<v1::FetchRequest>) -> Result<Response<Self::FetchStream>, Status> {
            self.answer.acquire().await.unwrap().forget();
            let chunk = self.chunk.clone();
            Ok(Response::new(Box::pin(async_stream::stream! {
                for _ in 0..CHUNKS {
                    chunk.acquire().await.unwrap().forget();
                    yield Ok(v1::SceneChunk::default());
                }
            })))
        }
    }

    /// Such a service, its address, and what says of each connection there that it was closed.
    async fn told() -> (Told, String, mpsc::UnboundedReceiver<()>) {
        let told = Told { answer: Arc::new(Semaphore::new(0)), chunk: Arc::new(Semaphore::new(0)) };
        let server = Told { answer: told.answer.clone(), chunk: told.chunk.clone() };
        let inner = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let outer = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (behind, address) = (inner.local_addr().unwrap(), outer.local_addr().unwrap());
        let server = Server::builder().add_service(ScenesServer::new(server));
        tokio::spawn(server.serve_with_incoming(TcpListenerStream::new(inner)));
        let (sender, closed) = mpsc::unbounded_channel();
        tokio::spawn(async move {
            loop {
                let (mut from, _) = outer.accept().await.unwrap();
                let mut to = TcpStream::connect(behind).await.unwrap();
                let sender = sender.clone();
                tokio::spawn(async move {
                    let _ = tokio::io::copy_bidirectional(&mut from, &mut to).await;
                    let _ = sender.send(());
                });
            }
        });
        (told, format!("http://{address}"), closed)
    }

    #[tokio::test]
    async fn requests_in_flight_outlive_their_channel_and_its_connection_ends_with_them() {
        let forget: [fn(&Channels, &str); 2] = [
            |channels, address| channels.forget(address),
            |channels, _| {
                for known in channels.by_address.lock().values_mut() {
                    known.used -= UNUSED;
                }
                channels.close_unused();
            },
        ];
        for forget in forget {
            let (told, address, mut closed) = told().await;
            let channels = Channels::new(Duration::from_secs(1), None, Network::default()).for_relays(2);
            let ask = || {
                // As a relay does: the stream alone stays.
                let channel = channels.to(&address).unwrap();
                async move { ScenesClient::new(channel).fetch(v1::FetchRequest::default()).await }
            };
            // Some of one answer is there, another was asked for, and a third is not on its way yet.
            told.answer.add_permits(1);
            let mut begun = ask().await.unwrap().into_inner();
            told.chunk.add_permits(1);
            assert!(begun.message().await.unwrap().is_some());
            let asked = tokio::spawn(ask());
            tokio::time::sleep(Duration::from_millis(50)).await;
            let to_ask = ask();
            forget(&channels, &address);
            assert!(channels.by_address.lock().is_empty());
            let to_ask = tokio::spawn(to_ask);
            tokio::time::sleep(Duration::from_millis(50)).await;
            assert!(closed.try_recv().is_err(), "it is in use");

            told.answer.add_permits(2);
            told.chunk.add_permits(3 * CHUNKS - 1);
            let asked = asked.await.unwrap().unwrap().into_inner();
            let to_ask = to_ask.await.unwrap().unwrap().into_inner();
            for (mut chunks, left) in [(begun, CHUNKS - 1), (asked, CHUNKS), (to_ask, CHUNKS)] {
                for _ in 0..left {
                    assert!(chunks.message().await.unwrap().is_some());
                }
                assert!(chunks.message().await.unwrap().is_none());
            }
            let ended = tokio::time::timeout(Duration::from_secs(5), closed.recv()).await;
            ended.expect("nobody uses it").unwrap();
        }
    }
}
