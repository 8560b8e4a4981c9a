//! Omnidirectional samples: seams between faces, poles, and corners of three faces. A dual paraboloid must be refused by
//! name, since its texels are not a planar projection.

use std::sync::Arc;

use anyhow::Result;
use argus_compositor::GpuCompositor;
use argus_scene::sample::{Plane, PlaneData, PlaneFormat, PlaneKind, Sample, SampleSet};
use argus_scene::{Camera, Compositor as _, FaceMask, OmniLayout, RenderError, Rig, SampleCamera};
use glam::DVec3;

use super::stage::{Limits, Pose, Stages};
use super::world::{self, FACE};
use super::{Outcome, Row, poses};

pub(super) fn run(stages: &mut Stages) -> Result<Vec<Row>> {
    let room = world::room();
    let Rig::Cell { origin, .. } = room.rig else { anyhow::bail!("a room has a lattice") };
    let eye = origin + DVec3::new(0.35, -0.2, 0.3);
    let towards = |direction: DVec3| Camera { fov_deg: 80.0, ..Camera::look_at(eye, eye + direction) };
    let upright = |direction: DVec3| Camera { up: DVec3::Z, ..towards(direction) };
    let close = Limits::new(0.02, 0.06);
    let views = [
        Pose::new("across a seam of two sides", towards(DVec3::new(1.0, 0.0, 1.0)), close),
        Pose::new("across a seam of a side and the top", towards(DVec3::new(-1.0, 1.0, 0.0)), close),
        Pose::new("across a seam of a side and the bottom", towards(DVec3::new(0.0, -1.0, -1.0)), close),
        Pose::new("into a corner of three faces", towards(DVec3::new(1.0, 1.0, -1.0)), close),
        Pose::new("into the opposite corner", towards(DVec3::new(-1.0, -1.0, 1.0)), close),
        Pose::new("upper pole", upright(DVec3::Y), close),
        Pose::new("lower pole", upright(DVec3::NEG_Y), close),
        Pose::new(
            "all faces at once",
            Camera { fov_deg: 150.0, ..towards(DVec3::new(0.7, 0.3, -1.0)) },
            Limits::new(0.03, 0.06),
        ),
    ];
    let mut rows = stages.run(room.clone(), &views)?;
    // Face +x starts at the cube's first texel. The ring around a face repeats its neighbours.
    let own = Camera { fov_deg: 90.0, ..Camera::look_at(origin, origin + DVec3::X) };
    let face = Pose::new("a face of a sample, from its centre", own, Limits::new(0.0, 0.0))
        .sized([FACE - 2, FACE - 2])
        .of_samples(1);
    rows.extend(poses::comes_back(stages, room, &[face], 1)?);
    rows.push(paraboloid(stages)?);
    Ok(rows)
}

/// Every search must refuse a dual paraboloid, naming the field at fault.
fn paraboloid(stages: &mut Stages) -> Result<Row> {
    let stage = stages.prepare(world::sky(), &[])?;
    let camera = SampleCamera::Omni { center: DVec3::ZERO, layout: OmniLayout::DualParaboloid { side: 16 } };
    let plane = |kind, format| {
        let data = PlaneData::Host(vec![0; 32 * 16 * 4].into());
        Plane { kind, format, size: [32, 16], data }
    };
    let planes = vec![
        plane(PlaneKind::Radiance, PlaneFormat::Rgb9e5Ufloat),
        plane(PlaneKind::InverseRange, PlaneFormat::R32Float),
    ];
    let id = argus_scene::SampleId { version: stage.info.version.number, camera: 0 };
    let sample = Arc::new(Sample { id, camera, faces: FaceMask::ALL, planes, stages: Vec::new() });
    let mut compositor = GpuCompositor::new(Arc::clone(stages.gpu()))?;
    let outcome = compositor.hold(&SampleSet { info: Arc::clone(&stage.info), samples: vec![sample] });
    let refused = matches!(outcome, Err(RenderError::Invalid(invalid)) if invalid.field == "sample.camera");
    Ok(Row {
        theme: None,
        case: "the rim of a paraboloid is refused by name".to_owned(),
        search: "any",
        measure: "not refused",
        oracle_error: f64::from(u8::from(!refused)),
        tolerance: 0.0,
        unresolved: 0.0,
        unresolved_tolerance: 0.0,
        malformed: 0,
        twin_bytes: 0,
        ms: 0.0,
        why: "",
        outcome: Outcome::default(),
    }
    .judged())
}
