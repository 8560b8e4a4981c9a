//! Relaying of a frame: which part of it the client has, and what the next chunk adds.
//!
//! A frame's bytes are a function of its provenance. If a worker fails within a frame, another worker's chunks
//! continue it: those that the client has are skipped.

use argus_proto::v1;
use argus_proto::v1::frame_chunk::Body;
use argus_scene::{Prediction, Stage};
use tonic::Status;

/// The part of a frame that a client has.
#[derive(Debug, Clone, Default)]
pub(super) struct Relayed {
    header: Option<v1::FrameHeader>,
    bytes: u64,
    /// Whether the trailer was sent.
    ended: bool,
    /// Milliseconds of rendering frames that were rejected.
    refused_ms: f64,
}

impl Relayed {
    /// The header that was sent to the client.
    pub(super) fn header(&self) -> Option<&v1::FrameHeader> {
        self.header.as_ref()
    }

    /// Adds the cost of a rejected frame. A value that is not finite is ignored.
    pub(super) fn refuse(&mut self, ms: f64) {
        if ms.is_finite() {
            self.refused_ms += ms;
        }
    }

    /// Whether the last chunk completed the frame.
    pub(super) fn is_whole(&self) -> bool {
        self.ended
    }

    /// The part of a chunk to send to the client; `None` if the client has it already. The chunk came `age_ms` after
    /// the request.
    ///
    /// # Errors
    /// The chunk is empty, data precede the header, or the header differs from the one that was sent.
    pub(super) fn pass(
        &mut self,
        chunk: v1::FrameChunk,
        age_ms: f64,
        expected: Option<Prediction>,
    ) -> Result<Option<v1::FrameChunk>, Status> {
        match chunk.body {
            Some(Body::Header(header)) => self.pass_header(header, age_ms, expected),
            Some(Body::Data(_)) if self.header.is_none() => {
                Err(Status::data_loss("the worker sent a frame without its header"))
            }
            // All workers cut a frame at the same offsets.
            Some(Body::Data(data)) if data.offset < self.bytes => Ok(None),
            Some(Body::Data(data)) => {
                self.bytes = data.offset.saturating_add(data.bytes.len() as u64);
                Ok(Some(v1::FrameChunk { body: Some(Body::Data(data)) }))
            }
            Some(Body::Trailer(trailer)) => {
                let due: Option<u64> = self
                    .header
                    .as_ref()
                    .map(|header| header.images.iter().map(|image| image.packed_bytes).sum());
                if due != Some(self.bytes) {
                    return Err(Status::data_loss("the worker ended a frame before its last byte"));
                }
                self.ended = true;
                Ok(Some(v1::FrameChunk { body: Some(Body::Trailer(trailer)) }))
            }
            None => Err(Status::data_loss("the worker sent an empty chunk")),
        }
    }

    fn pass_header(
        &mut self,
        mut header: v1::FrameHeader,
        age_ms: f64,
        expected: Option<Prediction>,
    ) -> Result<Option<v1::FrameChunk>, Status> {
        // A frame that was reprojected from an earlier one cannot be repeated: it is sent anew.
        if self.header.iter().chain([&header]).any(uses_history) {
            (self.header, self.bytes) = (None, 0);
        }
        if let Some(sent) = &self.header {
            let same = sent.provenance == header.provenance && sent.images == header.images;
            let reason = "the worker failed within a frame, and no other worker can repeat it";
            return if same { Ok(None) } else { Err(Status::unavailable(reason)) };
        }
        let relay_ms = (age_ms - header.age_ms).max(0.0);
        header.stages.push(v1::Stage { name: "relay".to_owned(), ms: relay_ms });
        header.age_ms = age_ms;
        if self.refused_ms > 0.0 {
            header.stages.push(v1::Stage { name: Stage::REFUSED.to_owned(), ms: self.refused_ms });
        }
        // Without a prediction the worker may have measured the error.
        header.predicted = expected.map(Into::into).or(header.predicted);
        header.observed = None;
        self.header = Some(header.clone());
        Ok(Some(v1::FrameChunk { body: Some(Body::Header(header)) }))
    }
}

fn uses_history(header: &v1::FrameHeader) -> bool {
    header.provenance.as_ref().is_some_and(|provenance| provenance.history)
}

/// Whether the frame is from triangles, since the one by its plan was not good enough.
pub(super) fn fell_short(header: &v1::FrameHeader) -> bool {
    header.decision.is_some_and(|decision| decision.reason == v1::Reason::FrameFellShort as i32)
}

/// Number of pixels that none of the frame's samples saw.
pub(super) fn uncovered(header: &v1::FrameHeader) -> u64 {
    let pixels = f64::from(header.width) * f64::from(header.height);
    // Traced pixels are no longer unresolved. A share that is not a number counts as 0.
    let guessed = (header.unresolved_fraction * pixels).round() as u64;
    guessed.saturating_add(header.served.map_or(0, |served| served.traced))
}

/// Milliseconds of the stages that render the frame, without transfers.
pub(super) fn rendering_ms(header: &v1::FrameHeader) -> f64 {
    header.stages.iter().filter(|stage| !Stage::is_on_the_way(&stage.name)).map(|stage| stage.ms).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(bytes: u64) -> v1::FrameChunk {
        let image = v1::ImageHeader { packed_bytes: bytes, ..v1::ImageHeader::default() };
        let header = v1::FrameHeader { images: vec![image], age_ms: 3.0, ..v1::FrameHeader::default() };
        v1::FrameChunk { body: Some(Body::Header(header)) }
    }

    fn begun(mut chunk: v1::FrameChunk) -> v1::FrameChunk {
        if let Some(Body::Header(header)) = &mut chunk.body {
            header.provenance = Some(v1::Provenance { history: true, ..v1::Provenance::default() });
        }
        chunk
    }

    fn data(offset: u64, bytes: &'static [u8]) -> v1::FrameChunk {
        v1::FrameChunk { body: Some(Body::Data(v1::FrameData { offset, bytes: bytes.into() })) }
    }

    fn trailer() -> v1::FrameChunk {
        v1::FrameChunk { body: Some(Body::Trailer(v1::FrameTrailer::default())) }
    }

    #[test]
    fn a_frame_that_another_worker_continues_is_sent_once() {
        let mut relayed = Relayed::default();
        let passes =
            |relayed: &mut Relayed, chunk| relayed.pass(chunk, 5.0, None).map(|chunk| chunk.is_some());
        assert!(passes(&mut relayed, header(4)).unwrap());
        assert!(passes(&mut relayed, data(0, b"ab")).unwrap());
        assert!(!relayed.is_whole());
        for (chunk, is_new) in [(header(4), false), (data(0, b"ab"), false), (data(2, b"cd"), true)] {
            assert_eq!(passes(&mut relayed, chunk).unwrap(), is_new);
        }
        assert!(!relayed.is_whole());
        assert!(passes(&mut relayed, trailer()).unwrap());
        assert!(relayed.is_whole());
        assert_eq!(relayed.header().unwrap().stages[0].ms, 2.0, "the relay's own time");
        let other = passes(&mut relayed, header(5)).unwrap_err();
        assert_eq!(other.code(), tonic::Code::Unavailable);
    }

    #[test]
    fn a_reprojected_frame_is_sent_anew() {
        let mut relayed = Relayed::default();
        assert!(relayed.pass(header(2), 5.0, None).unwrap().is_some());
        assert!(relayed.pass(data(0, b"a"), 5.0, None).unwrap().is_some());
        assert!(relayed.pass(begun(header(2)), 5.0, None).unwrap().is_some());
        assert!(relayed.pass(data(0, b"a"), 5.0, None).unwrap().is_some());
        assert!(!relayed.is_whole());
    }

    #[test]
    fn chunks_outside_of_a_frame_are_errors() {
        let mut relayed = Relayed::default();
        assert!(relayed.pass(data(0, b"a"), 5.0, None).is_err(), "before its header");
        assert!(relayed.pass(v1::FrameChunk { body: None }, 5.0, None).is_err());
        assert!(relayed.pass(trailer(), 5.0, None).is_err(), "before its header");
        assert!(!relayed.is_whole());
        assert!(relayed.pass(header(2), 5.0, None).is_ok());
        assert!(relayed.pass(trailer(), 5.0, None).is_err(), "before its bytes");
        assert!(
            relayed.pass(data(u64::MAX, b"ab"), 5.0, None).is_ok(),
            "a wrong offset is the client's to see"
        );
        assert!(!relayed.is_whole());
    }

    #[test]
    fn the_cost_of_rejected_frames_is_in_the_header() {
        let mut relayed = Relayed::default();
        relayed.refuse(f64::NAN);
        relayed.refuse(7.0);
        relayed.pass(header(0), 5.0, None).unwrap();
        relayed.pass(trailer(), 5.0, None).unwrap();
        assert!(relayed.is_whole());
        assert!(rendering_ms(relayed.header().unwrap()) == 7.0);
    }
}
