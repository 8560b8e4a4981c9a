//! Logins by token, to the page of a service that has tokens.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::sync::Arc;

use argus_client::{Client, ClientError, ConnectOptions, Credentials, Key, Token};
use argus_cluster::security::ReloadableSecurity;
use rand::TryRngCore as _;
use rand::rngs::OsRng;
use tokio::sync::{Mutex, Semaphore};

/// Connections to the service, shared by all pages.
pub(super) const CONNECTIONS: usize = 2;

/// Most logins that are remembered. Another one ends the oldest.
const MAX_LOGINS: usize = 64;

/// Most logins at the same time; each asks the service. Further ones wait.
const AT_ONCE: usize = 4;

/// Name of the cookie that tells logins apart.
pub(super) const COOKIE: &str = "argus_login";

/// Logins by token. A token stays with its client in this process; a browser gets a random number in its place.
pub(super) struct Logins {
    url: String,
    security: Arc<ReloadableSecurity>,
    turns: Semaphore,
    /// The oldest first.
    open: Mutex<VecDeque<Login>>,
}

/// A browser that is logged in.
struct Login {
    /// The value of its cookie.
    name: String,
    token: Token,
    client: Client,
    /// The certificates that the client trusts.
    generation: u64,
}

impl Logins {
    /// Logins to the service at `url` of this process, by its own certificates. The page is served by TLS.
    pub(super) fn new(url: String, security: Arc<ReloadableSecurity>) -> Self {
        Self { url, security, turns: Semaphore::new(AT_ONCE), open: Mutex::default() }
    }

    /// The client of a login; `None` if it is unknown, or if the service no longer knows its token.
    pub(super) async fn client(&self, name: &str) -> Option<Client> {
        let newest = self.security.current().generation();
        let (token, client, generation) = {
            let open = self.open.lock().await;
            let login = open.iter().find(|login| login.name == name)?;
            (login.token.clone(), login.client.clone(), login.generation)
        };
        if generation == newest {
            return Some(client);
        }
        // The authority may be another one now, and the token may be gone.
        let (client, generation) = match self.connect(token).await {
            Ok(connected) => connected,
            Err(ClientError::Refused { .. }) => {
                self.open.lock().await.retain(|login| login.name != name);
                return None;
            }
            // The service may answer later.
            Err(_) => return Some(client),
        };
        if let Some(login) = self.open.lock().await.iter_mut().find(|login| login.name == name) {
            (login.client, login.generation) = (client.clone(), generation);
        }
        Some(client)
    }

    /// Connects with a token. Returns the client, and the generation of the certificates that it trusts.
    async fn connect(&self, token: Token) -> Result<(Client, u64), ClientError> {
        let security = self.security.current();
        let identity = || (security.certificate.clone(), Key(security.key.clone()));
        let identity = security.require_client_certificates.then(identity);
        let credentials = Credentials { ca: Some(security.ca.clone()), token: Some(token), identity };
        let options = ConnectOptions { connections: CONNECTIONS, credentials, ..ConnectOptions::default() };
        let turn = self.turns.acquire().await;
        let client = Client::connect_with(&self.url, &options).await?;
        drop(turn);
        Ok((client, security.generation()))
    }

    /// Logs in. Returns the value of the header `Set-Cookie`.
    ///
    /// # Errors
    /// The text is no token, the service refuses it, or it does not answer.
    pub(super) async fn enter(&self, token: &str) -> Result<String, ClientError> {
        let token =
            Token::parse(token).map_err(|reason| ClientError::Refused { reason: reason.to_owned() })?;
        let (client, generation) = self.connect(token.clone()).await?;
        let mut random = [0_u8; 16];
        OsRng
            .try_fill_bytes(&mut random)
            .map_err(|error| ClientError::Refused { reason: error.to_string() })?;
        let name = random.iter().fold(String::new(), |mut name, byte| {
            // Writing to a string cannot fail.
            let _ = write!(name, "{byte:02x}");
            name
        });
        let mut open = self.open.lock().await;
        if open.len() >= MAX_LOGINS {
            open.pop_front();
        }
        open.push_back(Login { name: name.clone(), token, client, generation });
        Ok(format!("{COOKIE}={name}; Path=/; HttpOnly; SameSite=Strict; Secure"))
    }
}
