//! Tests of the machine by events: workers join and leave, demand rises and falls.

mod batches;
mod copies;
mod crowd;
mod epochs;
mod frames;
mod investing;
mod open;
mod placement;
mod property;
mod roles;
mod silence;
mod sim;
mod targets;
mod views;
mod visibility;
