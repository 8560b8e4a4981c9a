//! Values worked out by hand.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI};

use super::*;
use glam::{DQuat, Quat, Vec3};

use crate::animation::{Interpolation, Node, Track};
use crate::{Bounds, Instance, Mesh};

fn channel(times_secs: &[f32], track: Track, interpolation: Interpolation) -> Channel {
    Channel { node: 0, times_secs: times_secs.to_vec(), track, interpolation }
}

fn slide(times_secs: &[f32], xs: &[f32], interpolation: Interpolation) -> Channel {
    let values = xs.iter().map(|&x| Vec3::new(x, 0.0, 0.0)).collect();
    channel(times_secs, Track::Translation(values), interpolation)
}

fn about_y(angle: f64) -> DQuat {
    DQuat::from_rotation_y(angle)
}

fn turn(times_secs: &[f32], angles: &[f64], interpolation: Interpolation) -> Channel {
    let values = angles.iter().map(|&angle| about_y(angle).as_quat()).collect();
    channel(times_secs, Track::Rotation(values), interpolation)
}

fn x_at(channel: &Channel, time_secs: f64) -> f64 {
    channel.vector_at(time_secs).unwrap().x
}

/// The same rotation, whatever the sign of its quaternion.
fn same(a: DQuat, b: DQuat) -> bool {
    a.dot(b).abs() > 1.0 - 1e-12 && (a.length() - 1.0).abs() < 1e-12
}

/// One triangle a node: corners at the origin, x and y.
fn scene(nodes: Vec<Node>, animations: Vec<Animation>) -> Scene {
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    let place = |node| Instance { mesh: 0, node: Some(node), world_from_mesh: DAffine3::IDENTITY };
    Scene {
        meshes: vec![mesh],
        instances: (0..nodes.len() as u32).map(place).collect(),
        nodes,
        animations,
        ..Scene::default()
    }
}

fn node(parent: Option<u32>) -> Node {
    Node { name: String::new(), parent, rest: Rest::Parts(Parts::default()), lights: Vec::new() }
}

fn animation(channels: Vec<Channel>) -> Animation {
    Animation { name: String::new(), channels }
}

#[test]
fn steps_hold_the_earlier_key() {
    let channel = slide(&[1.0, 2.0, 4.0], &[10.0, 20.0, 40.0], Interpolation::Step);
    for (time, x) in
        [(0.0, 10.0), (1.0, 10.0), (1.999, 10.0), (2.0, 20.0), (3.9, 20.0), (4.0, 40.0), (9.0, 40.0)]
    {
        assert_eq!(x_at(&channel, time), x, "{time}");
    }
}

#[test]
fn lines_are_interpolated_and_held_at_both_ends() {
    let channel = slide(&[1.0, 2.0, 4.0], &[10.0, 20.0, 40.0], Interpolation::Linear);
    for (time, x) in
        [(-3.0, 10.0), (0.5, 10.0), (1.25, 12.5), (2.0, 20.0), (3.5, 35.0), (4.0, 40.0), (9.0, 40.0)]
    {
        assert_eq!(x_at(&channel, time), x, "{time}");
    }
}

#[test]
fn cubics_have_the_keys_values_and_slopes() {
    // In-tangent, value, out-tangent: from 0 at 3 m/s to 8 at −1 m/s in two seconds.
    let values = [7.0, 0.0, 3.0, -1.0, 8.0, 5.0];
    let channel = slide(&[1.0, 3.0], &values, Interpolation::CubicSpline);
    // Half way: ½·0 + ⅛·2·3 + ½·8 − ⅛·2·(−1).
    for (time, x) in [(0.0, 0.0), (1.0, 0.0), (2.0, 5.0), (3.0, 8.0), (4.0, 8.0)] {
        assert!((x_at(&channel, time) - x).abs() < 1e-12, "{time}");
    }
    let slope = |time: f64| (x_at(&channel, time + 1e-6) - x_at(&channel, time)) / 1e-6;
    assert!((slope(1.0) - 3.0).abs() < 1e-4 && (slope(3.0 - 1e-6) + 1.0).abs() < 1e-4);
}

#[test]
fn rotations_turn_at_constant_speed_along_the_shorter_arc() {
    let channel = turn(&[0.0, 1.0], &[0.0, FRAC_PI_2], Interpolation::Linear);
    for share in [0.0, 0.1, 0.5, 0.9, 1.0] {
        let q = channel.rotation_at(share).unwrap();
        // Keys are f32, so an angle is off by some 10⁻⁷.
        assert!((about_y(share * FRAC_PI_2).angle_between(q)).abs() < 1e-6, "{share}");
    }
    let Track::Rotation(keys) = channel.track.clone() else { panic!() };
    let negated = Channel { track: Track::Rotation(vec![keys[0], -keys[1]]), ..channel.clone() };
    assert!(same(negated.rotation_at(0.25).unwrap(), channel.rotation_at(0.25).unwrap()));
    let still = turn(&[0.0, 1.0], &[1.0, 1.0], Interpolation::Linear);
    assert!((still.rotation_at(0.4).unwrap().angle_between(about_y(1.0))).abs() < 1e-6);
}

#[test]
fn opposite_and_cubic_rotations_stay_rotations() {
    let half = turn(&[0.0, 1.0], &[0.0, PI], Interpolation::Linear);
    for share in [0.0, 0.25, 0.5, 1.0] {
        let q = half.rotation_at(share).unwrap();
        assert!((q.length() - 1.0).abs() < 1e-12);
        assert!((q.to_axis_angle().1 - share * PI).abs() < 1e-6, "{share}");
    }
    let still = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    let (from, to) = (Quat::IDENTITY, about_y(FRAC_PI_2).as_quat());
    let values = vec![still, from, still, still, to, still];
    let cubic = channel(&[0.0, 1.0], Track::Rotation(values), Interpolation::CubicSpline);
    // Without tangents, half way is the normalised mean: an eighth turn.
    assert!((cubic.rotation_at(0.5).unwrap().angle_between(about_y(FRAC_PI_2 / 2.0))).abs() < 1e-6);
    assert!((cubic.rotation_at(0.1).unwrap().length() - 1.0).abs() < 1e-12);
}

#[test]
fn malformed_keys_do_no_harm() {
    for interpolation in [Interpolation::Step, Interpolation::Linear] {
        let single = slide(&[2.0], &[5.0], interpolation);
        assert_eq!([0.0, 2.0, 7.0].map(|t| x_at(&single, t)), [5.0; 3]);
        let jump = slide(&[0.0, 1.0, 1.0, 2.0], &[0.0, 1.0, 5.0, 6.0], interpolation);
        assert_eq!((x_at(&jump, 1.0), x_at(&jump, 2.0)), (5.0, 6.0));
        assert!(x_at(&jump, 1.0 - 1e-9) < 1.0 + 1e-9);
        let all_equal = slide(&[1.0, 1.0, 1.0], &[1.0, 2.0, 3.0], interpolation);
        assert_eq!((x_at(&all_equal, 0.5), x_at(&all_equal, 1.0)), (1.0, 3.0));
    }
    let zero =
        channel(&[0.0, 1.0], Track::Rotation(vec![Quat::from_array([0.0; 4]); 2]), Interpolation::Linear);
    assert_eq!(zero.rotation_at(0.5), Some(DQuat::IDENTITY));
    let single = slide(&[1.0], &[7.0, 5.0, 9.0], Interpolation::CubicSpline);
    assert_eq!([0.0, 1.0, 2.0].map(|t| x_at(&single, t)), [5.0; 3]);
    let bad = slide(&[0.0, 1.0], &[0.0, f32::NAN], Interpolation::Linear);
    assert_eq!((bad.vector_at(0.5), bad.rotation_at(0.5)), (None, None));
    assert!(!slide(&[0.0, 1.0], &[0.0], Interpolation::Linear).is_whole());
    assert!(!slide(&[], &[], Interpolation::Step).is_whole());
}

#[test]
fn an_animation_repeats_after_its_last_key() {
    let scene = scene(
        vec![node(None)],
        vec![animation(vec![slide(&[0.0, 4.0], &[0.0, 8.0], Interpolation::Linear)])],
    );
    let x = |time: f64| scene.at(time).instances[0].world_from_mesh.translation.x;
    for (time, expected) in
        [(0.0, 0.0), (1.0, 2.0), (3.5, 7.0), (4.0, 0.0), (9.0, 2.0), (-1.0, 6.0), (4e6 + 1.0, 2.0)]
    {
        assert_eq!(x(time), expected, "{time}");
    }
    for time in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(x(time), 0.0);
    }
    assert!(scene.is_animated());
}

#[test]
fn only_descendants_of_a_moved_node_move() {
    let quarter = Rest::Parts(Parts { rotation: about_y(FRAC_PI_2), ..Parts::default() });
    let mut nodes = vec![node(None), node(Some(0)), node(None)];
    nodes[1].rest = Rest::Parts(Parts { translation: DVec3::new(0.0, 3.0, 0.0), ..Parts::default() });
    nodes[2].rest = quarter;
    let mut scene = scene(
        nodes,
        vec![animation(vec![turn(&[0.0, 1.0, 2.0], &[0.0, FRAC_PI_2, 0.0], Interpolation::Linear)])],
    );
    scene.instances[2].world_from_mesh = DAffine3::from_translation(DVec3::splat(1e6 + 0.1));
    let pose = scene.at(1.0);
    for i in 0..2 {
        let x = pose.instances[i].world_from_mesh.transform_vector3(DVec3::X);
        assert!((x - DVec3::NEG_Z).length() < 1e-6, "{x}");
    }
    assert_eq!(pose.instances[1].world_from_mesh.translation, DVec3::new(0.0, 3.0, 0.0));
    assert_eq!(pose.instances[2], scene.instances[2], "to the last bit");
    assert_eq!(pose.lighting, scene.lighting);
}

#[test]
fn of_two_animations_of_a_property_the_first_plays_beside_those_of_others_with_their_own_lengths() {
    let rise = |times: &[f32]| {
        let values = times.iter().map(|&t| Vec3::new(1.0, 1.0 + t, 1.0)).collect();
        channel(times, Track::Scale(values), Interpolation::Linear)
    };
    let animations = vec![
        animation(vec![slide(&[0.0, 2.0], &[0.0, 2.0], Interpolation::Linear)]),
        animation(vec![
            slide(&[0.0, 2.0], &[50.0, 60.0], Interpolation::Linear),
            turn(&[0.0], &[1.0], Interpolation::Step),
        ]),
        animation(vec![rise(&[0.0, 3.0])]),
    ];
    let scene = scene(vec![node(None)], animations);
    let pose = scene.at(5.0).instances[0].world_from_mesh;
    assert_eq!((pose.translation.x, pose.matrix3.y_axis.y), (1.0, 3.0));
    let [(silent, other)] = scene.not_playing()[..] else { panic!() };
    assert!(std::ptr::eq(silent, &scene.animations[1]) && std::ptr::eq(other, &scene.animations[0]));
}

#[test]
fn scenes_whose_animations_move_nothing_are_still() {
    let moved = |channels: Vec<Channel>| scene(vec![node(None)], vec![animation(channels)]).is_animated();
    assert!(moved(vec![slide(&[0.0, 1.0], &[0.0, 1.0], Interpolation::Step)]));
    assert!(!moved(vec![slide(&[0.0], &[7.0], Interpolation::Step)]));
    assert!(!moved(Vec::new()));
    let elsewhere = Channel { node: 9, ..slide(&[0.0, 1.0], &[0.0, 1.0], Interpolation::Step) };
    assert!(!moved(vec![elsewhere.clone()]));
    assert_eq!(scene(vec![node(None)], vec![animation(vec![elsewhere])]).at(0.5).instances.len(), 1);
    let mut sheared = node(None);
    sheared.rest = Rest::Matrix(DAffine3::from_translation(DVec3::Y));
    let sheared =
        scene(vec![sheared], vec![animation(vec![slide(&[0.0, 1.0], &[0.0, 1.0], Interpolation::Step)])]);
    assert_eq!(sheared.at(1.0).instances, sheared.instances);
}

#[test]
fn lights_move_with_their_nodes() {
    let mut lamp = node(None);
    lamp.lights = vec![0, 1];
    let channels = vec![
        slide(&[0.0, 2.0], &[0.0, 2.0], Interpolation::Linear),
        turn(&[0.0, 2.0], &[0.0, FRAC_PI_2], Interpolation::Linear),
    ];
    let mut scene = scene(vec![lamp], vec![animation(channels)]);
    let (position, direction) = (DVec3::ZERO, DVec3::NEG_Z);
    scene.lighting.lights = vec![
        Light::Point { position, intensity: Vec3::ONE, range: None, radius: 0.0 },
        Light::Directional { direction, irradiance: Vec3::ONE, angular_radius: 0.0 },
    ];
    scene.instances.clear();
    assert!(scene.is_animated());
    let lighting = scene.at(1.0).lighting;
    assert_eq!(
        lighting.lights[0],
        Light::Point { position: DVec3::X, intensity: Vec3::ONE, range: None, radius: 0.0 }
    );
    let Light::Directional { direction, .. } = lighting.lights[1] else { panic!() };
    assert!((direction - DVec3::new(-FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2)).length() < 1e-6, "{direction}");
}

/// The box around the vertices at many times.
fn sampled(scene: &Scene, secs: f64) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    for i in 0..=2000 {
        for instance in scene.at(secs * f64::from(i) / 2000.0).instances {
            for position in &scene.meshes[instance.mesh as usize].positions {
                bounds.extend(instance.world_from_mesh.transform_point3(position.as_dvec3()));
            }
        }
    }
    bounds
}

#[test]
fn bounds_hold_every_moment_and_are_tight_for_simple_motion() {
    let linear = Interpolation::Linear;
    let sliding = scene(vec![node(None)], vec![animation(vec![slide(&[0.0, 4.0], &[0.0, 8.0], linear)])]);
    assert_eq!(sliding.bounds(), Bounds { min: DVec3::ZERO, max: DVec3::new(9.0, 1.0, 0.0) });

    let spin = turn(&[0.0, 1.0, 2.0, 3.0], &[0.0, 2.0, 4.0, 2.0 * PI], linear);
    let spinning = scene(vec![node(None)], vec![animation(vec![spin.clone()])]).bounds();
    // The triangle's box turns about y: the circle of x, within the margin of the tested steps.
    assert!(
        (spinning.max - DVec3::ONE).abs().max_element() < 0.01 && (spinning.min.y).abs() < 0.01,
        "{spinning:?}"
    );

    // A spline that overshoots, below a node that turns, below one that is scaled, with lengths that never meet.
    let overshoot = slide(&[0.0, 1.7], &[0.0, 0.0, 30.0, -30.0, 1.0, 0.0], Interpolation::CubicSpline);
    let grow = channel(&[0.0, 2.3], Track::Scale(vec![Vec3::ONE, Vec3::new(-2.0, 3.0, 0.5)]), linear);
    let mut nodes = vec![node(None), node(Some(0)), node(Some(1)), node(Some(2))];
    nodes[1].rest =
        Rest::Matrix(DAffine3::from_rotation_x(0.7) * DAffine3::from_scale(DVec3::new(1.0, 2.0, -1.0)));
    let animations = vec![
        animation(vec![spin, Channel { node: 2, ..overshoot }]),
        animation(vec![Channel { node: 3, ..grow.clone() }]),
        animation(vec![
            Channel { node: 2, ..turn(&[0.0, 0.9], &[-1.0, 1.5], linear) },
            Channel { node: 0, ..grow },
        ]),
    ];
    let mut scene = scene(nodes, animations);
    scene.instances = scene.at(0.0).instances;
    let (bounds, seen) = (scene.bounds(), sampled(&scene, 40.0));
    assert!(bounds.contains(seen.min) && bounds.contains(seen.max), "{bounds:?} {seen:?}");
    assert!(bounds.size().max_element() < 3.0 * seen.size().max_element(), "{bounds:?} {seen:?}");
}

#[test]
fn a_deep_chain_of_moving_nodes_is_bounded_without_recursion() {
    let count = 20_000u32;
    let nodes = (0..count).map(|i| node(i.checked_sub(1))).collect();
    let wobble = |node| Channel { node, ..slide(&[0.0, 1.0], &[0.0, 1.0], Interpolation::Linear) };
    let mut scene = scene(nodes, vec![animation((0..count).map(wobble).collect())]);
    scene.instances.drain(..count as usize - 1);
    assert_eq!(scene.bounds().max.x, f64::from(count) + 1.0);
    assert_eq!(scene.at(0.5).instances[0].world_from_mesh.translation.x, f64::from(count) * 0.5);
}
