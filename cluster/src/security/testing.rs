//! Certificates for tests.

use std::time::{Duration, SystemTime};

use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};

use super::{CLUSTER_NAME, Security, Tokens};

const DAY: Duration = Duration::from_secs(86_400);

/// An authority of the tests.
pub(crate) struct Authority(CertifiedIssuer<'static, KeyPair>);

impl Authority {
    pub(crate) fn new() -> Self {
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        Self(CertifiedIssuer::self_signed(params, KeyPair::generate().unwrap()).unwrap())
    }

    /// Certificate and key of a process with this name, from one day ago for some days.
    fn certify(&self, name: &str, days: u32) -> [Vec<u8>; 2] {
        let mut params = CertificateParams::new(vec![name.to_owned()]).unwrap();
        params.not_before = (SystemTime::now() - DAY).into();
        params.not_after = (SystemTime::now() - DAY + DAY * days).into();
        let key = KeyPair::generate().unwrap();
        let certificate = params.signed_by(&key, &self.0).unwrap();
        [certificate.pem().into_bytes(), key.serialize_pem().into_bytes()]
    }

    /// A member of its cluster.
    pub(crate) fn member(&self) -> Security {
        self.named(CLUSTER_NAME, 3)
    }

    /// A process with this name, whose certificate ends after some days from one day ago.
    pub(crate) fn named(&self, name: &str, days: u32) -> Security {
        let [certificate, key] = self.certify(name, days);
        let (ca, tokens) = (self.0.pem().into_bytes(), Tokens::default());
        Security { certificate, key, ca, tokens, require_client_certificates: false }
    }
}
