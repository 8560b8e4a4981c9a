//! The machine driven by events alone: workers that come and go, demand that rises and falls.

mod copies;
mod epochs;
mod open;
mod placement;
mod property;
mod roles;
mod silence;
mod sim;
mod targets;
mod views;
mod ways;
