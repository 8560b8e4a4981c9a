//! Images of unusual shape. Splitting large images into pieces must not change their bytes.

use std::sync::Arc;

use anyhow::Result;
use argus_compositor::{CompositorSettings, GpuCompositor, SearchBackend};
use argus_scene::sample::SampleSet;
use argus_scene::{Camera, Compositor as _, Search};
use glam::DVec3;

use super::oracle::Truth;
use super::stage::{Exception, Limits, Pose, Stages, compose_one, differing};
use super::{Row, world};

pub(super) fn run(stages: &mut Stages) -> Result<Vec<Row>> {
    let usual = Camera::look_at(DVec3::new(-9.0, 9.0, -13.0), DVec3::new(0.0, 0.5, 0.0));
    let limits = Limits::new(0.035, 0.65)
        .because(
            "a texel of the samples is as wide as six pixels and more here: rims are as wide, and the coarsest are marked",
        );
    let flat = Camera { fov_deg: 0.2, ..usual };
    // A pixel that shows the whole scene has the colour of its footprint, not of its central ray.
    let one = Limits::ranges(0.0, 0.0).but(&[Exception {
        search: Search::Splat,
        wrong: 0.0,
        unresolved: 1.0,
        why: "one cell holds all of the scene, and its nearest texel is not the one in its middle",
    }]);
    let poses = [
        Pose::new("1×1 pixel", usual, one).sized([1, 1]),
        Pose::new("8192×8 pixels", flat, limits).sized([8192, 8]),
        Pose::new("8×8192 pixels", Camera { fov_deg: 70.0, ..usual }, limits).sized([8, 8192]),
    ];
    let stage = stages.prepare(world::garden(), &poses)?;
    // Tiles of 512 pixels, at most four per submission.
    let settings = CompositorSettings {
        piece_side: 512,
        chunk_pixels: 4 * 512 * 8,
        search_backend: SearchBackend::Fragment,
        ..CompositorSettings::default()
    };
    let mut tiled = GpuCompositor::with_settings(Arc::clone(stages.gpu()), settings)?;
    tiled.hold(&SampleSet { info: Arc::clone(&stage.info), samples: stage.samples.clone() })?;
    let mut rows = Vec::new();
    for pose in &poses {
        let truth = Truth::of(&stage.tracer, &pose.camera, pose.size);
        for search in Search::ALL {
            let answer = stages.compose(&stage, pose, search)?;
            let judged = truth.judge(&answer.frame, pose.samples, pose.limits.colors);
            let row = answer.row(pose, search, judged);
            let (parts, _) = compose_one(&mut tiled, &stage.job(pose, search))?;
            let same = Row {
                case: format!("{}, in tiles", pose.name),
                measure: "differing bytes",
                oracle_error: differing(&answer.frame, &parts) as f64,
                tolerance: 0.0,
                ..row.clone()
            };
            rows.extend([row, same.judged()]);
        }
    }
    stages.release(&stage);
    Ok(rows)
}
