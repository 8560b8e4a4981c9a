//! Samples in chunks.

use std::collections::BTreeSet;

use argus_scene::{
    FaceMask, FaceMasks, InvalidField, Plane, PlaneData, PlaneFormat, PlaneKind, Sample, SampleCamera,
    SampleId, SampleSetInfo, Stage,
};
use bytes::Bytes;

use super::{Gather, pieces};
use crate::WireError;
use crate::codec::{self, Layout};
use crate::convert::{WireEnum, hash, known, required, unspecified};
use crate::v1::{self, PlaneCodec};

/// Splits a sample into chunks, with packed planes. Cloning chunks is cheap, so a sample for many receivers is packed
/// once. Packing takes milliseconds: keep it off async threads.
///
/// # Errors
/// [`WireError::OnDevice`] if a plane has not been read back.
pub fn sample_chunks(sample: &Sample) -> Result<Vec<v1::SampleChunk>, WireError> {
    let mut planes = Vec::new();
    let mut packed = Vec::new();
    let hashes = plane_hashes(sample)?;
    for (plane, hash) in sample.planes.iter().zip(&hashes) {
        let raw = host_bytes(sample.id, plane)?;
        let small = codec::pack(plane.format.into(), raw)?;
        let codec = if small.is_some() { PlaneCodec::DeltaZstd } else { PlaneCodec::Raw };
        let bytes = small.unwrap_or_else(|| raw.clone());
        planes.push(v1::PlaneHeader {
            kind: plane.kind.number(),
            format: plane.format.number(),
            width: plane.size[0],
            height: plane.size[1],
            codec: codec as i32,
            packed_bytes: bytes.len() as u64,
            hash: Bytes::copy_from_slice(hash),
        });
        packed.push(bytes);
    }
    let header = v1::SampleHeader {
        id: Some(sample.id.into()),
        camera: Some((&sample.camera).into()),
        planes,
        stages: sample.stages.iter().map(Into::into).collect(),
        hash: Bytes::copy_from_slice(&combined(&hashes)),
        unchanged: false,
        faces: sample.faces.bits(),
    };
    let mut chunks = vec![v1::SampleChunk { body: Some(v1::sample_chunk::Body::Header(header)) }];
    let mut start = 0;
    for bytes in &packed {
        chunks.extend(pieces(start, bytes).map(|(offset, bytes)| v1::SampleChunk {
            body: Some(v1::sample_chunk::Body::Data(v1::SampleData { offset, bytes })),
        }));
        start += bytes.len() as u64;
    }
    Ok(chunks)
}

/// The chunk that replaces a sample that the receiver holds with the same hash.
pub fn unchanged_chunk(id: SampleId, hash: [u8; 32]) -> v1::SampleChunk {
    let header = v1::SampleHeader {
        id: Some(id.into()),
        hash: Bytes::copy_from_slice(&hash),
        unchanged: true,
        ..Default::default()
    };
    v1::SampleChunk { body: Some(v1::sample_chunk::Body::Header(header)) }
}

/// BLAKE3 over the hashes of the sample's planes in their stored format: equal texels, equal hash.
///
/// # Errors
/// [`WireError::OnDevice`] if a plane has not been read back.
pub fn sample_hash(sample: &Sample) -> Result<[u8; 32], WireError> {
    plane_hashes(sample).map(|hashes| combined(&hashes))
}

fn plane_hashes(sample: &Sample) -> Result<Vec<[u8; 32]>, WireError> {
    let hash = |plane| host_bytes(sample.id, plane).map(|bytes| *blake3::hash(bytes).as_bytes());
    sample.planes.iter().map(hash).collect()
}

fn combined(hashes: &[[u8; 32]]) -> [u8; 32] {
    *blake3::hash(hashes.as_flattened()).as_bytes()
}

fn host_bytes(id: SampleId, plane: &Plane) -> Result<&Bytes, WireError> {
    match &plane.data {
        PlaneData::Host(bytes) => Ok(bytes),
        PlaneData::Device(_) => Err(WireError::OnDevice(id)),
    }
}

/// An item of a subscription.
#[derive(Debug, Clone)]
pub enum Received {
    /// A sample, its planes in host memory and its hash.
    Sample(Sample, [u8; 32]),
    /// The receiver's sample is unchanged.
    Unchanged(SampleId),
}

/// Reassembles the samples of a subscription.
#[derive(Debug)]
pub struct SampleAssembler {
    due: Due,
    /// Requested samples that have not arrived yet.
    missing: BTreeSet<u64>,
    /// Requested faces.
    faces: FaceMasks,
    partial: Option<(Header, Gather)>,
}

/// What the samples of a subscription must be.
#[derive(Debug)]
enum Due {
    /// Of a set.
    Set(Box<SampleSetInfo>),
    /// A direct frame with this camera.
    Frame(SampleCamera),
}

impl Due {
    fn version(&self) -> u64 {
        match self {
            Self::Set(info) => info.version.number,
            Self::Frame(_) => SampleId::FRAMES,
        }
    }

    fn camera(&self, number: u64) -> Result<SampleCamera, InvalidField> {
        match self {
            Self::Set(info) => info.camera(number),
            Self::Frame(camera) => Ok(*camera),
        }
    }
}

/// A checked header.
#[derive(Debug)]
struct Header {
    id: SampleId,
    camera: SampleCamera,
    faces: FaceMask,
    planes: Vec<PlaneHeader>,
    stages: Vec<Stage>,
    hash: [u8; 32],
}

#[derive(Debug)]
struct PlaneHeader {
    kind: PlaneKind,
    format: PlaneFormat,
    size: [u32; 2],
    codec: PlaneCodec,
    packed: usize,
    raw: usize,
    hash: [u8; 32],
}

impl SampleAssembler {
    /// Accepts the samples of these cameras of a set. The set's rig bounds each sample's size, and so the memory that
    /// a header can request.
    pub fn new(info: SampleSetInfo, cameras: impl IntoIterator<Item = u64>) -> Self {
        let missing = cameras.into_iter().collect();
        Self { due: Due::Set(Box::new(info)), missing, faces: FaceMasks::default(), partial: None }
    }

    /// Accepts a direct frame that serves as a sample.
    pub fn of_frame(id: SampleId, camera: SampleCamera) -> Self {
        let missing = BTreeSet::from([id.camera]);
        Self { due: Due::Frame(camera), missing, faces: FaceMasks::default(), partial: None }
    }

    /// Accepts only samples that have these faces.
    pub fn with_faces(self, faces: FaceMasks) -> Self {
        Self { faces, ..self }
    }

    /// Adds the next chunk; `Some` if it completes a sample. Unpacking takes milliseconds.
    ///
    /// # Errors
    /// A [`WireError`] if the chunk is malformed; the stream is then unusable.
    pub fn push(&mut self, chunk: v1::SampleChunk) -> Result<Option<Received>, WireError> {
        match (required(chunk.body, "chunk.body")?, &mut self.partial) {
            (v1::sample_chunk::Body::Header(header), None) => {
                let id = SampleId::from(required(header.id, "sample.id")?);
                if id.version != self.due.version() || !self.missing.contains(&id.camera) {
                    return Err(WireError::field("sample.id", format!("{id} is not waited for")));
                }
                if header.unchanged {
                    self.missing.remove(&id.camera);
                    return Ok(Some(Received::Unchanged(id)));
                }
                let header = Header::check(id, header, &self.due)?;
                let asked = self.faces.of(id.camera).of_camera(&header.camera);
                if !header.faces.contains(asked) {
                    let (has, asked) = (header.faces.bits(), asked.bits());
                    return Err(WireError::field(
                        "sample.faces",
                        format!("must be {asked:#b}, not {has:#b}"),
                    ));
                }
                let expected = header.planes.iter().map(|plane| plane.packed as u64).sum();
                self.partial = Some((header, Gather::new("sample", expected)));
            }
            (v1::sample_chunk::Body::Header(_), Some((header, _))) => {
                let reason = format!("a header within sample {}", header.id);
                return Err(WireError::out_of_order("sample", reason));
            }
            (v1::sample_chunk::Body::Data(_), None) => {
                return Err(WireError::out_of_order("sample", "bytes before the header"));
            }
            (v1::sample_chunk::Body::Data(data), Some((_, gather))) => {
                gather.push(data.offset, data.bytes)?;
            }
        }
        match self.partial.take_if(|(_, gather)| gather.is_complete()) {
            Some((header, gather)) => {
                self.missing.remove(&header.id.camera);
                header.finish(gather.finish()).map(Some)
            }
            None => Ok(None),
        }
    }

    /// Cameras whose samples have not arrived whole.
    pub fn missing(&self) -> impl Iterator<Item = u64> {
        self.missing.iter().copied()
    }

    /// Whether the stream may end here.
    ///
    /// # Errors
    /// [`WireError::Truncated`] in the middle of a sample.
    pub fn end(&self) -> Result<(), WireError> {
        self.partial.as_ref().map_or(Ok(()), |(_, gather)| Err(gather.truncated()))
    }
}

impl Header {
    fn check(id: SampleId, header: v1::SampleHeader, due: &Due) -> Result<Self, InvalidField> {
        let camera: SampleCamera = required(header.camera, "sample.camera")?.try_into()?;
        let due = due.camera(id.camera)?;
        // Compares kind and size, not all fields: the last bit of a tangent may differ between machines.
        if camera.size() != due.size() || std::mem::discriminant(&camera) != std::mem::discriminant(&due) {
            return Err(InvalidField::new(
                "sample.camera",
                format!("is not camera {} of the rig", id.camera),
            ));
        }
        let faces = FaceMask::new(header.faces, "sample.faces")?.of_camera(&camera);
        let mut planes: Vec<PlaneHeader> = Vec::new();
        for plane in header.planes {
            let plane = PlaneHeader::check(plane, &camera)?;
            if planes.iter().any(|other| other.kind == plane.kind) {
                return Err(InvalidField::new("planes.kind", format!("{:?} occurs twice", plane.kind)));
            }
            planes.push(plane);
        }
        for kind in [PlaneKind::Radiance, PlaneKind::InverseRange] {
            if !planes.iter().any(|plane| plane.kind == kind) {
                return Err(InvalidField::new("sample.planes", format!("{kind:?} is missing")));
            }
        }
        let claimed = hash(&header.hash, "sample.hash")?;
        let hashes: Vec<[u8; 32]> = planes.iter().map(|plane| plane.hash).collect();
        if claimed != combined(&hashes) {
            return Err(InvalidField::new("sample.hash", "does not agree with the planes' hashes"));
        }
        let stages = header.stages.into_iter().map(Stage::try_from).collect::<Result<_, _>>()?;
        Ok(Self { id, camera, faces, planes, stages, hash: claimed })
    }

    fn finish(self, mut bytes: Bytes) -> Result<Received, WireError> {
        let mut planes = Vec::with_capacity(self.planes.len());
        for header in self.planes {
            let packed = bytes.split_to(header.packed);
            let raw = match header.codec {
                PlaneCodec::DeltaZstd => codec::unpack(header.format.into(), &packed, header.raw)?,
                PlaneCodec::Raw | PlaneCodec::Unspecified => packed,
            };
            if blake3::hash(&raw) != header.hash {
                return Err(WireError::corrupt("a plane", "its texels do not have the hash of its header"));
            }
            let PlaneHeader { kind, format, size, .. } = header;
            planes.push(Plane { kind, format, size, data: PlaneData::Host(raw) });
        }
        let Self { id, camera, faces, stages, .. } = self;
        let sample = Sample { id, camera, faces, planes, stages };
        Ok(Received::Sample(sample, self.hash))
    }
}

impl PlaneHeader {
    fn check(wire: v1::PlaneHeader, camera: &SampleCamera) -> Result<Self, InvalidField> {
        let kind = PlaneKind::from_number(wire.kind, "planes.kind")?;
        let size = Plane::size_of(kind, camera);
        let format = PlaneFormat::from_number(wire.format, "planes.format")?;
        if [wire.width, wire.height] != size {
            let reason =
                format!("must be the camera's {size:?} texels, not {} × {}", wire.width, wire.height);
            return Err(InvalidField::new("planes.width", reason));
        }
        // A rig's samples are at most 8192 texels a side, so this fits in 64 bits; `usize` is checked.
        let raw = u64::from(size[0]) * u64::from(size[1]) * Layout::from(format).texel_bytes() as u64;
        let raw = usize::try_from(raw)
            .map_err(|_| InvalidField::new("planes.width", "the plane does not fit in memory"))?;
        let codec = known(wire.codec, "planes.codec")?;
        let acceptable = match codec {
            PlaneCodec::Unspecified => return Err(unspecified("planes.codec")),
            PlaneCodec::Raw => wire.packed_bytes == raw as u64,
            PlaneCodec::DeltaZstd => (1..=raw as u64).contains(&wire.packed_bytes),
        };
        if !acceptable {
            let reason = format!("{} bytes for a plane of {raw}", wire.packed_bytes);
            return Err(InvalidField::new("planes.packed_bytes", reason));
        }
        let packed = wire.packed_bytes as usize;
        Ok(Self { kind, format, size, codec, packed, raw, hash: hash(&wire.hash, "planes.hash")? })
    }
}
