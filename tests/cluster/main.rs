//! Clusters of real processes on this machine: their answers, their failures, and the browser page.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod browse;
mod dataset;
mod demo;
mod deploy;
mod device_loss;
mod effects;
mod extent;
mod frames;
mod holes;
mod indirect;
mod lenses;
mod megaviews;
mod motion;
mod moved;
mod observe;
mod outputs;
mod processes;
mod reflections;
mod reload;
mod rolling_restart;
mod scenes;
mod security;
mod session_history;
mod several_scenes;
#[path = "../support/mod.rs"]
mod support;
mod twins;
