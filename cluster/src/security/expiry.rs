//! When certificates end.

use std::sync::Arc;
use std::time::Duration;

use rustls_pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::client::WebPkiServerVerifier;
use tokio_rustls::rustls::client::danger::ServerCertVerifier;
use tokio_rustls::rustls::{CertificateError, Error};

use super::CLUSTER_NAME;

/// A time after the end of every certificate: the year 9999 is the last that a certificate can name.
const AFTER_ALL: Duration = Duration::from_secs(300_000_000_000);

/// The time when a certificate ends, in seconds since 1970.
///
/// A verification at a later time fails, and its error has the time. The period is checked before anything else, so the
/// certificate may be of any authority and for any use.
///
/// # Errors
/// Why the certificate cannot be read.
pub(super) fn not_after(
    verifier: &Arc<WebPkiServerVerifier>,
    certificate: &CertificateDer<'_>,
) -> Result<u64, Error> {
    let name = ServerName::try_from(CLUSTER_NAME).map_err(|error| Error::General(error.to_string()))?;
    let at = UnixTime::since_unix_epoch(AFTER_ALL);
    match verifier.verify_server_cert(certificate, &[], &name, &[], at) {
        Err(Error::InvalidCertificate(CertificateError::ExpiredContext { not_after, .. })) => {
            Ok(not_after.as_secs())
        }
        Err(error) => Err(error),
        Ok(_) => Err(Error::General("the certificate has no end".to_owned())),
    }
}
