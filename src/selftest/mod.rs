//! `argus selftest`: whether Argus works correctly on this machine.

mod check;
mod device;
mod images;
mod limits;
mod recovery;
mod stage;

use std::time::Instant;

use anyhow::Context as _;
use argus_gpu::{Gpu, GpuOptions, LONGEST_PASS_MS};
use serde::Serialize;

use self::check::{Check, Checks, Limit};
use self::stage::Stage;
use crate::output;

/// Checks that this machine's GPU and driver render correctly.
///
/// Describes the device and what it lacks, renders a small scene with every backend and search, compares each image
/// with a 64-bit reference, and loses a device once on purpose. Takes some seconds. Exit code 1 if a check fails.
/// ARGUS_ADAPTER selects one of several GPUs, by a part of its name or by number.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus selftest
  argus selftest --json
  ARGUS_ADAPTER=llvmpipe argus selftest       the software driver, beside a GPU")]
pub(crate) struct Args {
    /// Print one JSON object: passed, seconds, device, checks: [{name, result, figure, unit, at_most, at_least, ms, note}]
    #[arg(long)]
    json: bool,
}

/// The outcome of the self-test.
#[derive(Serialize)]
struct Report {
    passed: bool,
    seconds: f64,
    /// `None` if no device could be opened.
    device: Option<device::Description>,
    checks: Vec<Check>,
}

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let report = tokio::task::spawn_blocking(test).await.context("the self-test panicked")?;
    if args.json {
        output::json(&report)?;
    } else {
        print!("{}", table(&report));
    }
    let failed: Vec<&Check> = report.checks.iter().filter(|check| check.failed()).collect();
    let Some(first) = failed.first() else { return Ok(()) };
    let why = first.note.as_deref().unwrap_or("out of bounds");
    anyhow::bail!("{} of {} checks failed, first `{}`: {why}", failed.len(), report.checks.len(), first.name)
}

/// Runs all checks. A check whose precondition failed is left out.
fn test() -> Report {
    let begin = Instant::now();
    let mut checks = Checks::default();
    let opened = checks.attempt("a device opens", || {
        Gpu::new(&GpuOptions::default()).map_err(|error| anyhow::anyhow!(device::advice(&error)))
    });
    let mut description = None;
    if let Some(gpu) = opened {
        description = Some(device::describe(&gpu));
        if let Some(mut stage) = checks.attempt("a scene is uploaded", || Stage::new(&gpu)) {
            let backends = images::triangles(&mut stage, &mut checks);
            if let Some(description) = &mut description {
                description.triangles_by = backends;
            }
            images::samples(&mut stage, &mut checks);
            images::searches(&mut stage, &mut checks);
        }
        longest_pass(&gpu, &mut checks);
        recovery::check(&mut checks);
    }
    let checks = checks.done();
    let passed = !checks.iter().any(Check::failed);
    Report { passed, seconds: begin.elapsed().as_secs_f64(), device: description, checks }
}

/// Checks the longest pass ([`argus_gpu::quirks`], `long-passes`), which these small images must stay far below. The software driver has
/// no such limit, and its passes wait for other processes.
fn longest_pass(gpu: &Gpu, checks: &mut Checks) {
    let Some(pass) = gpu.longest_pass() else {
        return checks.absent("the longest pass", "the device does not time passes".to_owned());
    };
    let name = format!("the longest pass, {}", pass.name);
    if gpu.is_software() {
        return checks.absent(&name, format!("no driver ends it; it took {:.1} ms", pass.ms));
    }
    checks.figure(&name, pass.ms, "ms", Limit::AtMost(LONGEST_PASS_MS), Instant::now());
}

fn table(report: &Report) -> String {
    let mut text = report.device.as_ref().map(device::Description::text).unwrap_or_default();
    text += &check::table(&report.checks);
    let verdict = if report.passed { "all passed" } else { "FAILED" };
    text + &format!("{verdict}, in {:.1} s\n", report.seconds)
}
