//! Traces the pixels of a frame that no sample saw.
//!
//! The cost depends on the number of holes, not on the size of the view. Workers that trace are asked one after the
//! other. If none traces, the frame keeps its marked holes, and its provenance says so.

use std::sync::Arc;
use std::time::Duration;

use argus_proto::chunks::{PixelAssembler, TracedFrame, joined, trace_requests};
use argus_proto::convert::light_level;
use argus_proto::trace::within;
use argus_proto::v1::samples_client::SamplesClient;
use argus_proto::{Fault, v1};
use argus_scene::{Frame, Output, PixelJob, Pixels, SceneState, Stage, ViewJob, Warp};
use bytes::Bytes;
use tokio::time::Instant;
use tracing::{Span, warn};

use super::node::{Node, check_specification};
use crate::rate_limited_log::RateLimitedLog;

/// Mask of a pixel that no sample saw and that is guessed.
const GUESSED: u8 = 255;
/// Mask of a pixel that no sample saw and that was traced.
const TRACED: u8 = 128;
/// Greatest confidence.
const EXACT: u8 = 255;

/// Traces the pixels that the frame's mask marks as guessed. The frame must have a mask. Asks `tracers` in order, no
/// later than `until`; without tracers, this worker traces.
///
/// # Errors
/// The error of the last tracer. The frame is then unchanged.
pub(super) async fn fill(
    node: &Arc<Node>,
    job: &ViewJob,
    warp: &Warp,
    tracers: &[String],
    until: Option<Instant>,
    frame: &mut Frame,
) -> Result<(), Fault> {
    let began = Instant::now();
    let pixels = guessed(frame);
    if pixels.is_empty() {
        return Ok(());
    }
    let job = PixelJob {
        camera: job.camera,
        width: job.width,
        height: job.height,
        pixels,
        samples_per_pixel: warp.supersampling * warp.supersampling,
        state: job.state,
        time_secs: job.time_secs,
        reflections: job.reflections,
    };
    let specification = frame.provenance.specification.unwrap_or_default().hash();
    let of = TracedFrame { scene: frame.provenance.scene, specification };
    let this_worker = [node.hello.address.clone()];
    let tracers = if tracers.is_empty() { &this_worker[..] } else { tracers };
    let mut last = Fault::Unavailable("no worker traces pixels".to_owned());
    for address in tracers {
        let left = until.map_or(Duration::MAX, |until| until.saturating_duration_since(Instant::now()));
        let attempt = async {
            match *address == node.hello.address {
                true => node.render_thread.render_pixels(&job).await,
                false => node.unless_suspected(address, by_other_worker(node, &job, of, address)).await,
            }
        };
        let traced =
            tokio::time::timeout(left.min(node.config.trace_timeout), attempt).await.unwrap_or_else(|_| {
                Err(Fault::Unavailable(format!("{address} did not trace the pixels in time")))
            });
        match traced {
            Ok(traced) => {
                patch(frame, &job.pixels, &traced);
                frame.stages.push(Stage::new("trace holes", began.elapsed().as_secs_f64() * 1e3));
                return Ok(());
            }
            Err(fault) => {
                static UNTRACED: RateLimitedLog = RateLimitedLog::new();
                if let Some(left_out) = UNTRACED.now() {
                    warn!(address, %fault, left_out, "a worker did not trace pixels that no sample saw");
                }
                last = fault;
            }
        }
    }
    Err(last)
}

/// Indices of the guessed pixels, ascending.
pub(super) fn guessed(frame: &Frame) -> Vec<u32> {
    let mask = frame.images[Output::Mask].as_deref().unwrap_or_default();
    (0..).zip(mask).filter(|(_, value)| **value == GUESSED).map(|(pixel, _)| pixel).collect()
}

/// Traces pixels at another worker.
async fn by_other_worker(
    node: &Node,
    job: &PixelJob,
    of: TracedFrame,
    address: &str,
) -> Result<Pixels, Fault> {
    let mut client = SamplesClient::new(node.channels.to(address)?);
    let unavailable = |status: tonic::Status| Fault::Unavailable(status.message().to_owned());
    let mut parts = Vec::new();
    for (request, count) in trace_requests(job, of) {
        let mut chunks =
            client.trace(within(&Span::current(), request)).await.map_err(unavailable)?.into_inner();
        let mut assembler = PixelAssembler::new(count);
        while let Some(chunk) = chunks.message().await.map_err(unavailable)? {
            assembler.push(chunk)?;
        }
        parts.push(assembler.finish()?);
    }
    Ok(joined(parts))
}

/// Checks a request and makes its job.
///
/// # Errors
/// [`Fault::NotFound`] for a scene, epoch or specification that is not served; [`Fault::Invalid`] for a malformed
/// request.
pub(super) fn check(node: &Node, request: v1::TraceRequest) -> Result<PixelJob, Fault> {
    let (epoch, revision) = (request.epoch, request.revision);
    let state = SceneState { epoch, light: light_level(request.light, "light")?, revision };
    let (info, limits) = node.served.set_showing(state)?;
    let (TracedFrame { scene, specification }, job) =
        argus_proto::chunks::trace_job(request, info.time_secs(), &limits)?;
    if scene != info.scene {
        return Err(Fault::NotFound(format!("this worker does not serve scene {scene}")));
    }
    check_specification(&info, specification)?;
    Ok(PixelJob { reflections: info.reflections, ..job })
}

/// Replaces the pixels at `pixels` by as many traced ones. Radiance, which is not traced with them, and what the triangles decide stay.
fn patch(frame: &mut Frame, pixels: &[u32], traced: &Pixels) {
    let all = |byte: u8| Bytes::from(vec![byte; pixels.len()]);
    for output in Output::ALL {
        let found = match output {
            Output::Color => traced.color.clone(),
            Output::Range => traced.range.clone(),
            Output::Mask => all(TRACED),
            Output::Source => all(0),
            Output::Confidence => all(EXACT),
            Output::Radiance | Output::Normal | Output::Instance | Output::Material => continue,
            // These are made of range once it is complete.
            Output::Depth | Output::Flow => continue,
        };
        place(frame, output, pixels, |i| found.get(i..i + output.pixel_bytes()));
    }
    let count = pixels.len() as u64;
    frame.served.traced += count;
    frame.served.unresolved = frame.served.unresolved.saturating_sub(count);
    // All guessed pixels are traced now.
    frame.unresolved_fraction = 0.0;
}

/// Replaces pixels of an image by those of another one of the whole view.
pub(super) fn place_traced(frame: &mut Frame, output: Output, pixels: &[u32], whole: Option<Bytes>) {
    let (Some(whole), bytes) = (whole, output.pixel_bytes()) else { return };
    place(frame, output, pixels, |i| {
        let at = *pixels.get(i / bytes)? as usize * bytes;
        whole.get(at..at + bytes)
    });
}

/// Replaces pixels of an image. `found` gives the bytes of the i-th byte's pixel, where i counts those of all replaced ones.
fn place<'a>(frame: &mut Frame, output: Output, pixels: &[u32], found: impl Fn(usize) -> Option<&'a [u8]>) {
    let Some(image) = &mut frame.images[output] else { return };
    let (bytes, mut patched) = (output.pixel_bytes(), Vec::from(std::mem::take(image)));
    for (i, &pixel) in pixels.iter().enumerate() {
        let at = pixel as usize * bytes;
        if let (Some(to), Some(from)) = (patched.get_mut(at..at + bytes), found(i * bytes)) {
            to.copy_from_slice(from);
        }
    }
    *image = patched.into();
}

#[cfg(test)]
mod tests {
    use argus_scene::{Images, Plan, Provenance, SceneHash, Served};

    use super::*;

    #[test]
    fn traced_pixels_replace_guesses_in_every_image() {
        let bytes = |n: usize, value: u8| Bytes::from(vec![value; n]);
        let mut frame = Frame {
            images: Images::from([
                (Output::Color, bytes(12, 9)),
                (Output::Range, bytes(16, 0)),
                (Output::Mask, Bytes::from_static(&[0, 255, 0, 255])),
                (Output::Source, bytes(4, 3)),
                (Output::Confidence, Bytes::from_static(&[200, 0, 100, 0])),
            ]),
            unresolved_fraction: 0.5,
            served: Served { warped: 2, unresolved: 2, ..Served::default() },
            ..Frame::without_images(
                2,
                2,
                Provenance::of_plan(SceneHash([0; 32]), SceneState::default(), Plan::Warp(Warp::default())),
            )
        };
        let pixels = guessed(&frame);
        assert_eq!(pixels, [1, 3]);
        let traced = Pixels {
            color: Bytes::from_static(&[1, 2, 3, 4, 5, 6]),
            range: [1.5_f32, f32::INFINITY].iter().flat_map(|r| r.to_le_bytes()).collect(),
            stages: Vec::new(),
        };
        patch(&mut frame, &pixels, &traced);
        assert_eq!(frame.images[Output::Color].as_deref(), Some(&[9, 9, 9, 1, 2, 3, 9, 9, 9, 4, 5, 6][..]));
        let ranges: Vec<f32> = frame.images[Output::Range]
            .iter()
            .flat_map(|r| r.as_chunks::<4>().0)
            .map(|bytes| f32::from_le_bytes(*bytes))
            .collect();
        assert_eq!(ranges, [0.0, 1.5, 0.0, f32::INFINITY]);
        assert_eq!(frame.images[Output::Mask].as_deref(), Some(&[0, TRACED, 0, TRACED][..]));
        assert_eq!(frame.images[Output::Source].as_deref(), Some(&[3, 0, 3, 0][..]));
        assert_eq!(frame.images[Output::Confidence].as_deref(), Some(&[200, EXACT, 100, EXACT][..]));
        assert_eq!(frame.served, Served { warped: 2, traced: 2, ..Served::default() });
        assert_eq!(frame.unresolved_fraction, 0.0);
        assert!(guessed(&frame).is_empty());
    }
}
