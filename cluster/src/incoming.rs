//! Connections of a listener: bounded, and never its end.
//!
//! A process that is out of file descriptors cannot accept; the server that is given such an error stops serving
//! everybody. So errors are waited out here. Beyond the bound, connections wait in the operating system's queue, which has
//! a bound of its own. One address has three quarters of the places at most, so that nobody takes them all; and who says
//! nothing at all for a minute, not even the answers to this side's probes, has none.

use std::collections::HashMap;
use std::future::Future;
use std::io;
use std::net::{IpAddr, Ipv4Addr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use futures::Stream;
use parking_lot::Mutex;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep_until};
use tonic::transport::server::{Connected, TcpConnectInfo};
use tracing::warn;

use crate::network::{Accept, Duplex};
use crate::seldom::Seldom;

/// Until what made a connection fail may have passed.
const PAUSE: Duration = Duration::from_millis(100);

/// A connection over which nothing came for so long is ended: both sides probe theirs more often.
const SILENCE: Duration = Duration::from_secs(60);

/// How many places each address has.
type Peers = Arc<Mutex<HashMap<IpAddr, usize>>>;

/// One of an address's places.
struct PeerSeat {
    peers: Peers,
    address: IpAddr,
}

impl PeerSeat {
    /// `None` if it has `most` already.
    fn take(peers: &Peers, address: IpAddr, most: usize) -> Option<Self> {
        let mut taken = peers.lock();
        let count = taken.entry(address).or_default();
        if *count >= most {
            return None;
        }
        *count += 1;
        Some(Self { peers: peers.clone(), address })
    }
}

impl Drop for PeerSeat {
    fn drop(&mut self) {
        let mut taken = self.peers.lock();
        if let Some(count) = taken.get_mut(&self.address) {
            *count -= 1;
            if *count == 0 {
                taken.remove(&self.address);
            }
        }
    }
}

/// The connections of `listener`, at most so many at the same time.
pub(crate) fn incoming(listener: impl Accept, most: usize) -> impl Stream<Item = io::Result<Connection>> {
    let peers = Peers::default();
    let most_of_one = (most / 4 * 3).max(1);
    let seats = Arc::new(Semaphore::new(most.min(Semaphore::MAX_PERMITS)));
    async_stream::stream! {
        while let Ok(seat) = seats.clone().acquire_owned().await {
            match listener.accept().await {
                Ok((stream, between)) => {
                    let address = between.remote_addr().map_or(Ipv4Addr::UNSPECIFIED.into(), |a| a.ip());
                    match PeerSeat::take(&peers, address, most_of_one) {
                        Some(own) => yield Ok(Connection::new(stream, between, (seat, own))),
                        None => {
                            static REFUSED: Seldom = Seldom::new();
                            if let Some(left_out) = REFUSED.now() {
                                warn!(%address, left_out, "a connection is refused: its address has too many");
                            }
                        }
                    }
                }
                Err(error) => {
                    static FAILED: Seldom = Seldom::new();
                    if let Some(left_out) = FAILED.now() {
                        warn!(%error, left_out, "no connection can be accepted");
                    }
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }
}

/// A connection, and its place among those that are open.
pub(crate) struct Connection {
    stream: Box<dyn Duplex>,
    between: TcpConnectInfo,
    /// When something came last, and when that is looked at.
    heard: Instant,
    silent: Pin<Box<Sleep>>,
    _seats: (OwnedSemaphorePermit, PeerSeat),
}

impl Connection {
    fn new(
        stream: Box<dyn Duplex>,
        between: TcpConnectInfo,
        seats: (OwnedSemaphorePermit, PeerSeat),
    ) -> Self {
        let heard = Instant::now();
        Self { stream, between, heard, silent: Box::pin(sleep_until(heard + SILENCE)), _seats: seats }
    }
}

impl Connected for Connection {
    type ConnectInfo = TcpConnectInfo;

    fn connect_info(&self) -> TcpConnectInfo {
        self.between.clone()
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(cx, buf);
        if read.is_ready() {
            if buf.filled().len() > before {
                self.heard = Instant::now();
            }
            return read;
        }
        // The timer is moved when it rings rather than with each read.
        while self.silent.as_mut().poll(cx).is_ready() {
            let until = self.heard + SILENCE;
            if until <= Instant::now() {
                return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
            }
            self.silent.as_mut().reset(until);
        }
        Poll::Pending
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, buf)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bufs: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(cx, bufs)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}

#[cfg(test)]
mod tests {
    use futures::StreamExt;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::{TcpListener, TcpStream};

    use super::*;

    #[tokio::test]
    async fn a_connection_beyond_the_bound_waits_for_a_place() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let accepted = incoming(listener, 1);
        tokio::pin!(accepted);
        let _clients =
            (TcpStream::connect(address).await.unwrap(), TcpStream::connect(address).await.unwrap());
        let first = accepted.next().await.unwrap().unwrap();
        let second = tokio::time::timeout(Duration::from_millis(50), accepted.next()).await;
        assert!(second.is_err(), "two connections are open");
        drop(first);
        assert!(accepted.next().await.unwrap().is_ok());
    }

    #[tokio::test]
    async fn one_address_cannot_take_all_places() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let accepted = incoming(listener, 4);
        tokio::pin!(accepted);
        let mut clients = Vec::new();
        for _ in 0..4 {
            clients.push(TcpStream::connect(address).await.unwrap());
        }
        let mut open = Vec::new();
        for _ in 0..3 {
            open.push(accepted.next().await.unwrap().unwrap());
        }
        let fourth = tokio::time::timeout(Duration::from_millis(50), accepted.next()).await;
        assert!(fourth.is_err(), "a quarter is for others");
        open.pop();
        clients.push(TcpStream::connect(address).await.unwrap());
        assert!(accepted.next().await.unwrap().is_ok());
    }

    #[tokio::test]
    async fn a_connection_over_which_nothing_comes_is_ended() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let accepted = incoming(listener, 4);
        tokio::pin!(accepted);
        let mut client = TcpStream::connect(address).await.unwrap();
        let mut connection = accepted.next().await.unwrap().unwrap();
        client.write_all(b"x").await.unwrap();
        let mut byte = [0];
        connection.read_exact(&mut byte).await.unwrap();
        // As if it had been heard of long ago: the timer rings, and is moved by what has come.
        connection.silent.as_mut().reset(Instant::now());
        let waits = tokio::time::timeout(Duration::from_millis(50), connection.read_exact(&mut byte)).await;
        assert!(waits.is_err(), "something came just now");
        connection.heard = Instant::now() - SILENCE;
        connection.silent.as_mut().reset(Instant::now());
        let error = connection.read_exact(&mut byte).await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }
}
