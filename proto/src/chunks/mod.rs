//! Frames, samples, traced pixels and scenes in pieces of at most [`MAX_CHUNK_BYTES`].
//!
//! Each begins with a header that states how many bytes follow. Bytes carry their offset, so that repeated or skipped
//! chunks are detected. A header's claims are compared with what the receiver expects before memory is allocated.

mod bundle;
mod frame;
mod pixels;
mod sample;

pub use bundle::{SceneFiles, SceneFilesAssembler, SceneFilesSource, bundle_chunks, procedural_chunk};
pub use frame::{FrameAssembler, FrameMeta, frame_chunks};
pub use pixels::{
    MAX_TRACE_PIXELS, PixelAssembler, TracedFrame, joined, pixel_chunks, trace_job, trace_requests,
};
pub use sample::{Received, SampleAssembler, sample_chunks, sample_hash, unchanged_chunk};

use bytes::{Bytes, BytesMut};

use crate::{MAX_CHUNK_BYTES, WireError};

/// Cuts `bytes` into chunks without copying, each with its offset; `start` is the offset of the first.
fn pieces(start: u64, bytes: &Bytes) -> impl Iterator<Item = (u64, Bytes)> {
    (0..bytes.len()).step_by(MAX_CHUNK_BYTES).map(move |begin| {
        let end = bytes.len().min(begin + MAX_CHUNK_BYTES);
        (start + begin as u64, bytes.slice(begin..end))
    })
}

/// Collects the bytes that follow a header.
#[derive(Debug)]
struct Gather {
    what: &'static str,
    expected: u64,
    received: BytesMut,
    /// The only chunk, kept without copying: most views of a cluster fit in one.
    whole: Option<Bytes>,
}

impl Gather {
    /// Collects `expected` bytes, which the caller has checked.
    fn new(what: &'static str, expected: u64) -> Self {
        Self { what, expected, received: BytesMut::new(), whole: None }
    }

    fn got(&self) -> u64 {
        self.whole.as_ref().map_or(self.received.len(), Bytes::len) as u64
    }

    /// Adds the next chunk, which must begin where the last one ended.
    fn push(&mut self, offset: u64, bytes: Bytes) -> Result<(), WireError> {
        let out_of_order = |reason| Err(WireError::out_of_order(self.what, reason));
        if offset != self.got() {
            return out_of_order(format!("a chunk at byte {offset} where byte {} was due", self.got()));
        }
        if bytes.is_empty() {
            return out_of_order("an empty chunk".to_owned());
        }
        if bytes.len() > MAX_CHUNK_BYTES {
            return out_of_order(format!("a chunk of {} bytes", bytes.len()));
        }
        if bytes.len() as u64 > self.expected - self.got() {
            return out_of_order(format!("more than the {} bytes that were announced", self.expected));
        }
        if bytes.len() as u64 == self.expected {
            self.whole = Some(bytes);
        } else {
            // The caller has checked how many are expected.
            let all = usize::try_from(self.expected).unwrap_or_default();
            self.received.reserve(all.saturating_sub(self.received.len()));
            self.received.extend_from_slice(&bytes);
        }
        Ok(())
    }

    fn is_complete(&self) -> bool {
        self.got() == self.expected
    }

    /// All bytes; to be called once complete.
    fn finish(self) -> Bytes {
        self.whole.unwrap_or_else(|| self.received.freeze())
    }

    /// The error of a stream that ends now.
    fn truncated(&self) -> WireError {
        WireError::Truncated { what: self.what, got: self.got(), expected: self.expected }
    }
}

#[cfg(test)]
mod tests;
