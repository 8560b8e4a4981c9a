//! Who does what: balance, membership, sessions, placement, and the processes around them.
//!
//! * [`core`] is a pure machine, `(state, event, now) → actions`: it reads no clock, opens no socket and
//!   throws no dice, so that tests and simulators drive the very code that runs in production.
//! * [`coordinator::serve`] is the shell around it: it serves `Views`, `Cluster` and `Scenes` on a listener
//!   that it is handed, and relays frames from workers to clients without opening them.
//! * [`worker::run`] is the process that renders: it joins a coordinator, takes the scene it is told to, and
//!   drives the two role traits of `argus_scene` on one render thread.
//!
//! Nothing here knows a GPU or a file format. Whoever wires a binary together hands in
//!
//! * a [`SceneSource`] to the coordinator: the scene that is served, and the files it came from;
//! * a [`SceneOpener`] to the worker: how a scene is opened, from this machine or from fetched files;
//! * a [`RoleFactory`] to the worker: how a sampler and a compositor are made on this machine's device.
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
#[doc(hidden)]
pub mod untrusted;
mod wire;
pub mod worker;

pub use interfaces::{BundleFile, RoleFactory, SceneOpener, SceneRef, SceneSource};
pub use observe::LIVE;
