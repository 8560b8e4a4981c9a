//! The cluster's decisions as a pure machine: `(state, event, now) → actions`.

pub mod balance;
pub mod config;
pub mod hysteresis;
pub mod plan;
pub mod smooth;
mod time;

pub use config::Config;
pub use time::Uptime;

#[cfg(test)]
mod tests {
    use argus_scene::{Bounds, Lighting, Rig, SampleSetInfo, SceneHash};
    use glam::DVec3;

    pub(super) fn set_info() -> SampleSetInfo {
        let bounds = Bounds { min: DVec3::splat(-10.0), max: DVec3::splat(10.0) };
        SampleSetInfo {
            scene: SceneHash([1; 32]),
            bounds,
            rig: Rig::TileCorners { bounds, tiles: [2, 2], height: 1.0, size: [40, 30] },
            epoch: 0,
            generation: 1,
            lighting: Lighting::default(),
        }
    }
}
