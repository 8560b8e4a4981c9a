//! Streams of chunks: frames, samples, traced pixels and scenes, as their receivers assemble them.

use std::collections::BTreeMap;

use argus_proto::chunks::{
    FrameAssembler, FrameMeta, PixelAssembler, Received, SampleAssembler, SceneFilesAssembler, TracedFrame,
    bundle_chunks, frame_chunks, pixel_chunks, procedural_chunk, sample_chunks, trace_job, trace_requests,
};
use argus_proto::v1;
use argus_scene::{
    Bounds, Camera, FaceMask, Frame, Images, Limits, Output, PixelJob, Pixels, Plan, Plane, PlaneData,
    PlaneFormat, PlaneKind, Provenance, Rig, Sample, SampleId, SampleSetInfo, SceneHash, Served, Stage,
};
use bytes::Bytes;
use glam::DVec3;
use prost::Message;

/// Largest view that receivers accept.
const LIMITS: Limits = Limits { max_side: 64, max_pixels: 1024 };
const HASH: SceneHash = SceneHash([7; 32]);

/// Messages in sequence, each after its length.
fn stream<M: Message>(messages: impl IntoIterator<Item = M>) -> Vec<u8> {
    messages.into_iter().flat_map(|message| message.encode_length_delimited_to_vec()).collect()
}

/// Passes each message of a stream on until one is malformed or refused.
fn each<M: Message + Default>(
    bytes: &[u8],
    mut take: impl FnMut(M) -> Result<(), String>,
) -> Result<(), String> {
    let mut rest = Bytes::copy_from_slice(bytes);
    while !rest.is_empty() {
        take(M::decode_length_delimited(&mut rest).map_err(|error| error.to_string())?)?;
    }
    Ok(())
}

fn noise(bytes: usize) -> Bytes {
    (0..bytes).map(|i| (i * i / 7) as u8).collect::<Vec<u8>>().into()
}

fn frame() -> Frame {
    let (width, height) = (8, 6);
    let pixels = (width * height) as usize;
    Frame {
        width,
        height,
        images: Images::from([
            (Output::Color, noise(pixels * 3)),
            (Output::Range, noise(pixels * 4)),
            (Output::Mask, vec![0; pixels].into()),
        ]),
        unresolved_fraction: 0.25,
        served: Served::default(),
        predicted: None,
        decision: None,
        provenance: Provenance {
            scene: HASH,
            state: argus_scene::SceneState::of_epoch(1),
            plan: Plan::direct(4),
            specification: Some(set().specification()),
            device: "none".to_owned(),
            history: false,
        },
        stages: vec![Stage::new("render", 1.5)],
    }
}

/// Valid frames.
pub fn frames_corpus() -> Vec<Vec<u8>> {
    let meta = FrameMeta {
        view_id: "view".to_owned(),
        worker: "worker".to_owned(),
        age_ms: 1.0,
        ..FrameMeta::default()
    };
    let chunks = |encoding| frame_chunks(&frame(), &meta, encoding).map(stream).unwrap_or_default();
    vec![chunks(v1::Encoding::Raw), chunks(v1::Encoding::Zstd)]
}

/// A client's side of a view.
pub fn frames(bytes: &[u8]) -> Result<(), String> {
    let mut assembler = FrameAssembler::new(LIMITS);
    each(bytes, |chunk: v1::FrameChunk| {
        if let Some((frame, _)) = assembler.push(chunk).map_err(|error| error.to_string())? {
            let pixels = u64::from(frame.width) * u64::from(frame.height);
            assert!(pixels <= LIMITS.max_pixels, "{pixels} pixels");
            let color = frame.images[Output::Color].clone().map(|bytes| bytes.len() as u64);
            assert!(color.is_none_or(|bytes| bytes == pixels * 3), "{color:?} bytes of colour");
        }
        Ok(())
    })?;
    assembler.end().map_err(|error| error.to_string())
}

fn set() -> SampleSetInfo {
    let bounds = Bounds { min: DVec3::splat(-10.0), max: DVec3::splat(10.0) };
    SampleSetInfo::plain(HASH, bounds, Rig::TileCorners { bounds, tiles: [2, 2], height: 1.0, size: [12, 8] })
}

/// Valid samples.
pub fn samples_corpus() -> Vec<Vec<u8>> {
    let sample = |index| {
        let camera = set().rig.camera(index).ok()?;
        let size = camera.size();
        let plane = |kind, format: PlaneFormat| {
            let bytes = (size[0] * size[1]) as usize * format.texel_bytes();
            Plane { kind, format, size, data: PlaneData::Host(noise(bytes)) }
        };
        let planes = vec![
            plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat),
            plane(PlaneKind::InverseRange, PlaneFormat::R32Float),
        ];
        let id = SampleId { version: 0, camera: index };
        sample_chunks(&Sample { id, camera, faces: FaceMask::ALL, planes, stages: Vec::new() }).ok()
    };
    let both = [0, 3].into_iter().filter_map(sample).flatten();
    vec![stream(sample(0).unwrap_or_default()), stream(both)]
}

/// A worker's side of a subscription.
pub fn samples(bytes: &[u8]) -> Result<(), String> {
    let mut assembler = SampleAssembler::new(set(), [0, 3]);
    each(bytes, |chunk: v1::SampleChunk| {
        match assembler.push(chunk).map_err(|error| error.to_string())? {
            Some(Received::Sample(sample, _)) => {
                for plane in sample.planes {
                    let PlaneData::Host(bytes) = plane.data else { panic!("a plane came from nowhere") };
                    let texels = (plane.size[0] * plane.size[1]) as usize;
                    assert_eq!(bytes.len(), texels * plane.format.texel_bytes());
                }
            }
            Some(Received::Unchanged(_)) | None => {}
        }
        Ok(())
    })
}

fn job() -> PixelJob {
    PixelJob {
        camera: Camera::look_at(DVec3::ONE, DVec3::ZERO),
        width: 16,
        height: 12,
        pixels: vec![1, 2, 3, 40, 41, 100],
        samples_per_pixel: 4,
        state: argus_scene::SceneState::default(),
        time_secs: 0.0,
        reflections: None,
    }
}

/// Valid requests for pixels.
pub fn traces_corpus() -> Vec<Vec<u8>> {
    let frame = TracedFrame { scene: HASH, specification: set().specification().hash() };
    vec![stream(trace_requests(&job(), frame).into_iter().map(|(request, _)| request))]
}

/// A sampler's side of pixels to trace.
pub fn traces(bytes: &[u8]) -> Result<(), String> {
    each(bytes, |request: v1::TraceRequest| {
        let (_, job) = trace_job(request, 0.0, &LIMITS).map_err(|error| error.to_string())?;
        let pixels = job.width * job.height;
        assert!(job.pixels.iter().all(|&pixel| pixel < pixels), "a pixel lies outside of the view");
        Ok(())
    })
}

/// Valid pixels.
pub fn pixels_corpus() -> Vec<Vec<u8>> {
    let count = job().pixels.len();
    let pixels = Pixels { color: noise(count * 3), range: noise(count * 4), stages: Vec::new() };
    vec![pixel_chunks(&pixels).map(stream).unwrap_or_default()]
}

/// A compositor's side of pixels to trace.
pub fn pixels(bytes: &[u8]) -> Result<(), String> {
    let count = job().pixels.len();
    let mut assembler = PixelAssembler::new(count);
    each(bytes, |chunk: v1::TraceChunk| assembler.push(chunk).map_err(|error| error.to_string()))?;
    let pixels = assembler.finish().map_err(|error| error.to_string())?;
    assert_eq!((pixels.color.len(), pixels.range.len()), (count * 3, count * 4));
    Ok(())
}

/// Valid scenes.
pub fn scenes_corpus() -> Vec<Vec<u8>> {
    let files = [("a.obj".to_owned(), noise(300)), ("textures/b.png".to_owned(), noise(40))];
    let bundle = bundle_chunks("a.obj", HASH, "a.obj", files.to_vec()).map(stream).unwrap_or_default();
    vec![stream([procedural_chunk("terrain", HASH, "terrain:20000")]), bundle]
}

/// A worker's side of a scene; the names of its files must stay within a folder.
pub fn scenes(bytes: &[u8]) -> Result<(), String> {
    let mut assembler = SceneFilesAssembler::new(HASH, 1 << 16);
    each(bytes, |chunk: v1::SceneChunk| {
        let bundle = assembler.push(chunk).map_err(|error| error.to_string())?;
        if let Some(argus_proto::chunks::SceneFilesSource::Files { files, .. }) =
            bundle.map(|bundle| bundle.source)
        {
            let files: BTreeMap<String, Bytes> = files.into_iter().collect();
            for name in files.keys() {
                let path = std::path::Path::new(name);
                let within = path.components().all(|part| matches!(part, std::path::Component::Normal(_)));
                assert!(within && !name.is_empty(), "{name:?} leaves its folder");
            }
        }
        Ok(())
    })?;
    assembler.end().map_err(|error| error.to_string())
}
