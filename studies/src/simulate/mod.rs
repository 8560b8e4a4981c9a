//! A cluster simulated event by event: the coordinator's real core ([`argus_cluster::core::Core`], the very code that
//! runs in production), and workers, machines, links and clients that are simulated.
//!
//! What things cost is given ([`Parameters`]); what comes of it is not: who does what, who waits for whom, how long a
//! tick takes. `host` is a machine's cores and link, `worker` what a worker process does with its orders, `world` the
//! events, `load` the clients, `efficiency`, `trouble` and `change` the experiments.

pub mod change;
pub mod efficiency;
mod host;
mod load;
mod parameters;
pub mod trouble;
mod worker;
mod world;

use std::time::Duration;

use argus_scene::{
    Bounds, Indirect, Lighting, Rig, SampleSetInfo, Sampling, SceneHash, Specification, Version, Visibility,
};
use glam::DVec3;

pub use parameters::{Machines, Parameters};

/// Simulated time since the beginning, nanoseconds.
type Nanos = u64;

fn nanos(duration: Duration) -> Nanos {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

fn secs(secs: f64) -> Nanos {
    (secs * 1e9) as Nanos
}

/// The set that simulated samples belong to: four cameras over a tile, or a lattice of cells.
fn set_info(moves: bool, cell: Option<f64>) -> SampleSetInfo {
    let bounds = Bounds { min: DVec3::splat(-100.0), max: DVec3::splat(100.0) };
    let rig = match cell {
        Some(spacing) => Rig::Cell { origin: DVec3::ZERO, spacing, face: 64 },
        None => Rig::TileCorners { bounds, tiles: [1, 1], height: 1.0, size: [400, 300] },
    };
    SampleSetInfo {
        scene: SceneHash([1; 32]),
        bounds,
        rig,
        version: Version::of_epoch(0, 0),
        epoch_secs: if moves { 1e-3 } else { 0.0 },
        lighting: Lighting::default(),
        visibility: Visibility::default(),
        sampling: Sampling::default(),
        sub_samples: Specification::USUAL_SUB_SAMPLES,
        indirect: Indirect::Off,
        reflections: None,
    }
}
