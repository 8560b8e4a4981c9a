//! The cluster: balance, membership, sessions, placement, and the processes around them.
//!
//! * [`core`] is a pure machine, `(state, event, now) → actions`. It reads no clock, opens no socket and uses no
//!   randomness, so tests and simulators run the code of production.
//! * [`coordinator::serve`] is the shell around the core. It serves `Views`, `Cluster` and `Scenes` on a given
//!   listener, and relays frames from workers to clients without opening them.
//! * [`worker::run`] is the process that renders. It joins a coordinator, opens the assigned scene, and drives the
//!   two role traits of `argus_scene` on one render thread.
//!
//! Nothing here depends on a GPU or a file format. The binary provides
//!
//! * a [`SceneSource`] for the coordinator: the served scene, and its files;
//! * a [`SceneOpener`] for the worker, which opens a scene from this machine or from fetched files;
//! * a [`RoleFactory`] for the worker, which makes samplers and compositors on this machine's device.
//!
//! Both entry points run until their `CancellationToken` is cancelled, then drain and return `Ok(())`.

pub mod coordinator;
pub mod core;
mod incoming;
mod interfaces;
pub mod leadership;
mod net;
pub mod network;
mod observe;
mod rate_limited_log;
pub mod sealed;
pub mod security;
mod send_timeout;
#[cfg(feature = "fuzzing")]
pub mod untrusted;
mod wire;
pub mod worker;

pub use interfaces::{RoleFactory, SceneFile, SceneOpener, SceneRef, SceneSource};
pub use observe::LIVE;
