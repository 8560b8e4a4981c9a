//! Discrete-event simulation of a cluster: the real coordinator core ([`argus_cluster::core::Core`]) with simulated
//! workers, machines, links and clients.
//!
//! [`Parameters`] gives the costs. Roles, waits and the time of a tick follow from the simulation. `host` models a
//! machine's cores and link, `worker` a worker process, `world` the events, `load` the clients. `efficiency`
//! and `trouble` are the experiments.

pub mod efficiency;
mod host;
mod load;
mod parameters;
pub mod trouble;
mod work;
mod worker;
mod world;

#[cfg(test)]
mod tests;

use std::time::Duration;

use argus_scene::{Bounds, Rig, SampleSetInfo, SceneHash};
use glam::DVec3;

pub use parameters::{Machines, Parameters};

/// Simulated time since the start, in nanoseconds.
type Nanos = u64;

fn nanos(duration: Duration) -> Nanos {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

fn secs(secs: f64) -> Nanos {
    (secs * 1e9) as Nanos
}

/// The sample set: four cameras over a tile, or a lattice of cells with the given spacing in metres.
fn set_info(moves: bool, cell: Option<f64>) -> SampleSetInfo {
    let bounds = Bounds { min: DVec3::splat(-100.0), max: DVec3::splat(100.0) };
    let rig = match cell {
        Some(spacing) => Rig::Cell { origin: DVec3::ZERO, spacing, face: 64 },
        None => Rig::TileCorners { bounds, tiles: [1, 1], height: 1.0, size: [400, 300] },
    };
    SampleSetInfo {
        epoch_secs: if moves { 1e-3 } else { 0.0 },
        ..SampleSetInfo::plain(SceneHash([1; 32]), bounds, rig)
    }
}
