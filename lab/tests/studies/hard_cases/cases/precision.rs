//! Precision: the same view far from the origin, very small and very large must be as good as at the origin.

use anyhow::Result;
use argus_scene::{Camera, Search};
use glam::DVec3;

use super::Row;
use super::stage::{Limits, Pose, Stages};
use super::world::{self, World};

/// A pixel or two may fall on the other side of an edge, since rounding differs.
const ROUNDING: f64 = 0.002;

pub(super) fn run(stages: &mut Stages) -> Result<Vec<Row>> {
    let far = DVec3::splat(1e6);
    let places = [
        ("at (10⁶, 10⁶, 10⁶) m", 1.0, far),
        ("scaled by 10⁻³", 1e-3, DVec3::ZERO),
        ("scaled by 10³", 1e3, DVec3::ZERO),
    ];
    let tile = Camera::look_at(DVec3::new(-9.0, 9.0, -13.0), DVec3::new(0.0, 0.5, 0.0));
    let cell =
        Camera { fov_deg: 70.0, ..Camera::look_at(DVec3::new(-1.3, 2.0, 1.9), DVec3::new(1.0, 1.8, -3.0)) };
    let mut rows = Vec::new();
    let scenes: [(&str, &str, World, Camera); 2] = [
        ("garden", "garden at the origin", world::garden(), tile),
        ("room", "room at the origin", world::room(), cell),
    ];
    for (what, name, world, camera) in scenes {
        let pose = Pose::new(name, camera, Limits::new(0.02, 0.05));
        let here = stages.run(world.clone(), std::slice::from_ref(&pose))?;
        for (place, scale, offset) in places {
            let at = |p: DVec3| p * scale + offset;
            let camera = Camera { eye: at(camera.eye), target: at(camera.target), ..camera };
            let moved = Pose { camera, ..pose.clone() };
            let there = stages.run(world.clone().placed(scale, offset), &[moved])?;
            rows.extend(there.into_iter().filter_map(|row| {
                let origin = here.iter().find(|origin| origin.search == row.search)?;
                let case = format!("{what} {place}");
                let (tolerance, unresolved_tolerance) =
                    (origin.oracle_error + ROUNDING, origin.unresolved + ROUNDING);
                Some(Row { case, tolerance, unresolved_tolerance, ..row }.judged())
            }));
        }
        rows.extend(here);
    }
    debug_assert!(rows.iter().all(|row| Search::ALL.iter().any(|search| search.name() == row.search)));
    Ok(rows)
}
