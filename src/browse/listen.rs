//! Where pages connect: plain TCP, or TLS with the service's own certificate.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use argus_cluster::security::ReloadableSecurity;
use axum::serve::Listener;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, mpsc};
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tokio_util::either::Either;

/// Time for a browser to shake hands.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// Most connections that shake hands at a time. Further ones wait to be accepted.
const SHAKING: usize = 64;

/// A listener for pages.
pub(super) enum PageListener {
    Plain(TcpListener),
    Secure { address: SocketAddr, ready: mpsc::Receiver<(TlsStream<TcpStream>, SocketAddr)> },
}

impl PageListener {
    /// Listens with TLS. Each connection gets the certificate of its time.
    ///
    /// # Errors
    /// The listener has no address.
    pub(super) fn secure(tcp: TcpListener, security: Arc<ReloadableSecurity>) -> io::Result<Self> {
        let address = tcp.local_addr()?;
        let (shaken, ready) = mpsc::channel(1);
        tokio::spawn(async move {
            let turns = Arc::new(Semaphore::new(SHAKING));
            let mut tcp = tcp;
            while let Ok(turn) = turns.clone().acquire_owned().await {
                let accepted = tokio::select! {
                    accepted = Listener::accept(&mut tcp) => accepted,
                    () = shaken.closed() => return,
                };
                let (acceptor, shaken) = (TlsAcceptor::from(security.current().of_page()), shaken.clone());
                tokio::spawn(async move {
                    let _turn = turn;
                    let (stream, from) = accepted;
                    // A browser that does not trust the certificate goes away; its user sees why.
                    if let Ok(Ok(stream)) = timeout(HANDSHAKE, acceptor.accept(stream)).await {
                        let _ = shaken.send((stream, from)).await;
                    }
                });
            }
        });
        Ok(Self::Secure { address, ready })
    }
}

impl Listener for PageListener {
    type Io = PageStream;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (PageStream, SocketAddr) {
        let (stream, from) = match self {
            Self::Plain(tcp) => {
                let (stream, from) = Listener::accept(tcp).await;
                (Either::Left(stream), from)
            }
            Self::Secure { ready, .. } => match ready.recv().await {
                Some((stream, from)) => (Either::Right(Box::new(stream)), from),
                None => std::future::pending().await,
            },
        };
        // Send each image at once, without waiting for the acknowledgement of the previous one.
        let tcp = match &stream {
            Either::Left(tcp) => tcp,
            Either::Right(tls) => tls.get_ref().0,
        };
        if let Err(error) = tcp.set_nodelay(true) {
            tracing::debug!(%error, "a connection keeps its delay");
        }
        (stream, from)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Plain(tcp) => tcp.local_addr(),
            Self::Secure { address, .. } => Ok(*address),
        }
    }
}

/// A connection of a page.
type PageStream = Either<TcpStream, Box<TlsStream<TcpStream>>>;
