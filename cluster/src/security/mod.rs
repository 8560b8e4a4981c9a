//! Who may talk to whom.
//!
//! Without a [`Security`] everything is plaintext and everybody may ask for anything: for one machine. With one, every
//! listener and every connection of a process is TLS, and callers are told apart ([`guard`]):
//!
//! * *members*, the cluster's own processes, have a certificate of the cluster's authority with the name
//!   [`CLUSTER_NAME`]. They alone join, fetch scenes and samples, and give orders. They check each other by that name and
//!   not by their hosts', which change;
//! * *clients* have a token, of the role view or admin, and at most a certificate without that name;
//! * health is for anybody: probes have no credentials.

pub(crate) mod guard;
mod tokens;

use std::fmt;

use tonic::transport::{Certificate, ClientTlsConfig, Identity, ServerTlsConfig};

pub use argus_proto::CLUSTER_NAME;
pub use tokens::Tokens;

/// Longest handshake: whoever connects and says nothing holds no connection for longer.
const HANDSHAKE: std::time::Duration = std::time::Duration::from_secs(10);

/// Longest handshake of a connection that this process opens: another server may answer.
const CONNECTION_HANDSHAKE: std::time::Duration = std::time::Duration::from_secs(2);

/// What makes a process a member, and whom it takes for one. Everything in it is PEM.
#[derive(Clone, PartialEq, Eq)]
pub struct Security {
    /// Certificate of this process, with [`CLUSTER_NAME`] and, for clients, the names of its host.
    pub certificate: Vec<u8>,
    /// Its key.
    pub key: Vec<u8>,
    /// The authority that signs the certificates of all members.
    pub ca: Vec<u8>,
    /// Of clients; a worker has none.
    pub tokens: Tokens,
    /// Whether a connection without a certificate is refused, whatever its token; probes of health included.
    pub require_client_certificates: bool,
}

impl fmt::Debug for Security {
    /// Without the key.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { require_client_certificates, tokens, .. } = self;
        f.debug_struct("Security")
            .field("require_client_certificates", require_client_certificates)
            .field("tokens", tokens)
            .finish_non_exhaustive()
    }
}

impl Security {
    fn identity(&self) -> Identity {
        Identity::from_pem(&self.certificate, &self.key)
    }

    /// How a listener proves itself, and asks callers who can to prove themselves.
    pub(crate) fn of_listener(&self) -> ServerTlsConfig {
        ServerTlsConfig::new()
            .identity(self.identity())
            .client_ca_root(Certificate::from_pem(&self.ca))
            .client_auth_optional(!self.require_client_certificates)
            .timeout(HANDSHAKE)
    }

    /// How a connection to another member is made.
    pub(crate) fn of_connection(&self) -> ClientTlsConfig {
        ClientTlsConfig::new()
            .identity(self.identity())
            .ca_certificate(Certificate::from_pem(&self.ca))
            .domain_name(CLUSTER_NAME)
            // That of a connection ends with TCP's part of it: what listens there may be a process that hangs.
            .timeout(CONNECTION_HANDSHAKE)
    }
}
