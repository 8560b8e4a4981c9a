//! The guard before all services of a listener: authenticates and authorises each call.
//!
//! The required rank follows from the path alone, and is checked before the body is read. An unknown path requires a
//! member.

use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use argus_proto::Fault;
use futures::future::{Either, Ready, ready};
use rustls_pki_types::{CertificateDer, ServerName};
use tonic::body::Body;
use tonic::codegen::http;
use tonic::{Code, Status};
use tower::{Layer, Service};
use tracing::warn;
use webpki::EndEntityCert;

use super::handshake::PeerInfo;
use super::tokens::Rank;
use super::{CLUSTER_NAME, ReloadableSecurity};
use crate::incoming::ConnectionInfo;
use crate::rate_limited_log::RateLimitedLog;

/// Hint when a refused connection may find a slot.
const COME_AGAIN: Duration = Duration::from_secs(1);

/// The caller, in the extensions of every admitted request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Caller {
    /// The name by which a client's limits are counted: that of its token, or else its address.
    pub(crate) name: Arc<str>,
}

impl Caller {
    /// The caller of an admitted request.
    pub(crate) fn of<T>(request: &tonic::Request<T>) -> Self {
        let unknown = || Self { name: "unknown".into() };
        request.extensions().get::<Self>().cloned().unwrap_or_else(unknown)
    }
}

/// The kind of process whose services are guarded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Guarded {
    Coordinator,
    Worker,
}

/// The rank that a path requires.
fn needed(guarded: Guarded, path: &str) -> Rank {
    match (guarded, path) {
        (_, path) if is_health(path) => Rank::Anybody,
        // A redirected client has a ticket, which the service checks.
        (Guarded::Worker, "/argus.v1.Views/Redeem") => Rank::Anybody,
        (_, "/metrics") => Rank::Admin,
        (Guarded::Coordinator, "/argus.v1.Views/SetTransforms") => Rank::Author,
        (Guarded::Coordinator, path) if path.starts_with("/argus.v1.Views/") => Rank::View,
        (Guarded::Coordinator, path) if path.starts_with("/grpc.reflection.") => Rank::View,
        (Guarded::Coordinator, "/argus.v1.Cluster/Status") => Rank::Admin,
        _ => Rank::Member,
    }
}

/// Whether a path belongs to health probes.
fn is_health(path: &str) -> bool {
    path.starts_with("/grpc.health.v1.Health/") || matches!(path, "/livez" | "/readyz")
}

/// The answer to a client in a slot that is reserved for members.
fn no_slot() -> Status {
    let what = "the connection limit is reached; retry later, or raise `connections` in the configuration"
        .to_owned();
    Fault::Overloaded { what, retry_after: COME_AGAIN }.into()
}

/// The layer that guards services.
#[derive(Debug, Clone)]
pub(crate) struct Guard {
    guarded: Guarded,
    security: Option<Arc<ReloadableSecurity>>,
}

impl Guard {
    pub(crate) fn new(guarded: Guarded, security: Option<Arc<ReloadableSecurity>>) -> Self {
        Self { guarded, security }
    }

    /// Authenticates and authorises a call.
    ///
    /// # Errors
    /// Why the call is refused.
    fn admit(&self, path: &str, headers: &http::HeaderMap, peer: &Peer<'_>) -> Result<Caller, Status> {
        let Some(security) = &self.security else { return Ok(Caller { name: peer.address.clone() }) };
        let needs = needed(self.guarded, path);
        if peer.is_member() {
            return Ok(Caller { name: peer.address.clone() });
        }
        if needs == Rank::Member {
            // No token gives the rank of a member.
            return Err(Status::permission_denied(format!(
                "only the cluster's own processes may call this: a certificate of its authority with the name \
                 {CLUSTER_NAME} is required"
            )));
        }
        let token = match headers.get(http::header::AUTHORIZATION) {
            None => None,
            Some(value) => {
                let bearer = value.as_bytes().strip_prefix(b"Bearer ");
                let malformed = || Status::unauthenticated("authorization must be `Bearer TOKEN`");
                let known = security.current().tokens.find(bearer.ok_or_else(malformed)?);
                Some(
                    known
                        .ok_or_else(|| Status::unauthenticated("the token is not one that is known here"))?,
                )
            }
        };
        let (rank, name) = match token {
            Some(known) => known,
            None => (Rank::Anybody, peer.address.clone()),
        };
        if rank >= needs {
            return Ok(Caller { name });
        }
        Err(match rank {
            Rank::Anybody => Status::unauthenticated("a token is required: give one with --token-file"),
            _ => Status::permission_denied(format!(
                "a token of the role {} is required, but that of {name} has the role {}",
                needs.role(),
                rank.role()
            )),
        })
    }
}

/// The other end of a connection.
struct Peer<'a> {
    address: Arc<str>,
    certificate: Option<&'a CertificateDer<'static>>,
}

impl Peer<'_> {
    /// Whether it has a member's certificate. The handshake checked that the authority signed it.
    fn is_member(&self) -> bool {
        let Some(certificate) = self.certificate else { return false };
        let (Ok(certificate), Ok(name)) =
            (EndEntityCert::try_from(certificate), ServerName::try_from(CLUSTER_NAME))
        else {
            return false;
        };
        certificate.verify_is_valid_for_subject_name(&name).is_ok()
    }
}

impl<S> Layer<S> for Guard {
    type Service = Gate<S>;

    fn layer(&self, inner: S) -> Gate<S> {
        Gate { guard: self.clone(), inner }
    }
}

/// A guarded service.
#[derive(Debug, Clone)]
pub(crate) struct Gate<S> {
    guard: Guard,
    inner: S,
}

impl<S, B> Service<http::Request<B>> for Gate<S>
where
    S: Service<http::Request<B>, Response = http::Response<Body>>,
{
    type Response = S::Response;
    type Error = S::Error;
    type Future = Either<Ready<Result<S::Response, S::Error>>, S::Future>;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(cx)
    }

    fn call(&mut self, mut request: http::Request<B>) -> Self::Future {
        let info = request.extensions().get::<PeerInfo>();
        let connection = info.map(|info| &info.connection);
        let address = connection.and_then(|connection| connection.tcp.remote_addr());
        let peer = Peer {
            address: address.map_or_else(|| "unknown".into(), |address| address.ip().to_string().into()),
            certificate: info.and_then(|info| info.certificate.as_deref()),
        };
        let path = request.uri().path();
        let needs = needed(self.guard.guarded, path);
        let admitted = self.guard.admit(path, request.headers(), &peer);
        if let Some(connection) = connection.filter(|_| admitted.is_ok()) {
            // Without certificates, the requested path decides.
            let is_members = match &self.guard.security {
                Some(_) => peer.is_member(),
                None => needs == Rank::Member,
            };
            if is_members {
                connection.set_member();
            }
        }
        let kept = connection.is_some_and(ConnectionInfo::holds_reserved_slot) && !is_health(path);
        let admitted = admitted.and_then(|caller| if kept { Err(no_slot()) } else { Ok(caller) });
        match admitted {
            Ok(caller) => {
                request.extensions_mut().insert(caller);
                Either::Right(self.inner.call(request))
            }
            Err(status) => {
                static REFUSED: RateLimitedLog = RateLimitedLog::new();
                if let Some(left_out) = REFUSED.now() {
                    warn!(peer = %peer.address, path, reason = status.message(), left_out, "refused");
                }
                let code = status.code();
                let mut response = status.into_http();
                // Pages are requested by HTTP, where gRPC's refusals would count as successes.
                if matches!(path, "/metrics" | "/livez" | "/readyz") {
                    *response.status_mut() = match code {
                        Code::Unauthenticated => http::StatusCode::UNAUTHORIZED,
                        _ => http::StatusCode::FORBIDDEN,
                    };
                }
                Either::Left(ready(Ok(response)))
            }
        }
    }
}

#[cfg(test)]
mod tests {

    use super::super::testing::Authority;
    use super::super::{Security, Tokens};
    use super::*;

    const VIEW: &str = "AAAAAAAAAAAAAAAAAAAAAAAAAAAA";
    const ADMIN: &str = "BBBBBBBBBBBBBBBBBBBBBBBBBBBB";

    fn guard(guarded: Guarded) -> Guard {
        guarded_by(guarded, &format!("view shop {VIEW}\nadmin ops {ADMIN}"))
    }

    fn guarded_by(guarded: Guarded, tokens: &str) -> Guard {
        let tokens = Tokens::parse(tokens).unwrap();
        let security = Security { tokens, ..Authority::new().member() };
        Guard::new(guarded, Some(Arc::new(ReloadableSecurity::new(security).unwrap())))
    }

    fn call(guard: &Guard, path: &str, authorization: Option<&str>) -> Result<Arc<str>, Code> {
        let mut headers = http::HeaderMap::new();
        if let Some(value) = authorization {
            headers.insert(http::header::AUTHORIZATION, value.parse().unwrap());
        }
        let peer = Peer { address: "10.0.0.1".into(), certificate: None };
        guard.admit(path, &headers, &peer).map(|caller| caller.name).map_err(|status| status.code())
    }

    #[test]
    fn a_token_allows_what_its_role_may_do() {
        let guard = guard(Guarded::Coordinator);
        let (view, admin) = (format!("Bearer {VIEW}"), format!("Bearer {ADMIN}"));
        let (none, view, admin) = (None, Some(view.as_str()), Some(admin.as_str()));
        let (render, status) = ("/argus.v1.Views/Render", "/argus.v1.Cluster/Status");
        assert_eq!(call(&guard, render, none), Err(Code::Unauthenticated));
        assert_eq!(call(&guard, render, view).as_deref(), Ok("shop"));
        assert_eq!(call(&guard, render, admin).as_deref(), Ok("ops"));
        assert_eq!(call(&guard, status, none), Err(Code::Unauthenticated));
        assert_eq!(call(&guard, status, view), Err(Code::PermissionDenied));
        assert_eq!(call(&guard, status, admin).as_deref(), Ok("ops"));
        for members_only in
            ["/argus.v1.Cluster/Join", "/argus.v1.Scenes/Fetch", "/argus.v1.Samples/Trace", "/x"]
        {
            for token in [none, view, admin] {
                assert_eq!(call(&guard, members_only, token), Err(Code::PermissionDenied), "{members_only}");
            }
        }
    }

    #[test]
    fn a_wrong_token_is_refused_even_if_none_is_required() {
        let guard = guard(Guarded::Coordinator);
        let health = "/grpc.health.v1.Health/Check";
        assert!(call(&guard, health, None).is_ok());
        for wrong in ["Bearer ", "Bearer AAAA", VIEW, "Basic QQ=="] {
            assert_eq!(call(&guard, health, Some(wrong)), Err(Code::Unauthenticated), "{wrong}");
        }
    }

    #[test]
    fn a_worker_serves_only_members_except_for_health_and_tickets() {
        let guard = guard(Guarded::Worker);
        let admin = format!("Bearer {ADMIN}");
        for open in ["/grpc.health.v1.Health/Watch", "/argus.v1.Views/Redeem"] {
            assert!(call(&guard, open, None).is_ok(), "{open}");
        }
        for path in [
            "/argus.v1.Views/Render",
            "/argus.v1.Samples/Subscribe",
            "/grpc.reflection.v1.ServerReflection/X",
        ] {
            assert_eq!(call(&guard, path, Some(&admin)), Err(Code::PermissionDenied), "{path}");
        }
    }

    #[test]
    fn nodes_are_moved_by_authors_and_operators_and_not_by_viewers() {
        const AUTHOR: &str = "CCCCCCCCCCCCCCCCCCCCCCCCCCCC";
        let text = format!("view shop {VIEW}\nauthor robot {AUTHOR}\nadmin ops {ADMIN}");
        let guard = guarded_by(Guarded::Coordinator, &text);
        let by = |token: &str, path| call(&guard, path, Some(&format!("Bearer {token}")));
        let path = "/argus.v1.Views/SetTransforms";
        assert_eq!(by(AUTHOR, path).as_deref(), Ok("robot"));
        assert_eq!(by(ADMIN, path).as_deref(), Ok("ops"));
        assert_eq!(by(VIEW, path), Err(Code::PermissionDenied));
        assert_eq!(call(&guard, path, None), Err(Code::Unauthenticated));
        assert_eq!(by(AUTHOR, "/argus.v1.Views/Render").as_deref(), Ok("robot"));
        assert_eq!(by(AUTHOR, "/argus.v1.Cluster/Status"), Err(Code::PermissionDenied));
        let mut headers = http::HeaderMap::new();
        headers.insert(http::header::AUTHORIZATION, format!("Bearer {VIEW}").parse().unwrap());
        let refused = guard.admit(path, &headers, &Peer { address: "10.0.0.1".into(), certificate: None });
        let said = refused.unwrap_err();
        assert!(said.message().contains("the role author") && said.message().contains("role view"), "{said}");
    }

    #[test]
    fn without_security_callers_are_named_by_their_addresses() {
        let open = Guard::new(Guarded::Coordinator, None);
        assert_eq!(call(&open, "/argus.v1.Cluster/Join", None).as_deref(), Ok("10.0.0.1"));
    }
}
