//! Tests without a cluster: the command line, the configuration, the rules of the workspace, the deployed files.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod alerts;
mod cli;
mod configuration;
mod dependency_rules;
mod imports;
mod manifests;
mod named_files;
mod quirks;
mod release;
mod supply_chain;
#[path = "../support/mod.rs"]
mod support;
