//! What a view costs and how close it comes, on the terrain, against a pass of one fetch a pixel.
//!
//! `cargo run -p argus-compositor --example bench -- [TRIANGLES] [VIEWS] [WIDTHxHEIGHT] [PICTURE FOLDER]`

#[path = "../tests/common/mod.rs"]
mod common;

use std::sync::Arc;
use std::time::Instant;

use argus_compositor::CompositorKnobs;
use argus_scene::metrics::compare;
use argus_scene::reference::Tracer;
use argus_scene::{
    Camera, Cancel, Compositor as _, Outputs, Plan, Rig, RigKnobs, Search, ViewJob, procedural,
};
use common::{compositor_with, id, sample_set};
use glam::DVec3;
use image::RgbImage;

fn main() {
    let mut args = std::env::args().skip(1);
    let triangles = args.next().map_or(50_000, |n| n.parse().expect("triangles"));
    let count: usize = args.next().map_or(64, |n| n.parse().expect("views"));
    let size = args.next().unwrap_or_else(|| "200x150".to_owned());
    let (width, height) = size.split_once('x').expect("WIDTHxHEIGHT");
    let [width, height]: [u32; 2] = [width.parse().expect("width"), height.parse().expect("height")];
    let folder = args.next();
    let quick = std::env::var("QUICK").is_ok();
    let glossy = std::env::var("GLOSSY").is_ok();

    let scene = Arc::new(procedural::terrain(triangles));
    let rig = Rig::for_scene(&scene, &RigKnobs::default()).expect("a rig");
    let tracer = Tracer::new(Arc::clone(&scene));
    let cameras: Vec<_> = (0..4).map(|i| rig.camera(i).expect("a camera")).collect();
    let set = sample_set(&tracer, &cameras, glossy, if quick { 1 } else { 3 });
    let mut knobs = CompositorKnobs::default();
    if let Ok(n) = std::env::var("SPLATTING") {
        knobs.splatting = n.parse().expect("SPLATTING");
    }
    let mut compositor = compositor_with(&set, knobs);

    let center = scene.bounds().center();
    let extent = scene.bounds().size().max_element();
    let jobs = |search, steps| -> Vec<ViewJob> {
        (0..count)
            .map(|i| {
                let angle = i as f64 * 2.399963;
                let above = 0.25 + 0.35 * ((i * 7) % 16) as f64 / 16.0;
                let radius = 0.35 + 0.25 * ((i * 5) % 8) as f64 / 8.0;
                let eye = center + DVec3::new(angle.cos() * radius, above, angle.sin() * radius) * extent;
                let camera = Camera::look_at(eye, center);
                let samples = rig.nearest(&camera, 4).into_iter().map(id).collect();
                let plan = Plan::Warp { search, steps, supersampling: 1, samples };
                ViewJob { camera, width, height, outputs: Outputs::COLOR, plan, epoch: 3 }
            })
            .collect()
    };
    let references: Vec<Option<RgbImage>> = jobs(Search::Splat, 64)
        .iter()
        .enumerate()
        .map(|(i, job)| {
            (i < 6 && !quick).then(|| {
                tracer.render(&job.camera, width, height, 16, |_| {}).display(scene.lighting.exposure)
            })
        })
        .collect();
    let only = std::env::var("ONLY").unwrap_or_default();
    for (name, search, steps) in [("splat", Search::Splat, 64), ("linear 64", Search::Linear, 64)] {
        if !name.contains(&only) {
            continue;
        }
        let jobs = jobs(search, steps);
        let mut best = f64::INFINITY;
        let mut frames = Vec::new();
        for _ in 0..5 {
            let began = Instant::now();
            let batch = compositor.compose(&jobs, &Cancel::new());
            let ms = began.elapsed().as_secs_f64() * 1e3 / count as f64;
            if ms < best {
                best = ms;
                frames = batch.into_iter().map(|f| f.expect("a frame")).collect();
            }
        }
        let stages: Vec<String> =
            frames[0].stages.iter().map(|s| format!("{} {:.3}", s.name, s.ms)).collect();
        let unresolved = frames.iter().map(|f| f.unresolved_fraction).sum::<f64>() / count as f64;
        let (mut psnr, mut flip, mut judged) = (0.0, 0.0, 0.0);
        for (i, (frame, reference)) in frames.iter().zip(&references).enumerate() {
            let Some(reference) = reference else { continue };
            let color = frame.color.as_ref().expect("colour").to_vec();
            let image = RgbImage::from_raw(width, height, color).expect("a whole image");
            let comparison = compare(reference, &image).expect("same size");
            psnr += comparison.psnr_db;
            flip += comparison.flip_mean;
            judged += 1.0;
            if let Some(folder) = &folder {
                let mut both = RgbImage::new(2 * width, height);
                image::imageops::replace(&mut both, reference, 0, 0);
                image::imageops::replace(&mut both, &image, i64::from(width), 0);
                both.save(format!("{folder}/{}_{i}.png", name.replace(' ', "_"))).expect("writable");
            }
        }
        println!(
            "{name}: {best:.3} ms/view, unresolved {:.3}%, PSNR {:.2} dB, FLIP {:.4} | {}",
            unresolved * 100.0,
            psnr / judged,
            flip / judged,
            stages.join(", ")
        );
    }
}
