//! Stability over time: the eye and all reflectors move, and reflections change more than they ought to.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Arc;

use anyhow::Result;
use argus_eye_points::PointScene;
use argus_sampler::plug::{ReflectionRays, taps};
use argus_scene::animation::{Animation, Channel, Interpolation, Track};
use argus_scene::{Camera, Scene};
use glam::{DQuat, DVec3};
use image::RgbImage;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};

use super::options::Options;
use super::sheets::save;
use super::stage::{Pose, Seen, Stage};
use super::ways::{TapRule, USUAL_DENSITY, Way, Ways};
use crate::report;

const WAYS: [Way; 6] = [
    Way::Points(USUAL_DENSITY),
    Way::CulledPoints,
    Way::MapPoints,
    Way::MultiView(None),
    Way::TracedMaps,
    Way::Rays,
];
/// Frames of scene time a second.
const FRAMES_PER_SEC: f64 = 30.0;
/// Degrees that the eye turns about its target in a frame.
const TURN_DEG: f64 = 0.25;
/// Seconds of a reflector's way up, down and back; and its height as a share of the reflector's radius.
const PERIOD_SECS: f64 = 4.0;
const RISE: f64 = 0.2;
/// Keys of a way.
const KEYS: u32 = 32;

pub(super) fn rows(options: &Options, progress: &ProgressBar) -> Result<Vec<Map<String, Value>>> {
    let taps = taps(options.taps);
    let mut rows = Vec::new();
    progress.set_length(options.reflectors.len() as u64 * u64::from(options.frames));
    for &balls in &options.reflectors {
        let rest = moving(&Stage::open(&options.scene, balls)?);
        let camera = rest.camera(Pose::Distant)?;
        let mut sums = [Sums::default(); WAYS.len()];
        let mut before: Option<Frame> = None;
        for frame in 0..options.frames {
            let stage = rest.at(f64::from(frame) / FRAMES_PER_SEC);
            let seen = stage.see(&turned(&camera, f64::from(frame) * TURN_DEG), options.size);
            let points = PointScene::new(&stage.scene, stage.time_secs);
            let rays = ReflectionRays::new(&stage.scene, stage.time_secs)?;
            let ways = Ways {
                stage: &stage,
                points: &points,
                device: None,
                rays: &rays,
                seen: &seen,
                taps: &taps,
                tap_rule: TapRule::Fixed,
                budget: options.budget,
            };
            let exposure = stage.scene.lighting.exposure;
            let truth = seen.image(&stage.arriving(&seen, &taps, 1), exposure);
            let image = |way: &Way| Ok(seen.image(&ways.go(*way)?.arriving, exposure));
            let images: Vec<RgbImage> = WAYS.iter().map(image).collect::<Result<_>>()?;
            for (way, image) in WAYS.iter().zip(&images) {
                save(options, &format!("motion-{balls}-{frame}-{way}"), image)?;
            }
            let now = Frame::new(&seen, truth, images);
            if let Some(before) = &before {
                sums.iter_mut().enumerate().for_each(|(way, sums)| sums.add(before, &now, way));
            }
            before = Some(now);
            progress.inc(1);
        }
        for (way, sums) in WAYS.iter().zip(sums) {
            let mean = |sum: f64| sum / sums.channels.max(1) as f64;
            rows.push(report::row(json!({
                "reflectors": balls,
                "way": way.to_string(),
                "frames": options.frames,
                "compared_pixels": sums.channels / 3,
                "change": mean(sums.change),
                "true_change": mean(sums.truth),
                "beyond": mean(sums.beyond),
                "change_of_error": mean(sums.error),
                "resized_maps": sums.resized,
            })));
        }
    }
    Ok(rows)
}

/// A frame: the truth, the images of all ways, and what is seen in reflective pixels.
struct Frame {
    truth: RgbImage,
    images: Vec<RgbImage>,
    /// The instance in a reflective pixel, by index in the image.
    reflective: BTreeMap<usize, u32>,
    /// The side of an instance's map.
    sides: BTreeMap<u32, u32>,
}

impl Frame {
    fn new(seen: &Seen, truth: RgbImage, images: Vec<RgbImage>) -> Self {
        let instance = |reflector: u32| seen.reflectors[reflector as usize].instance;
        let pixels = seen.surfaces.iter().zip(&seen.pixels);
        let reflective = pixels.map(|((index, ..), pixel)| (*index, instance(pixel.reflector))).collect();
        let sides = seen.reflectors.iter().map(|reflector| (reflector.instance, reflector.side)).collect();
        Self { truth, images, reflective, sides }
    }
}

/// Sums of changes of channels, of 255, over pixels that show the same reflector in both of two frames.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Sums {
    channels: u64,
    change: f64,
    truth: f64,
    /// Change beyond that of the truth.
    beyond: f64,
    /// Change of the difference from the truth.
    error: f64,
    /// Maps whose side changed.
    resized: u64,
}

impl Sums {
    fn add(&mut self, before: &Frame, now: &Frame, way: usize) {
        for (index, instance) in &now.reflective {
            if before.reflective.get(index) != Some(instance) {
                continue;
            }
            let (x, y) =
                ((index % now.truth.width() as usize) as u32, (index / now.truth.width() as usize) as u32);
            for channel in 0..3 {
                let change = |before: &RgbImage, now: &RgbImage| {
                    let [from, to] = [before, now].map(|image| f64::from(image.get_pixel(x, y)[channel]));
                    to - from
                };
                let found = change(&before.images[way], &now.images[way]);
                let truth = change(&before.truth, &now.truth);
                self.channels += 1;
                self.change += found.abs();
                self.truth += truth.abs();
                self.beyond += (found.abs() - truth.abs()).max(0.0);
                self.error += (found - truth).abs();
            }
        }
        let resized =
            |(instance, side): &(&u32, &u32)| before.sides.get(instance).is_some_and(|s| s != *side);
        self.resized += now.sides.iter().filter(resized).count() as u64;
    }
}

/// A stage whose reflectors rise and sink.
fn moving(stage: &Stage) -> Stage {
    let mut scene = Scene::clone(&stage.scene);
    let placed = scene.at(stage.time_secs).instances;
    let mut channels = Vec::new();
    for (number, &index) in (0u32..).zip(&stage.instances) {
        let instance = &placed[index as usize];
        let (Some(node), Some(found)) = (instance.node, scene.reflector(index, instance)) else { continue };
        let middle = instance.world_from_mesh.translation;
        let times = (0..=KEYS).map(|key| f64::from(key) / f64::from(KEYS));
        let height =
            |part: f64| (TAU * (part + 0.37 * f64::from(number))).sin() * RISE * found.radius / 3f64.sqrt();
        channels.push(Channel {
            node,
            times_secs: times.clone().map(|part| (part * PERIOD_SECS) as f32).collect(),
            track: Track::Translation(
                times.map(|part| (middle + DVec3::Y * height(part)).as_vec3()).collect(),
            ),
            interpolation: Interpolation::Linear,
        });
    }
    scene.animations = vec![Animation { name: "rise and sink".to_owned(), channels }];
    Stage::of(Arc::new(scene), stage.instances.clone())
}

/// A camera that has turned about its target.
fn turned(camera: &Camera, degrees: f64) -> Camera {
    let turn = DQuat::from_rotation_y(degrees.to_radians());
    Camera { eye: camera.target + turn * (camera.eye - camera.target), ..*camera }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::options;

    #[test]
    fn rays_change_as_the_truth_does_and_points_change_more() {
        let options = Options {
            scene: "rooms:20".to_owned(),
            reflectors: vec![3],
            size: [96, 64],
            taps: 4,
            frames: 3,
            ..options(false)
        };
        let rows = rows(&options, &ProgressBar::hidden()).unwrap();
        let number = |way: &str, key: &str| {
            rows.iter().find(|row| row["way"] == way).and_then(|row| row[key].as_f64()).unwrap()
        };
        assert!(number("rays", "true_change") > 0.1, "reflections move");
        assert!(number("rays", "change_of_error") < 0.1 * number("rays", "true_change"), "{rows:?}");
        assert!(number("points", "change_of_error") > number("rays", "change_of_error"));
        assert!(number("points", "beyond") <= number("points", "change_of_error"));
    }

    #[test]
    fn changes_are_counted_where_the_same_reflector_is_seen_twice() {
        let image = |value: u8| RgbImage::from_pixel(2, 1, image::Rgb([value; 3]));
        let frame = |value: u8, seen: [u32; 2]| Frame {
            truth: image(10),
            images: vec![image(value)],
            reflective: [(0, seen[0]), (1, seen[1])].into(),
            sides: [(seen[0], u32::from(value))].into(),
        };
        let mut sums = Sums::default();
        sums.add(&frame(20, [5, 6]), &frame(23, [5, 7]), 0);
        let expected = Sums { channels: 3, change: 9.0, truth: 0.0, beyond: 9.0, error: 9.0, resized: 1 };
        assert_eq!(sums, expected);
    }
}
