//! Image checks: every visibility backend and search against the reference.

use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_compositor::SearchBackend;
use argus_scene::metrics::Comparison;
use argus_scene::sample::{PlaneData, PlaneKind, Sample};
use argus_scene::{Frame, Output, RenderError, SampleCamera, Search, Visibility, Warp};

use super::check::{Checks, Limit};
use super::limits;
use super::stage::{SIZE, Stage};

/// Checks views from triangles by each visibility backend. Returns the names of the backends that the device has.
pub(super) fn triangles(stage: &mut Stage, checks: &mut Checks) -> Vec<&'static str> {
    let mut found = Vec::new();
    let mut rasterised = None;
    for backend in Visibility::ALL {
        let name = format!("triangles by {}", backend.name());
        let camera = stage.cameras[0];
        let begin = Instant::now();
        let ids = match stage.sampler.identify(&camera, SIZE, 1, backend) {
            Ok((ids, _)) => ids,
            Err(RenderError::Invalid(reason)) => {
                checks.absent(&name, reason.to_string());
                continue;
            }
            Err(error) => {
                checks.attempt::<()>(&name, || Err(error.into()));
                continue;
            }
        };
        found.push(backend.name());
        match &rasterised {
            None => rasterised = Some(ids),
            Some(first) => {
                let apart = first.iter().zip(&ids).filter(|(a, b)| a != b).count();
                let share = apart as f64 / ids.len().max(1) as f64;
                let limit = Limit::AtMost(limits::DIFFERING_IDS);
                checks.figure(&format!("{name}: seen otherwise than by raster"), share, "", limit, begin);
            }
        }
        let begin = Instant::now();
        let judged = stage.direct(backend).and_then(|frames| stage.judge(&frames));
        compare(checks, &name, judged, [limits::DIRECT_FLIP, limits::DIRECT_PSNR_DB], begin);
    }
    found
}

/// Checks a sample's ranges.
pub(super) fn samples(stage: &mut Stage, checks: &mut Checks) {
    let name = "a sample: ranges off the reference";
    let begin = Instant::now();
    match stage.samples(true).and_then(|samples| share_off(stage, samples.first().context("no sample")?)) {
        Ok(share) => checks.figure(name, share, "", Limit::AtMost(limits::SAMPLE_OFF), begin),
        Err(error) => drop(checks.attempt::<()>(name, || Err(error))),
    }
}

/// Share of a sample's texels whose range differs from the reference by more than 1%, or where only one of them is sky.
fn share_off(stage: &Stage, sample: &Sample) -> Result<f64> {
    let SampleCamera::Perspective { camera, width, height } = sample.camera else {
        anyhow::bail!("the terrain's samples are perspective images");
    };
    let plane = sample.plane(PlaneKind::InverseRange).context("the sample has no ranges")?;
    let PlaneData::Host(bytes) = &plane.data else { anyhow::bail!("the sample was not read back") };
    let (values, _) = bytes.as_chunks::<4>();
    let truth = stage.ranges(&camera, [width, height]).range;
    anyhow::ensure!(values.len() == truth.len(), "{} ranges for {} texels", values.len(), truth.len());
    let off = values.iter().zip(&truth).filter(|(inverse, truth)| {
        let inverse = f32::from_le_bytes(**inverse);
        match truth.is_finite() {
            true => !((inverse * **truth - 1.0).abs() <= 0.01),
            false => inverse != 0.0,
        }
    });
    Ok(off.count() as f64 / truth.len() as f64)
}

/// Checks views from samples by each search, and its two programs against each other.
pub(super) fn searches(stage: &mut Stage, checks: &mut Checks) {
    let compositors = [SearchBackend::Fragment, SearchBackend::Compute]
        .map(|search_backend| stage.compositor(search_backend));
    let [Ok(mut fragment), Ok(mut compute)] = compositors else {
        for error in compositors.into_iter().filter_map(Result::err) {
            checks.attempt::<()>("samples are held", || Err(error));
        }
        return;
    };
    for search in Search::ALL {
        let name = format!("a view from samples by {}", search.name());
        let warp = Warp { search, steps: search.usual_steps(), ..Warp::default() };
        let begin = Instant::now();
        let frames = stage.warped(&mut fragment, &warp);
        let judged = frames.as_ref().map_err(|error| anyhow::anyhow!("{error:#}"));
        let judged = judged.and_then(|frames| stage.judge(frames));
        compare(checks, &name, judged, [limits::WARP_FLIP, limits::WARP_PSNR_DB], begin);
        let Ok(frames) = frames else { continue };
        let begin = Instant::now();
        let name = format!("{}: fragment against compute", search.name());
        match stage.warped(&mut compute, &warp) {
            Ok(again) => {
                let limit = Limit::AtMost(limits::DIFFERING_BYTES);
                checks.figure(&name, differing(&frames, &again), "", limit, begin);
            }
            Err(error) => drop(checks.attempt::<()>(&name, || Err(error))),
        }
    }
}

/// Share of differing colour bytes; 1 if the images differ in size.
fn differing(a: &[Frame], b: &[Frame]) -> f64 {
    let bytes = |frames: &[Frame]| -> Vec<u8> {
        frames
            .iter()
            .flat_map(|frame| frame.images[Output::Color].iter().flat_map(|color| color.to_vec()))
            .collect()
    };
    let (a, b) = (bytes(a), bytes(b));
    if a.len() != b.len() || a.is_empty() {
        return 1.0;
    }
    a.iter().zip(&b).filter(|(a, b)| a != b).count() as f64 / a.len() as f64
}

/// Adds checks of FLIP and PSNR, or one failed check with the reason why nothing was rendered.
fn compare(checks: &mut Checks, name: &str, judged: Result<Comparison>, limits: [f64; 2], begin: Instant) {
    match judged {
        Ok(judged) => {
            checks.figure(&format!("{name}: FLIP"), judged.flip_mean, "", Limit::AtMost(limits[0]), begin);
            let limit = Limit::AtLeast(limits[1]);
            checks.figure(&format!("{name}: PSNR"), judged.psnr_db, "dB", limit, begin);
        }
        Err(error) => drop(checks.attempt::<()>(name, || Err(error))),
    }
}
