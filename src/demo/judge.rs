//! Compares views of the crowd with their references.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::Context;
use argus_client::Client;
use argus_client::load::direct_view;
use argus_scene::{Frame, FrameSource, Outputs, Plan, PlanRequest, Provenance, View, metrics};
use image::RgbImage;

use crate::demo::crowd::Shown;
use crate::demo::kind::{KINDS, kind_of};
use crate::demo::references::References;
use crate::output::image_of;

/// Samples a side of a reference's pixel.
const REFERENCE_SIDE: u32 = 4;

/// A view with its reference and its errors.
pub(crate) struct Judged {
    pub(crate) viewer: u32,
    /// When it was due, seconds after the crowd began.
    pub(crate) due_secs: f64,
    /// The view as the crowd got it.
    pub(crate) shown: RgbImage,
    /// The reference: the view from triangles, sixteen samples a pixel.
    pub(crate) truth: RgbImage,
    /// Mean FLIP of the view as the crowd got it.
    pub(crate) flip: f64,
    /// Mean FLIP of the view from triangles at one sample a pixel: the cost of aliasing alone.
    pub(crate) flip_direct: f64,
    /// How the view was answered.
    pub(crate) kind: &'static str,
    /// The frame that the view was first of all warped from, as a view of its own; `None` of one from triangles or from a rig.
    pub(crate) source: Option<View>,
}

impl Judged {
    /// The error beyond that of the view from triangles; below 0 if it is better.
    pub(crate) fn excess(&self) -> f64 {
        self.flip - self.flip_direct
    }
}

/// Judges views. The service renders their references: the same cameras, at the moments that the frames show.
///
/// # Errors
/// There are no views, or a reference is not answered.
pub(crate) async fn all(
    client: &Client,
    references: &References,
    views: Vec<Shown>,
) -> anyhow::Result<Vec<Judged>> {
    anyhow::ensure!(!views.is_empty(), "none of the crowd's views was answered");
    let needed = views.iter().flat_map(|Shown { camera, frame, .. }| {
        [REFERENCE_SIDE, 1].map(|side| direct_view(frame, *camera, frame.provenance.state, side))
    });
    let images = references.images(client, &needed.collect::<Vec<_>>()).await?;
    tokio::task::spawn_blocking(move || compare(views, images)).await?
}

/// Compares views with their pairs of reference and view from triangles, on all cores.
fn compare(views: Vec<Shown>, images: Vec<RgbImage>) -> anyhow::Result<Vec<Judged>> {
    let (next, judged) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let (Some(view), Some([truth, direct])) = (views.get(i), images.get(2 * i..2 * i + 2)) else {
                return;
            };
            let one = judge(view, truth, direct);
            judged.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((i, one));
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| (0..cores).for_each(|_| drop(scope.spawn(work))));
    let mut judged = judged.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    judged.sort_by_key(|(i, _)| *i);
    judged.into_iter().map(|(_, one)| one).collect()
}

fn judge(view: &Shown, truth: &RgbImage, direct: &RgbImage) -> anyhow::Result<Judged> {
    let shown = image_of(&view.frame)?;
    Ok(Judged {
        viewer: view.viewer,
        due_secs: view.due_secs,
        flip: metrics::flip_mean(truth, &shown)?,
        flip_direct: metrics::flip_mean(truth, direct)?,
        kind: KINDS[kind_of(&view.frame)],
        source: source_of(&view.frame),
        shown,
        truth: truth.clone(),
    })
}

/// The first frame that a frame was warped from, as a view that shows it.
fn source_of(frame: &Frame) -> Option<View> {
    let Plan::Warp(warp) = &frame.provenance.plan else { return None };
    let source: &FrameSource = warp.frames.first()?;
    let pin =
        Provenance { plan: source.plan(), device: String::new(), history: false, ..frame.provenance.clone() };
    let plan = PlanRequest { direct: true, ..PlanRequest::default() };
    let view = View::new(source.camera, [source.width, source.height], plan);
    Some(View { outputs: Outputs::COLOR, pin: Some(pin), ..view })
}

/// A row of the contact sheet.
pub(crate) struct Row {
    /// The source that the view was first of all warped from.
    pub(crate) source: Option<RgbImage>,
    pub(crate) shown: RgbImage,
    pub(crate) reference: RgbImage,
    /// FLIP map of the two.
    pub(crate) difference: RgbImage,
    pub(crate) caption: String,
}

/// Rows of some judged views: of all parts of the crowd's time, and at last the worst.
///
/// # Errors
/// A source is not rendered.
pub(crate) async fn rows(
    client: &Client,
    references: &References,
    judged: &[Judged],
    count: usize,
) -> anyhow::Result<Vec<Row>> {
    let worst = judged.iter().enumerate().max_by(|a, b| a.1.excess().total_cmp(&b.1.excess()));
    let worst = worst.context("there are no judged views")?.0;
    let spread = count.saturating_sub(1).min(judged.len() - 1);
    let mut picked: Vec<usize> = (0..spread).map(|i| (2 * i + 1) * judged.len() / (2 * spread)).collect();
    picked.push(worst);
    let sources: Vec<View> = picked.iter().filter_map(|i| judged[*i].source.clone()).collect();
    let mut sources = references.images(client, &sources).await?.into_iter();
    let row = |(place, i): (usize, usize)| {
        let view = &judged[i];
        let note = if place == spread { "worst: " } else { "" };
        Ok(Row {
            source: view.source.as_ref().and_then(|_| sources.next()),
            shown: view.shown.clone(),
            reference: view.truth.clone(),
            difference: metrics::flip_map(&view.truth, &view.shown)?,
            caption: format!(
                "{note}{:.1} s, viewer {}, {}: mean FLIP {:.3}, from triangles {:.3}",
                view.due_secs, view.viewer, view.kind, view.flip, view.flip_direct
            ),
        })
    };
    picked.into_iter().enumerate().map(row).collect()
}
