//! Samples from the octree of an animated scene.

use std::sync::Arc;

use argus_scene::{Camera, MegaViews, PlaneKind, SampleId, SampleSetInfo, Sampling, Version};
use glam::DVec3;

use crate::common::*;
use crate::moving::{EPOCH_SECS, camera, scene_that_deforms};

#[test]
fn samples_from_an_octree_move_too() {
    let scene = Arc::new(scene_that_deforms());
    let mut moving = sampler(&scene);
    let settings = MegaViews { map_side: 128, levels: 7, block: 1 };
    let bytes_at = |sampler: &mut argus_sampler::GpuSampler, epoch, sampling| {
        let eye = DVec3::new(-0.2, 2.6, 2.2);
        let mut job = sample_job(&scene, omni_rig(eye, 96), 0, true);
        let index = job.info.rig.nearest(&Camera { eye, ..camera() }, 1)[0];
        let info = SampleSetInfo { epoch_secs: EPOCH_SECS, sampling, ..(*job.info).clone() };
        job.info = Arc::new(info.at_version(&scene, Version::of_epoch(epoch, epoch)));
        job.ids = vec![SampleId { version: epoch, camera: index }];
        let sample = sample(sampler, &job);
        [PlaneKind::Radiance, PlaneKind::InverseRange].map(|kind| host_bytes(&sample, kind))
    };
    let mapped = Sampling::MegaViews(settings);
    let [first, other, again] = [2, 7, 2].map(|epoch| bytes_at(&mut moving, epoch, mapped));
    assert!(first == again && first != other);
    assert!(other == bytes_at(&mut sampler(&scene), 7, mapped), "what came before leaves no trace");

    // Where the ball came or went, triangles of that time have the same range, and those of another have not.
    let [was, is] = [2, 7].map(|epoch| floats(&bytes_at(&mut moving, epoch, Sampling::Triangles)[1]));
    // Three cells, metres.
    let is_near = |a: f32, b: f32| a == b || (1.0 / a - 1.0 / b).abs() < 0.3;
    let ours = floats(&other[1]);
    let moved: Vec<usize> = (0..is.len()).filter(|&i| !is_near(was[i], is[i])).collect();
    assert!(moved.len() > 30, "{} texels show motion", moved.len());
    let share =
        |of: &[f32]| moved.iter().filter(|&&i| is_near(ours[i], of[i])).count() as f64 / moved.len() as f64;
    let (now, then) = (share(&is), share(&was));
    assert!(now > 0.7 && then < 0.2, "{now} of its time, {then} of another");
}
