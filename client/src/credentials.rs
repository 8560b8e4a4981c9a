//! Credentials of a client, and its trust in a server.

use std::fmt;
use std::time::Duration;

use argus_proto::{SCENE_METADATA, check_scene_name};
use argus_scene::InvalidField;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::transport::{Certificate, ClientTlsConfig, Identity};
use tonic::{Request, Status};

/// Credentials for `https://`. Certificates and keys are PEM.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Credentials {
    /// The authority that signed the server's certificate.
    pub ca: Option<Vec<u8>>,
    /// The token that identifies this client.
    pub token: Option<Token>,
    /// A client certificate and its key, for servers that require one.
    pub identity: Option<(Vec<u8>, Key)>,
}

/// A private key. Its debug output hides it.
#[derive(Clone, PartialEq, Eq)]
pub struct Key(pub Vec<u8>);

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key")
    }
}

/// A secret that is sent with every request. Its debug output hides it.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(MetadataValue<Ascii>);

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

impl Token {
    /// Parses the text of a token file, which holds only the token.
    ///
    /// # Errors
    /// Why the text is not a token; the text is not repeated.
    pub fn parse(text: &str) -> Result<Self, &'static str> {
        let token = text.trim();
        if token.is_empty() || token.contains(char::is_whitespace) {
            return Err("the file must hold one word, the token");
        }
        let mut header = MetadataValue::try_from(format!("Bearer {token}"))
            .map_err(|_| "it has characters that a token cannot have")?;
        // Keeps it out of logs and header compression tables.
        header.set_sensitive(true);
        Ok(Self(header))
    }
}

impl Credentials {
    /// The TLS configuration, with a time limit for the handshake.
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

/// Adds the client's token and the name of its scene, if it has any, to each request.
#[derive(Debug, Clone)]
pub(crate) struct RequestMetadata {
    token: Option<Token>,
    scene: Option<MetadataValue<Ascii>>,
}

impl RequestMetadata {
    /// The metadata of a client with this token, of this scene.
    ///
    /// # Errors
    /// The field `scene`, if it is no name of a scene.
    pub(crate) fn new(token: Option<Token>, scene: Option<&str>) -> Result<Self, InvalidField> {
        let value = |name: &str| {
            check_scene_name(name)?;
            MetadataValue::try_from(name).map_err(|error| InvalidField::new("scene", error.to_string()))
        };
        Ok(Self { token, scene: scene.map(value).transpose()? })
    }
}

impl Interceptor for RequestMetadata {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(Token(header)) = &self.token {
            request.metadata_mut().insert("authorization", header.clone());
        }
        if let Some(scene) = &self.scene {
            request.metadata_mut().insert(SCENE_METADATA, scene.clone());
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
