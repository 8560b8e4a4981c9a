//! A registry in NATS JetStream's key-value store.
//!
//! The lease is one key in a bucket whose entries expire after the lease's duration. It is acquired by *create*,
//! which the server refuses while the key exists, and renewed by *update* of the last revision. Revisions ascend over
//! the bucket's whole life, so the term is the time when the bucket was made plus the revision of the acquisition.
//! Reads may be answered by a server that lags, so nothing is decided by them. An expired entry leaves no marker, so
//! waiting coordinators poll. Servers from 2.9 on are supported, since lifetimes of single keys are not needed.

use std::fmt;
use std::future::Future;
use std::path::PathBuf;
use std::time::Duration;

use async_nats::jetstream;
use async_nats::jetstream::kv::{CreateErrorKind, Operation, Store, UpdateErrorKind};
use async_nats::jetstream::stream::{Config, DiscardPolicy, StorageType};
use bytes::Bytes;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};
use tracing::debug;

use super::{HeldLease, Registry, RegistryError};
use crate::net::root_cause;

const LEASES: &str = "argus-lease";
const MEMBERS: &str = "argus-members";
const KEY: &str = "leader";
const WORKERS: &str = "workers";

/// Requests to the server time out after this part of a lease.
const PATIENCE: u32 = 3;

/// Workers are recorded for this many leases, since they look for the new leader that long.
const REMEMBERED: u32 = 10;

/// Access to a NATS server. The default is plaintext without authentication.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NatsAccess {
    /// TLS; `None`: plaintext.
    pub tls: Option<NatsTls>,
    /// Credentials; `None`: no authentication.
    pub secret: Option<NatsSecret>,
}

/// Paths of PEM files. They are read with each connection, so that certificates may be renewed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NatsTls {
    /// The only trusted authority of the server's certificate.
    pub ca: PathBuf,
    /// The client certificate of this process.
    pub certificate: PathBuf,
    /// The private key of the client certificate.
    pub key: PathBuf,
}

/// Credentials for a NATS server, which are never printed.
#[derive(Clone, PartialEq, Eq)]
pub enum NatsSecret {
    /// A token.
    Token(String),
    /// User and password.
    User(String, String),
}

impl fmt::Debug for NatsSecret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("NatsSecret")
    }
}

impl NatsSecret {
    /// Parses the text of a file: a token, or a user and a password separated by a space.
    ///
    /// # Errors
    /// What is wrong, without the text.
    pub fn parse(text: &str) -> Result<Self, &'static str> {
        match text.split_whitespace().collect::<Vec<_>>()[..] {
            [token] => Ok(Self::Token(token.to_owned())),
            [user, password] => Ok(Self::User(user.to_owned(), password.to_owned())),
            _ => Err("must be a token, or a user and a password separated by a space"),
        }
    }
}

/// The host of a NATS server's address.
///
/// # Errors
/// Why it is invalid, without the address, which may contain a password.
pub fn nats_host(url: &str) -> Result<String, &'static str> {
    let none = "is not an address of a NATS server";
    let address: async_nats::ServerAddr = url.parse().map_err(|_| none)?;
    if address.host().is_empty() {
        return Err(none);
    }
    match address.username().is_some() || address.password().is_some() {
        true => Err(
            "must have no user and no password: put them into the file of coordinator.registry_credentials",
        ),
        false => Ok(address.host().to_owned()),
    }
}

/// An address for messages, without the credentials before its host.
fn shown(url: &str) -> String {
    let (scheme, rest) = url.split_once("://").map_or(("", url), |(scheme, rest)| (scheme, rest));
    let Some((_, host)) = rest.rsplit_once('@') else { return url.to_owned() };
    if scheme.is_empty() { host.to_owned() } else { format!("{scheme}://{host}") }
}

/// A registry in a NATS server or cluster.
#[derive(Debug)]
pub struct NatsRegistry {
    url: String,
    lease: Duration,
    /// Distinguishes this process from others at the same address.
    nonce: u64,
    /// The base of terms: the time when the bucket was made, milliseconds since 1970. So a new bucket, or one after a
    /// single coordinator's registry, starts with a higher term.
    since: u64,
    leases: Store,
    members: Store,
}

impl NatsRegistry {
    /// Connects, and makes missing buckets. An existing bucket's lease duration is used.
    ///
    /// # Errors
    /// [`RegistryError`] if no server answers at `url`, such as `nats://127.0.0.1:4222`, or if JetStream is off.
    pub async fn connect(url: &str, lease: Duration) -> Result<Self, RegistryError> {
        Self::connect_as(url, lease, NatsAccess::default()).await
    }

    /// Connects with TLS or credentials, and makes missing buckets.
    ///
    /// # Errors
    /// [`RegistryError`] if no server answers, if JetStream is off, if one side does not trust the other, or if
    /// certificates cannot be read.
    pub async fn connect_as(url: &str, lease: Duration, access: NatsAccess) -> Result<Self, RegistryError> {
        let failed = |reason: String| RegistryError { url: shown(url), reason };
        let mut options =
            async_nats::ConnectOptions::new().connection_timeout(lease).request_timeout(Some(lease));
        if let Some(NatsTls { ca, certificate, key }) = access.tls {
            options =
                options.require_tls(true).add_root_certificates(ca).add_client_certificate(certificate, key);
        }
        options = match access.secret {
            Some(NatsSecret::Token(token)) => options.token(token),
            Some(NatsSecret::User(user, password)) => options.user_and_password(user, password),
            None => options,
        };
        let client = options.connect(url).await.map_err(|error| failed(root_cause(&error)))?;
        let context = jetstream::new(client);
        let bucket = async |name: &str, max_age: Duration, storage| {
            if let Ok(store) = context.get_key_value(name).await {
                return Ok(store);
            }
            // A bucket is a stream of this form. The library's function queries the account first, whose answer from
            // servers before 2.10 it does not understand.
            let stream = Config {
                name: format!("KV_{name}"),
                subjects: vec![format!("$KV.{name}.>")],
                max_messages_per_subject: 1,
                max_bytes: -1,
                max_messages: -1,
                max_consumers: -1,
                max_message_size: -1,
                max_age,
                duplicate_window: max_age,
                discard: DiscardPolicy::New,
                storage,
                num_replicas: 1,
                allow_rollup: true,
                deny_delete: true,
                allow_direct: true,
                ..Config::default()
            };
            let refused = |reason: &dyn std::fmt::Display| {
                let hint = "start it with `nats-server -js`";
                failed(format!("cannot make the bucket {name} ({reason}); if JetStream is off, {hint}"))
            };
            context.create_stream(stream).await.map_err(|error| refused(&error))?;
            context.get_key_value(name).await.map_err(|error| refused(&error))
        };
        // In a file, so that terms ascend across restarts of the server.
        let leases = bucket(LEASES, lease, StorageType::File).await?;
        let members = bucket(MEMBERS, lease * REMEMBERED, StorageType::Memory).await?;
        let status = leases.status().await.map_err(|error| failed(error.to_string()))?;
        let since = u64::try_from(status.info.created.unix_timestamp_nanos() / 1_000_000).unwrap_or(0);
        let nonce = SmallRng::from_os_rng().random();
        Ok(Self { url: shown(url), lease: status.max_age(), nonce, since, leases, members })
    }

    fn failed(&self, reason: &dyn std::fmt::Display) -> RegistryError {
        RegistryError { url: self.url.clone(), reason: reason.to_string() }
    }

    /// The lease's value while this process leads.
    fn value(&self, address: &str) -> Bytes {
        Bytes::from(format!("{address}\n{:016x}", self.nonce))
    }

    /// Waits for an answer with a timeout, since late answers are useless.
    async fn timely<T>(&self, answer: impl Future<Output = T>) -> Result<T, RegistryError> {
        let limit = self.lease / PATIENCE;
        let silent = |_| self.failed(&format!("no answer within {} ms", limit.as_millis()));
        tokio::time::timeout(limit, answer).await.map_err(silent)
    }
}

#[tonic::async_trait]
impl Registry for NatsRegistry {
    fn lease(&self) -> Option<Duration> {
        Some(self.lease)
    }

    async fn acquire(&self, address: &str) -> Result<Option<HeldLease>, RegistryError> {
        match self.timely(self.leases.create(KEY, self.value(address))).await? {
            Ok(revision) => Ok(Some(HeldLease { term: self.since + revision, revision })),
            Err(error) if error.kind() == CreateErrorKind::AlreadyExists => Ok(None),
            Err(error) => Err(self.failed(&error)),
        }
    }

    async fn renew(&self, held: HeldLease, address: &str) -> Result<Option<HeldLease>, RegistryError> {
        let value = self.value(address);
        match self.timely(self.leases.update(KEY, value.clone(), held.revision)).await? {
            Ok(revision) => return Ok(Some(HeldLease { revision, ..held })),
            Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => {}
            Err(error) => return Err(self.failed(&error)),
        }
        // The answer to an earlier renewal may have been lost, so the value may be this process's own.
        let there = self.timely(self.leases.entry(KEY)).await?.map_err(|error| self.failed(&error))?;
        let Some(own) = there.filter(|e| e.operation == Operation::Put && e.value == value) else {
            return Ok(None);
        };
        match self.timely(self.leases.update(KEY, value, own.revision)).await? {
            Ok(revision) => Ok(Some(HeldLease { revision, ..held })),
            Err(error) if error.kind() == UpdateErrorKind::WrongLastRevision => Ok(None),
            Err(error) => Err(self.failed(&error)),
        }
    }

    async fn release(&self, held: HeldLease) {
        let released = self.timely(self.leases.delete_expect_revision(KEY, Some(held.revision))).await;
        if !matches!(released, Ok(Ok(()))) {
            debug!("the lease was not released; it will lapse");
        }
    }

    async fn leader(&self) -> Option<String> {
        let value = self.timely(self.leases.get(KEY)).await.ok()?.ok()??;
        let text = String::from_utf8(value.into()).ok()?;
        text.lines().next().filter(|address| !address.is_empty()).map(str::to_owned)
    }

    async fn note_workers(&self, names: &[String]) {
        let Ok(text) = serde_json::to_vec(names) else { return };
        if !matches!(self.timely(self.members.put(WORKERS, text.into())).await, Ok(Ok(_))) {
            debug!("the workers were not recorded");
        }
    }

    async fn noted_workers(&self) -> Vec<String> {
        let noted = self.timely(self.members.get(WORKERS)).await;
        let Ok(Ok(Some(text))) = noted else { return Vec::new() };
        serde_json::from_slice(&text).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credentials_are_read_from_a_file_and_never_printed() {
        let token = NatsSecret::parse("s3cret\n").unwrap();
        let user = NatsSecret::parse("argus s3cret").unwrap();
        assert_eq!(token, NatsSecret::Token("s3cret".to_owned()));
        assert_eq!(user, NatsSecret::User("argus".to_owned(), "s3cret".to_owned()));
        assert!(!format!("{token:?} {user:?}").contains("s3cret"));
        assert!(NatsSecret::parse(" ").is_err() && NatsSecret::parse("a b c").is_err());
        assert_eq!(shown("nats://argus:s3cr@t@host:4222"), "nats://host:4222");
        assert_eq!(shown("s3cret@host"), "host");
        assert_eq!(shown("nats://host:4222"), "nats://host:4222");
        assert_eq!(nats_host("tls://host:4222").as_deref(), Ok("host"));
        for wrong in ["nats://argus:s3cret@host", "nats://s3cret@host", "nats://"] {
            assert!(nats_host(wrong).is_err_and(|reason| !reason.contains("s3cret")), "{wrong}");
        }
    }
}
