//! Frames as they arrive from a server, in chunks.

use argus_proto::WireError;
use argus_proto::chunks::{FrameAssembler, FrameMeta};
use argus_proto::v1::{self, frame_chunk::Body};
use argus_scene::{Frame, Limits};
use tokio::time::Instant;

/// Puts frames together, and adds to the age that the header tells what passes until the frame is whole: a slow line, or a
/// worker that failed within the frame and another one that made the rest of it.
#[derive(Debug)]
pub(crate) struct Arrival {
    assembler: FrameAssembler,
    /// When the header of the frame came that is arriving.
    since: Option<Instant>,
}

impl Arrival {
    pub(crate) fn new(limits: Limits) -> Self {
        Self { assembler: FrameAssembler::new(limits), since: None }
    }

    /// Takes the next chunk; the frame once it is whole.
    ///
    /// # Errors
    /// As [`FrameAssembler::push`].
    pub(crate) fn push(&mut self, chunk: v1::FrameChunk) -> Result<Option<(Frame, FrameMeta)>, WireError> {
        if matches!(chunk.body, Some(Body::Header(_))) {
            self.since = Some(Instant::now());
        }
        let Some((frame, mut meta)) = self.assembler.push(chunk)? else { return Ok(None) };
        let reception = self.since.take().map_or(0.0, |since| since.elapsed().as_secs_f64() * 1e3);
        meta.age_ms += reception;
        Ok(Some((frame, meta)))
    }

    /// Forgets what has arrived of a frame: it is sent anew.
    pub(crate) fn begin_again(&mut self) {
        self.assembler.abandon();
    }

    /// # Errors
    /// As [`FrameAssembler::end`].
    pub(crate) fn end(&self) -> Result<(), WireError> {
        self.assembler.end()
    }
}
