//! Walks in a room whose walls and pillar are known.

use std::time::Duration;

use argus_scene::{Bounds, Camera, Lens};
use glam::{DVec2, DVec3};

use super::surroundings::Surroundings;
use super::*;
use crate::load::CameraPath;

/// A hall of 20 m × 4 m × 12 m with a square pillar in its middle.
const HALL: Bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(20.0, 4.0, 12.0) };
const PILLAR: Bounds = Bounds { min: DVec3::new(9.0, 0.0, 5.0), max: DVec3::new(11.0, 4.0, 7.0) };

/// Where a ray enters and leaves a box.
fn slab(bounds: Bounds, from: DVec3, direction: DVec3) -> (f64, f64) {
    let (a, b) = ((bounds.min - from) / direction, (bounds.max - from) / direction);
    (a.min(b).max_element(), a.max(b).min_element())
}

/// Range to the hall's walls or its pillar.
fn range(from: DVec3, direction: DVec3) -> f32 {
    let (_, wall) = slab(HALL, from, direction);
    let (enters, leaves) = slab(PILLAR, from, direction);
    let hit = if enters > 0.0 && enters < leaves { enters.min(wall) } else { wall };
    hit as f32
}

async fn probe(at: DVec3) -> Result<Surroundings, ClientError> {
    let camera = Camera { lens: Some(Lens::Equirectangular), ..Camera::look_at(at, at + DVec3::X) };
    let rays = camera.rays(128, 64);
    let pixels = (0..128 * 64).map(|i| DVec2::new(f64::from(i % 128), f64::from(i / 128)) + 0.5);
    let ranges = pixels.map(|pixel| range(at, rays.direction(pixel).unwrap()));
    Ok(Surroundings::new(at, &camera, ranges))
}

fn viewpoints() -> Vec<Camera> {
    vec![Camera::look_at(DVec3::new(3.0, 1.7, 3.0), DVec3::new(10.0, 1.7, 6.0))]
}

/// Distance to the nearest surface; negative inside of the pillar or behind a wall.
fn room(at: DVec3) -> f64 {
    let walls = (at - HALL.min).min(HALL.max - at).min_element();
    let outside = (PILLAR.min - at).max(at - PILLAR.max);
    walls.min(outside.x.max(outside.z))
}

async fn roam(secs: u64) -> Roam {
    Roam::new(&viewpoints(), HALL, Duration::from_secs(secs), &probe).await.unwrap()
}

#[tokio::test]
async fn people_who_roam_keep_off_walls_and_pillars_and_walk_at_a_steady_speed() {
    let walk = roam(30).await;
    for viewer in 0..16 {
        let mut before: Option<DVec3> = None;
        for secs in (0..300).map(|i| f64::from(i) * 0.1) {
            let camera = walk.camera(viewer, secs);
            camera.validate().unwrap();
            assert!(room(camera.eye) > 0.05, "viewer {viewer} at {secs} s stands at {}", camera.eye);
            let step = before.map_or(0.0, |before| (camera.eye - before).length());
            assert!(step < 0.3, "viewer {viewer} jumps {step} m at {secs} s");
            before = Some(camera.eye);
        }
    }
    let way: f64 = (0..300)
        .map(|i| f64::from(i) * 0.1)
        .map(|secs| (walk.camera(0, secs + 0.1).eye - walk.camera(0, secs).eye).length())
        .sum();
    assert!((way / 30.0 - 1.2).abs() < 0.1, "{} m a second", way / 30.0);
}

#[tokio::test]
async fn a_longer_walk_begins_with_the_shorter_one_and_groups_part() {
    let (short, long) = (roam(10).await, roam(30).await);
    for viewer in 0..16 {
        for secs in [0.0, 3.3, 9.9] {
            assert_eq!(short.camera(viewer, secs), long.camera(viewer, secs));
        }
    }
    let eyes: Vec<DVec3> = (0..4).map(|leader| long.camera(leader, 10.0).eye).collect();
    let apart = (0..4).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| (eyes[i] - eyes[j]).length());
    assert!(apart.fold(0.0, f64::max) > 3.0, "{eyes:?}");
}

#[tokio::test]
async fn viewers_who_jump_stand_still_in_free_space_and_then_elsewhere() {
    let walk = Jumps::new(&viewpoints(), HALL, &probe).await.unwrap();
    let mut places = Vec::new();
    for viewer in 0..8 {
        let cameras: Vec<Camera> = (0..300).map(|i| walk.camera(viewer, f64::from(i) * 0.1)).collect();
        let moves = cameras.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!((7..=10).contains(&moves), "{moves} jumps in 30 s");
        assert!(cameras.iter().all(|camera| room(camera.eye) > 0.1));
        places.extend(cameras.iter().map(|camera| camera.eye.to_array().map(f64::to_bits)));
    }
    places.sort_unstable();
    places.dedup();
    assert!(places.len() > 6, "{} places", places.len());
}

/// A description with one viewpoint in the hall.
fn description(eye: DVec3, target: DVec3) -> argus_proto::Description {
    let mut description = crate::load::tests::description(&[eye]);
    description.cameras[0].camera.target = target;
    description.bounds = Bounds { min: HALL.min, max: HALL.max };
    description
}

#[tokio::test]
async fn a_swing_is_full_where_there_is_room_and_stops_at_a_wall_that_is_near() {
    let (middle, near) = (DVec3::new(5.0, 1.7, 6.0), DVec3::new(11.1, 1.7, 6.0));
    let free = Looping::new(&description(middle, middle + DVec3::X), &probe).await.unwrap();
    let path = CameraPath::new(&description(middle, middle + DVec3::X), 3);
    for secs in (0..120).map(|i| f64::from(i) * 0.1) {
        assert!((free.camera(3, secs).eye - path.camera(secs).eye).length() < 1e-9);
    }
    // A metre less than the pillar: the swing of .2 m goes towards it and away from it.
    let bound = Looping::new(&description(near, near + DVec3::Z), &probe).await.unwrap();
    let eyes: Vec<DVec3> = (0..120).map(|i| bound.camera(0, f64::from(i) * 0.1).eye).collect();
    let (least, most) = eyes
        .iter()
        .fold((0.0, 0.0), |(a, b): (f64, f64), eye| (a.min(eye.x - near.x), b.max(eye.x - near.x)));
    assert!(least > -0.06 && most > 0.15, "it swings from {least} to {most}");
    assert!(eyes.windows(2).all(|pair| (pair[1] - pair[0]).length() < 0.05));
}

#[test]
fn the_names_of_walks_are_those_of_their_kinds() {
    for kind in WalkKind::ALL {
        assert_eq!(kind.name().parse::<WalkKind>().unwrap(), kind);
    }
    assert!("stroll".parse::<WalkKind>().is_err());
}
