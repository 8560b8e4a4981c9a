//! Difficult surfaces: insides, floors through the near plane, grazing and coplanar planes, wires, depth edges
//! everywhere, walls between viewer and samples, an empty scene, one triangle, degenerate triangles.

use anyhow::Result;
use argus_scene::{Camera, Search};
use glam::DVec3;

use super::stage::{Exception, Limits, Pose, Stages};
use super::{Row, world};

/// The paper's search continues until it is behind the surface of every camera that looks there.
const SHEETS: &[Exception] = &[
    Exception {
        search: Search::Linear,
        wrong: 0.35,
        unresolved: 0.05,
        why: "a sheet that cameras see from both sides is inside no solid",
    },
    Exception {
        search: Search::Pyramid,
        wrong: 0.2,
        unresolved: 0.05,
        why: "a sheet that cameras see from both sides is inside no solid",
    },
];

/// Between two rows of the image, a grazing plane recedes by a fifth of its range.
const ROWS: &[Exception] = &[Exception {
    search: Search::Splat,
    wrong: 0.2,
    unresolved: 0.05,
    why: "a cell of several rows has one depth",
}];

/// A surface much nearer to the viewer than to the sample camera has gaps between its texels' cells.
const THROUGH: &[Exception] = &[
    Exception {
        search: Search::Splat,
        wrong: 0.2,
        unresolved: 1.0,
        why: "a surface that is much nearer to the viewer than to the camera is seen through between its texels",
    },
    Exception {
        search: Search::Seeded,
        wrong: 0.15,
        unresolved: 1.0,
        why: "the surface that the iteration settles on depends on where it starts",
    },
];

/// The viewer is a millimetre from a surface whose texels are centimetres wide.
const TOUCHING: &[Exception] = &[
    Exception {
        search: Search::Splat,
        wrong: 0.05,
        unresolved: 0.5,
        why: "texels are as wide as the viewer is high, or wider",
    },
    Exception {
        search: Search::Pyramid,
        wrong: 0.05,
        unresolved: 1.0,
        why: "the search takes the surface that the eye all but touches for hit by every ray: its texels are too coarse",
    },
    Exception {
        search: Search::Seeded,
        wrong: 0.05,
        unresolved: 0.55,
        why: "texels are as wide as the viewer is high, or wider",
    },
];

/// A grazed plane has texels as wide as the viewer is high, or wider.
const SKIMMING: &[Exception] = &[
    Exception {
        search: Search::Seeded,
        wrong: 0.25,
        unresolved: 1.0,
        why: "what no sample resolves is settled on the nearest surface that any of them has, in texels that are too coarse",
    },
    Exception {
        search: Search::Pyramid,
        wrong: 0.66,
        unresolved: 0.7,
        why: "texels are as wide as the viewer is high, or wider",
    },
];

/// No sample sees below a sheet, which this search does not notice.
const UNDER: &[Exception] = &[Exception {
    search: Search::Seeded,
    wrong: 0.32,
    unresolved: 0.15,
    why: "known failure: what no sample saw is settled on the nearest surface that any of them has",
}];

pub(super) fn run(stages: &mut Stages) -> Result<Vec<Row>> {
    let look = Camera::look_at;
    let slant = look(DVec3::new(-8.0, 7.0, -12.0), DVec3::new(0.0, 0.5, 0.0));
    let good = Limits::new(0.03, 0.05);
    let mut rows = Vec::new();
    let mut run_poses = |world, poses: &[Pose]| -> Result<()> {
        rows.extend(stages.run(world, poses)?);
        Ok(())
    };
    run_poses(
        world::hollow(),
        &[Pose::new(
            "eye inside geometry",
            look(DVec3::new(0.3, 1.5, 0.2), DVec3::new(2.0, 1.2, 0.4)),
            Limits::ranges(0.05, 1.0).but(THROUGH),
        )],
    )?;
    // Texels are centimetres wide, and the search steps by centimetres.
    let near = |wrong, unresolved| {
        Limits::new(wrong, unresolved).because("texels are as wide as the viewer is high, or wider")
    };
    run_poses(
        world::room_to_its_walls(),
        &[
            Pose::new(
                "floor through the near plane",
                look(DVec3::new(-1.0, 1e-3, 0.5), DVec3::new(2.0, 1e-3, 1.0)),
                near(0.46, 0.5).but(TOUCHING),
            )
            .of_samples(1),
            Pose::new(
                "wall through the near plane",
                look(DVec3::new(-6.0 + 1e-3, 2.0, 0.5), DVec3::new(-6.0 + 1e-3, 2.2, -3.0)),
                near(0.46, 0.5).but(TOUCHING),
            )
            .of_samples(1),
            Pose::new(
                "one of two samples behind the floor",
                look(DVec3::new(-1.0, 1e-3, 0.5), DVec3::new(2.0, 1e-3, 1.0)),
                Limits::new(0.55, 0.45)
                    .because("a sample that sees a sheet from behind marks the space before it as free")
                    .but(TOUCHING),
            )
            .of_samples(2),
        ],
    )?;
    let level = |height: f64| look(DVec3::new(-9.0, height, 0.0), DVec3::new(2.0, height * 0.5, 0.0));
    run_poses(
        world::plain(),
        &[
            Pose::new("grazing plane from 1 m", level(1.0), good.but(ROWS)),
            Pose::new("grazing plane from 10 cm", level(0.1), near(0.2, 0.45).but(SKIMMING)),
            Pose::new("grazing plane from 1 mm", level(1e-3), near(0.1, 0.65).but(SKIMMING)),
            Pose::new(
                "over the edge of a sheet",
                look(DVec3::new(-12.0, 0.1, 0.0), DVec3::ZERO),
                Limits::new(0.28, 0.15)
                    .because("just under a sheet is what cameras above it take for the sheet")
                    .but(UNDER),
            ),
        ],
    )?;
    run_poses(
        world::coplanar(),
        &[Pose::new("two coplanar surfaces", slant, Limits::ranges(0.02, 0.03).but(SHEETS))],
    )?;
    run_poses(world::wires(), &[Pose::new("thin wires", slant, Limits::ranges(0.06, 0.06))])?;
    run_poses(
        world::checkerboard(),
        &[Pose::new(
            "checkerboard of depths",
            slant,
            Limits::new(0.08, 0.05)
                .because("every square's rim is an edge of depth, and a pixel on it may show either side"),
        )],
    )?;
    run_poses(
        world::divided_room(),
        &[
            Pose::new(
                "samples on the far side of a wall",
                look(DVec3::new(-1.0, 2.4, 3.0), DVec3::new(1.0, 2.2, 5.0)),
                Limits::ranges(0.03, 1.0),
            )
            .of_samples(1),
            Pose::new(
                "samples on both sides of a wall",
                look(DVec3::new(-1.0, 2.4, 3.2), DVec3::new(1.0, 2.2, 5.0)),
                Limits::ranges(0.03, 0.1),
            )
            .of_samples(8),
        ],
    )?;
    run_poses(
        world::sky(),
        &[Pose::new(
            "sky only",
            look(DVec3::new(0.2, 0.1, 0.0), DVec3::new(1.0, 0.4, 0.3)),
            Limits::new(0.0, 0.0),
        )],
    )?;
    run_poses(
        world::one_triangle(),
        &[Pose::new("one triangle", look(DVec3::new(0.4, 0.3, 3.2), DVec3::ZERO), Limits::new(0.01, 0.01))],
    )?;
    run_poses(world::broken(), &[Pose::new("degenerate triangles", slant, good)])?;
    Ok(rows)
}
