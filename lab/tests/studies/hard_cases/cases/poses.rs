//! Viewer positions: at a sample camera, outside and behind the rig, looking away, and fields of view of 1° and 179°.

use anyhow::{Context as _, Result};
use argus_scene::tone::display_from_radiance;
use argus_scene::{Camera, Output, PlaneData, PlaneKind, Sample, SampleCamera, Search};
use glam::{DVec3, Vec3};

use super::oracle::Judged;
use super::stage::{Exception, Limits, Pose, Stages};
use super::{Row, world};

/// A search for solids takes the lit side of a sheet for the start of a solid.
const SHEETS: &[Exception] = &[
    Exception {
        search: Search::Linear,
        wrong: 0.7,
        unresolved: 0.1,
        why: "from behind, a sheet is the end of a solid and not its beginning",
    },
    Exception {
        search: Search::Pyramid,
        wrong: 0.7,
        unresolved: 0.1,
        why: "from behind, a sheet is the end of a solid and not its beginning",
    },
    Exception {
        search: Search::Seeded,
        wrong: 0.4,
        unresolved: 0.1,
        why: "where it does not settle, its tail is the linear search, which sees no sheet from behind",
    },
];

pub(super) fn run(stages: &mut Stages) -> Result<Vec<Row>> {
    let look = Camera::look_at;
    let usual = look(DVec3::new(-9.0, 9.0, -13.0), DVec3::new(0.0, 0.5, 0.0));
    let garden = world::garden();
    let SampleCamera::Perspective { camera: own, width, height } = garden.rig.camera(0)? else {
        anyhow::bail!("tiles have perspective cameras")
    };
    let good = Limits::new(0.02, 0.02);
    let poses = [
        Pose::new("between the sample cameras", usual, good),
        Pose::new("at a sample camera", own, Limits::new(0.01, 0.01)),
        Pose::new(
            "a hair away from a sample camera",
            Camera { eye: own.eye + DVec3::splat(1e-7), ..own },
            Limits::new(0.01, 0.01),
        ),
        Pose::new(
            "outside the rig",
            look(DVec3::new(-19.0, 5.0, -17.0), DVec3::ZERO),
            Limits::new(0.035, 0.02)
                .because("depths are refined along a plane, which is off beside silhouettes"),
        ),
        Pose::new("behind the rig", look(own.eye * 3.0, DVec3::ZERO), good),
        Pose::new(
            "from below the ground",
            look(DVec3::new(3.0, -6.0, -5.0), DVec3::ZERO),
            Limits::ranges(0.03, 0.1).but(SHEETS),
        ),
        Pose::new(
            "looking away",
            look(DVec3::new(0.0, 6.0, 14.0), DVec3::new(0.0, 8.0, 40.0)),
            Limits::new(0.0, 0.0),
        ),
        Pose::new(
            "straight down",
            Camera { up: DVec3::X, ..look(DVec3::new(0.5, 12.0, 0.5), DVec3::new(0.5, 0.0, 0.5)) },
            good,
        ),
        Pose::new(
            "fov 1°",
            Camera { fov_deg: 1.0, ..usual },
            Limits::new(0.02, 1.0).because("a texel of the samples covers more than 16 pixels to a side"),
        ),
        Pose::new("fov 179°", Camera { fov_deg: 179.0, ..usual }, good),
        Pose::new(
            "from another continent",
            look(DVec3::new(1e7, 1e6, 0.0), DVec3::ZERO),
            Limits::new(0.01, 0.01),
        ),
    ];
    let mut rows = stages.run(garden.clone(), &poses)?;
    let alone = Pose::new("at a sample camera, that sample alone", own, Limits::new(0.0, 0.0))
        .sized([width, height])
        .of_samples(1);
    rows.extend(comes_back(stages, garden, &[alone], 0)?);
    Ok(rows)
}

/// A view with exactly a sample's rays must equal the sample within one colour step. The error is the share of pixels
/// that do not. `first`: the column and row of the sample's texel that is the view's first pixel.
pub(super) fn comes_back(
    stages: &mut Stages,
    world: world::World,
    poses: &[Pose],
    first: u32,
) -> Result<Vec<Row>> {
    let exposure = world.scene.lighting.exposure;
    let stage = stages.prepare(world, poses)?;
    let mut rows = Vec::new();
    for pose in poses {
        let sample = stage.samples.first().context("the stage has a sample")?;
        let stored = shown(sample, pose.size, first, exposure)?;
        for search in Search::ALL {
            let answer = stages.compose(&stage, pose, search)?;
            let color = answer.frame.images[Output::Color].as_ref().context("colour was asked for")?;
            let off = |(a, b): &(&[u8], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > 1);
            let wrong = color.chunks_exact(3).zip(&stored).filter(off).count();
            let judged = Judged {
                wrong: wrong as f64 / stored.len() as f64,
                unresolved: answer.frame.unresolved_fraction,
                malformed: 0,
            };
            rows.push(Row { measure: "pixels off by more than a step", ..answer.row(pose, search, judged) });
        }
    }
    stages.release(&stage);
    Ok(rows)
}

/// The displayed colours of a rectangle of a sample's texels.
fn shown(sample: &Sample, [width, height]: [u32; 2], first: u32, exposure: f32) -> Result<Vec<[u8; 3]>> {
    let plane = sample.plane(PlaneKind::Radiance).context("samples have radiance")?;
    let PlaneData::Host(bytes) = &plane.data else { anyhow::bail!("the plane is on the device") };
    let texel = |i: u32| {
        let at = 4 * ((first + i / width) * plane.size[0] + first + i % width) as usize;
        let word = u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let part = |shift: u32| ((word >> shift) & 511) as f32;
        let scale = 2f32.powi((word >> 27) as i32 - 24);
        display_from_radiance(Vec3::new(part(0), part(9), part(18)) * scale, exposure)
    };
    Ok((0..width * height).map(texel).collect())
}
