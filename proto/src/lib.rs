//! The wire: argus.v1 messages and services, and their conversions to the vocabulary.
//!
//! [`v1`] is generated; nothing outside this crate needs to read its fields for what has a word in
//! [`argus_scene`]: [`convert`] translates single values and checks them, [`chunks`] takes frames, samples
//! and scenes apart and puts them together again, [`codec`] packs images without loss, [`jpeg`] with
//! some for browsers, [`status`] says
//! which error becomes which gRPC code. Whatever arrives is untrusted: a message that claims more than its
//! receiver expects is refused before memory is set aside for it.

pub mod buffers;
pub mod chunks;
pub mod codec;
pub mod convert;
mod error;
pub mod jpeg;
pub mod network;
pub mod status;
pub mod trace;
pub mod transport;

pub use convert::Description;
pub use error::WireError;
pub use status::Fault;

/// Messages, clients and servers generated from `proto/argus/v1/*.proto`, whose comments document them.
#[allow(missing_docs, clippy::all)]
pub mod v1 {
    tonic::include_proto!("argus.v1");
}

/// Raised when a message changes so that older processes would misread it. Compared when a worker joins
/// and when a client describes the service.
pub const PROTOCOL_VERSION: u32 = 2;

/// The name that certificates of a cluster's processes have, beside those of their hosts: they know each other by it, and
/// clients know by it a worker that they were sent to.
pub const CLUSTER_NAME: &str = "cluster.argus.internal";

/// The largest number of payload bytes in one chunk of a frame, a sample or a scene.
pub const MAX_CHUNK_BYTES: usize = 1 << 20;

/// The encoded `FileDescriptorSet` of the package, for gRPC server reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/argus_descriptors.bin"));

#[cfg(test)]
mod arbitrary;
