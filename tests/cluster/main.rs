//! Clusters of real processes on this machine: their answers, their failures, and the browser page.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod browse;
mod demo;
mod deploy;
mod device_loss;
mod effects;
mod extent;
mod frames;
mod holes;
mod indirect;
mod megaviews;
mod motion;
mod observe;
mod processes;
mod reflections;
mod rolling_restart;
mod scenes;
mod security;
mod session_history;
#[path = "../support/mod.rs"]
mod support;
mod twins;
