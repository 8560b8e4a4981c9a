//! Tests of coordinators and workers, each in its own runtime. One program, since each takes half a minute to build.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod common;

mod batch;
mod cells;
mod faults;
mod history;
mod leadership;
mod limits;
mod memory;
mod network;
mod redirect;
mod services;
mod several_scenes;
mod sources;
mod specification;
mod transforms;
mod views;
mod watching;
