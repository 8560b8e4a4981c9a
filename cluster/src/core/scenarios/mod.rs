//! Tests of the machine by events: workers join and leave, demand rises and falls.

mod copies;
mod crowd;
mod epochs;
mod open;
mod placement;
mod property;
mod roles;
mod silence;
mod sim;
mod targets;
mod views;
mod visibility;
