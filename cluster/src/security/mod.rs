//! Authentication and authorisation between processes and clients.
//!
//! Without a [`Security`], connections are plaintext and any caller may call anything: for one machine. With one,
//! every listener and connection uses TLS, and callers have ranks ([`guard`]):
//!
//! * *members*, the cluster's own processes, have a certificate of the cluster's authority with the name
//!   [`CLUSTER_NAME`]. Only they join, fetch scenes and samples, and give orders. They verify each other by this
//!   name, not by host names, which change;
//! * *clients* have a token, of the role view, author or admin, and at most a certificate without that name;
//! * health is open to any caller, since probes have no credentials.
//!
//! Certificates and tokens may be replaced while a process runs ([`reloadable`]).

mod expiry;
pub(crate) mod guard;
pub(crate) mod handshake;
mod reloadable;
#[cfg(test)]
pub(crate) mod testing;
mod tokens;

use std::fmt;

use tonic::transport::{Certificate, ClientTlsConfig, Identity};

pub use argus_proto::CLUSTER_NAME;
pub use reloadable::{InvalidSecurity, LoadedSecurity, ReloadableSecurity};
pub use tokens::Tokens;

/// Timeout of a TLS handshake of a connection that this process opens. Another server may answer.
const CONNECTION_HANDSHAKE: std::time::Duration = std::time::Duration::from_secs(2);

/// Credentials of a process, and what it trusts. All certificates and keys are PEM.
#[derive(Clone, PartialEq, Eq)]
pub struct Security {
    /// The certificate of this process, with [`CLUSTER_NAME`] and, for clients, its host names.
    pub certificate: Vec<u8>,
    /// The private key of the certificate.
    pub key: Vec<u8>,
    /// The certificate of the authority that signs those of all members.
    pub ca: Vec<u8>,
    /// Tokens of clients; empty for a worker.
    pub tokens: Tokens,
    /// Whether connections without a client certificate are refused, including those with a token and health probes.
    pub require_client_certificates: bool,
}

impl fmt::Debug for Security {
    /// Prints no key.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { require_client_certificates, tokens, .. } = self;
        f.debug_struct("Security")
            .field("require_client_certificates", require_client_certificates)
            .field("tokens", tokens)
            .finish_non_exhaustive()
    }
}

impl Security {
    /// The TLS configuration of a connection to another member.
    pub(crate) fn of_connection(&self) -> ClientTlsConfig {
        ClientTlsConfig::new()
            .identity(Identity::from_pem(&self.certificate, &self.key))
            .ca_certificate(Certificate::from_pem(&self.ca))
            .domain_name(CLUSTER_NAME)
            // The connection timeout covers only TCP: the listener may be a process that hangs.
            .timeout(CONNECTION_HANDSHAKE)
    }
}
