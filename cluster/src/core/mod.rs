//! The cluster's decisions as a pure machine: `(state, event, now) → actions`.
//!
//! [`Core::step`] takes an [`Event`] and the time, and says what to do as [`Action`]s. It reads no clock,
//! opens no socket and throws no dice: the same events at the same times give the same actions, which is what
//! the tests here rely on. The parts: [`balance`] says how many sample, [`hysteresis`] when that is worth a
//! change, `roles` who changes; `admission` keeps what clients may ask for; `dispatch` admits views and gives them to
//! workers, which `choose` picks from those at the front of `lines`; `whereabouts` knows who has which sample,
//! `directory` who renders it, `spread` how it reaches the others, `placement` where more samples are needed and
//! `refine` who gets them,
//! `epochs` which moment of an animated scene is served and `moments` what follows from it, [`plan`] how a view is
//! answered, with what error and cost [`quality`], `wishes` what becomes of requests that state what they want,
//! `status` tells it all.

mod admission;
pub mod balance;
mod calibrated_error;
mod cameras;
mod choose;
mod config;
mod copies;
mod directory;
mod dispatch;
mod epochs;
mod event;
pub mod hysteresis;
mod investments;
mod lines;
mod machine;
mod moments;
mod open;
mod pending;
mod placement;
pub mod plan;
pub mod planner;
pub mod quality;
mod refine;
mod roles;
mod silence;
pub mod smooth;
mod spread;
mod status;
mod suspicion;
mod time;
mod ways;
mod whereabouts;
mod wishes;
mod worker;

pub use admission::Client;
pub use config::Config;
pub use event::{
    Action, Assignment, Event, Failure, Hello, Order, Probed, Report, Role, Source, Ticket, WorkerId,
};
pub use machine::{Core, Counters};
pub use open::SurveyWanted;
pub use placement::Refinements;
pub use status::{Status, WorkerStatus};
pub use time::Uptime;

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
