//! Light cells of scenes in which things move.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_sampler::{CellSettings, GpuSampler, Indirect, PathSettings, SamplerSettings};
use argus_scene::animation::{Animation, Channel, Interpolation, Node, Parts, Rest, Track};
use argus_scene::{
    Cancel, LightEffects, Output, Plan, Sampler as _, Scene, SceneState, SurfaceLight, ViewJob,
};
use glam::{DAffine3, DVec3, Vec3};

use crate::common::*;
use crate::moving::EPOCH_SECS;
use crate::rooms::*;

/// So large that cells that lack are not filled at once.
const LARGE: [u32; 2] = [320, 240];
const SMALL: [u32; 2] = [96, 72];

/// A room in which a ball is somewhere else at each epoch.
fn room_with_a_ball() -> Arc<Scene> {
    let mut scene = (*box_of_cornell(DVec3::ZERO)).clone();
    place(&mut scene, ball(0, 12), DAffine3::IDENTITY);
    if let Some(ball) = scene.instances.last_mut() {
        ball.node = Some(0);
    }
    let rest = Rest::Parts(Parts { scale: DVec3::splat(0.2), ..Parts::default() });
    scene.nodes = vec![Node { name: String::new(), parent: None, rest, lights: vec![] }];
    let places = [(-1.2, -1.5, -1.0), (-1.2, -1.5, -0.6), (-0.4, -1.2, -1.4), (-1.0, 0.5, -1.2)];
    let moves = Channel {
        node: 0,
        times_secs: (0..places.len()).map(|i| i as f32 * EPOCH_SECS as f32).collect(),
        track: Track::Translation(places.into_iter().map(Vec3::from).collect()),
        interpolation: Interpolation::Step,
    };
    scene.animations = vec![Animation { name: "moves".to_owned(), channels: vec![moves] }];
    scene.instances = scene.at(0.0).instances;
    Arc::new(scene)
}

fn with_cells(scene: &Arc<Scene>) -> GpuSampler {
    let paths = PathSettings { level: 5, ..PathSettings::default() };
    let indirect = Indirect::Cells(CellSettings { paths, rays: 64, ..CellSettings::default() });
    let effects = indirect.effects_with(LightEffects { shadows: true, ..LightEffects::NONE });
    sampler_with(scene, SamplerSettings { sub_samples: 1, effects, indirect, ..SamplerSettings::default() })
}

fn job(size: [u32; 2], epoch: u64, light: Option<SurfaceLight>) -> ViewJob {
    ViewJob {
        plan: Plan::direct(1).with_light(light),
        state: SceneState::of_epoch(epoch),
        time_secs: epoch as f64 * EPOCH_SECS,
        ..view_job(view_of_room(DVec3::ZERO), size, 1)
    }
}

fn cells(rays: u32) -> Option<SurfaceLight> {
    Some(SurfaceLight::Cells { rays, reflected: true })
}

fn fill(sampler: &mut GpuSampler) {
    let begin = Instant::now();
    while sampler.fill_light(Duration::from_millis(20), true) {
        assert!(begin.elapsed() < Duration::from_secs(60), "filling ends: {:?}", sampler.light_cells());
    }
}

#[test]
fn a_view_by_cells_is_the_same_whatever_moved_before() {
    let scene = room_with_a_ball();
    let color = |sampler: &mut GpuSampler, epoch, light| {
        direct(sampler, &job(SMALL, epoch, light)).images[Output::Color].clone()
    };
    let mut moved = with_cells(&scene);
    for (epoch, rays) in [(0, 16), (1, 16), (2, 64), (0, 64), (2, 16)] {
        color(&mut moved, epoch, None);
        let found = color(&mut moved, epoch, cells(rays));
        assert!(found == color(&mut with_cells(&scene), epoch, cells(rays)), "epoch {epoch}, {rays} rays");
    }
    let report = moved.light_cells().unwrap();
    println!("{} pages kept, {} touched", report.pages_kept, report.pages_touched);
    assert!(report.pages_touched > 0, "{report:?}");
}

#[test]
fn cells_of_an_earlier_pose_are_shown_and_labelled_until_they_are_new() {
    let scene = room_with_a_ball();
    let mut sampler = with_cells(&scene);
    let light =
        |sampler: &mut GpuSampler, epoch| direct(sampler, &job(LARGE, epoch, None)).provenance.plan.light();
    direct(&mut sampler, &job(LARGE, 0, cells(64)));
    assert_eq!(light(&mut sampler, 0), cells(64));
    let older = Some(SurfaceLight::OlderCells { rays: 64, reflected: true });
    assert_eq!(light(&mut sampler, 1), older);
    // A frame that shows cells of an earlier pose cannot be rendered again.
    let pin = sampler.render_views(&[job(LARGE, 1, older)], &Cancel::new()).remove(0);
    assert!(pin.is_err_and(|error| error.to_string().contains("plan.light")));
    // Whoever names cells gets those of this pose.
    let named = direct(&mut sampler, &job(LARGE, 1, cells(16)));
    assert_eq!(named.provenance.plan.light(), cells(16));
    assert!(
        direct(&mut with_cells(&scene), &job(LARGE, 1, cells(16))).images[Output::Color]
            == named.images[Output::Color]
    );
    let rises = (0..8).any(|_| {
        fill(&mut sampler);
        light(&mut sampler, 1) == cells(64)
    });
    assert!(rises, "{:?}", sampler.light_cells());
}
