//! Who may see what: one client for all pages of `argus browse`, or one for each token where the service has tokens.

use std::sync::{Arc, PoisonError, RwLock};

use argus_client::Client;
use axum::http::{HeaderMap, header};

use super::logins::{COOKIE, Logins};

/// The clients of pages.
pub(super) enum Access {
    /// All pages share a client, and its token.
    Shared(SharedClient),
    /// Each page's user gives a token.
    ByToken(Box<Logins>),
}

/// A client that may be replaced, when its token or its authority is.
#[derive(Clone)]
pub(super) struct SharedClient(Arc<RwLock<Client>>);

impl From<Client> for SharedClient {
    fn from(client: Client) -> Self {
        Self(Arc::new(RwLock::new(client)))
    }
}

impl SharedClient {
    /// The client for a new page.
    pub(super) fn get(&self) -> Client {
        self.0.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Replaces the client. Open pages keep theirs.
    pub(super) fn replace(&self, client: Client) {
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = client;
    }
}

impl Access {
    /// The client of a request; `None`: its user must log in.
    pub(super) async fn client(&self, headers: &HeaderMap) -> Option<Client> {
        match self {
            Self::Shared(client) => Some(client.get()),
            Self::ByToken(logins) => logins.client(cookie(headers)?).await,
        }
    }
}

/// The value of the login's cookie.
fn cookie(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|cookies| cookies.to_str().ok());
    cookies.flat_map(|cookies| cookies.split(';')).find_map(|pair| {
        let (name, value) = pair.trim().split_once('=')?;
        (name == COOKIE).then_some(value)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cookie_is_found_among_others() {
        let of = |lines: &[&str]| {
            let mut headers = HeaderMap::new();
            for line in lines {
                headers.append(header::COOKIE, line.parse().unwrap());
            }
            cookie(&headers).map(str::to_owned)
        };
        assert_eq!(of(&["a=1; argus_login=77; b=2"]).as_deref(), Some("77"));
        assert_eq!(of(&["a=1", "argus_login=78"]).as_deref(), Some("78"));
        for without in [&[][..], &["argus_login"], &["xargus_login=1"], &["a=argus_login=1"]] {
            assert_eq!(of(without), None, "{without:?}");
        }
    }
}
