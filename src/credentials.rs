//! Certificates, keys and tokens, from the files that settings name.

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use argus_client::{ConnectOptions, Credentials, Key, Token};
use argus_cluster::leadership::{NatsAccess, NatsSecret, NatsTls, nats_host};
use argus_cluster::security::{Security, Tokens};
use tokio::net::TcpListener;

use crate::exit::bad_arguments;
use crate::settings;

/// What a listener's process is known by, as its settings say; `None`: plaintext.
///
/// # Errors
/// Settings that do not go together, and files that cannot be read or hold something else.
pub(crate) fn of_member(
    settings: &settings::Security,
    clients: bool,
) -> anyhow::Result<Option<Arc<Security>>> {
    let settings::Security { certificate, key, ca, tokens, require_client_certificates, .. } = settings;
    let Some(certificate) = certificate else {
        let useless = [
            ("key", key.is_some()),
            ("ca", ca.is_some()),
            ("tokens", tokens.is_some()),
            ("require_client_certificates", *require_client_certificates),
        ];
        return match useless.into_iter().find(|(_, given)| *given) {
            Some((name, _)) => Err(bad_arguments(format!(
                "security.{name} is set and security.certificate is not: without a certificate there is no TLS that \
                 it could be part of; `argus certs DIR` makes one"
            ))),
            None => Ok(None),
        };
    };
    let wanted = |path: &Option<PathBuf>, name: &str, what: &str| {
        path.clone().ok_or_else(|| {
            bad_arguments(format!(
                "security.certificate is set and security.{name} is not: {what}; `argus certs DIR` makes one"
            ))
        })
    };
    let key = wanted(key, "key", "a certificate needs its key")?;
    let ca = wanted(
        ca,
        "ca",
        "the cluster's processes are known by the authority that signed their certificates",
    )?;
    let tokens = match clients {
        // A worker answers no client.
        false => Tokens::default(),
        true => {
            let path = wanted(tokens, "tokens", "clients are known by their tokens")?;
            let text = secret(&path, "security.tokens")?;
            let text = String::from_utf8(text).map_err(|_| malformed(&path, "it is no UTF-8"))?;
            Tokens::parse(&text).map_err(|reason| malformed(&path, &reason))?
        }
    };
    Ok(Some(Arc::new(Security {
        certificate: pem(certificate, "security.certificate", "CERTIFICATE")?,
        key: key_pem(&key, "security.key")?,
        ca: pem(&ca, "security.ca", "CERTIFICATE")?,
        tokens,
        require_client_certificates: *require_client_certificates,
    })))
}

/// How a client connects, as its settings say.
///
/// # Errors
/// As [`of_member`].
pub(crate) fn of_client(settings: &settings::Client) -> anyhow::Result<ConnectOptions> {
    let settings::Client { ca, token_file, certificate, key, .. } = settings;
    let token = |path: &PathBuf| {
        let text = secret(path, "client.token_file")?;
        let text = String::from_utf8(text).map_err(|_| malformed(path, "it is no UTF-8"))?;
        Token::parse(&text).map_err(|reason| malformed(path, reason))
    };
    let identity = match (certificate, key) {
        (Some(certificate), Some(key)) => {
            let certificate = pem(certificate, "client.certificate", "CERTIFICATE")?;
            Some((certificate, Key(key_pem(key, "client.key")?)))
        }
        (None, None) => None,
        _ => {
            return Err(bad_arguments("client.certificate and client.key go together: set both, or neither"));
        }
    };
    let ca = ca.as_ref().map(|path| pem(path, "client.ca", "CERTIFICATE")).transpose()?;
    let credentials = Credentials { ca, token: token_file.as_ref().map(token).transpose()?, identity };
    Ok(ConnectOptions { credentials, ..ConnectOptions::default() })
}

/// How a coordinator speaks to the registry at `url`: by TLS where it has a certificate, and beyond this machine in plaintext
/// only where it was told so.
///
/// # Errors
/// As [`of_member`], and plaintext that nobody asked for.
pub(crate) fn of_registry(
    url: &str,
    coordinator: &settings::Coordinator,
    security: &settings::Security,
) -> anyhow::Result<NatsAccess> {
    let secret = |path: &PathBuf| {
        let text = secret(path, "coordinator.registry_credentials")?;
        let text = String::from_utf8(text).map_err(|_| malformed(path, "it is no UTF-8"))?;
        NatsSecret::parse(&text).map_err(|reason| malformed(path, reason))
    };
    let secret = coordinator.registry_credentials.as_ref().map(secret).transpose()?;
    let settings::Security { certificate, key, ca, insecure, .. } = security;
    let tls = match (certificate, key, ca) {
        (Some(certificate), Some(key), Some(ca)) => {
            Some(NatsTls { ca: ca.clone(), certificate: certificate.clone(), key: key.clone() })
        }
        _ => None,
    };
    let host = nats_host(url).map_err(|reason| bad_arguments(format!("coordinator.registry: {reason}")))?;
    let local = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback());
    if tls.is_none() && !local {
        if !insecure {
            return Err(bad_arguments(format!(
                "speaking to the registry at {host} without TLS would let whoever listens in or stands between decide who \
                 leads: set security.certificate, security.key and security.ca, or say --insecure if the network is trusted"
            )));
        }
        tracing::warn!(
            "the registry at {host} is spoken to without TLS: whoever stands between can decide who leads"
        );
    }
    Ok(NatsAccess { tls, secret })
}

/// Listens on `address`, or says what to do instead: beyond this machine only by TLS, unless it was told so.
///
/// # Errors
/// An address that cannot be listened on, or should not be.
pub(crate) async fn listen(
    address: &str,
    secured: bool,
    settings: &settings::Security,
) -> anyhow::Result<TcpListener> {
    let listener = TcpListener::bind(address).await.map_err(|error| {
        anyhow::Error::new(error).context(format!(
            "cannot listen on {address}: choose another address with --listen, such as 127.0.0.1:0"
        ))
    })?;
    if !secured && !listener.local_addr()?.ip().is_loopback() {
        if !settings.insecure {
            return Err(bad_arguments(format!(
                "listening on {address} without TLS would let everybody who can reach this machine ask, join and \
                 listen in: run `argus certs DIR` and give --certificate, --key, --ca and --tokens, or listen on \
                 127.0.0.1, or say --insecure if the network is trusted"
            )));
        }
        tracing::warn!(
            "listening on {address} without TLS: everybody who can reach it can ask, join and listen in"
        );
    }
    Ok(listener)
}

/// Where a process on this machine reaches what listens there.
pub(crate) fn url(secured: bool, mut address: SocketAddr) -> String {
    use std::net::{Ipv4Addr, Ipv6Addr};
    if address.ip().is_unspecified() {
        address.set_ip(match address.ip() {
            IpAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    format!("{}://{address}", if secured { "https" } else { "http" })
}

fn malformed(path: &Path, reason: &str) -> anyhow::Error {
    bad_arguments(format!("{}: {reason}", path.display()))
}

fn read(path: &Path, setting: &str) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path)
        .map_err(|e| bad_arguments(format!("{setting}: {} cannot be read: {e}", path.display())))
}

/// A file that has a block of that kind; what is in the block is checked by who uses it.
fn pem(path: &Path, setting: &str, label: &str) -> anyhow::Result<Vec<u8>> {
    let text = read(path, setting)?;
    has_block(path, &text, label).map(|()| text)
}

fn key_pem(path: &Path, setting: &str) -> anyhow::Result<Vec<u8>> {
    let text = secret(path, setting)?;
    has_block(path, &text, "PRIVATE KEY").map(|()| text)
}

fn has_block(path: &Path, text: &[u8], label: &str) -> anyhow::Result<()> {
    let end = format!("{label}-----");
    match text.windows(end.len()).any(|window| window == end.as_bytes()) {
        true => Ok(()),
        false => Err(malformed(path, &format!("it has no PEM block of a {}", label.to_lowercase()))),
    }
}

/// A file that others on this machine should not be able to read.
fn secret(path: &Path, setting: &str) -> anyhow::Result<Vec<u8>> {
    let bytes = read(path, setting)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(path).map(|meta| meta.permissions().mode()).unwrap_or_default();
        if mode & 0o004 != 0 {
            tracing::warn!("{} can be read by everybody on this machine: chmod 600 it", path.display());
        }
    }
    Ok(bytes)
}
