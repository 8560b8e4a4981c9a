//! A device that is lost on purpose: whoever uses it is told, and the next one renders the same.

use anyhow::{Context as _, Result, bail, ensure};
use argus_gpu::{Gpu, GpuOptions};
use argus_scene::{Frame, Visibility};

use super::check::Checks;
use super::stage::Stage;

/// Loses a device of its own, so that the other checks' device stays.
pub(super) fn check(checks: &mut Checks) {
    let Some(before) = checks.attempt("a device is lost, and that is reported", lose) else { return };
    checks.attempt("the next device renders the same bytes", || {
        let gpu = Gpu::new(&GpuOptions::default())?;
        ensure!(
            colors(&render(&mut Stage::without_truth(&gpu)?)?)? == colors(&before)?,
            "its images are others"
        );
        Ok(())
    });
}

fn lose() -> Result<Vec<Frame>> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let mut stage = Stage::without_truth(&gpu)?;
    let before = render(&mut stage)?;
    gpu.device.destroy();
    match render(&mut stage) {
        Ok(_) => bail!("a device that is gone still renders"),
        Err(error) => {
            let cause = error.downcast_ref::<argus_scene::RenderError>();
            let told = matches!(cause, Some(argus_scene::RenderError::DeviceLost(_)));
            ensure!(told, "the loss is reported as something else: {error:#}");
        }
    }
    ensure!(gpu.lost().is_some(), "the device does not know that it is lost");
    Ok(before)
}

fn render(stage: &mut Stage) -> Result<Vec<Frame>> {
    stage.direct(Visibility::default())
}

fn colors(frames: &[Frame]) -> Result<Vec<&[u8]>> {
    frames.iter().map(|frame| frame.color.as_deref().context("the frame has no colour")).collect()
}
