//! The wire: argus.v1 messages and services, and their conversions to the vocabulary.

/// Messages, clients and servers generated from `proto/argus/v1/*.proto`, whose comments document them.
#[allow(missing_docs, clippy::all)]
pub mod v1 {
    tonic::include_proto!("argus.v1");
}

/// Raised when a message changes so that older processes would misread it. Compared when a worker joins
/// and when a client describes the service.
pub const PROTOCOL_VERSION: u32 = 1;

/// The largest number of payload bytes in one chunk of a frame, a sample or a scene.
pub const MAX_CHUNK_BYTES: usize = 1 << 20;

/// The encoded `FileDescriptorSet` of the package, for gRPC server reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/argus_descriptors.bin"));
