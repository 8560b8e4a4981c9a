//! Networking between processes: servers, and one channel per address, which connects lazily and reconnects by
//! itself.

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
use crate::security::guard::{Guard, Guarded};
use crate::security::{LoadedSecurity, ReloadableSecurity};

/// Interval of keepalive probes from both ends, which detect a vanished machine.
const KEEPALIVE: Duration = Duration::from_secs(10);

/// Channels are closed this long after their last use. A new connection takes milliseconds.
const UNUSED: Duration = Duration::from_secs(30);

/// Most concurrent requests on one connection: the default number of sessions, since a load balancer or a load test
/// (`argus load` uses four connections) may put all of them on one. Beyond it a request would wait silently in the
/// client, while the core refuses overload at once. It is no larger, since each open request takes memory.
const MAX_STREAMS: u32 = 1 << 14;

/// Largest request of unauthenticated services, bytes: the name of a service or a symbol.
pub(crate) const MOST_QUESTION_BYTES: usize = 4 << 10;

/// Most cancelled, unprocessed requests on one connection. A client that cancels all of its views at once is no
/// attack.
const MAX_RESETS: usize = 1 << 12;

/// HTTP/2 window of a server's connection, bytes. Fixed and large: h2 (0.4.20) ends a connection with
/// ENHANCE_YOUR_CALM once unread small DATA frames take up half of it. An adaptive window begins at 64 KiB, where
/// three hundred requests at once cause that.
const CONNECTION_WINDOW: u32 = 64 << 20;

/// The endpoint of an address. With `security`, it uses TLS and accepts only a member of the cluster.
///
/// # Errors
/// What is wrong with the address or the certificates, in one line.
pub(crate) fn endpoint(
    address: &str,
    connect_timeout: Duration,
    security: Option<&LoadedSecurity>,
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

/// The URL scheme of members' addresses.
pub(crate) fn scheme<T>(security: Option<&T>) -> &'static str {
    if security.is_some() { "https" } else { "http" }
}

/// The innermost cause of an error, which is the informative one ("connection refused").
pub(crate) fn root_cause(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}

/// The server of both kinds of process. Its connections are secured before it gets them.
pub(crate) fn server(
    guarded: Guarded,
    security: Option<&Arc<ReloadableSecurity>>,
) -> Server<Stack<Guard, Identity>> {
    Server::builder()
        // Metrics and probes use HTTP/1.1.
        .accept_http1(true)
        .initial_connection_window_size(CONNECTION_WINDOW)
        .http2_keepalive_interval(Some(KEEPALIVE))
        .max_concurrent_streams(Some(MAX_STREAMS))
        .http2_max_pending_accept_reset_streams(Some(MAX_RESETS))
        .layer(Guard::new(guarded, security.cloned()))
}

/// Whether a connection failed since one side does not trust the other's certificate, or does not use TLS. The
/// transport keeps only the text.
pub(crate) fn is_distrust(reason: &str) -> bool {
    ["certificate", "fatal alert", "corrupt message"].iter().any(|word| reason.contains(word))
}

/// The channels of a process.
#[derive(Debug)]
pub(crate) struct Channels {
    connect_timeout: Duration,
    security: Option<Arc<ReloadableSecurity>>,
    network: Network,
    /// Most concurrent relayed responses from one address; `None`: nothing is relayed.
    relays: Option<usize>,
    by_address: Mutex<HashMap<String, PooledChannel>>,
}

/// A channel and the time of its last use.
#[derive(Debug)]
struct PooledChannel {
    channel: Channel,
    used: Instant,
    /// The certificates that it was made with.
    generation: u64,
}

impl Channels {
    pub(crate) fn new(
        connect_timeout: Duration,
        security: Option<Arc<ReloadableSecurity>>,
        network: Network,
    ) -> Self {
        Self { connect_timeout, security, network, relays: None, by_address: Mutex::default() }
    }

    /// Makes channels for relayed responses, up to `most` concurrent ones from one address. Unread responses then
    /// never block other ones.
    pub(crate) fn for_relays(self, most: usize) -> Self {
        Self { relays: Some(most), ..self }
    }

    /// Certificates and tokens of the process; `None`: plaintext.
    pub(crate) fn reloadable(&self) -> Option<&ReloadableSecurity> {
        self.security.as_deref()
    }

    /// The certificates for a new connection.
    pub(crate) fn security(&self) -> Option<Arc<LoadedSecurity>> {
        self.security.as_ref().map(|security| security.current())
    }

    /// The channel to an address. After a change of certificates it is a new one; the one before it is closed once it is
    /// idle.
    ///
    /// # Errors
    /// [`Fault::Unavailable`] if the address is invalid.
    pub(crate) fn to(&self, address: &str) -> Result<Channel, Fault> {
        let (now, security) = (Instant::now(), self.security());
        let generation = security.as_ref().map_or(0, |loaded| loaded.generation());
        let is_new = |pooled: &&mut PooledChannel| pooled.generation >= generation;
        if let Some(pooled) = self.by_address.lock().get_mut(address).filter(is_new) {
            pooled.used = now;
            return Ok(pooled.channel.clone());
        }
        let endpoint = endpoint(address, self.connect_timeout, security.as_deref());
        let endpoint = endpoint.map_err(Fault::Unavailable)?;
        let endpoint = match self.relays {
            Some(most) => relayed(endpoint, most),
            None => endpoint,
        };
        let mut channels = self.by_address.lock();
        // Another request may have made it meanwhile.
        if let Some(pooled) = channels.get_mut(address).filter(is_new) {
            return Ok(pooled.channel.clone());
        }
        let channel = self.network.channel(&endpoint);
        channels
            .insert(address.to_owned(), PooledChannel { channel: channel.clone(), used: now, generation });
        Ok(channel)
    }

    /// Closes channels that were not requested for a while, once they are idle. Each keeps a connection slot at its
    /// other end, and in a large cluster all processes eventually talk to each other.
    pub(crate) fn close_unused(&self) {
        let now = Instant::now();
        self.by_address.lock().retain(|_, pooled| now < pooled.used + UNUSED);
    }

    /// Closes the channel to an address once it is idle.
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
    async fn unused_channels_are_closed() {
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

    /// A service that answers, and then sends each chunk, when the test tells it to.
    struct Gates {
        answer: Arc<Semaphore>,
        chunk: Arc<Semaphore>,
    }

    const CHUNKS: usize = 4;

    #[tonic::async_trait]
    impl Scenes for Gates {
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

    /// Starts such a service. Returns it, its address, and a receiver that gets an item for each closed connection.
    async fn paused_server() -> (Gates, String, mpsc::UnboundedReceiver<()>) {
        let server_gates = Gates { answer: Arc::new(Semaphore::new(0)), chunk: Arc::new(Semaphore::new(0)) };
        let server = Gates { answer: server_gates.answer.clone(), chunk: server_gates.chunk.clone() };
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
        (server_gates, format!("http://{address}"), closed)
    }

    #[tokio::test]
    async fn requests_in_flight_outlive_their_closed_channel() {
        let forget: [fn(&Channels, &str); 2] = [
            |channels, address| channels.forget(address),
            |channels, _| {
                for pooled in channels.by_address.lock().values_mut() {
                    pooled.used -= UNUSED;
                }
                channels.close_unused();
            },
        ];
        for forget in forget {
            let (server_gates, address, mut closed) = paused_server().await;
            let channels = Channels::new(Duration::from_secs(1), None, Network::default()).for_relays(2);
            let ask = || {
                // Like a relay, keeps only the stream.
                let channel = channels.to(&address).unwrap();
                async move { ScenesClient::new(channel).fetch(v1::FetchRequest::default()).await }
            };
            // One answer is partly read, one was requested, and one was not sent yet.
            server_gates.answer.add_permits(1);
            let mut begun = ask().await.unwrap().into_inner();
            server_gates.chunk.add_permits(1);
            assert!(begun.message().await.unwrap().is_some());
            let asked = tokio::spawn(ask());
            tokio::time::sleep(Duration::from_millis(50)).await;
            let to_ask = ask();
            forget(&channels, &address);
            assert!(channels.by_address.lock().is_empty());
            let to_ask = tokio::spawn(to_ask);
            tokio::time::sleep(Duration::from_millis(50)).await;
            assert!(closed.try_recv().is_err(), "it is in use");

            server_gates.answer.add_permits(2);
            server_gates.chunk.add_permits(3 * CHUNKS - 1);
            let asked = asked.await.unwrap().unwrap().into_inner();
            let to_ask = to_ask.await.unwrap().unwrap().into_inner();
            for (mut chunks, left) in [(begun, CHUNKS - 1), (asked, CHUNKS), (to_ask, CHUNKS)] {
                for _ in 0..left {
                    assert!(chunks.message().await.unwrap().is_some());
                }
                assert!(chunks.message().await.unwrap().is_none());
            }
            let ended = tokio::time::timeout(Duration::from_secs(5), closed.recv()).await;
            ended.expect("it is idle").unwrap();
        }
    }
}
