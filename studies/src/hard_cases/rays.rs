//! Rays along the planes and borders of a search's data structures: of the bounds, of tiles, of the lattice, and of the
//! texels under a pyramid's cells.

use anyhow::Result;
use argus_scene::{Camera, Rig, Search};
use glam::DVec3;

use super::Row;
use super::stage::{Exception, Limits, Pose, Stages};
use super::world::{self, FACE, World};

/// Past an edge the iteration may settle on either side.
const EDGE: &[Exception] =
    &[Exception { search: Search::Seeded, wrong: 0.06, unresolved: 0.05, why: SETTLES }];

const SETTLES: &str = "the surface that the iteration settles on depends on where it starts";

/// No sample covers half of the view, which this search does not notice.
const BESIDE: &[Exception] = &[Exception {
    search: Search::Seeded,
    wrong: 0.37,
    unresolved: 0.2,
    why: "known failure: what no sample saw is settled on the nearest surface that any of them has",
}];

pub(super) fn run(stages: &mut Stages) -> Result<Vec<Row>> {
    let look = Camera::look_at;
    let garden = world::garden();
    let top = garden.scene.bounds().max.y;
    let along = |eye: DVec3, by: DVec3| look(eye, eye + by);
    let tiled = World {
        rig: match garden.rig {
            Rig::TileCorners { bounds, height, size, .. } => {
                Rig::TileCorners { bounds, tiles: [2, 2], height, size }
            }
            cell => cell,
        },
        ..garden.clone()
    };
    let grazing = Limits::new(0.05, 0.05).but(EDGE);
    let mut rows = stages.run(
        garden,
        &[
            Pose::new("along the top of the bounds", along(DVec3::new(-14.0, top, 0.0), DVec3::X), grazing),
            Pose::new(
                "along the side of the bounds",
                along(DVec3::new(-10.0, 2.0, -10.0), DVec3::Z),
                grazing,
            ),
        ],
    )?;
    rows.extend(
        stages.run(
            tiled,
            &[
                Pose::new(
                    "along the border of two tiles",
                    along(DVec3::new(0.0, 4.0, -14.0), DVec3::new(0.0, -0.2, 1.0)),
                    Limits::new(0.18, 0.2)
                        .because("half of the view is another tile's than the samples'")
                        .but(BESIDE),
                ),
                Pose::new(
                    "in the corner of four tiles",
                    along(DVec3::new(0.0, 6.0, 0.0), DVec3::new(1.0, -0.6, 0.0)),
                    grazing,
                ),
            ],
        )?,
    );
    let room = world::room();
    let Rig::Cell { origin, spacing, .. } = room.rig else { return Ok(rows) };
    // One pixel fewer than the face has texels, and a field of view that is narrower by as much. Pixel centres then
    // lie on edges of texels, and a sideways move keeps every ray on a row or column of them.
    let edge = FACE - 1;
    let fov_deg = 2.0 * (f64::from(edge) / (f64::from(FACE) - 2.0)).atan().to_degrees();
    let straight = |eye: DVec3| Camera { fov_deg, ..look(eye, eye - DVec3::Z) };
    let close = Limits::new(0.02, 0.08);
    rows.extend(
        stages.run(
            room,
            &[
                Pose::new("along rows of texels", straight(origin + DVec3::X * 0.3), close)
                    .sized([edge, edge]),
                Pose::new("along columns of texels", straight(origin + DVec3::Y * 0.3), close)
                    .sized([edge, edge]),
                Pose::new("towards the middle of a face", straight(origin - DVec3::Z * 0.4), close)
                    .sized([edge, edge]),
                Pose::new(
                    "along a plane of the lattice",
                    along(origin + DVec3::X * (spacing * 0.5), DVec3::NEG_Z),
                    close.but(EDGE),
                ),
                Pose::new(
                    "along a line of the lattice",
                    along(origin + DVec3::Z * (spacing * 0.25), DVec3::NEG_Z),
                    close,
                ),
            ],
        )?,
    );
    Ok(rows)
}
