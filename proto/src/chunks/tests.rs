use argus_scene::{
    FaceMask, Frame, Images, Limits, Output, PlaneData, Sample, SampleId, SceneHash, SceneState, Served,
};
use bytes::Bytes;
use proptest::prelude::*;

use super::*;
use crate::tests::arbitrary;
use crate::v1::{self, Encoding, frame_chunk, sample_chunk, scene_chunk};

fn assemble(chunks: Vec<v1::FrameChunk>) -> Result<Option<(Frame, FrameMeta)>, WireError> {
    let mut assembler = FrameAssembler::new(Limits::default());
    let mut whole = None;
    for chunk in chunks {
        assert!(whole.is_none(), "nothing follows a whole frame");
        whole = assembler.push(chunk)?;
    }
    assembler.end().map(|()| whole)
}

fn receive(
    info: &argus_scene::SampleSetInfo,
    id: SampleId,
    chunks: Vec<v1::SampleChunk>,
) -> Result<Vec<Received>, WireError> {
    // All faces of the sample were requested.
    let faces = match chunks.first().and_then(|chunk| chunk.body.as_ref()) {
        Some(sample_chunk::Body::Header(header)) => FaceMask::new(header.faces, "faces").ok(),
        _ => None,
    };
    let faces = faces.map(|faces| (id.camera, faces)).into_iter().collect();
    let mut assembler = SampleAssembler::new(info.clone(), [id.camera]).with_faces(faces);
    let mut received = Vec::new();
    for chunk in chunks {
        received.extend(assembler.push(chunk)?);
    }
    assembler.end().map(|()| received)
}

fn texels(sample: &Sample) -> Vec<Bytes> {
    let host = |plane: &argus_scene::Plane| match &plane.data {
        PlaneData::Host(bytes) => bytes.clone(),
        PlaneData::Device(_) => panic!("host expected"),
    };
    sample.planes.iter().map(host).collect()
}

proptest! {
    #[test]
    fn frames_survive_in_every_encoding(
        frame in arbitrary::frame(),
        meta in arbitrary::frame_meta(),
        packed in any::<bool>(),
    ) {
        let encoding = if packed { Encoding::Zstd } else { Encoding::Raw };
        let chunks = frame_chunks(&frame, &meta, encoding).unwrap();
        let meta = FrameMeta { digest: frame.images.digest(), ..meta };
        prop_assert_eq!(assemble(chunks).unwrap(), Some((frame, meta)));
    }

    #[test]
    fn samples_survive_bit_for_bit((info, sample) in arbitrary::sample()) {
        let received = receive(&info, sample.id, sample_chunks(&sample).unwrap()).unwrap();
        let [Received::Sample(arrived, hash)] = &received[..] else { panic!("one sample expected") };
        prop_assert_eq!(*hash, sample_hash(&sample).unwrap());
        prop_assert_eq!((arrived.id, arrived.camera, arrived.faces), (sample.id, sample.camera, sample.faces));
        prop_assert_eq!(texels(arrived), texels(&sample));
        prop_assert_eq!(&arrived.stages, &sample.stages);
        for (a, b) in arrived.planes.iter().zip(&sample.planes) {
            prop_assert_eq!((a.kind, a.format, a.size), (b.kind, b.format, b.size));
        }
    }

    #[test]
    fn a_frame_with_any_chunk_lost_repeated_or_changed_is_an_error(
        frame in arbitrary::frame(),
        at in any::<prop::sample::Index>(),
        fault in 0..3u8,
    ) {
        let mut chunks = frame_chunks(&frame, &FrameMeta::default(), Encoding::Zstd).unwrap();
        let at = at.index(chunks.len());
        match fault {
            0 => drop(chunks.remove(at)),
            // A complete frame may be followed by another one, so a repeated last chunk is detected as bytes without
            // a header.
            1 => chunks.insert(at, chunks[at].clone()),
            _ => match chunks[at].body.as_mut().unwrap() {
                frame_chunk::Body::Header(header) => header.images[0].packed_bytes += 1,
                frame_chunk::Body::Data(data) => data.bytes = data.bytes.slice(..data.bytes.len() - 1),
                frame_chunk::Body::Trailer(trailer) => trailer.digest = Bytes::from_static(&[7; 32]),
            },
        }
        let mut assembler = FrameAssembler::new(Limits::default());
        let outcome = chunks.into_iter().try_for_each(|chunk| assembler.push(chunk).map(drop));
        prop_assert!(outcome.and_then(|()| assembler.end()).is_err());
    }
}

fn frame() -> Frame {
    let plan = argus_scene::Plan::direct(1);
    let hash = SceneHash([1; 32]);
    let device = String::new();
    Frame {
        width: 1000,
        height: 700,
        images: Images::from([
            (Output::Color, (0..2_100_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()),
            (Output::Mask, vec![0; 700_000].into()),
        ]),
        unresolved_fraction: 0.25,
        served: Served::default(),
        predicted: None,
        decision: None,
        provenance: argus_scene::Provenance {
            scene: hash,
            state: SceneState::of_epoch(1),
            plan,
            specification: None,
            device,
            history: false,
        },
        stages: Vec::new(),
    }
}

fn header(chunk: &mut v1::FrameChunk) -> &mut v1::FrameHeader {
    match chunk.body.as_mut().unwrap() {
        frame_chunk::Body::Header(header) => header,
        frame_chunk::Body::Data(_) | frame_chunk::Body::Trailer(_) => panic!("a header expected"),
    }
}

#[test]
fn a_large_frame_is_cut_into_pieces_of_at_most_a_mebibyte() {
    let frame = frame();
    let chunks = frame_chunks(&frame, &FrameMeta::default(), Encoding::Raw).unwrap();
    assert_eq!(chunks.len(), 1 + 3 + 1 + 1);
    for chunk in &chunks[1..chunks.len() - 1] {
        let Some(frame_chunk::Body::Data(data)) = &chunk.body else { panic!("bytes expected") };
        assert!((1..=MAX_CHUNK_BYTES).contains(&data.bytes.len()));
    }
    let packed = frame_chunks(&frame, &FrameMeta::default(), Encoding::Zstd).unwrap();
    assert_eq!(assemble(packed).unwrap(), assemble(chunks).unwrap());
}

#[test]
fn hostile_frame_headers_are_refused_before_memory_is_allocated() {
    let good = frame_chunks(&frame(), &FrameMeta::default(), Encoding::Raw).unwrap();
    type Change = fn(&mut v1::FrameHeader);
    let cases: [(&str, Change); 13] = [
        ("frame.width", |h| h.width = 0),
        ("frame.width", |h| h.width = u32::MAX),
        ("frame.height", |h| h.height = u32::MAX),
        ("frame.width", |h| (h.width, h.height) = (8192, 8192)),
        ("images.packed_bytes", |h| h.images[0].packed_bytes = u64::MAX),
        ("images.packed_bytes", |h| h.images[0].packed_bytes = 0),
        ("images.encoding", |h| h.images[0].encoding = 0),
        ("images.encoding", |h| h.images[0].encoding = 9),
        ("images.output", |h| h.images[1].output = h.images[0].output),
        ("images.output", |h| h.images[0].output = -1),
        ("frame.images", |h| h.images.clear()),
        ("frame.unresolved_fraction", |h| h.unresolved_fraction = f64::NAN),
        ("frame.age_ms", |h| h.age_ms = -1.0),
    ];
    for (field, change) in cases {
        let mut chunk = good[0].clone();
        change(header(&mut chunk));
        match FrameAssembler::new(Limits::default()).push(chunk) {
            Err(WireError::Invalid(at)) => assert_eq!(at.field, field),
            other => panic!("{field}: {other:?}"),
        }
    }
    let mut assembler = FrameAssembler::new(Limits::default());
    assert!(assembler.push(v1::FrameChunk { body: None }).is_err());
    assert!(matches!(assembler.push(good[1].clone()), Err(WireError::OutOfOrder { .. })));
}

#[test]
fn overlapping_skipped_excess_and_missing_bytes_are_refused() {
    let good = frame_chunks(&frame(), &FrameMeta::default(), Encoding::Raw).unwrap();
    let after = |chunks: &[usize]| {
        let mut assembler = FrameAssembler::new(Limits::default());
        let outcome = chunks.iter().try_for_each(|i| assembler.push(good[*i].clone()).map(drop));
        outcome.and_then(|()| assembler.end())
    };
    assert!(matches!(after(&[0, 0]), Err(WireError::OutOfOrder { .. })));
    assert!(matches!(after(&[0, 1, 1]), Err(WireError::OutOfOrder { .. })));
    assert!(matches!(after(&[0, 2]), Err(WireError::OutOfOrder { .. })));
    let truncated = WireError::Truncated { what: "frame", got: 1 << 20, expected: 2_800_000 };
    assert_eq!(after(&[0, 1]), Err(truncated));
    let unended = WireError::Truncated { what: "frame", got: 2_800_000, expected: 2_800_000 };
    assert_eq!(after(&[0, 1, 2, 3, 4]), Err(unended));
    assert!(matches!(after(&[0, 1, 5]), Err(WireError::Truncated { .. })));
    assert_eq!(after(&[0, 1, 2, 3, 4, 5]), Ok(()));
    assert_eq!(after(&[0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5]), Ok(()));

    let mut gather = Gather::new("frame", 4);
    assert!(gather.push(0, Bytes::new()).is_err());
    assert!(gather.push(0, Bytes::from_static(b"12345")).is_err());
    assert!(gather.push(u64::MAX, Bytes::from_static(b"1")).is_err());
    gather.push(0, Bytes::from_static(b"123")).unwrap();
    assert!(gather.push(3, Bytes::from_static(b"45")).is_err());
    let mut large = Gather::new("frame", u64::MAX);
    assert!(large.push(0, vec![0; MAX_CHUNK_BYTES + 1].into()).is_err());
}

#[test]
fn bytes_that_changed_on_the_way_are_found_by_the_digest() {
    let mut chunks = frame_chunks(&frame(), &FrameMeta::default(), Encoding::Raw).unwrap();
    let Some(frame_chunk::Body::Data(data)) = &mut chunks[2].body else { panic!("bytes expected") };
    let mut bytes = data.bytes.to_vec();
    bytes[12345] ^= 1;
    data.bytes = bytes.into();
    let Err(WireError::Corrupt { reason, .. }) = assemble(chunks) else { panic!("must be refused") };
    assert!(reason.contains("digest"), "{reason}");
}

#[test]
fn an_image_of_another_size_than_its_frame_is_never_sent() {
    let mut frame = frame();
    frame.images[Output::Mask] = Some(Bytes::from_static(b"short"));
    assert!(frame_chunks(&frame, &FrameMeta::default(), Encoding::Raw).is_err());
}

fn sample() -> (argus_scene::SampleSetInfo, Sample) {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut drawn = std::iter::repeat_with(|| arbitrary::sample().new_tree(&mut runner).unwrap().current());
    drawn.find(|(_, sample)| sample.camera.faces().len() == 6).unwrap()
}

#[test]
fn samples_that_were_not_requested_or_do_not_fit_the_rig_are_refused() {
    let (info, sample) = sample();
    let good = sample_chunks(&sample).unwrap();
    type Change = fn(&mut v1::SampleHeader);
    let cases: [(&str, Change); 14] = [
        ("sample.id", |h| h.id = None),
        ("sample.id", |h| h.id.as_mut().unwrap().version ^= 1),
        ("sample.id", |h| h.id.as_mut().unwrap().camera ^= 1),
        ("sample.camera", |h| h.camera = None),
        ("sample.camera", |h| {
            let center = Some(glam::DVec3::ONE.into());
            let layout = Some(v1::omni_camera::Layout::CubeFace(2048));
            let omni = v1::OmniCamera { center, layout };
            h.camera = Some(v1::SampleCamera { kind: Some(v1::sample_camera::Kind::Omni(omni)) });
        }),
        ("planes.width", |h| h.planes[0].width = u32::MAX),
        ("planes.packed_bytes", |h| h.planes[0].packed_bytes = u64::MAX),
        ("planes.kind", |h| h.planes[1].kind = h.planes[0].kind),
        ("planes.format", |h| h.planes[1].format = 99),
        ("planes.codec", |h| h.planes[0].codec = 0),
        ("sample.planes", |h| h.planes.truncate(1)),
        ("sample.hash", |h| h.hash = vec![0; 32].into()),
        ("sample.faces", |h| h.faces = 0),
        ("sample.faces", |h| h.faces = 64),
    ];
    for (field, change) in cases {
        let mut chunks = good.clone();
        let Some(sample_chunk::Body::Header(header)) = &mut chunks[0].body else { panic!() };
        change(header);
        match receive(&info, sample.id, chunks) {
            Err(WireError::Invalid(at)) => assert_eq!(at.field, field),
            other => panic!("{field}: {other:?}"),
        }
    }
}

#[test]
fn a_sample_that_lacks_requested_faces_is_refused() {
    let (info, sample) = sample();
    let camera = argus_scene::SampleCamera::Omni {
        center: sample.camera.center(),
        layout: argus_scene::OmniLayout::CubeFaces { face: 8 },
    };
    assert_eq!(std::mem::discriminant(&camera), std::mem::discriminant(&sample.camera), "samples are cubes");
    let pushed = |has: u32, asked: u32| {
        let mut chunks = sample_chunks(&sample).unwrap();
        let Some(sample_chunk::Body::Header(header)) = &mut chunks[0].body else { panic!() };
        header.faces = has;
        let asked = [(sample.id.camera, FaceMask::new(asked, "faces").unwrap())].into_iter().collect();
        let mut assembler = SampleAssembler::new(info.clone(), [sample.id.camera]).with_faces(asked);
        assembler.push(chunks.swap_remove(0)).map(drop)
    };
    assert!(pushed(0b11, 0b10).is_ok());
    let Err(WireError::Invalid(refused)) = pushed(0b11, 0b110) else { panic!("must be refused") };
    assert_eq!(refused.field, "sample.faces");
}

#[test]
fn a_damaged_sample_is_detected_by_its_hash() {
    let (info, sample) = sample();
    let mut chunks = sample_chunks(&sample).unwrap();
    // The claimed hashes agree with each other, but not with the texels.
    let Some(sample_chunk::Body::Header(header)) = &mut chunks[0].body else { panic!() };
    header.planes[0].hash = vec![9; 32].into();
    let hashes: Vec<u8> = header.planes.iter().flat_map(|plane| plane.hash.to_vec()).collect();
    header.hash = Bytes::copy_from_slice(blake3::hash(&hashes).as_bytes());
    assert!(matches!(receive(&info, sample.id, chunks), Err(WireError::Corrupt { .. })));

    let good = sample_chunks(&sample).unwrap();
    let cut = good[..good.len() - 1].to_vec();
    assert!(matches!(receive(&info, sample.id, cut), Err(WireError::Truncated { .. })));
    let twice = [good.clone(), good].concat();
    assert!(receive(&info, sample.id, twice).is_err());
}

#[test]
fn a_sample_that_the_receiver_has_is_not_sent_again() {
    let (info, sample) = sample();
    let chunk = unchanged_chunk(sample.id, sample_hash(&sample).unwrap());
    let mut assembler = SampleAssembler::new(info.clone(), [sample.id.camera]);
    assert_eq!(assembler.missing().collect::<Vec<_>>(), [sample.id.camera]);
    let received = assembler.push(chunk.clone()).unwrap();
    assert!(matches!(received, Some(Received::Unchanged(id)) if id == sample.id));
    assert_eq!(assembler.missing().count(), 0);
    assert!(assembler.push(chunk).is_err());
}

#[test]
fn a_sample_on_a_device_is_not_sent() {
    let (_, mut sample) = sample();
    sample.planes[1].data = PlaneData::Device(std::sync::Arc::new(()));
    assert_eq!(sample_chunks(&sample).unwrap_err(), WireError::OnDevice(sample.id));
    assert_eq!(sample_hash(&sample).unwrap_err(), WireError::OnDevice(sample.id));
}

fn unbundle(
    max_bytes: u64,
    chunks: impl IntoIterator<Item = v1::SceneChunk>,
) -> Result<SceneFiles, WireError> {
    let mut assembler = SceneFilesAssembler::new(SceneHash([3; 32]), max_bytes);
    let mut bundle = None;
    for chunk in chunks {
        bundle = bundle.or(assembler.push(chunk)?);
    }
    assembler.end()?;
    bundle.ok_or(WireError::out_of_order("scene", "nothing came"))
}

fn files() -> Vec<(String, Bytes)> {
    vec![
        ("room.gltf".to_owned(), Bytes::from_static(b"{}")),
        ("textures/empty.png".to_owned(), Bytes::new()),
        ("room.bin".to_owned(), vec![5; 3 * MAX_CHUNK_BYTES + 1].into()),
    ]
}

#[test]
fn bundles_and_procedural_scenes_survive() {
    let hash = SceneHash([3; 32]);
    let chunks = bundle_chunks("rooms/room.gltf", hash, "room.gltf", files()).unwrap();
    let bundle = unbundle(u64::MAX, chunks).unwrap();
    assert_eq!(bundle.name, "rooms/room.gltf");
    assert_eq!(bundle.source, SceneFilesSource::Files { root: "room.gltf".to_owned(), files: files() });
    let bundle = unbundle(0, [procedural_chunk("terrain", hash, "terrain:500000")]).unwrap();
    assert_eq!(bundle.source, SceneFilesSource::Procedural("terrain:500000".to_owned()));
    assert!(unbundle(0, [procedural_chunk("terrain", SceneHash([4; 32]), "terrain")]).is_err());
}

#[test]
fn bundles_with_false_sizes_or_names_outside_their_folder_are_refused() {
    let hash = SceneHash([3; 32]);
    for name in ["../up", "/etc/passwd", "a/../../b", "a//b", "C:\\x", "a\\b", "", "./a"] {
        let files = vec![(name.to_owned(), Bytes::new())];
        assert!(bundle_chunks("x", hash, name, files).is_err(), "{name}");
    }
    assert!(bundle_chunks("x", hash, "other.gltf", files()).is_err());
    let good: Vec<_> = bundle_chunks("x", hash, "room.gltf", files()).unwrap().collect();
    assert!(unbundle(1 << 20, good.clone()).is_err());
    for end in 0..good.len() {
        assert!(unbundle(u64::MAX, good[..end].to_vec()).is_err(), "cut after {end}");
    }
    for at in 0..good.len() {
        let mut chunks = good.clone();
        chunks.insert(at, chunks[at].clone());
        assert!(unbundle(u64::MAX, chunks).is_err(), "{at} twice");
    }
    let mut escaping = good.clone();
    escaping[1].body = Some(scene_chunk::Body::File(v1::FileHeader { name: "../x".to_owned(), bytes: 2 }));
    assert!(unbundle(u64::MAX, escaping).is_err());
}
