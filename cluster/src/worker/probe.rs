//! Probes: measure in spare time how much the frames of a view err by several plans.
//!
//! Square parts of the view are rendered from triangles, with many samples a pixel as the reference and with one, as images of their own:
//! neighbours share rays of light there as in a view, and whole FLIP applies. The answered frame and the other plans are judged by the
//! same parts. Reference and other plans from triangles are rendered in slices like sources, so views wait for a slice at most.

use std::sync::Arc;
use std::time::Duration;

use argus_scene::{
    Camera, Frame, Holes, Intrinsics, Lens, Output, Outputs, Plan, SampleSetInfo, ViewJob, Warp,
};
use bytes::Bytes;
use glam::{DVec2, UVec2};
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, flip};
use tracing::debug;

use super::from_sources::{self, From};
use super::node::Node;
use super::order::Ordered;
use super::trace;
use crate::core::{ProbeResult, Source};
use crate::wire::Probe;

/// A probe is given up after this time.
const PATIENCE: Duration = Duration::from_secs(8);

/// Parts of a view that are judged, in two columns.
///
/// Of 200×150 pixels of terrain, in six directions, eight parts of 16 find the excess of half and quarter detail (.019, .062) with a mean
/// deviation of −.000 and +.002 and a root mean square of .005 and .011. Four parts of 32 take twice the time, and find it with .012 and
/// .025: where the parts lie matters more than how large they are.
const PARTS: u32 = 8;

/// Pixels along the side of a part.
const SIDE: u32 = 16;

/// Rows of a part that are rendered together.
const BAND_ROWS: u32 = 16;

/// Samples per pixel of the reference.
const REFERENCE_SAMPLES: u32 = 16;

/// A part of a view: first pixel and size.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Part {
    begin: UVec2,
    size: UVec2,
}

/// What a probe needs of its view.
struct View {
    job: ViewJob,
    info: Arc<SampleSetInfo>,
    /// Where other workers hold sources.
    others: Vec<Source>,
    tracers: Vec<String>,
    parts: Vec<Part>,
    /// The answered frame's colours of each part.
    answered: Vec<Bytes>,
}

/// Begins the probe of an order in the background, if it has one. A probe in progress precedes it.
pub(super) fn consider(node: &Arc<Node>, ordered: &Ordered, frame: &Frame) {
    let Some(Probe { view_id, attempt, plans }) = ordered.probe.clone() else { return };
    let job = &ordered.job;
    let parts = parts_of([job.width, job.height], view_id.0);
    let answered = frame.images[Output::Color].as_ref().map(|color| {
        parts.iter().map(|part| part.of_image(color, frame.width)).collect::<Option<Vec<Bytes>>>()
    });
    let (Some(Some(answered)), true) = (answered, job.camera.is_pinhole()) else { return };
    if !node.probes.begin() {
        return;
    }
    let view = View {
        job: ViewJob { outputs: Outputs::COLOR, history: None, rays: None, ..job.clone() },
        info: ordered.info.clone(),
        others: ordered.frames.clone(),
        tracers: ordered.tracers.clone(),
        parts,
        answered,
    };
    let node = node.clone();
    tokio::spawn(async move {
        let excess = tokio::time::timeout(PATIENCE, measured(&node, &view, &plans)).await.ok().flatten();
        debug!(view = view_id.0, ?excess, "probe");
        node.probes.end(excess.map(|excess| ProbeResult { view_id, attempt, excess }));
        node.news.notify_one();
    });
}

/// The excess errors of the answered frame and of other plans; `None` if the reference cannot be rendered.
async fn measured(node: &Arc<Node>, view: &View, plans: &[Plan]) -> Option<Vec<f32>> {
    let reference = from_triangles(node, view, &Plan::direct(REFERENCE_SAMPLES)).await?;
    let direct = from_triangles(node, view, &Plan::direct(1)).await?;
    let mut judged = vec![Some(view.answered.clone())];
    for plan in plans {
        judged.push(match plan {
            Plan::Direct { .. } => from_triangles(node, view, plan).await,
            Plan::Warp(warp) => from_sources(node, view, warp).await,
        });
    }
    let parts = view.parts.clone();
    let excess = move || -> Option<Vec<f32>> {
        let error = |shown: &[Bytes]| error_of(&parts, shown, &reference);
        let least = error(&direct)?;
        let excess = |shown: &Option<Vec<Bytes>>| Some((error(shown.as_ref()?)? - least) as f32);
        Some(judged.iter().map(|shown| excess(shown).unwrap_or(f32::NAN)).collect())
    };
    tokio::task::spawn_blocking(excess).await.ok().flatten()
}

/// Colours of the parts by a plan from triangles.
async fn from_triangles(node: &Node, view: &View, plan: &Plan) -> Option<Vec<Bytes>> {
    let mut all = Vec::with_capacity(view.parts.len());
    for part in &view.parts {
        let UVec2 { x: width, y: height } = part.size;
        let camera = part.camera(&view.job.camera, [view.job.width, view.job.height]);
        let band_rows = if plan.is_whole() { BAND_ROWS } else { 0 };
        let job = ViewJob { camera, width, height, band_rows, plan: plan.clone(), ..view.job.clone() };
        let frame = node.render_thread.render_in_slices(job, &view.info).await.ok()?;
        all.push(frame.images[Output::Color].clone()?);
    }
    Some(all)
}

/// Colours of the parts by a plan from sources. They are parts of the whole view, which takes a few milliseconds.
async fn from_sources(node: &Arc<Node>, view: &View, warp: &Warp) -> Option<Vec<Bytes>> {
    let traces = warp.holes == Holes::Trace;
    let outputs = if traces { view.job.outputs.with(Output::Mask) } else { view.job.outputs };
    let job = ViewJob { plan: Plan::Warp(warp.clone()), outputs, ..view.job.clone() };
    let from = From { others: &view.others, renders: false };
    let gathered = from_sources::gather(node, &job, warp, &view.info, from).await.ok()?;
    let rendered =
        node.render_thread.render_view(gathered.job, gathered.info, gathered.samples, false).await.ok()?;
    let mut frame = rendered.frame;
    if traces {
        trace::fill(node, &job, warp, &view.tracers, None, &mut frame).await.ok()?;
    }
    let color = frame.images[Output::Color].as_ref()?;
    view.parts.iter().map(|part| part.of_image(color, frame.width)).collect()
}

/// Mean FLIP of parts; `None` if one has another size.
fn error_of(parts: &[Part], shown: &[Bytes], reference: &[Bytes]) -> Option<f64> {
    let (mut sum, mut pixels) = (0.0, 0.0);
    for ((part, shown), reference) in parts.iter().zip(shown).zip(reference) {
        let count = f64::from(part.size.x * part.size.y);
        sum += count * flip_mean(part.size.to_array(), reference, shown)?;
        pixels += count;
    }
    (pixels > 0.0).then(|| sum / pixels)
}

/// Mean FLIP of an image in sRGB, 3 bytes a pixel; `None` if one of the two has another size, or no pixels.
fn flip_mean([width, height]: [u32; 2], reference: &[u8], shown: &[u8]) -> Option<f64> {
    let bytes = 3 * width as usize * height as usize;
    if bytes == 0 || [reference, shown].iter().any(|image| image.len() != bytes) {
        return None;
    }
    let image = |bytes: &[u8]| FlipImageRgb8::with_data(width, height, bytes);
    let errors = flip(image(reference), image(shown), DEFAULT_PIXELS_PER_DEGREE).to_vec();
    Some(errors.iter().map(|error| f64::from(*error)).sum::<f64>() / errors.len() as f64)
}

/// The parts of a view of this size: one in each of as many cells. `turn` moves them.
fn parts_of(size: [u32; 2], turn: u64) -> Vec<Part> {
    let size = UVec2::from(size);
    let of_part = size.min(UVec2::splat(SIDE));
    let part = |number: u32| {
        // Roberts' two-dimensional sequence (2018) spreads positions evenly.
        let step = (turn % (1 << 32) * u64::from(PARTS) + u64::from(number)) as f64;
        let share = DVec2::new(step * 0.754_877_666_246_69, step * 0.569_840_290_998_05).fract();
        let cell = DVec2::new(f64::from(number % 2), f64::from(number / 2)) + share;
        let place = cell / DVec2::new(2.0, f64::from(PARTS / 2)) * (size - of_part).as_dvec2();
        Part { begin: place.as_uvec2(), size: of_part }
    };
    (0..PARTS).map(part).collect()
}

impl Part {
    /// The camera of the part of a view of this size as an image of its own.
    fn camera(&self, camera: &Camera, [width, height]: [u32; 2]) -> Camera {
        let plane = camera.plane(width, height);
        let half_size = DVec2::new(f64::from(width), f64::from(height)) * 0.5;
        let focal = half_size / plane.half;
        let center = half_size - plane.center * focal - self.begin.as_dvec2();
        Camera { lens: Some(Lens::Intrinsics(Intrinsics::pinhole(focal, center))), ..*camera }
    }

    /// The part's pixels of an image with rows of `width` pixels.
    fn of_image(&self, color: &Bytes, width: u32) -> Option<Bytes> {
        let mut pixels = Vec::with_capacity(3 * (self.size.x * self.size.y) as usize);
        for row in self.begin.y..self.begin.y + self.size.y {
            let at = 3 * (row * width + self.begin.x) as usize;
            pixels.extend_from_slice(color.get(at..at + 3 * self.size.x as usize)?);
        }
        Some(pixels.into())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn parts_lie_within_the_view_at_every_turn_and_size() {
        for size in [[200, 150], [33, 32], [40, 5], [1, 1]] {
            for turn in [0, 1, 77, u64::MAX] {
                let parts = parts_of(size, turn);
                assert_eq!(parts.len(), PARTS as usize);
                let is_within = |part: &Part| (part.begin + part.size).cmple(UVec2::from(size)).all();
                assert!(parts.iter().all(is_within), "{parts:?}");
            }
        }
        assert_ne!(parts_of([200, 150], 0), parts_of([200, 150], 1));
    }

    #[test]
    fn a_part_looks_in_the_directions_of_its_pixels() {
        let camera = Camera::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO);
        let lens = Lens::Intrinsics(Intrinsics::pinhole(DVec2::new(150.0, 140.0), DVec2::new(90.0, 80.0)));
        for camera in [camera, Camera { lens: Some(lens), ..camera }] {
            for part in parts_of([200, 150], 3) {
                let of_part = part.camera(&camera, [200, 150]);
                for pixel in [DVec2::new(0.5, 0.5), DVec2::new(15.5, 7.25)] {
                    let whole = camera.direction(pixel + part.begin.as_dvec2(), 200, 150);
                    assert!((whole - of_part.direction(pixel, SIDE, SIDE)).length() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn pixels_of_a_part_are_those_of_the_image() {
        let color: Bytes = (0..10 * 8).flat_map(|pixel| [pixel as u8, 0, 0]).collect::<Vec<u8>>().into();
        let part = Part { begin: UVec2::new(3, 2), size: UVec2::new(4, 5) };
        let pixels = part.of_image(&color, 10).unwrap();
        assert_eq!((pixels[0], pixels[3], pixels[12], pixels.len()), (23, 24, 33, 60));
        assert_eq!(Part { begin: UVec2::new(0, 4), ..part }.of_image(&color, 10), None);
        let shown = std::slice::from_ref(&pixels);
        assert_eq!(error_of(&[part], shown, shown), Some(0.0));
        assert_eq!(error_of(&[part], &[pixels.slice(3..)], &[pixels]), None);
    }
}
