//! Traced pixels of a view: requests to samplers, and answers.
//!
//! Pixels that no sample saw form clusters, so runs per row name them in a few bytes each.

use argus_scene::{
    InvalidField, Limits, PixelJob, Pixels, PlanRequest, SceneHash, SceneState, SpecificationHash, Stage,
    View,
};
use bytes::{Bytes, BytesMut};

use super::{Gather, pieces};
use crate::WireError;
use crate::convert::{
    WireEnum, light_level, required, scene_hash, scene_hash_bytes, specification_hash,
    specification_hash_bytes,
};
use crate::v1::{self, trace_chunk};

/// Most pixels of one request; more need several requests. It bounds both messages, whatever the view's size: 2 MiB
/// of runs and 1.75 MiB of answer at worst.
pub const MAX_TRACE_PIXELS: usize = 1 << 18;

/// Bytes of a pixel on the wire: sRGB and range.
const COLOR_BYTES: usize = 3;
const RANGE_BYTES: usize = 4;

/// The scene and the specification of the frame whose pixels are requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TracedFrame {
    /// Its scene.
    pub scene: SceneHash,
    /// The specification of its samples.
    pub specification: SpecificationHash,
}

/// The requests for a job's pixels, in order, each with its number of pixels.
pub fn trace_requests(job: &PixelJob, frame: TracedFrame) -> Vec<(v1::TraceRequest, usize)> {
    let request = |pixels: &[u32]| v1::TraceRequest {
        scene_hash: scene_hash_bytes(frame.scene),
        specification_hash: specification_hash_bytes(frame.specification),
        epoch: job.state.epoch,
        light: job.state.light.number(),
        revision: job.state.revision,
        camera: Some((&job.camera).into()),
        width: job.width,
        height: job.height,
        samples_per_pixel: job.samples_per_pixel,
        runs: runs(pixels),
    };
    job.pixels.chunks(MAX_TRACE_PIXELS).map(|pixels| (request(pixels), pixels.len())).collect()
}

/// Runs: alternately pixels to skip and pixels to take.
fn runs(ascending: &[u32]) -> Vec<u32> {
    let mut runs: Vec<u32> = Vec::new();
    let mut next = 0;
    for &pixel in ascending {
        match runs.last_mut() {
            Some(taken) if pixel == next => *taken += 1,
            _ => runs.extend([pixel - next, 1]),
        }
        next = pixel + 1;
    }
    runs
}

/// Validates an untrusted request. Returns the frame and the job. `time_secs` is the scene time of its epoch.
///
/// # Errors
/// [`InvalidField`] if [`View::validate`] refuses a direct view of this size, or if the runs are not 1 to
/// [`MAX_TRACE_PIXELS`] pixels of the view in ascending order.
pub fn trace_job(
    wire: v1::TraceRequest,
    time_secs: f64,
    limits: &Limits,
) -> Result<(TracedFrame, PixelJob), InvalidField> {
    let scene = scene_hash(&wire.scene_hash, "scene_hash")?;
    let specification = specification_hash(&wire.specification_hash, "specification_hash")?;
    let side = wire.samples_per_pixel.isqrt();
    if side == 0 || side * side != wire.samples_per_pixel {
        let reason = format!("must be a square number, not {}", wire.samples_per_pixel);
        return Err(InvalidField::new("samples_per_pixel", reason));
    }
    let view = View::new(
        required(wire.camera, "camera")?.try_into()?,
        [wire.width, wire.height],
        PlanRequest { direct: true, supersampling: Some(side), ..PlanRequest::default() },
    );
    view.validate(limits)?;
    let pixels = taken(&wire.runs, u64::from(wire.width) * u64::from(wire.height))?;
    let View { camera, width, height, .. } = view;
    let v1::TraceRequest { samples_per_pixel, epoch, light, revision, .. } = wire;
    let state = SceneState { epoch, light: light_level(light, "light")?, revision };
    Ok((
        TracedFrame { scene, specification },
        PixelJob { camera, width, height, pixels, samples_per_pixel, state, time_secs, reflections: None },
    ))
}

/// Inverse of [`runs`] for a view of `count` pixels.
fn taken(runs: &[u32], count: u64) -> Result<Vec<u32>, InvalidField> {
    let wrong = |reason: String| InvalidField::new("runs", reason);
    let (pairs, odd) = runs.as_chunks::<2>();
    if !odd.is_empty() {
        return Err(wrong(format!("must be an even number of counts, not {}", runs.len())));
    }
    let mut pixels: Vec<u32> = Vec::new();
    let mut next = 0_u64;
    for (i, &[over, take]) in pairs.iter().enumerate() {
        if take == 0 || (over == 0 && i > 0) {
            return Err(wrong("a count is 0, and not the first one".to_owned()));
        }
        let (begin, end) = (next + u64::from(over), next + u64::from(over) + u64::from(take));
        if end > count {
            return Err(wrong(format!("pixel {} of {count} is asked for", end - 1)));
        }
        if pixels.len() as u64 + u64::from(take) > MAX_TRACE_PIXELS as u64 {
            return Err(wrong(format!("more than {MAX_TRACE_PIXELS} pixels are asked for")));
        }
        pixels.extend((begin..end).map(|pixel| pixel as u32));
        next = end;
    }
    if pixels.is_empty() {
        return Err(wrong("no pixel is asked for".to_owned()));
    }
    Ok(pixels)
}

/// Splits traced pixels into chunks.
///
/// # Errors
/// [`WireError::Invalid`] unless there is one colour per range.
pub fn pixel_chunks(pixels: &Pixels) -> Result<Vec<v1::TraceChunk>, WireError> {
    let count = pixels.range.len() / RANGE_BYTES;
    if pixels.range.len() != count * RANGE_BYTES || pixels.color.len() != count * COLOR_BYTES {
        let (colors, ranges) = (pixels.color.len(), pixels.range.len());
        return Err(WireError::field("pixels", format!("{colors} bytes of colour, {ranges} of range")));
    }
    let header = v1::TraceHeader {
        pixels: u32::try_from(count).map_err(|_| WireError::field("pixels", "too many"))?,
        stages: pixels.stages.iter().map(Into::into).collect(),
    };
    let data = |(offset, bytes)| trace_chunk::Body::Data(v1::TraceData { offset, bytes });
    let bodies = std::iter::once(trace_chunk::Body::Header(header))
        .chain(pieces(0, &pixels.color).map(data))
        .chain(pieces(pixels.color.len() as u64, &pixels.range).map(data));
    Ok(bodies.map(|body| v1::TraceChunk { body: Some(body) }).collect())
}

/// Reassembles traced pixels.
#[derive(Debug)]
pub struct PixelAssembler {
    count: usize,
    stages: Option<Vec<Stage>>,
    gather: Gather,
}

impl PixelAssembler {
    /// Accepts the answer to a request for `count` pixels, which bounds the memory.
    pub fn new(count: usize) -> Self {
        let bytes = count.saturating_mul(COLOR_BYTES + RANGE_BYTES);
        Self { count, stages: None, gather: Gather::new("traced pixels", bytes as u64) }
    }

    /// Takes the next chunk.
    ///
    /// # Errors
    /// A [`WireError`] if the chunk is malformed; the stream is then unusable.
    pub fn push(&mut self, chunk: v1::TraceChunk) -> Result<(), WireError> {
        match required(chunk.body, "chunk.body")? {
            trace_chunk::Body::Header(_) if self.stages.is_some() => {
                Err(WireError::out_of_order("traced pixels", "a second header"))
            }
            trace_chunk::Body::Header(header) => {
                if header.pixels as usize != self.count {
                    let reason = format!("{} where {} were asked for", header.pixels, self.count);
                    return Err(WireError::field("pixels", reason));
                }
                let stages: Result<_, _> = header.stages.into_iter().map(Stage::try_from).collect();
                self.stages = Some(stages?);
                Ok(())
            }
            trace_chunk::Body::Data(_) if self.stages.is_none() => {
                Err(WireError::out_of_order("traced pixels", "bytes before the header"))
            }
            trace_chunk::Body::Data(data) => self.gather.push(data.offset, data.bytes),
        }
    }

    /// The pixels, after the stream's end.
    ///
    /// # Errors
    /// [`WireError::Truncated`] if something is missing, [`WireError::Corrupt`] for an invalid range.
    pub fn finish(self) -> Result<Pixels, WireError> {
        let Some(stages) = self.stages.filter(|_| self.gather.is_complete()) else {
            return Err(self.gather.truncated());
        };
        let mut color = self.gather.finish();
        let range = color.split_off(self.count * COLOR_BYTES);
        // Written so that NaN is refused.
        let is_range = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes) >= 0.0;
        if !range.as_chunks::<RANGE_BYTES>().0.iter().all(is_range) {
            return Err(WireError::corrupt("traced pixels", "a range is negative or no number"));
        }
        Ok(Pixels { color, range, stages })
    }
}

/// Joins the answers to several requests.
pub fn joined(parts: Vec<Pixels>) -> Pixels {
    let all = |part: fn(&Pixels) -> &Bytes| match &parts[..] {
        [one] => part(one).clone(),
        _ => parts.iter().flat_map(|p| part(p).iter().copied()).collect::<BytesMut>().freeze(),
    };
    let (color, range) = (all(|p| &p.color), all(|p| &p.range));
    Pixels { color, range, stages: parts.into_iter().flat_map(|p| p.stages).collect() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use proptest::prelude::*;

    use super::*;
    use crate::tests::arbitrary;

    const FRAME: TracedFrame =
        TracedFrame { scene: SceneHash([7; 32]), specification: SpecificationHash([8; 32]) };

    fn job(width: u32, height: u32, pixels: Vec<u32>) -> PixelJob {
        let camera = argus_scene::Camera::look_at(glam::DVec3::ONE, glam::DVec3::ZERO);
        PixelJob {
            camera,
            width,
            height,
            pixels,
            samples_per_pixel: 4,
            state: SceneState { epoch: 3, light: argus_scene::LightLevel::Coarse, revision: 9 },
            time_secs: 0.5,
            reflections: None,
        }
    }

    fn pixels(count: usize) -> Pixels {
        let color = (0..3 * count).map(|i| i as u8).collect::<Vec<_>>();
        let range = (0..count).flat_map(|i| if i == 1 { f32::INFINITY } else { i as f32 }.to_le_bytes());
        Pixels { color: color.into(), range: range.collect(), stages: vec![Stage::new("trace rays", 1.5)] }
    }

    fn receive(count: usize, chunks: Vec<v1::TraceChunk>) -> Result<Pixels, WireError> {
        let mut assembler = PixelAssembler::new(count);
        chunks.into_iter().try_for_each(|chunk| assembler.push(chunk))?;
        assembler.finish()
    }

    proptest! {
        #[test]
        fn jobs_survive(
            camera in arbitrary::pinhole(),
            which in prop::collection::btree_set(0u32..640 * 480, 1..2000),
            side in 1u32..4,
        ) {
            let mut asked = job(640, 480, which.into_iter().collect());
            (asked.camera, asked.samples_per_pixel) = (camera, side * side);
            let [(request, count)] = &trace_requests(&asked, FRAME)[..] else { panic!("one request") };
            prop_assert_eq!(*count, asked.pixels.len());
            let (of, arrived) = trace_job(request.clone(), 0.5, &Limits::default()).unwrap();
            prop_assert_eq!(of, FRAME);
            prop_assert_eq!(arrived.camera, asked.camera);
            prop_assert_eq!((arrived.width, arrived.height, arrived.time_secs), (640, 480, 0.5));
            prop_assert_eq!(arrived.state, asked.state);
            prop_assert_eq!((arrived.pixels, arrived.samples_per_pixel), (asked.pixels, side * side));
        }

        #[test]
        fn any_runs_are_pixels_of_the_view_or_refused(runs in prop::collection::vec(any::<u32>(), 0..9)) {
            if let Ok(pixels) = taken(&runs, 100) {
                prop_assert!(pixels.windows(2).all(|w| w[0] < w[1]));
                prop_assert!(pixels.last().is_some_and(|&last| last < 100));
            }
        }
    }

    #[test]
    fn a_view_without_samples_is_requested_in_parts_and_joined() {
        let count = MAX_TRACE_PIXELS as u32 + 10;
        let requests = trace_requests(&job(1024, 1024, (5..5 + count).collect()), FRAME);
        assert_eq!(requests.iter().map(|(_, n)| *n).collect::<Vec<_>>(), [MAX_TRACE_PIXELS, 10]);
        assert_eq!(requests[0].0.runs, [5, MAX_TRACE_PIXELS as u32]);
        let (whole, ends) = (pixels(5), [2, 5]);
        let part = |from: usize, to: usize| Pixels {
            color: whole.color.slice(3 * from..3 * to),
            range: whole.range.slice(4 * from..4 * to),
            stages: Vec::new(),
        };
        let all = joined(vec![part(0, ends[0]), part(ends[0], ends[1])]);
        assert_eq!((all.color, all.range), (whole.color, whole.range));
    }

    #[test]
    fn a_malformed_request_is_refused_with_its_invalid_field() {
        let good = trace_requests(&job(10, 10, vec![0, 1, 99]), FRAME).remove(0).0;
        assert_eq!(good.runs, [0, 2, 97, 1]);
        assert_eq!(trace_job(good.clone(), 0.5, &Limits::default()).unwrap().1.pixels, [0, 1, 99]);
        let refused = |spoil: &dyn Fn(&mut v1::TraceRequest)| {
            let mut request = good.clone();
            spoil(&mut request);
            trace_job(request, 0.5, &Limits::default()).unwrap_err().field
        };
        let wrong: [&[u32]; 7] =
            [&[], &[0], &[0, 0], &[0, 2, 0, 1], &[0, 101], &[u32::MAX, u32::MAX], &[99, 2]];
        for runs in wrong {
            assert_eq!(refused(&|r| r.runs = runs.to_vec()), "runs", "{runs:?}");
        }
        let most = MAX_TRACE_PIXELS as u32;
        let large = |r: &mut v1::TraceRequest| (r.width, r.height, r.runs) = (1024, 1024, vec![0, most + 1]);
        assert_eq!(refused(&large), "runs");
        assert_eq!(refused(&|r| r.scene_hash = vec![1; 3].into()), "scene_hash");
        let no_hash = |r: &mut v1::TraceRequest| r.specification_hash.clear();
        assert_eq!(refused(&no_hash), "specification_hash");
        assert_eq!(refused(&|r| r.camera = None), "camera");
        assert_eq!(refused(&|r| r.width = 0), "width");
        assert_eq!(refused(&|r| r.samples_per_pixel = 0), "samples_per_pixel");
        assert_eq!(refused(&|r| r.samples_per_pixel = 5), "samples_per_pixel");
    }

    #[test]
    fn pixels_survive_and_malformed_chunks_are_refused() {
        // More than one chunk of each.
        let whole = pixels(400_000);
        let chunks = pixel_chunks(&whole).unwrap();
        assert_eq!(chunks.len(), 1 + 2 + 2);
        assert_eq!(receive(400_000, chunks.clone()).unwrap(), whole);
        assert!(matches!(receive(399_999, chunks.clone()), Err(WireError::Invalid(_))));
        for at in 0..chunks.len() {
            let mut lacking = chunks.clone();
            lacking.remove(at);
            assert!(receive(400_000, lacking).is_err(), "chunk {at} lost");
            let mut repeated = chunks.clone();
            repeated.insert(at, repeated[at].clone());
            assert!(receive(400_000, repeated).is_err(), "chunk {at} twice");
        }
        assert!(receive(3, vec![v1::TraceChunk { body: None }]).is_err());
        for bad in [f32::NAN, -1.0] {
            let spoilt = Pixels { range: bad.to_le_bytes().to_vec().into(), ..pixels(1) };
            let received = receive(1, pixel_chunks(&spoilt).unwrap());
            assert!(matches!(received, Err(WireError::Corrupt { .. })), "{bad}");
        }
        let uneven = Pixels { color: Bytes::new(), ..pixels(2) };
        assert!(matches!(pixel_chunks(&uneven), Err(WireError::Invalid(_))));
    }
}
