//! Accepts connections: bounded in number, and surviving accept errors.
//!
//! A process without free file descriptors cannot accept, and a server that gets such an error stops serving. So
//! errors are waited out here. Beyond the limit, connections wait in the operating system's queue, which is bounded
//! as well. One address gets at most three quarters of the slots. A connection over which nothing arrives for a
//! minute, not even answers to keepalive probes, is closed.
//!
//! A quarter of the slots is reserved for the cluster's own processes, which would otherwise wait behind clients. A
//! process is known by its certificate, and so only after it has a slot. So a reserved slot is lost unless the
//! connection soon proves to be a member's (`security::guard` decides). Clients in reserved slots are refused at
//! once, but health probes are answered.
//!
//! Plaintext has no certificates, and any process may call anything. There, a process that calls what only members
//! call counts as one. That keeps harmless clients out of the reserve, but no attacker: against those, listen on
//! loopback or use certificates.

use std::collections::HashMap;
use std::future::Future;
use std::io;
use std::net::{IpAddr, Ipv4Addr};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
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
use crate::rate_limited_log::RateLimitedLog;

/// Pause after an accept error.
const PAUSE: Duration = Duration::from_millis(100);

/// A connection is closed if nothing arrives for this long. Both sides send probes more often.
const SILENCE: Duration = Duration::from_secs(60);

/// Time in which a connection in a reserved slot must prove that it is a member's. Within a cluster this takes
/// milliseconds.
const INTRODUCTION: Duration = Duration::from_secs(5);

/// Number of slots that each address uses.
type Peers = Arc<Mutex<HashMap<IpAddr, usize>>>;

/// One slot of an address.
struct AddressSlot {
    peers: Peers,
    address: IpAddr,
}

impl AddressSlot {
    /// Takes a slot; `None` if the address uses `most` already.
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

impl Drop for AddressSlot {
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

/// The connections of `listener`, at most `most` at the same time.
pub(crate) fn incoming(listener: impl Accept, most: usize) -> impl Stream<Item = io::Result<Connection>> {
    let peers = Peers::default();
    let most_of_one = (most / 4 * 3).max(1);
    let reserve = most / 4;
    let slots = |count: usize| Arc::new(Semaphore::new(count.min(Semaphore::MAX_PERMITS)));
    let (open, reserved) = (slots(most - reserve), slots(reserve));
    async_stream::stream! {
        loop {
            let (slot, is_reserved) = tokio::select! {
                biased;
                slot = open.clone().acquire_owned() => (slot, false),
                slot = reserved.clone().acquire_owned() => (slot, true),
            };
            // The semaphores are never closed.
            let Ok(slot) = slot else { return };
            match listener.accept().await {
                Ok((stream, info)) => {
                    let address = info.remote_addr().map_or(Ipv4Addr::UNSPECIFIED.into(), |a| a.ip());
                    match AddressSlot::take(&peers, address, most_of_one) {
                        Some(own) => yield Ok(Connection::new(stream, info, is_reserved, (slot, own))),
                        None => {
                            static REFUSED: RateLimitedLog = RateLimitedLog::new();
                            if let Some(left_out) = REFUSED.now() {
                                warn!(%address, left_out, "connection refused: its address has too many open ones");
                            }
                        }
                    }
                }
                Err(error) => {
                    static FAILED: RateLimitedLog = RateLimitedLog::new();
                    if let Some(left_out) = FAILED.now() {
                        warn!(%error, left_out, "cannot accept connections");
                    }
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }
}

/// The addresses and the slot of a connection, in the extensions of its requests.
#[derive(Clone)]
pub(crate) struct ConnectionInfo {
    pub(crate) tcp: TcpConnectInfo,
    slot: Arc<Slot>,
}

struct Slot {
    is_reserved: bool,
    is_member: AtomicBool,
}

impl ConnectionInfo {
    /// Records that the other end is a member of the cluster.
    pub(crate) fn set_member(&self) {
        self.slot.is_member.store(true, Ordering::Relaxed);
    }

    /// Whether it holds a reserved slot without being a member's.
    pub(crate) fn holds_reserved_slot(&self) -> bool {
        self.slot.is_reserved && !self.slot.is_member.load(Ordering::Relaxed)
    }
}

/// A connection, and its slot.
pub(crate) struct Connection {
    stream: Box<dyn Duplex>,
    info: ConnectionInfo,
    since: Instant,
    /// The time of the last received bytes.
    heard: Instant,
    silent: Pin<Box<Sleep>>,
    _slots: (OwnedSemaphorePermit, AddressSlot),
}

impl Connection {
    fn new(
        stream: Box<dyn Duplex>,
        tcp: TcpConnectInfo,
        is_reserved: bool,
        slots: (OwnedSemaphorePermit, AddressSlot),
    ) -> Self {
        let now = Instant::now();
        let slot = Arc::new(Slot { is_reserved, is_member: AtomicBool::new(false) });
        let look = now + if is_reserved { INTRODUCTION } else { SILENCE };
        Self {
            stream,
            info: ConnectionInfo { tcp, slot },
            since: now,
            heard: now,
            silent: Box::pin(sleep_until(look)),
            _slots: slots,
        }
    }

    /// The time at which it is closed, unless bytes arrive or it proves to be a member's.
    fn ends(&self) -> Instant {
        let silent = self.heard + SILENCE;
        match self.info.holds_reserved_slot() {
            true => silent.min(self.since + INTRODUCTION),
            false => silent,
        }
    }
}

impl Connected for Connection {
    type ConnectInfo = ConnectionInfo;

    fn connect_info(&self) -> ConnectionInfo {
        self.info.clone()
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
        // The timer is moved when it fires, not with each read.
        while self.silent.as_mut().poll(cx).is_ready() {
            let until = self.ends();
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
    async fn a_connection_beyond_the_limit_waits_for_a_slot() {
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
    async fn one_address_cannot_take_all_slots() {
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
    async fn a_silent_connection_is_closed() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let accepted = incoming(listener, 4);
        tokio::pin!(accepted);
        let mut client = TcpStream::connect(address).await.unwrap();
        let mut connection = accepted.next().await.unwrap().unwrap();
        client.write_all(b"x").await.unwrap();
        let mut byte = [0];
        connection.read_exact(&mut byte).await.unwrap();
        // Pretends that the last bytes came long ago: the timer fires, and is moved by those that came.
        connection.silent.as_mut().reset(Instant::now());
        let waits = tokio::time::timeout(Duration::from_millis(50), connection.read_exact(&mut byte)).await;
        assert!(waits.is_err(), "something came just now");
        connection.heard = Instant::now() - SILENCE;
        connection.silent.as_mut().reset(Instant::now());
        let error = connection.read_exact(&mut byte).await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }

    #[tokio::test]
    async fn only_members_keep_reserved_slots() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let accepted = incoming(listener, 8);
        tokio::pin!(accepted);
        let mut clients = Vec::new();
        // From several addresses, since one address may not use so many slots.
        for from in [2, 2, 2, 3, 3, 3, 4, 4] {
            let socket = tokio::net::TcpSocket::new_v4().unwrap();
            socket.bind((Ipv4Addr::new(127, 0, 0, from), 0).into()).unwrap();
            clients.push(socket.connect(address).await.unwrap());
        }
        let mut open = Vec::new();
        for _ in 0..8 {
            open.push(accepted.next().await.unwrap().unwrap());
        }
        let in_the_way: Vec<bool> = open.iter().map(|c| c.info.holds_reserved_slot()).collect();
        assert_eq!(in_the_way, [false, false, false, false, false, false, true, true]);
        // One of the two proves to be a member's in time.
        open[7].connect_info().set_member();
        let mut byte = [0];
        for connection in &mut open[6..] {
            connection.since = Instant::now() - INTRODUCTION;
            connection.silent.as_mut().reset(Instant::now());
        }
        let error = open[6].read_exact(&mut byte).await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        let waits = tokio::time::timeout(Duration::from_millis(50), open[7].read_exact(&mut byte)).await;
        assert!(waits.is_err(), "a member stays");
    }
}
