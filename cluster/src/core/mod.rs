//! The cluster's decisions as a pure machine: `(state, event, now) → (state, actions)`.
//!
//! [`Core::step`] takes an [`Event`] and the time, and returns [`Action`]s. It reads no clock, opens no socket and
//! uses no randomness: the same events at the same times give the same actions. Tests and the simulator rely on that.
//!
//! The state has three parts, each a folder with a struct of private fields. A part reads the parts to its left, by shared
//! reference, and changes none of them:
//!
//! ```text
//!   workers  ◄── reads ──  samples  ◄── reads ──  views (reads workers, too)
//!      ▲                    ▲    │                 │
//!      │                    │    ▼ returns         ▼ returns
//!      └────── calls ───────┴───────── machine ◄── events
//! ```
//!
//! * `workers`: the joined workers, their roles, measured costs and queues, and which of them are suspected.
//! * `samples`: which worker holds or renders which sample, how samples reach other workers, which samples are worth
//!   their price, and which version is served.
//! * `views`: limits of clients, plans of views, the choice of workers, and retries.
//!
//! What must go back is a returned value: prefetch lists, the number of samples to render, and the outputs of views.
//! `machine` passes it on, and is the only module that changes more than one part.
//!
//! `scene_balance` decides which scene a worker belongs to. Each scene of a service has a machine of its own.
//!
//! All parts share `event` (inputs and outputs of the core), `config`, `time`, [`smooth`] and [`quality`] (models of
//! errors and costs). `status` takes a snapshot of all parts.

mod config;
mod event;
mod machine;
pub mod market;
pub mod quality;
mod samples;
mod scene_balance;
pub mod smooth;
mod status;
mod time;
mod views;
mod workers;

pub use config::Config;
pub use event::{
    Action, Assignment, Client, Event, Failure, Fallback, HeldSource, Hello, LastView, Order, ProbeResult,
    Purchase, Report, Role, Source, SourceNews, ViewId, WorkerId,
};
pub use machine::Core;
pub use scene_balance::{SceneBalance, SceneLoad, SceneMove, scene_for_newcomer};
pub use time::Uptime;
pub use views::explicit_plan;
pub use workers::{balance, hysteresis};

#[cfg(test)]
mod scenarios;

#[cfg(test)]
mod tests {
    use argus_scene::{Bounds, Rig, SampleSetInfo, SceneHash};
    use glam::DVec3;

    pub(super) fn set_info() -> SampleSetInfo {
        let bounds = Bounds { min: DVec3::splat(-10.0), max: DVec3::splat(10.0) };
        SampleSetInfo::plain(
            SceneHash([1; 32]),
            bounds,
            Rig::TileCorners { bounds, tiles: [2, 2], height: 1.0, size: [40, 30] },
        )
    }
}
