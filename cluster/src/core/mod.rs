//! The cluster's decisions as a pure machine: `(state, event, now) → (state, actions)`.
//!
//! [`Core::step`] takes an [`Event`] and the time, and returns what is to be done as [`Action`]s. It reads no clock, opens
//! no socket and throws no dice: the same events at the same times give the same actions. The tests here rely on that, and
//! so does the simulator.
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
//! * `workers`: which workers there are, what each can be given, their roles, their measured costs, and which are suspected.
//! * `samples`: which worker has which sample, which one renders it, how it reaches the others, which samples are worth
//!   their price, and which moment of an animated scene is served.
//! * `views`: what clients may ask for, how a view is answered, which worker answers it, and what follows when that fails.
//!
//! What has to go back is a returned value: what workers shall have at hand, how many samples are to be
//! rendered, and the effects of a view. `machine` passes it on, and is the only module that changes more than one part.
//!
//! All parts share `event` (what the core is told and what it tells), `config`, `time`, [`smooth`] and [`quality`] (the model
//! of errors and costs). `status` tells it all.

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
    Action, Assignment, Client, Event, Failure, Hello, LastView, Order, Probed, Report, Role, Source, ViewId,
    WorkerId,
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
    use argus_scene::{
        Bounds, Indirect, Lighting, Rig, SampleSetInfo, Sampling, SceneHash, Specification, Version,
        Visibility,
    };
    use glam::DVec3;

    pub(super) fn set_info() -> SampleSetInfo {
        let bounds = Bounds { min: DVec3::splat(-10.0), max: DVec3::splat(10.0) };
        SampleSetInfo {
            scene: SceneHash([1; 32]),
            bounds,
            rig: Rig::TileCorners { bounds, tiles: [2, 2], height: 1.0, size: [40, 30] },
            version: Version::of_epoch(0, 0),
            epoch_secs: 0.0,
            lighting: Lighting::default(),
            visibility: Visibility::default(),
            sampling: Sampling::default(),
            sub_samples: Specification::USUAL_SUB_SAMPLES,
            indirect: Indirect::Off,
            reflections: None,
        }
    }
}
