//! `argus compare`: the difference of two images.

use std::path::PathBuf;

use argus_scene::metrics;

use crate::exit::bad_arguments;
use crate::output;

/// Compares an image with a reference: FLIP, PSNR and SSIM.
///
/// FLIP is 0 where a viewer sees no difference and 1 at worst. PSNR is in dB; higher is closer. SSIM is 1 if the
/// images are equal.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  argus compare warped.png direct.png --json")]
pub(crate) struct Args {
    /// Image to judge
    a: PathBuf,
    /// Reference image
    b: PathBuf,
    /// Print one JSON object: flip_mean, psnr_db (null if the images are equal), ssim
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let (a, b) = (output::read_rgb(&args.a)?, output::read_rgb(&args.b)?);
    if a.dimensions() != b.dimensions() {
        let ((aw, ah), (bw, bh)) = (a.dimensions(), b.dimensions());
        return Err(bad_arguments(format!(
            "images must have the same size: {} is {aw}x{ah}, {} is {bw}x{bh}",
            args.a.display(),
            args.b.display()
        )));
    }
    // The reference comes first. FLIP is symmetric, but error messages name the sizes in this order.
    let comparison = metrics::compare(&b, &a)?;
    if args.json {
        return output::json(&comparison);
    }
    println!("FLIP  {:.5}", comparison.flip_mean);
    println!("PSNR  {:.2} dB", comparison.psnr_db);
    println!("SSIM  {:.5}", comparison.ssim);
    Ok(())
}
