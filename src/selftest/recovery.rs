//! Device loss: the loss is reported, and a new device renders the same images.

use anyhow::{Context as _, Result, bail, ensure};
use argus_gpu::{Gpu, GpuOptions};
use argus_scene::{Frame, Output, Visibility};

use super::check::Checks;
use super::stage::Stage;

/// Loses a device of its own; the other checks keep theirs.
pub(super) fn check(checks: &mut Checks) {
    let Some(before) = checks.attempt("a device is lost, and that is reported", lose) else { return };
    checks.attempt("the next device renders the same bytes", || {
        let gpu = Gpu::new(&GpuOptions::default())?;
        ensure!(colors(&render(&mut Stage::without_truth(&gpu)?)?)? == colors(&before)?, "its images differ");
        Ok(())
    });
}

fn lose() -> Result<Vec<Frame>> {
    let gpu = Gpu::new(&GpuOptions::default())?;
    let mut stage = Stage::without_truth(&gpu)?;
    let before = render(&mut stage)?;
    gpu.device.destroy();
    match render(&mut stage) {
        Ok(_) => bail!("a lost device still renders"),
        Err(error) => {
            let cause = error.downcast_ref::<argus_scene::RenderError>();
            let told = matches!(cause, Some(argus_scene::RenderError::DeviceLost(_)));
            ensure!(told, "the loss is reported as another error: {error:#}");
        }
    }
    ensure!(gpu.lost().is_some(), "the device does not report its loss");
    Ok(before)
}

fn render(stage: &mut Stage) -> Result<Vec<Frame>> {
    stage.direct(Visibility::default())
}

fn colors(frames: &[Frame]) -> Result<Vec<&[u8]>> {
    frames
        .iter()
        .map(|frame| frame.images[Output::Color].as_deref().context("the frame has no colour"))
        .collect()
}
