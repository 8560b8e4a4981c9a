//! The studies, each in its short form, and the hard cases.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

#[allow(dead_code)] // other tests use the rest
#[path = "../../../tests/cluster/twins/files.rs"]
mod files;
mod hard_cases;
mod light;
mod repeats;
mod short_forms;
mod strangers;
#[path = "../../../tests/support/mod.rs"]
mod support;
mod wishes;
