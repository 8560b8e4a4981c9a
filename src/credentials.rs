//! Reads certificates, keys and tokens from the files that settings name, and again when these change ([`reload`]).

mod changed_files;
mod reload;

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use argus_client::{ConnectOptions, Credentials, Key, Token};
use argus_cluster::leadership::{NatsAccess, NatsSecret, NatsTls, nats_host};
use argus_cluster::security::{ReloadableSecurity, Security, Tokens};
use tokio::net::TcpListener;

use crate::exit::bad_arguments;
use crate::settings;

pub(crate) use reload::{keep_client, keep_member};

/// The security of a process that listens; `None`: plaintext.
///
/// # Errors
/// Contradictory settings, or a file that cannot be read or has another format.
pub(crate) fn of_member(
    settings: &settings::Security,
    clients: bool,
) -> anyhow::Result<Option<Arc<ReloadableSecurity>>> {
    let Some(security) = read_member(settings, clients)? else { return Ok(None) };
    let security = ReloadableSecurity::new(security).map_err(|error| bad_arguments(error.to_string()))?;
    Ok(Some(Arc::new(security)))
}

/// Reads the files of a process that listens; `None`: plaintext.
fn read_member(settings: &settings::Security, clients: bool) -> anyhow::Result<Option<Security>> {
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
                "security.{name} is set but security.certificate is not: without a certificate there is no TLS; `argus \
                certs DIR` makes one"
            ))),
            None => Ok(None),
        };
    };
    let wanted = |path: &Option<PathBuf>, name: &str, what: &str| {
        path.clone().ok_or_else(|| {
            bad_arguments(format!(
                "security.certificate is set but security.{name} is not: {what}; `argus certs DIR` makes one"
            ))
        })
    };
    let key = wanted(key, "key", "a certificate needs its key")?;
    let ca = wanted(ca, "ca", "the authority identifies the processes of the cluster")?;
    let tokens = match clients {
        // Workers do not authenticate clients.
        false => Tokens::default(),
        true => {
            let path = wanted(tokens, "tokens", "tokens identify the clients")?;
            let text = secret(&path, "security.tokens")?;
            let text = String::from_utf8(text).map_err(|_| malformed(&path, "it is not UTF-8"))?;
            Tokens::parse(&text).map_err(|reason| malformed(&path, &reason))?
        }
    };
    Ok(Some(Security {
        certificate: pem(certificate, "security.certificate", "CERTIFICATE")?,
        key: key_pem(&key, "security.key")?,
        ca: pem(&ca, "security.ca", "CERTIFICATE")?,
        tokens,
        require_client_certificates: *require_client_certificates,
    }))
}

/// The connection options of a client.
///
/// # Errors
/// Any error of [`of_member`].
pub(crate) fn of_client(settings: &settings::Client) -> anyhow::Result<ConnectOptions> {
    let settings::Client { ca, token_file, certificate, key, scene, .. } = settings;
    let token = |path: &PathBuf| {
        let text = secret(path, "client.token_file")?;
        let text = String::from_utf8(text).map_err(|_| malformed(path, "it is not UTF-8"))?;
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
    Ok(ConnectOptions { credentials, scene: scene.clone(), ..ConnectOptions::default() })
}

/// The access of a coordinator to the registry at `url`: with TLS if it has a certificate. Plaintext beyond this machine
/// requires `insecure`.
///
/// # Errors
/// Any error of [`of_member`], or plaintext without permission.
pub(crate) fn of_registry(
    url: &str,
    coordinator: &settings::Coordinator,
    security: &settings::Security,
) -> anyhow::Result<NatsAccess> {
    let secret = |path: &PathBuf| {
        let text = secret(path, "coordinator.registry_credentials")?;
        let text = String::from_utf8(text).map_err(|_| malformed(path, "it is not UTF-8"))?;
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
                "without TLS, an attacker between this machine and the registry at {host} could decide who leads: set \
                security.certificate, security.key and security.ca, or allow it with --insecure if the network is trusted"
            )));
        }
        tracing::warn!(
            "the registry at {host} is used without TLS: an attacker on the way can decide who leads"
        );
    }
    Ok(NatsAccess { tls, secret })
}

/// Listens on `address`. Addresses beyond this machine require TLS or `insecure`.
///
/// # Errors
/// An address that cannot be used or is not allowed, with advice.
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
                "listening on {address} without TLS would let everyone who can reach this machine send requests, join as a \
                worker and eavesdrop: run `argus certs DIR` and give --certificate, --key, --ca and --tokens, or listen on \
                127.0.0.1, or allow it with --insecure if the network is trusted"
            )));
        }
        tracing::warn!(
            "listening on {address} without TLS: everyone who can reach it can send requests, join and eavesdrop"
        );
    }
    Ok(listener)
}

/// The URL by which processes of this machine reach a listener.
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

/// Reads a file with a PEM block of this kind. The block's content is checked by its user.
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

/// Reads a file that other users of this machine should not be able to read.
fn secret(path: &Path, setting: &str) -> anyhow::Result<Vec<u8>> {
    let bytes = read(path, setting)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(path).map(|meta| meta.permissions().mode()).unwrap_or_default();
        if mode & 0o004 != 0 {
            tracing::warn!("every user of this machine can read {}: run chmod 600 on it", path.display());
        }
    }
    Ok(bytes)
}
