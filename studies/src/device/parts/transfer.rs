//! Readback from the device, and the encoders of frames.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use argus_gpu::Gpu;
use argus_gpu::wgpu::BufferUsages;
use argus_proto::codec::{self, Layout};
use argus_proto::jpeg;
use argus_sampler::GpuSampler;
use argus_scene::{Cancel, Output, Outputs, Plan, Sampler as _, SceneState, ViewJob, Visibility};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};

use super::measure::Measure;
use super::options::Options;
use crate::median::median;

/// Readbacks or encodings timed together in a round: a single one may be shorter than the clock's noise.
const AT_ONCE: usize = 8;
/// JPEG quality that the page of `argus browse` uses.
const JPEG_QUALITY: u8 = 90;

pub(super) fn measure(gpu: &Arc<Gpu>, options: &Options) -> Result<Vec<Measure>> {
    let mut rows = Vec::new();
    for &bytes in &options.readbacks {
        rows.push(readback(gpu, options, bytes)?);
    }
    rows.extend(encoders(gpu, options)?);
    Ok(rows)
}

/// Microseconds from the submission of a copy until the bytes are on the host.
fn readback(gpu: &Arc<Gpu>, options: &Options, bytes: u64) -> Result<Measure> {
    let buffer = gpu.buffer("to be read back", bytes, BufferUsages::COPY_SRC);
    let mut times = Vec::new();
    for round in 0..=options.rounds {
        let begin = Instant::now();
        for _ in 0..AT_ONCE {
            let mut commands = gpu.commands("read back");
            let ticket = commands.read_buffer(&buffer, 0..bytes);
            let read = commands.submit().wait()?.take(ticket);
            anyhow::ensure!(read.len() as u64 == bytes, "{} of {bytes} bytes came back", read.len());
        }
        if round > 0 {
            times.push(begin.elapsed().as_secs_f64() / AT_ONCE as f64);
        }
    }
    let secs = median(&times);
    let rate = format!("{:.2} GB/s, one at a time", bytes as f64 / secs * 1e-9);
    Ok(Measure::new("readback", format!("{bytes} bytes"), secs * 1e6, "µs").noting(rate))
}

/// CPU microseconds of each encoder for one view.
fn encoders(gpu: &Arc<Gpu>, options: &Options) -> Result<Vec<Measure>> {
    let scene = Arc::new(argus_scene::open(&options.scene)?);
    let mut sampler = GpuSampler::new(Arc::clone(gpu), Arc::clone(&scene))?;
    let [width, height] = options.size;
    let job = ViewJob {
        camera: scene.cameras.first().map_or_else(|| scene.default_camera(), |named| named.camera),
        width,
        height,
        outputs: Outputs::COLOR.with(Output::Range),
        band_rows: 0,
        plan: Plan::direct(1),
        state: SceneState::default(),
        time_secs: 0.0,
        visibility: Visibility::default(),
        reflections: None,
        history: None,
        rays: None,
    };
    let frame = sampler.render_views(&[job], &Cancel::new()).pop().context("no view was rendered")??;
    let color = frame.images[Output::Color].clone().context("the view has no colour")?;
    let range = frame.images[Output::Range].clone().context("the view has no range")?;
    let encoders: [(&str, &[u8], Encode<'_>); 4] = [
        ("colour, zstd", &color, &|raw| Some(codec::pack(Layout::Rgb8, raw).ok()??.len())),
        ("range, zstd", &range, &|raw| Some(codec::pack(Layout::R32, raw).ok()??.len())),
        ("colour, JPEG", &color, &|raw| Some(jpeg::encode(raw, width, height, JPEG_QUALITY)?.len())),
        ("colour, PNG", &color, &|raw| png(raw, width, height)),
    ];
    Ok(encoders.map(|(name, raw, encode)| encoder(options, name, raw, encode)).into())
}

/// Encodes an image. Returns its size in bytes; `None` if the encoder does not make it smaller.
type Encode<'a> = &'a dyn Fn(&[u8]) -> Option<usize>;

fn encoder(options: &Options, name: &str, raw: &[u8], encode: Encode<'_>) -> Measure {
    let [width, height] = options.size;
    let variant = format!("{name}, {width}x{height}");
    let Some(bytes) = encode(raw) else {
        return Measure::absent("encoding", variant, "µs", "does not make the image smaller".to_owned());
    };
    let round = |_| {
        let begin = Instant::now();
        for _ in 0..AT_ONCE {
            std::hint::black_box(encode(std::hint::black_box(raw)));
        }
        begin.elapsed().as_secs_f64() / AT_ONCE as f64
    };
    let secs = median(&(0..options.rounds).map(round).collect::<Vec<_>>());
    let share = 100.0 * bytes as f64 / raw.len().max(1) as f64;
    let note = format!("one core, {:.0} MB/s, to {share:.0}% of the bytes", raw.len() as f64 / secs * 1e-6);
    Measure::new("encoding", variant, secs * 1e6, "µs").noting(note)
}

/// Encodes a PNG as `argus view` does.
fn png(raw: &[u8], width: u32, height: u32) -> Option<usize> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive);
    encoder.write_image(raw, width, height, ExtendedColorType::Rgb8).ok()?;
    Some(bytes.len())
}
