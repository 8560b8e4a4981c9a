//! The cluster's decisions as a pure machine: `(state, event, now) → actions`.
//!
//! [`Core::step`] takes an [`Event`] and the time, and says what to do as [`Action`]s. It reads no clock,
//! opens no socket and throws no dice: the same events at the same times give the same actions, which is what
//! the tests here rely on.

mod config;
mod event;
mod machine;
pub mod quality;
mod samples;
pub mod smooth;
mod status;
mod time;
mod views;
mod workers;

pub use config::Config;
pub use event::{
    Action, Assignment, Client, Event, Failure, Hello, Order, Report, Role, Source, Ticket, WorkerId,
};
pub use machine::Core;
pub use samples::Refinements;
pub use status::{Counters, Status, WorkerStatus};
pub use time::Uptime;
pub use views::{SurveyWanted, plan, planner};
pub use workers::{balance, hysteresis};

#[cfg(test)]
mod scenarios;

#[cfg(test)]
mod tests {
    use argus_scene::{Bounds, Lighting, Rig, SampleSetInfo, Sampling, SceneHash, Visibility};
    use glam::DVec3;

    pub(super) fn set_info() -> SampleSetInfo {
        let bounds = Bounds { min: DVec3::splat(-10.0), max: DVec3::splat(10.0) };
        SampleSetInfo {
            scene: SceneHash([1; 32]),
            bounds,
            rig: Rig::TileCorners { bounds, tiles: [2, 2], height: 1.0, size: [40, 30] },
            epoch: 0,
            epoch_secs: 0.0,
            generation: 1,
            lighting: Lighting::default(),
            visibility: Visibility::default(),
            sampling: Sampling::default(),
            reflections: None,
        }
    }
}
