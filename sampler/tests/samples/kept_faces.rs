//! Faces of samples that are kept after something moved, since nothing that they show or are lit by has changed.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use std::collections::HashMap;
use std::sync::Arc;

use argus_sampler::{CellSettings, GpuSampler, Indirect, PathSettings, SamplerSettings};
use argus_scene::animation::{Node, Parts, Rest};
use argus_scene::{
    Camera, Cancel, Light, LightEffects, Material, Sample, SampleJob, SampleSetInfo, Sampler as _, Scene,
    SceneState, Transforms, Version, Visibility,
};
use glam::{DAffine3, DVec3, Vec3};

use crate::common::*;
use crate::faces::{assert_equal, face_of};
use crate::rooms::*;

/// Texels on a side of a face.
const FACE: u32 = 32;
/// Middles of the rooms. So far apart that no page of light cells is in both.
const ROOMS: [DVec3; 2] = [DVec3::ZERO, DVec3::new(32.0, 0.0, 0.0)];
/// Places of the ball, all in the first room: in the file, and by revision.
const PLACES: [[f64; 3]; 4] = [[-1.2, -1.5, -1.0], [-1.2, -1.5, -0.6], [-0.4, -1.2, -1.4], [-1.0, 0.5, -1.2]];

/// Two closed rooms, each with a light of its own. A ball moves in the first one.
fn two_rooms(change: impl FnOnce(&mut Scene)) -> Arc<Scene> {
    let mut scene = (*box_of_cornell(ROOMS[0])).clone();
    add_room(&mut scene, ROOMS[1], [2, 1, 0, 0, 0, 0]);
    let Light::Point { position, intensity, range, radius } = scene.lighting.lights[0] else {
        panic!("the box has a point light")
    };
    scene.lighting.lights.push(Light::Point {
        position: position + ROOMS[1] + DVec3::new(0.4, -0.3, 0.1),
        intensity,
        range,
        radius,
    });
    let at = |place: [f64; 3]| {
        DAffine3::from_translation(DVec3::from_array(place)) * DAffine3::from_scale(DVec3::splat(0.2))
    };
    place(&mut scene, ball(0, 12), at(PLACES[0]));
    scene.instances.last_mut().unwrap().node = Some(0);
    let translation = DVec3::from_array(PLACES[0]);
    let rest = Rest::Parts(Parts { translation, scale: DVec3::splat(0.2), ..Parts::default() });
    scene.nodes = vec![Node { name: "ball".to_owned(), parent: None, rest, lights: vec![] }];
    change(&mut scene);
    let scene = Arc::new(scene);
    for (revision, place) in (1..).zip(&PLACES[1..]) {
        scene.revisions.add(Arc::new(Transforms { revision, parent_from_node: [(0, at(*place))].into() }));
    }
    scene
}

fn with_cells(scene: &Arc<Scene>) -> GpuSampler {
    let paths = PathSettings { level: 5, ..PathSettings::default() };
    let indirect = Indirect::Cells(CellSettings { paths, rays: 16, ..CellSettings::default() });
    let effects = indirect.effects_with(LightEffects {
        shadows: true,
        soft_shadows: true,
        emitters: true,
        ..LightEffects::NONE
    });
    sampler_with(scene, SamplerSettings { effects, indirect, ..SamplerSettings::default() })
}

/// The order for a sample in the middle of a room. Each version has the lights of its revision.
fn job(scene: &Scene, room: usize, number: u64, revision: u64, visibility: Visibility) -> SampleJob {
    let rig = omni_rig(DVec3::ZERO, FACE);
    let middle = ROOMS[room] + DVec3::Z;
    let index = rig.nearest(&Camera::look_at(middle, middle + DVec3::X), 1)[0];
    let still = sample_job(scene, rig, index, room == 0);
    let version = Version { number, state: SceneState { revision, ..SceneState::of_epoch(0) } };
    let info = SampleSetInfo { visibility, ..still.info.at_version(scene, version) };
    let ids = still.ids.iter().map(|id| argus_scene::SampleId { version: number, ..*id }).collect();
    SampleJob { info: Arc::new(info), ids, ..still }
}

/// Moves the ball several times, and asks each time which faces are kept: they and all others must be as a sampler renders them that
/// knows of nothing before. Returns how many faces of each room were kept, from the second move on, and how many were asked for.
fn kept_of(scene: &Arc<Scene>, visibility: Visibility) -> ([u32; 2], u32) {
    let mut sampler = with_cells(scene);
    let mut before: HashMap<usize, (Arc<Sample>, SceneState)> = HashMap::new();
    let (mut kept, mut asked) = ([0; 2], 0);
    for (number, revision) in (1..).zip([1, 2, 3, 1]) {
        asked += if number > 1 { 6 } else { 0 };
        for room in [0, 1] {
            let mut job = specified(&sampler, &job(scene, room, number, revision, visibility));
            let mut fresh = with_cells(scene);
            let truth = fresh.render_samples(&job, &Cancel::new()).remove(0).unwrap();
            if let Some((earlier, shows)) = before.remove(&room) {
                let faces = sampler.unchanged_faces(&job, (&earlier, shows), &Cancel::new()).unwrap();
                let unknown = (&*earlier, SceneState { revision: 99, ..shows });
                assert!(sampler.unchanged_faces(&job, unknown, &Cancel::new()).unwrap().is_empty());
                for face in (0..6).filter(|face| faces.has(*face)) {
                    kept[room] += 1;
                    for (a, b) in earlier.planes.iter().zip(&truth.planes) {
                        let [a, b] = [a, b].map(|plane| face_of(plane, FACE, face));
                        assert!(a == b, "room {room}, revision {revision}, face {face}");
                    }
                }
                if !faces.is_empty() {
                    job.extended = vec![Arc::new(Sample { id: job.ids[0], faces, ..(*earlier).clone() })];
                }
            }
            let sample = sampler.render_samples(&job, &Cancel::new()).remove(0).unwrap();
            assert_equal(&sample, &truth);
            before.insert(room, (Arc::new(sample), job.info.version.state));
        }
    }
    println!("{kept:?} of {asked} faces are kept");
    (kept, asked)
}

#[test]
fn faces_that_see_no_mover_and_none_of_its_light_are_kept_to_the_byte() {
    let (kept, asked) = kept_of(&two_rooms(|_| ()), Visibility::Cpu);
    assert_eq!(kept[1], asked, "nothing of the ball is in the other room");
    assert!(kept[0] < asked, "a face shows the ball");
    let glossy = |scene: &mut Scene| scene.materials[0] = Material { roughness: 0.3, ..grey(0.7) };
    let (kept, asked) = kept_of(&two_rooms(glossy), Visibility::Cpu);
    assert_eq!(kept[1], asked, "so where surfaces are glossy");
}

#[test]
fn no_face_is_kept_where_lights_move_or_lamps() {
    let light = |scene: &mut Scene| scene.nodes[0].lights = vec![1];
    assert_eq!(kept_of(&two_rooms(light), Visibility::Cpu).0, [0, 0]);
    // Of all lamps a ray looks at one, by their power: another place is another choice.
    let lamp = |scene: &mut Scene| {
        scene.materials.push(Material { emissive: Vec3::splat(3.0), ..grey(0.5) });
        let lamp = scene.materials.len() as u32 - 1;
        scene.meshes.last_mut().unwrap().material = lamp;
    };
    assert_eq!(kept_of(&two_rooms(lamp), Visibility::Cpu).0, [0, 0]);
}

#[test]
fn faces_that_are_rasterised_are_rendered_again() {
    assert_eq!(kept_of(&two_rooms(|_| ()), Visibility::Raster).0, [0, 0]);
}
