//! Frames in chunks.

use argus_scene::{Frame, FrameDigest, Images, InvalidField, Limits, Output, Stage};
use bytes::Bytes;

use super::{Gather, pieces};
use crate::WireError;
use crate::codec::{self, Layout};
use crate::convert::{WireEnum, duration_ms, hash, known, required};
use crate::v1::{self, Encoding};

/// Metadata of a frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameMeta {
    /// The request's view_id.
    pub view_id: String,
    /// Name of the worker that made it.
    pub worker: String,
    /// Milliseconds from the request's arrival to the first chunk, summed over the processes it passed.
    pub age_ms: f64,
    /// Digest of the images, which the worker computed and the receiver compared. A sender computes it anew.
    pub digest: FrameDigest,
}

/// Splits a frame into chunks, with images packed by `encoding`. Unspecified means [`Encoding::Raw`], which is also
/// used where packing would not save bytes. Packing takes milliseconds: keep it off async threads.
///
/// # Errors
/// [`WireError::Invalid`] if an image's size is not that of the frame.
pub fn frame_chunks(
    frame: &Frame,
    meta: &FrameMeta,
    encoding: Encoding,
) -> Result<Vec<v1::FrameChunk>, WireError> {
    let mut images = Vec::new();
    let mut packed = Vec::new();
    for (output, bytes) in frame.images.iter() {
        if Some(bytes.len()) != raw_bytes(frame.width, frame.height, output) {
            let reason = format!("{} bytes are not {} × {} pixels", bytes.len(), frame.width, frame.height);
            return Err(WireError::field("images.output", reason));
        }
        let small = match encoding {
            Encoding::Zstd => codec::pack(output.into(), bytes)?,
            Encoding::Raw | Encoding::Unspecified => None,
        };
        let encoding = if small.is_some() { Encoding::Zstd } else { Encoding::Raw };
        let bytes = small.unwrap_or_else(|| bytes.clone());
        images.push(v1::ImageHeader {
            output: output.number(),
            encoding: encoding as i32,
            packed_bytes: bytes.len() as u64,
        });
        packed.push(bytes);
    }
    let header = v1::FrameHeader {
        width: frame.width,
        height: frame.height,
        images,
        unresolved_fraction: frame.unresolved_fraction,
        served: Some(frame.served.into()),
        predicted: frame.predicted.map(Into::into),
        decision: frame.decision.map(Into::into),
        provenance: Some((&frame.provenance).into()),
        stages: frame.stages.iter().map(Into::into).collect(),
        view_id: meta.view_id.clone(),
        worker: meta.worker.clone(),
        age_ms: meta.age_ms,
        observed: None,
    };
    let mut chunks = vec![v1::FrameChunk { body: Some(v1::frame_chunk::Body::Header(header)) }];
    let mut start = 0;
    for bytes in &packed {
        chunks.extend(pieces(start, bytes).map(|(offset, bytes)| v1::FrameChunk {
            body: Some(v1::frame_chunk::Body::Data(v1::FrameData { offset, bytes })),
        }));
        start += bytes.len() as u64;
    }
    let trailer = v1::FrameTrailer { digest: Bytes::copy_from_slice(&frame.images.digest().0) };
    chunks.push(v1::FrameChunk { body: Some(v1::frame_chunk::Body::Trailer(trailer)) });
    Ok(chunks)
}

/// Reassembles consecutive frames from the chunks of a stream.
#[derive(Debug)]
pub struct FrameAssembler {
    limits: Limits,
    partial: Option<Partial>,
}

#[derive(Debug)]
struct Partial {
    header: Header,
    gather: Gather,
}

/// A checked header.
#[derive(Debug)]
struct Header {
    frame: Frame,
    meta: FrameMeta,
    /// Output, encoding, packed and raw size.
    images: Vec<(Output, Encoding, usize, usize)>,
}

impl FrameAssembler {
    /// Accepts frames of at most `limits`, which bound the memory that a header can request.
    pub fn new(limits: Limits) -> Self {
        Self { limits, partial: None }
    }

    /// Adds the next chunk; `Some` if it completes a frame, after which the next one may begin.
    ///
    /// # Errors
    /// A [`WireError`] if the chunk is malformed; the stream is then unusable.
    pub fn push(&mut self, chunk: v1::FrameChunk) -> Result<Option<(Frame, FrameMeta)>, WireError> {
        match (required(chunk.body, "chunk.body")?, &mut self.partial) {
            (v1::frame_chunk::Body::Header(header), None) => {
                let header = Header::check(header, &self.limits)?;
                // Each at most the size of its image, so the sum cannot overflow.
                let expected = header.images.iter().map(|(_, _, packed, _)| *packed as u64).sum();
                self.partial = Some(Partial { header, gather: Gather::new("frame", expected) });
            }
            (v1::frame_chunk::Body::Header(_), Some(partial)) => {
                let reason = format!("a second header after {} bytes", partial.gather.got());
                return Err(WireError::out_of_order("frame", reason));
            }
            (v1::frame_chunk::Body::Data(_) | v1::frame_chunk::Body::Trailer(_), None) => {
                return Err(WireError::out_of_order("frame", "bytes before the header"));
            }
            (v1::frame_chunk::Body::Data(data), Some(partial)) => {
                partial.gather.push(data.offset, data.bytes)?;
            }
            (v1::frame_chunk::Body::Trailer(trailer), Some(partial)) => {
                if !partial.gather.is_complete() {
                    return Err(partial.gather.truncated());
                }
                let digest = FrameDigest(hash(&trailer.digest, "trailer.digest")?);
                let partial = self.partial.take();
                return partial
                    .map(|partial| partial.header.finish(partial.gather.finish(), digest))
                    .transpose();
            }
        }
        Ok(None)
    }

    /// Forgets a partial frame.
    pub fn abandon(&mut self) {
        self.partial = None;
    }

    /// Whether the stream may end here.
    ///
    /// # Errors
    /// [`WireError::Truncated`] in the middle of a frame.
    pub fn end(&self) -> Result<(), WireError> {
        self.partial.as_ref().map_or(Ok(()), |partial| Err(partial.gather.truncated()))
    }
}

impl Header {
    fn check(header: v1::FrameHeader, limits: &Limits) -> Result<Self, InvalidField> {
        let v1::FrameHeader { width, height, .. } = header;
        InvalidField::within("frame.width", width, 1..=limits.max_side)?;
        InvalidField::within("frame.height", height, 1..=limits.max_side)?;
        if u64::from(width) * u64::from(height) > limits.max_pixels {
            let reason = format!("must be at most {} pixels, not {width} × {height}", limits.max_pixels);
            return Err(InvalidField::new("frame.width", reason));
        }
        let mut images: Vec<(Output, Encoding, usize, usize)> = Vec::new();
        for image in &header.images {
            let output = Output::from_number(image.output, "images.output")?;
            if images.last().is_some_and(|(before, ..)| *before >= output) {
                return Err(InvalidField::new(
                    "images.output",
                    format!("{output:?} is out of order or occurs twice"),
                ));
            }
            let encoding = known(image.encoding, "images.encoding")?;
            let raw = raw_bytes(width, height, output)
                .ok_or_else(|| InvalidField::new("frame.width", "does not fit in memory"))?;
            let acceptable = match encoding {
                Encoding::Raw => image.packed_bytes == raw as u64,
                Encoding::Zstd => (1..=raw as u64).contains(&image.packed_bytes),
                Encoding::Unspecified => {
                    return Err(InvalidField::new("images.encoding", "must not be unspecified"));
                }
            };
            if !acceptable {
                let reason = format!("{} bytes for an image of {raw}", image.packed_bytes);
                return Err(InvalidField::new("images.packed_bytes", reason));
            }
            images.push((output, encoding, image.packed_bytes as usize, raw));
        }
        if images.is_empty() {
            return Err(InvalidField::new("frame.images", "must hold at least one image"));
        }
        let frame = Frame {
            width,
            height,
            images: Images::default(),
            unresolved_fraction: InvalidField::within(
                "frame.unresolved_fraction",
                header.unresolved_fraction,
                0.0..=1.0,
            )?,
            served: header.served.unwrap_or_default().into(),
            predicted: header.predicted.map(TryInto::try_into).transpose()?,
            decision: header.decision.map(TryInto::try_into).transpose()?,
            provenance: required(header.provenance, "frame.provenance")?.try_into()?,
            stages: header.stages.into_iter().map(Stage::try_from).collect::<Result<_, _>>()?,
        };
        let meta = FrameMeta {
            view_id: header.view_id,
            worker: header.worker,
            age_ms: duration_ms(header.age_ms, "frame.age_ms")?,
            digest: FrameDigest::default(),
        };
        Ok(Self { frame, meta, images })
    }

    fn finish(self, mut bytes: Bytes, digest: FrameDigest) -> Result<(Frame, FrameMeta), WireError> {
        let mut frame = self.frame;
        for (output, encoding, packed, raw) in self.images {
            let part = bytes.split_to(packed);
            let image = match encoding {
                Encoding::Zstd => codec::unpack(Layout::from(output), &part, raw)?,
                Encoding::Raw | Encoding::Unspecified => part,
            };
            frame.images[output] = Some(image);
        }
        let found = frame.images.digest();
        if found != digest {
            let reason = format!("its digest is {found}, and its worker computed {digest}");
            return Err(WireError::corrupt("the frame", reason));
        }
        Ok((frame, FrameMeta { digest, ..self.meta }))
    }
}

/// Size of an image in memory; `None` if it exceeds the address space.
fn raw_bytes(width: u32, height: u32, output: Output) -> Option<usize> {
    let pixels = usize::try_from(u64::from(width) * u64::from(height)).ok()?;
    pixels.checked_mul(Layout::from(output).texel_bytes())
}
