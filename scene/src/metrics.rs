//! How far an image is from another: FLIP, PSNR and SSIM.
