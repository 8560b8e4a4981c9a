//! Certificates and tokens that are replaced while a process runs.
//!
//! New connections and requests use the newest ones. Open connections stay as they are: a session that began with a
//! token which is gone ends when its client ends it.

use std::fmt;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use parking_lot::RwLock;
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use tokio_rustls::rustls::client::WebPkiServerVerifier;
use tokio_rustls::rustls::client::danger::ServerCertVerifier as _;
use tokio_rustls::rustls::crypto::CryptoProvider;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::{RootCertStore, ServerConfig};

use super::expiry::not_after;
use super::{CLUSTER_NAME, Security};
use crate::observe::Exposition;

/// Why certificates cannot be used: the file's role, and the reason.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {reason}")]
pub struct InvalidSecurity {
    /// What is wrong: the certificate, the key or the authority.
    pub what: &'static str,
    /// The reason.
    pub reason: String,
}

/// Makes the error of a part, from any reason.
fn invalid<E: fmt::Display>(what: &'static str) -> impl Fn(E) -> InvalidSecurity {
    move |reason| InvalidSecurity { what, reason: reason.to_string() }
}

/// Certificates and tokens in use, with the TLS configurations made of them.
pub struct LoadedSecurity {
    security: Security,
    /// Ascends with each replacement.
    generation: u64,
    listener: Arc<ServerConfig>,
    page: Arc<ServerConfig>,
    verifier: Arc<WebPkiServerVerifier>,
    chain: Vec<CertificateDer<'static>>,
    /// When the certificate and the first of the authorities to end do so, seconds since 1970.
    ends: [u64; 2],
}

impl Deref for LoadedSecurity {
    type Target = Security;

    fn deref(&self) -> &Security {
        &self.security
    }
}

impl fmt::Debug for LoadedSecurity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.security.fmt(f)
    }
}

impl LoadedSecurity {
    fn new(security: Security, generation: u64) -> Result<Self, InvalidSecurity> {
        let (certificate, authority) = ("the certificate", "the authority");
        let provider = Arc::new(default_provider());
        let chain = certificates(&security.certificate, certificate)?;
        let authorities = certificates(&security.ca, authority)?;
        let mut roots = RootCertStore::empty();
        for one in &authorities {
            roots.add(one.clone()).map_err(invalid(authority))?;
        }
        let roots = Arc::new(roots);
        let verifier = WebPkiServerVerifier::builder_with_provider(roots.clone(), provider.clone());
        let verifier = verifier.build().map_err(invalid(authority))?;
        let own_end = match chain.first() {
            Some(first) => not_after(&verifier, first).map_err(invalid(certificate))?,
            None => return Err(invalid(certificate)("the file has none")),
        };
        let ends = authorities.iter().map(|one| not_after(&verifier, one));
        let ends = ends.collect::<Result<Vec<_>, _>>().map_err(invalid(authority))?;
        let ends = [own_end, ends.into_iter().min().unwrap_or_default()];

        let clients = WebPkiClientVerifier::builder_with_provider(roots, provider.clone());
        let clients =
            if security.require_client_certificates { clients } else { clients.allow_unauthenticated() };
        let clients = clients.build().map_err(invalid(authority))?;
        // Metrics and probes may use HTTP/1.1, and so do pages, since WebSockets begin with it.
        let listener = config(&provider, &chain, &security.key, &[b"h2", b"http/1.1"], |builder| {
            builder.with_client_cert_verifier(clients)
        })?;
        let page = config(&provider, &chain, &security.key, &[b"http/1.1"], |builder| {
            builder.with_no_client_auth()
        })?;
        Ok(Self { security, generation, listener, page, verifier, chain, ends })
    }

    /// The TLS configuration of the process's listener, which requests client certificates.
    pub(crate) fn of_listener(&self) -> Arc<ServerConfig> {
        self.listener.clone()
    }

    /// The TLS configuration of a web page, which needs no client certificate.
    pub fn of_page(&self) -> Arc<ServerConfig> {
        self.page.clone()
    }

    /// A number that ascends whenever certificates or tokens are replaced.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Checks that other members accept the certificate now.
    fn check_membership(&self) -> Result<(), InvalidSecurity> {
        let what = "the certificate";
        let name = ServerName::try_from(CLUSTER_NAME).map_err(invalid(what))?;
        let Some((first, rest)) = self.chain.split_first() else { return Ok(()) };
        let verified = self.verifier.verify_server_cert(first, rest, &name, &[], UnixTime::now());
        verified.map(drop).map_err(invalid(what))
    }
}

/// The certificates of a PEM text, at least one.
fn certificates(pem: &[u8], what: &'static str) -> Result<Vec<CertificateDer<'static>>, InvalidSecurity> {
    let all = CertificateDer::pem_slice_iter(pem).collect::<Result<Vec<_>, _>>().map_err(invalid(what))?;
    if all.is_empty() { Err(invalid(what)("the file has none")) } else { Ok(all) }
}

type Unauthenticated = tokio_rustls::rustls::ConfigBuilder<ServerConfig, tokio_rustls::rustls::WantsVerifier>;
type Authenticated =
    tokio_rustls::rustls::ConfigBuilder<ServerConfig, tokio_rustls::rustls::server::WantsServerCert>;

/// The configuration of a server with this certificate, which offers these protocols.
fn config(
    provider: &Arc<CryptoProvider>,
    chain: &[CertificateDer<'static>],
    key: &[u8],
    protocols: &[&[u8]],
    clients: impl FnOnce(Unauthenticated) -> Authenticated,
) -> Result<Arc<ServerConfig>, InvalidSecurity> {
    let key = PrivateKeyDer::from_pem_slice(key).map_err(invalid("the certificate's key"))?;
    let builder = ServerConfig::builder_with_provider(provider.clone());
    let builder = builder.with_safe_default_protocol_versions().map_err(invalid("TLS"))?;
    let config = clients(builder).with_single_cert(chain.to_vec(), key);
    let mut config = config.map_err(invalid("the certificate and its key"))?;
    config.alpn_protocols = protocols.iter().map(|protocol| protocol.to_vec()).collect();
    Ok(Arc::new(config))
}

/// The security of a process, which may be replaced while the process runs.
pub struct ReloadableSecurity {
    current: RwLock<Arc<LoadedSecurity>>,
    replaced: AtomicU64,
    refused: AtomicU64,
    /// Whether the newest certificates or tokens were refused.
    is_refused: AtomicBool,
}

impl fmt::Debug for ReloadableSecurity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.current().fmt(f)
    }
}

impl PartialEq for ReloadableSecurity {
    /// Whether both use the same certificates and tokens now.
    fn eq(&self, other: &Self) -> bool {
        self.current().security == other.current().security
    }
}

impl ReloadableSecurity {
    /// Begins with these certificates and tokens.
    ///
    /// # Errors
    /// [`InvalidSecurity`] if a certificate or key cannot be read, or if they do not belong together.
    pub fn new(security: Security) -> Result<Self, InvalidSecurity> {
        Ok(Self {
            current: RwLock::new(Arc::new(LoadedSecurity::new(security, 1)?)),
            replaced: AtomicU64::new(0),
            refused: AtomicU64::new(0),
            is_refused: AtomicBool::new(false),
        })
    }

    /// The certificates and tokens for a new connection or request.
    pub fn current(&self) -> Arc<LoadedSecurity> {
        self.current.read().clone()
    }

    /// Replaces certificates and tokens. Returns whether they differ from the present ones.
    ///
    /// # Errors
    /// [`InvalidSecurity`] for what [`Self::new`] refuses, and for a certificate that other members would not accept
    /// now: of another authority, of another name, or out of its period. The present ones then stay in use.
    pub fn replace(&self, security: Security) -> Result<bool, InvalidSecurity> {
        let present = self.current();
        if present.security == security {
            self.is_refused.store(false, Ordering::Relaxed);
            return Ok(false);
        }
        let loaded = LoadedSecurity::new(security, present.generation + 1);
        let loaded = loaded.and_then(|loaded| loaded.check_membership().map(|()| loaded));
        match loaded {
            Ok(loaded) => {
                *self.current.write() = Arc::new(loaded);
                self.replaced.fetch_add(1, Ordering::Relaxed);
                self.is_refused.store(false, Ordering::Relaxed);
                Ok(true)
            }
            Err(error) => {
                self.refuse();
                Err(error)
            }
        }
    }

    /// Records that new certificates or tokens could not be read. The present ones stay in use.
    pub fn refuse(&self) {
        self.refused.fetch_add(1, Ordering::Relaxed);
        self.is_refused.store(true, Ordering::Relaxed);
    }

    /// Writes the metrics of certificates and tokens.
    pub(crate) fn expose(&self, to: &mut Exposition<'_>) -> fmt::Result {
        let [own, authority] = self.current().ends.map(|secs| secs as f64);
        to.gauges(
            "certificate_expiry_timestamp_seconds",
            "When this process's certificate and the authority's end, seconds since 1970",
            [([("certificate", "own")], own), ([("certificate", "authority")], authority)],
        )?;
        let outcomes = [("loaded", &self.replaced), ("refused", &self.refused)];
        to.counters(
            "credentials_reloads",
            "Changes of the files of certificates and tokens, by whether they could be used",
            outcomes.map(|(outcome, count)| ([("outcome", outcome)], count.load(Ordering::Relaxed) as f64)),
        )?;
        to.gauge(
            "credentials_refused",
            "1 while the files of certificates and tokens cannot be used and earlier ones are in use, else 0",
            f64::from(self.is_refused.load(Ordering::Relaxed)),
        )
    }
}

#[cfg(test)]
mod tests;
