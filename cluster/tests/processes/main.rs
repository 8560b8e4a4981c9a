//! Coordinators and workers with each other, each in a runtime of its own: one program, since each costs half a minute to
//! build.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod common;

mod batch;
mod faults;
mod history;
mod leadership;
mod limits;
mod memory;
mod network;
mod redirect;
mod services;
mod specification;
mod views;
mod watching;
