//! How a client is known to a service, and the service to it.

use std::fmt;
use std::time::Duration;

use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::transport::{Certificate, ClientTlsConfig, Identity};
use tonic::{Request, Status};

/// What `https://` takes. Certificates and keys are PEM.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Credentials {
    /// The authority that signed the service's certificate.
    pub ca: Option<Vec<u8>>,
    /// By which the service knows this client.
    pub token: Option<Token>,
    /// A certificate of this client's own and its key, for services that want one.
    pub identity: Option<(Vec<u8>, Key)>,
}

/// A private key; printing it shows nothing.
#[derive(Clone, PartialEq, Eq)]
pub struct Key(pub Vec<u8>);

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key")
    }
}

/// A secret that a client shows with every request; printing it shows nothing.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(MetadataValue<Ascii>);

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// Of the text of a file that holds it and nothing else.
    ///
    /// # Errors
    /// What is wrong with it, without the text.
    pub fn parse(text: &str) -> Result<Self, &'static str> {
        let token = text.trim();
        if token.is_empty() || token.contains(char::is_whitespace) {
            return Err("one word is wanted, the token");
        }
        let mut header = MetadataValue::try_from(format!("Bearer {token}"))
            .map_err(|_| "it has characters that no token has")?;
        // Neither logged nor kept in the tables by which headers are compressed.
        header.set_sensitive(true);
        Ok(Self(header))
    }
}

impl Credentials {
    /// How a connection is made, with so much time for the handshake.
    pub(crate) fn tls(&self, timeout: Duration) -> ClientTlsConfig {
        let mut tls = ClientTlsConfig::new()
            .timeout(timeout)
            .ca_certificates(self.ca.iter().map(Certificate::from_pem));
        if let Some((certificate, key)) = &self.identity {
            tls = tls.identity(Identity::from_pem(certificate, &key.0));
        }
        tls
    }
}

/// Shows the token with each request, if there is one.
#[derive(Debug, Clone)]
pub(crate) struct Bearer(pub(crate) Option<Token>);

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(Token(header)) = &self.0 {
            request.metadata_mut().insert("authorization", header.clone());
        }
        Ok(request)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_one_word_and_never_printed() {
        let token = Token::parse(" secret-word\n").unwrap();
        let credentials = Credentials { token: Some(token), ..Credentials::default() };
        assert!(!format!("{credentials:?}").contains("secret"));
        for wrong in ["", " \n", "two words", "bell\u{7}"] {
            assert!(Token::parse(wrong).is_err(), "{wrong:?}");
        }
    }
}
