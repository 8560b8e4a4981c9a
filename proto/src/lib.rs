//! The wire: argus.v1 messages and services, and their conversions to the vocabulary.
//!
//! [`v1`] is generated. Code outside this crate rarely needs its fields, since [`argus_scene`] has the vocabulary.
//! [`convert`] translates and checks single values, [`chunks`] splits and reassembles frames, samples and scenes,
//! [`codec`] packs images losslessly, [`jpeg`] encodes them with loss for browsers, [`relief`] their depth, and [`status`] maps errors to
//! gRPC codes. Arriving data is untrusted: a message that claims more than its receiver expects is refused before
//! memory is allocated.

pub mod buffers;
pub mod chunks;
mod cluster_status;
pub mod codec;
pub mod convert;
mod error;
pub mod jpeg;
pub mod network;
pub mod relief;
mod scene_name;
pub mod status;
pub mod trace;
pub mod transport;

pub use convert::Description;
pub use error::WireError;
pub use scene_name::{MAX_SCENE_NAME, SCENE_METADATA, check_scene_name, scene_name_like};
pub use status::Fault;

/// Messages, clients and servers generated from `proto/argus/v1/*.proto`, whose comments document them.
#[allow(missing_docs, clippy::all)]
pub mod v1 {
    tonic::include_proto!("argus.v1");
}

/// Raised when older processes would misread a changed message. Compared when a worker joins and when a client
/// describes the service.
pub const PROTOCOL_VERSION: u32 = 3;

/// The name in the certificates of a cluster's processes, beside their host names. Processes verify each other by it,
/// and clients verify workers by it when they are redirected.
pub const CLUSTER_NAME: &str = "cluster.argus.internal";

/// Most payload bytes in one chunk of a frame, a sample or a scene.
pub const MAX_CHUNK_BYTES: usize = 1 << 20;

/// The encoded `FileDescriptorSet` of the package, for gRPC server reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/argus_descriptors.bin"));

#[cfg(test)]
mod tests;
