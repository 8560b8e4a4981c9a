//! Receives frames in chunks.

use argus_proto::WireError;
use argus_proto::chunks::{FrameAssembler, FrameMeta};
use argus_proto::v1::{self, frame_chunk::Body};
use argus_scene::{Frame, Limits};
use tokio::time::Instant;

/// Assembles a frame and adds its reception time to its age. Reception takes long on a slow line, or if a worker failed
/// within the frame and another one rendered the rest.
#[derive(Debug)]
pub(crate) struct Arrival {
    assembler: FrameAssembler,
    /// When the header of the current frame arrived.
    since: Option<Instant>,
}

impl Arrival {
    pub(crate) fn new(limits: Limits) -> Self {
        Self { assembler: FrameAssembler::new(limits), since: None }
    }

    /// Adds a chunk. Returns the frame once it is whole.
    ///
    /// # Errors
    /// Any error of [`FrameAssembler::push`].
    pub(crate) fn push(&mut self, chunk: v1::FrameChunk) -> Result<Option<(Frame, FrameMeta)>, WireError> {
        if matches!(chunk.body, Some(Body::Header(_))) {
            self.since = Some(Instant::now());
        }
        let Some((frame, mut meta)) = self.assembler.push(chunk)? else { return Ok(None) };
        let reception = self.since.take().map_or(0.0, |since| since.elapsed().as_secs_f64() * 1e3);
        meta.age_ms += reception;
        Ok(Some((frame, meta)))
    }

    /// Drops the incomplete frame: it is sent again from the start.
    pub(crate) fn begin_again(&mut self) {
        self.assembler.abandon();
    }

    /// Checks at the end of the stream that no frame is incomplete.
    ///
    /// # Errors
    /// Any error of [`FrameAssembler::end`].
    pub(crate) fn end(&self) -> Result<(), WireError> {
        self.assembler.end()
    }
}
