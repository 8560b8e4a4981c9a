//! Which cameras see what a view shows: by packets of rays, against the reference's single ones.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::sync::Arc;

use argus_sampler::PacketSight;
use argus_scene::procedural::{mirrors, terrain};
use argus_scene::reference::SceneSight;
use argus_scene::rig::{CoverageEstimate, Target, VisibilityQuery};
use argus_scene::{AddedLight, Camera, LightChoice, Rig, Scene};
use glam::{DVec2, DVec3};

/// Points that are evenly spread, by the powers of the root of x⁴ = x + 1 (Roberts, 2018).
fn spread(scene: &Scene) -> impl Iterator<Item = DVec3> + use<> {
    let bounds = scene.bounds();
    (1..)
        .map(|i| (f64::from(i) * DVec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5)).fract())
        .map(move |share| bounds.min + bounds.size() * share)
}

fn directions(camera: &Camera) -> Vec<DVec3> {
    let place = |i: u32| DVec2::new(f64::from(i % 8), f64::from(i / 8)) + 0.5;
    (0..48).map(|i| camera.direction(place(i), 8, 6)).collect()
}

/// Shares of the questions to which both give the same answer: what is met, what is shown, what is seen.
fn agreement(
    packets: &dyn VisibilityQuery,
    single: &dyn VisibilityQuery,
    scene: &Scene,
    time_secs: f64,
) -> [f64; 3] {
    let (mut same, mut asked) = ([0u32; 3], [0u32; 3]);
    let mut count = |kind: usize, is_same: bool| {
        asked[kind] += 1;
        same[kind] += u32::from(is_same);
    };
    let mut places = spread(scene);
    let mut place = || places.next().unwrap();
    for _ in 0..40 {
        let (camera, other) = (Camera::look_at(place(), place()), place());
        let targets = single.targets(camera.eye, &directions(&camera), time_secs);
        for pair in packets.targets(camera.eye, &directions(&camera), time_secs).iter().zip(&targets) {
            count(
                0,
                match pair {
                    (Target::Surface(a), Target::Surface(b)) => {
                        a.distance(*b) <= 1e-5 * b.distance(camera.eye)
                    }
                    (a, b) => a == b,
                },
            );
        }
        let shown = packets.shows(other, &targets, time_secs);
        for pair in shown.iter().zip(single.shows(other, &targets, time_secs)) {
            count(1, *pair.0 == pair.1);
        }
        count(2, packets.sees(camera.eye, other) == single.sees(camera.eye, other));
    }
    [0, 1, 2].map(|kind| f64::from(same[kind]) / f64::from(asked[kind]))
}

/// Along edges a ray of f32 may pass a triangle that one of f64 meets.
const MOST_ALIKE: f64 = 0.995;

#[test]
fn packets_of_rays_answer_as_single_rays_do() {
    for scene in [terrain(3000), mirrors(5)].map(Arc::new) {
        let (packets, single) = (PacketSight::new(&scene), SceneSight::new(&scene));
        // Back and forth in time, since what was posed for one time is asked about another.
        for secs in [0.0, 1.3, 0.0, 2.6] {
            let alike = agreement(&packets, &single, &scene, secs);
            assert!(
                alike[..2].iter().all(|&share| share >= MOST_ALIKE),
                "{} {secs} s: {alike:?}",
                scene.name
            );
            assert!(alike[2] >= 0.97, "{} {secs} s: {alike:?}", scene.name);
        }
    }
}

#[test]
fn an_estimate_far_from_the_origin_is_that_near_it() {
    let estimated = |away: DVec3| {
        let mut scene = terrain(3000);
        scene.instances.iter_mut().for_each(|instance| instance.world_from_mesh.translation += away);
        let (scene, eye) = (Arc::new(scene), terrain(3000).default_camera());
        let camera = Camera { eye: eye.eye + away, target: eye.target + away, ..eye };
        let sight = PacketSight::new(&scene);
        let rig = Rig::Cell { origin: away, spacing: 8.0, face: 128 };
        let near = rig.nearest(&camera, 8);
        let mut estimate = CoverageEstimate::new(&camera, [320, 240], &sight, 0.0);
        near.iter().for_each(|&index| estimate.judge(&rig, index, &sight, 0.0, 1.5));
        (estimate.coverage(&near), estimate.choose(|_| true, 4))
    };
    assert_eq!(estimated(DVec3::new(1048576.0, -131072.0, 2097152.0)), estimated(DVec3::ZERO));
}

#[test]
fn in_another_light_the_triangles_stay_and_the_light_is_new() {
    let opened = Arc::new(mirrors(5));
    let as_opened = SceneSight::new(&opened);
    let choice = LightChoice { added: AddedLight::Sky, ..opened.opened_light() };
    let lit = PacketSight::new(&opened).in_light(choice);
    assert_eq!(lit.scene().lighting, opened.lighting_in(choice));
    assert_ne!(lit.scene().hash, opened.hash);
    let alike = agreement(&lit, &as_opened, &opened, 1.3);
    assert!(alike[..2].iter().all(|&share| share >= MOST_ALIKE), "{alike:?}");
}

#[test]
fn an_empty_scene_is_all_sky_and_hard_cases_are_answered() {
    let mut scene = terrain(3000);
    scene.instances.clear();
    let sight = PacketSight::new(&Arc::new(scene));
    let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
    let targets = sight.targets(camera.eye, &directions(&camera), 0.0);
    assert!(targets.iter().all(|target| matches!(target, Target::Sky(_))));
    assert!(sight.shows(DVec3::Y, &targets, 5.0).into_iter().all(|shown| shown));
    assert!(sight.sees(DVec3::ZERO, DVec3::X));
    let odd = [Target::Surface(DVec3::Y), Target::Surface(DVec3::splat(f64::NAN)), Target::Sky(DVec3::NAN)];
    assert_eq!(sight.shows(DVec3::Y, &odd, 0.0), [false; 3]);
    assert_eq!(sight.shows(DVec3::NAN, &targets[..2], 0.0), [false; 2]);
    assert_eq!(sight.targets(DVec3::NAN, &[DVec3::X], 0.0), [Target::Sky(DVec3::X)]);
    assert_eq!(sight.targets(DVec3::ZERO, &[], 0.0), []);
}
