//! Nodes that clients move, in a scene without animations.

use std::sync::Arc;
use std::time::{Duration, Instant};

use argus_sampler::{CellSettings, GpuSampler, Indirect, PathSettings, SamplerSettings};
use argus_scene::animation::{Node, Parts, Rest};
use argus_scene::deformation::{Deformation, Joint, Shape, Skin};
use argus_scene::{
    Cancel, LightEffects, Mesh, Output, Plan, Sampler as _, Scene, SceneState, SurfaceLight, Transforms,
    ViewJob,
};
use glam::{DAffine3, DQuat, DVec3};

use crate::cells::fill;
use crate::common::*;
use crate::rooms::*;

const SIZE: [u32; 2] = [96, 72];

/// Where the ball is in the file, and where clients put it.
const PLACES: [[f64; 3]; 4] = [[-1.2, -1.5, -1.0], [-1.2, -1.5, -0.6], [-0.4, -1.2, -1.4], [-1.0, 0.5, -1.2]];

fn at([x, y, z]: [f64; 3]) -> DAffine3 {
    DAffine3::from_scale_rotation_translation(DVec3::splat(0.2), DQuat::IDENTITY, DVec3::new(x, y, z))
}

/// A room with a ball, which hangs from node 0. Revision i has it at place i.
fn room_with_a_ball(place_in_file: [f64; 3]) -> Arc<Scene> {
    room_with(place_in_file, ball(0, 12), at(place_in_file))
}

/// The same room with the ball as the skin of node 0.
fn room_with_a_skin(place_in_file: [f64; 3]) -> Arc<Scene> {
    let mut ball = ball(0, 12);
    let (rest, corners) = (ball.clone(), 0..ball.positions.len() as u32);
    ball.positions.iter_mut().for_each(|p| *p = at(place_in_file).transform_point3(p.as_dvec3()).as_vec3());
    ball.deformation = Some(Arc::new(Deformation {
        rest: Shape { positions: rest.positions, normals: rest.normals, ..Shape::default() },
        node: 1,
        targets: vec![],
        weights: vec![],
        skin: Some(Skin {
            joints: Arc::new(vec![Joint { node: 0, joint_from_mesh: DAffine3::IDENTITY }]),
            first: (0..=corners.end).collect(),
            influences: corners.map(|_| (0, 1.0)).collect(),
        }),
        flattens: false,
        flat_normals: false,
    }));
    room_with(place_in_file, ball, DAffine3::IDENTITY)
}

fn room_with(place_in_file: [f64; 3], ball: Mesh, world_from_ball: DAffine3) -> Arc<Scene> {
    let mut scene = (*box_of_cornell(DVec3::ZERO)).clone();
    let is_skin = ball.deformation.is_some();
    place(&mut scene, ball, world_from_ball);
    if let Some(ball) = scene.instances.last_mut() {
        ball.node = Some(u32::from(is_skin));
    }
    let translation = DVec3::from_array(place_in_file);
    let rest = Rest::Parts(Parts { translation, scale: DVec3::splat(0.2), ..Parts::default() });
    let node = |name: &str, rest| Node { name: name.to_owned(), parent: None, rest, lights: vec![] };
    scene.nodes = vec![node("ball", rest), node("skin", Rest::Parts(Parts::default()))];
    let scene = Arc::new(scene);
    for (revision, place) in (1..).zip(&PLACES[1..]) {
        let parent_from_node = [(0, at(*place))].into();
        scene.revisions.add(Arc::new(Transforms { revision, parent_from_node }));
    }
    scene
}

fn with_shadows(scene: &Arc<Scene>) -> GpuSampler {
    let effects = LightEffects { shadows: true, ..LightEffects::NONE };
    sampler_with(scene, SamplerSettings { sub_samples: 1, effects, ..SamplerSettings::default() })
}

fn with_cells(scene: &Arc<Scene>) -> GpuSampler {
    let paths = PathSettings { level: 5, ..PathSettings::default() };
    let indirect = Indirect::Cells(CellSettings { paths, rays: 64, ..CellSettings::default() });
    let effects = indirect.effects_with(LightEffects { shadows: true, ..LightEffects::NONE });
    sampler_with(scene, SamplerSettings { sub_samples: 1, effects, indirect, ..SamplerSettings::default() })
}

fn job(revision: u64, light: Option<SurfaceLight>) -> ViewJob {
    ViewJob {
        plan: Plan::direct(1).with_light(light),
        state: SceneState { revision, ..SceneState::of_epoch(0) },
        ..view_job(view_of_room(DVec3::ZERO), SIZE, 1)
    }
}

fn color(sampler: &mut GpuSampler, job: &ViewJob) -> Vec<u8> {
    direct(sampler, job).images[Output::Color].clone().expect("is asked for").to_vec()
}

/// Share of pixels that differ by more than rounding.
fn differing(a: &[u8], b: &[u8]) -> f64 {
    let pixels = a.chunks(3).zip(b.chunks(3));
    let differ = pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
    differ as f64 / (a.len() / 3) as f64
}

#[test]
fn a_moved_node_and_its_shadow_are_where_they_would_be_if_the_file_had_them_there() {
    is_where_the_file_could_have_it(room_with_a_ball(PLACES[0]));
}

#[test]
fn a_joint_that_clients_move_takes_its_skin_along() {
    let scene = room_with_a_skin(PLACES[0]);
    assert!(!scene.is_animated());
    is_where_the_file_could_have_it(scene);
}

fn is_where_the_file_could_have_it(scene: Arc<Scene>) {
    let mut sampler = with_shadows(&scene);
    let file = color(&mut sampler, &job(0, None));
    for revision in [1, 3, 2] {
        let moved = color(&mut sampler, &job(revision, None));
        let there = room_with_a_ball(PLACES[revision as usize]);
        let truth = color(&mut with_shadows(&there), &job(0, None));
        let (off, before) = (differing(&moved, &truth), differing(&moved, &file));
        assert!(off < 0.005 && before > 0.01, "revision {revision}: {off} off, {before} moved");
        assert!(moved == color(&mut with_shadows(&scene), &job(revision, None)), "whatever moved before");
    }
    assert!(differing(&color(&mut sampler, &job(0, None)), &file) < 0.005, "the file's transforms again");
}

#[test]
fn cells_are_those_of_the_new_place_and_what_no_mover_touches_is_kept() {
    for scene in [room_with_a_ball(PLACES[0]), room_with_a_skin(PLACES[0])] {
        cells_are_those_of_the_new_place(&scene);
    }
}

fn cells_are_those_of_the_new_place(scene: &Arc<Scene>) {
    let cells = Some(SurfaceLight::Cells { rays: 16, reflected: true });
    let mut moved = with_cells(scene);
    for revision in [1, 2, 1, 2] {
        let found = color(&mut moved, &job(revision, cells));
        assert!(found == color(&mut with_cells(scene), &job(revision, cells)), "revision {revision}");
    }
    let report = moved.light_cells().expect("has cells");
    println!("{} pages kept, {} touched", report.pages_kept, report.pages_touched);
    assert!(report.pages_touched > 0, "{report:?}");
}

#[test]
fn open_views_after_a_move_show_earlier_light_until_that_of_the_present_is_prepared() {
    let scene = room_with_a_ball(PLACES[0]);
    let mut sampler = with_cells(&scene);
    direct(&mut sampler, &job(0, None));
    fill(&mut sampler);
    // For the first move the ball gets trees of its own, and what the cells of before met is not recorded.
    let frame = direct(&mut sampler, &job(2, None));
    let light = frame.provenance.plan.light();
    assert!(matches!(light, Some(SurfaceLight::OlderCells { .. })), "{light:?}");
    assert!(!frame.stages.iter().any(|stage| stage.name.starts_with("light leaves")), "{:?}", frame.stages);
    let pinned = ViewJob { plan: frame.provenance.plan.clone(), ..job(2, None) };
    assert!(sampler.render_views(&[pinned], &Cancel::new()).remove(0).is_err(), "it cannot be had again");
    // However often it moves, and back.
    for revision in [3, 1, 3, 2] {
        direct(&mut sampler, &job(revision, None));
    }
    let (whole, begin) = (Some(SurfaceLight::Cells { rays: 64, reflected: true }), Instant::now());
    while direct(&mut sampler, &job(2, None)).provenance.plan.light() != whole {
        fill(&mut sampler);
        assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", sampler.light_cells());
    }
    let found = color(&mut sampler, &job(2, None));
    assert!(found == color(&mut with_cells(&scene), &job(2, whole)), "nothing of the earlier light is left");
}

#[test]
fn a_view_of_a_revision_that_is_not_known_is_refused_and_the_next_one_is_answered() {
    let mut sampler = with_shadows(&room_with_a_ball(PLACES[0]));
    let file = color(&mut sampler, &job(0, None));
    let refused = sampler.render_views(&[job(77, None)], &Cancel::new()).remove(0).unwrap_err().to_string();
    assert!(refused.contains("state.revision") && refused.contains("77"), "{refused}");
    assert!(color(&mut sampler, &job(0, None)) == file);
}

#[test]
fn a_node_that_moved_once_moves_again_without_trees_being_built_anew() {
    let scene = room_with_a_ball(PLACES[0]);
    let mut sampler = with_shadows(&scene);
    let mut rebuilds = |revision| {
        let begin = Instant::now();
        let frame = direct(&mut sampler, &job(revision, None));
        let rebuilt = frame.stages.iter().any(|stage| stage.name.contains("build trees"));
        (rebuilt, begin.elapsed())
    };
    let _ = rebuilds(0);
    let first = rebuilds(1);
    let later: Vec<(bool, Duration)> = [2, 3, 0, 1].map(&mut rebuilds).into();
    println!("first {first:?}, later {later:?}");
    assert!(first.0, "the ball gets a tree of its own");
    assert!(later.iter().all(|(rebuilt, _)| !rebuilt), "{later:?}");
}
