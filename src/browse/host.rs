//! The page of a service, served by its coordinator's own process.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use argus_client::{Client, ConnectOptions};
use argus_cluster::security::ReloadableSecurity;
use argus_scene::PlanRequest;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use super::access::Access;
use super::listen::PageListener;
use super::logins::CONNECTIONS;
use super::logins::Logins;
use super::serve;
use super::site::Site;
use crate::credentials;
use crate::exit::bad_arguments;

/// Where the page is, unless the command says otherwise. If the port is taken, a free one is.
const USUAL: &str = "127.0.0.1:7480";

/// Where a service's page is.
#[derive(Clone, Copy)]
pub(crate) enum Place<'a> {
    /// Nowhere.
    Off,
    /// At the usual address, or at a free port of this machine.
    Usual,
    /// At this address.
    At(&'a str),
}

impl<'a> Place<'a> {
    /// The place that a flag names: an address, or `off`.
    pub(crate) fn named(flag: &'a str) -> Self {
        if flag == "off" { Self::Off } else { Self::At(flag) }
    }
}

/// Pause between two attempts to reach the own service.
const TRY_AGAIN: Duration = Duration::from_millis(100);

/// The page of a service, which listens but does not answer yet.
pub(crate) struct Page {
    /// Its link, for browsers on this machine.
    pub(crate) url: String,
    address: SocketAddr,
    listener: PageListener,
}

impl Page {
    /// Listens with the service's TLS, if it has any; its users then log in with their tokens. Without, only this machine can
    /// reach the page, unless `insecure`. Returns `None` if there is to be no page.
    ///
    /// # Errors
    /// An address that cannot be used or is not allowed, or a certificate that cannot be used.
    pub(crate) async fn listen(
        place: Place<'_>,
        security: Option<&Arc<ReloadableSecurity>>,
        insecure: bool,
    ) -> anyhow::Result<Option<Self>> {
        let tcp = match place {
            Place::Off => return Ok(None),
            Place::At(address) => TcpListener::bind(address).await.with_context(|| {
                format!(
                    "the page cannot listen on {address}: choose another address with --page, or --page off"
                )
            })?,
            Place::Usual => match TcpListener::bind(USUAL).await {
                Ok(tcp) => tcp,
                Err(_) => TcpListener::bind("127.0.0.1:0").await.context("the page cannot listen")?,
            },
        };
        let address = tcp.local_addr()?;
        if security.is_none() && !address.ip().is_loopback() && !insecure {
            return Err(bad_arguments(format!(
                "the page at {address} would show the scene to everyone who can reach this machine: give --certificate, --key, \
                 --ca and --tokens, or choose 127.0.0.1 with --page, or allow it with --insecure"
            )));
        }
        let listener = match security {
            Some(security) => PageListener::secure(tcp, security.clone())?,
            None => PageListener::Plain(tcp),
        };
        Ok(Some(Self { url: credentials::url(security.is_some(), address), address, listener }))
    }

    /// Serves the page of the service at `server`, once that answers, until the process must stop.
    ///
    /// # Errors
    /// The page can no longer be served.
    pub(crate) async fn serve(
        self,
        server: &str,
        security: Option<Arc<ReloadableSecurity>>,
        shutdown: CancellationToken,
    ) -> anyhow::Result<()> {
        let access = match security {
            Some(security) => Access::ByToken(Box::new(Logins::new(server.to_owned(), security))),
            None => tokio::select! {
                client = own_client(server) => Access::Shared(client.into()),
                () = shutdown.cancelled() => return Ok(()),
            },
        };
        let site = Site::new(access, PlanRequest::default(), self.address.ip().is_loopback(), None);
        serve(site, self.listener, shutdown).await
    }
}

/// A client of the service in this process, which may not answer yet.
async fn own_client(server: &str) -> Client {
    let options = ConnectOptions { connections: CONNECTIONS, ..ConnectOptions::default() };
    loop {
        match Client::connect_with(server, &options).await {
            Ok(client) => return client,
            Err(error) => tracing::debug!(%error, "the page waits for its service"),
        }
        tokio::time::sleep(TRY_AGAIN).await;
    }
}
