//! The demo and the studies, each in its short form, and the hard cases.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod demo;
mod hard_cases;
mod light;
mod short_forms;
#[path = "../support/mod.rs"]
mod support;
