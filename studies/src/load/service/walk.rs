//! Camera walks of the service study's clients.
//!
//! A walk depends only on the scene's description, the client and the time, so that every mode renders the same views. It
//! knows bounds and recommended viewpoints but no triangles: a client may pass through a wall.

use std::f64::consts::TAU;

use argus_proto::Description;
use argus_scene::{Bounds, Camera};
use glam::{DQuat, DVec3};

/// How clients move. All walks but [`Walk::Jumps`] start at the scene's recommended viewpoints in turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Walk {
    /// A smooth walk. Inside the bounds a client wanders by several per cent of the scene's size and turns its head.
    /// Outside it swings about its target, comes down into the bounds, and goes back.
    Steady,
    /// Another viewpoint each second: level and anywhere within the bounds if the recommended viewpoint is inside
    /// them, else anywhere around the scene.
    Jumps,
    /// The camera stands still.
    Stand,
}

/// Period in seconds of the quickest client of the steady walk, and how much longer the slowest one takes. Periods
/// differ so that some clients are near the scene while others are far away.
const PERIOD_SECS: f64 = 12.0;
const SLOWEST: f64 = 8.0;
/// Radius of the circle of an eye inside the bounds, as a share of the scene's longest side.
const STRAY: f64 = 0.04;
/// Largest turn of the head to either side in radians, inside and in front of the scene.
const HEAD_TURN: f64 = 0.7;
/// Largest swing to either side of an eye outside the bounds, in radians.
const SWING: f64 = 0.44;
/// The closest approach to the target, as a share of the distance from the bounds' surface to the target.
const LEAST_LEFT: f64 = 0.05;
/// Distance that eyes inside the bounds keep from their surface, as a share of each side.
const MARGIN: f64 = 0.02;
/// Relatives of the golden ratio for two and three dimensions: their multiples spread evenly.
const SPREAD: [f64; 3] = [0.819_172_513_396_164, 0.671_043_606_703_789, 0.549_700_477_901_97];
const GOLDEN: f64 = 0.618_033_988_749_895;

impl Walk {
    /// All walks, in the order of the help text.
    pub const ALL: [Self; 3] = [Self::Steady, Self::Jumps, Self::Stand];

    /// The name in arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Steady => "steady",
            Self::Jumps => "jumps",
            Self::Stand => "stand",
        }
    }

    /// The camera of a client, counted from 0, at a time in seconds. It is always valid.
    pub fn camera(self, description: &Description, client: u32, secs: f64) -> Camera {
        let base = description.cameras[client as usize % description.cameras.len()].camera;
        let path = ClientPath { base, bounds: description.bounds, client };
        let inside = description.bounds.contains(base.eye);
        let moved = match (self, inside) {
            (Self::Stand, _) => base,
            (Self::Steady, true) => path.stray(secs),
            (Self::Steady, false) => path.approach(secs),
            (Self::Jumps, true) => path.room(secs),
            (Self::Jumps, false) => path.around(secs),
        };
        // Bounds without extent, or a target at their surface, may leave no view direction.
        if moved.validate().is_ok() { moved } else { base }
    }
}

/// What a client's walk depends on.
struct ClientPath {
    base: Camera,
    bounds: Bounds,
    client: u32,
}

impl ClientPath {
    fn up(&self) -> DVec3 {
        self.base.up.normalize_or(DVec3::Y)
    }

    /// The view direction without its part along `up`: a unit vector.
    fn ahead(&self) -> DVec3 {
        let (up, axis) = (self.up(), self.base.target - self.base.eye);
        (axis - up * axis.dot(up)).normalize_or(up.any_orthonormal_vector())
    }

    /// This client's number in 0–1; the numbers of all clients are evenly spread.
    fn share(&self) -> f64 {
        (f64::from(self.client) * GOLDEN).fract()
    }

    /// Angle in radians on the client's circle; 0 at the start.
    fn turn(&self, secs: f64) -> f64 {
        TAU * secs / (PERIOD_SECS + SLOWEST * self.share())
    }

    /// The closest point of the bounds, slightly inside their surface.
    fn within(&self, point: DVec3) -> DVec3 {
        if self.bounds.is_empty() {
            return self.base.eye;
        }
        let margin = self.bounds.size() * MARGIN;
        point.clamp(self.bounds.min + margin, self.bounds.max - margin)
    }

    /// Walks a circle through the viewpoint, each client in its own direction, with a turning head.
    fn stray(&self, secs: f64) -> Camera {
        let (turn, up) = (self.turn(secs), self.up());
        let radius = STRAY * self.bounds.size().max_element();
        let heading = DQuat::from_axis_angle(up, TAU * self.share()) * self.ahead();
        let side = heading.cross(up);
        let eye = self.base.eye
            + (heading * (1.0 - turn.cos()) + side * turn.sin() + up * 0.2 * (2.0 * turn).sin()) * radius;
        let head = DQuat::from_axis_angle(up, HEAD_TURN * (1.5 * turn).sin());
        // The viewpoint lies within the bounds, so they are not empty.
        let eye = eye.clamp(self.bounds.min, self.bounds.max);
        self.looking(eye, head * (self.base.target - self.base.eye))
    }

    /// Goes from the viewpoint towards the target, into the bounds and back, swinging about the target.
    fn approach(&self, secs: f64) -> Camera {
        let (turn, up) = (self.turn(secs), self.up());
        let target = self.base.target;
        let far = self.base.eye - target;
        let near = self.nearest() - target;
        // 0 at the viewpoint, 1 at the nearest point. Equal times give equal ratios of distance.
        let closeness = 0.5 - 0.5 * turn.cos();
        let length = far.length() * (near.length() / far.length()).powf(closeness);
        let direction = far.normalize_or(DVec3::Z).lerp(near.normalize_or(DVec3::Z), closeness);
        let side = if self.client.is_multiple_of(2) { 1.0 } else { -1.0 };
        let swing = DQuat::from_axis_angle(up, side * SWING * (0.7 * turn).sin());
        let eye = target + swing * direction.normalize_or(DVec3::Z) * length;
        let eye = if closeness > 0.5 { eye.lerp(self.within(eye), 2.0 * closeness - 1.0) } else { eye };
        let head = DQuat::from_axis_angle(up, 0.5 * HEAD_TURN * closeness * (2.0 * turn).sin());
        self.looking(eye, head * (target - eye))
    }

    /// The nearest point of an approach, inside the bounds: at the surface of a compact object, and the closer to the
    /// target the flatter the scene is.
    fn nearest(&self) -> DVec3 {
        let (size, target) = (self.bounds.size(), self.base.target);
        let flatness = size.dot(self.up().abs()) / size.max_element();
        // Written so that bounds without extent give 1.
        let left = if flatness > 0.0 { (flatness * flatness).clamp(LEAST_LEFT, 1.0) } else { 1.0 };
        self.within(target + (self.entry() - target) * left)
    }

    /// Where the line from the eye to the target enters the bounds; if it does not, their point closest to the target.
    fn entry(&self) -> DVec3 {
        let (eye, way) = (self.base.eye, self.base.target - self.base.eye);
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for axis in 0..3 {
            let (least, most) = (self.bounds.min[axis] - eye[axis], self.bounds.max[axis] - eye[axis]);
            if way[axis] != 0.0 {
                let (a, b) = (least / way[axis], most / way[axis]);
                (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
            } else if least > 0.0 || most < 0.0 {
                return self.within(self.base.target);
            }
        }
        if from <= to { eye + way * from } else { self.within(self.base.target) }
    }

    /// The client's viewpoint of this second, as three numbers in 0–1.
    fn jump(&self, secs: f64) -> [f64; 3] {
        let second = secs.max(0.0).floor();
        let of = |axis: usize| {
            (0.5 + self.share() * (1.0 + axis as f64) + (1.0 + second) * SPREAD[axis]).rem_euclid(1.0)
        };
        [of(0), of(1), of(2)]
    }

    /// A random position in the lower half of the bounds, looking about level.
    fn room(&self, secs: f64) -> Camera {
        let (share, up) = (DVec3::from(self.jump(secs)), self.up());
        // Along the up axis, only the lower half.
        let share = share + up.abs() * (DVec3::splat(0.1) - share * 0.6);
        let eye = self.within(self.bounds.min + self.bounds.size() * share);
        let yaw = TAU * share.element_sum().fract();
        self.looking(eye, DQuat::from_axis_angle(up, yaw) * self.ahead())
    }

    /// A random position around the target, 10° to 70° above it, at 25% to 100% of the viewpoint's distance.
    fn around(&self, secs: f64) -> Camera {
        let [x, y, z] = self.jump(secs);
        let (up, target) = (self.up(), self.base.target);
        let distance = (self.base.eye - target).length() * (0.25 + 0.75 * z);
        let (sin, cos) = (10.0 + 60.0 * y).to_radians().sin_cos();
        let level = DQuat::from_axis_angle(up, TAU * x) * -self.ahead();
        self.looking(target + (level * cos + up * sin) * distance, -(level * cos + up * sin) * distance)
    }

    fn looking(&self, eye: DVec3, along: DVec3) -> Camera {
        Camera { eye, target: eye + along, ..self.base }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::scene::NamedCamera;
    use argus_scene::{LightLevel, Limits, PlanRequest, Rig, SceneHash};

    use super::*;

    fn description(bounds: Bounds, cameras: &[Camera]) -> Description {
        let named = |camera: &Camera| NamedCamera { name: String::new(), camera: *camera };
        Description {
            scene_name: "a scene".to_owned(),
            scene_hash: SceneHash([0; 32]),
            bounds,
            triangles: 12,
            effects: Vec::new(),
            effect_plan: argus_scene::EffectPlan::default(),
            cameras: cameras.iter().map(named).collect(),
            limits: Limits::default(),
            rig: Rig::Cell { origin: DVec3::ZERO, spacing: 1.0, face: 64 },
            defaults: PlanRequest::default(),
            epoch_secs: 0.0,
            first_light: LightLevel::Full,
            light: String::new(),
            scenes: Vec::new(),
        }
    }

    /// Bounds whose longest side is 40 m.
    fn hall() -> Description {
        let bounds = Bounds { min: DVec3::new(-20.0, -1.0, -10.0), max: DVec3::new(20.0, 14.0, 10.0) };
        let corner = Camera::look_at(DVec3::new(19.9, 2.0, 9.9), DVec3::ZERO);
        description(bounds, &[Camera::look_at(DVec3::new(-11.0, 3.0, 0.0), DVec3::Y * 4.0), corner])
    }

    /// Bounds 200 m wide and 70 m high, seen from above their rim.
    fn valley() -> Description {
        let bounds = Bounds { min: DVec3::new(-100.0, -14.0, -100.0), max: DVec3::new(100.0, 56.0, 100.0) };
        let look = |x, y, z| Camera::look_at(DVec3::new(x, y, z), DVec3::new(4.0, 12.0, 0.0));
        description(bounds, &[look(-14.0, 72.0, 112.0), look(118.0, 80.0, 48.0), look(0.0, 230.0, 60.0)])
    }

    fn times() -> impl Iterator<Item = f64> {
        (0..400).map(|i| f64::from(i) * 0.1).chain([1e6, 1e9])
    }

    #[test]
    fn every_camera_is_valid_and_repeatable() {
        for description in [hall(), valley()] {
            for walk in Walk::ALL {
                for (client, secs) in (0..20).flat_map(|client| times().map(move |secs| (client, secs))) {
                    let camera = walk.camera(&description, client, secs);
                    camera.validate().unwrap();
                    assert_eq!(camera, walk.camera(&description, client, secs), "{walk:?} {client} {secs}");
                }
            }
        }
    }

    #[test]
    fn a_walk_that_starts_inside_stays_within_the_bounds() {
        let hall = hall();
        for walk in Walk::ALL {
            for (client, secs) in (0..20).flat_map(|client| times().map(move |secs| (client, secs))) {
                let eye = walk.camera(&hall, client, secs).eye;
                assert!(hall.bounds.contains(eye), "{walk:?} {client} {secs}: {eye}");
            }
        }
    }

    #[test]
    fn steady_walks_start_at_the_recommended_viewpoints_and_standing_ones_stay() {
        for description in [hall(), valley()] {
            for client in 0..6 {
                let base = description.cameras[client as usize % description.cameras.len()].camera;
                let first = Walk::Steady.camera(&description, client, 0.0);
                assert!(first.eye.distance(base.eye) < 1e-9 * base.eye.length(), "{first:?} {base:?}");
                assert_eq!(Walk::Stand.camera(&description, client, 7.3), base);
            }
        }
    }

    #[test]
    fn a_steady_walk_inside_wanders_by_several_per_cent_without_jumps() {
        let hall = hall();
        for client in 0..8 {
            let eye = |secs| Walk::Steady.camera(&hall, client, secs).eye;
            let farthest = times().map(|secs| eye(secs).distance(eye(0.0))).fold(0.0, f64::max);
            assert!((0.03 * 40.0..0.1 * 40.0).contains(&farthest), "client {client}: {farthest} m");
            let step = times().take(400).map(|secs| eye(secs + 0.1).distance(eye(secs)));
            assert!(step.fold(0.0, f64::max) < 0.2, "client {client}: a step of more than 2 m/s");
        }
    }

    #[test]
    fn a_steady_walk_outside_descends_into_the_bounds_and_returns_without_jumps() {
        let (valley, target) = (valley(), DVec3::new(4.0, 12.0, 0.0));
        for client in 0..8 {
            let eye = |secs| Walk::Steady.camera(&valley, client, secs).eye;
            let distance = |secs| eye(secs).distance(target);
            let near = times().min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap();
            assert!((4.0..20.0).contains(&distance(near)), "client {client}: {} m", distance(near));
            assert!((target.y..target.y + 12.0).contains(&eye(near).y), "client {client}: {}", eye(near));
            assert!(valley.bounds.contains(eye(near)) && !valley.bounds.contains(eye(0.0)));
            assert!(near < 11.0 || client > 0, "the first client is there within {PERIOD_SECS} s: {near}");
            for secs in times().take(400) {
                let step = eye(secs + 0.1).distance(eye(secs));
                assert!(step < 0.12 * distance(secs), "client {client} at {secs} s: {step} m");
            }
        }
    }

    #[test]
    fn a_steady_walk_approaches_an_object_without_entering_it() {
        let bounds = Bounds { min: DVec3::new(-1.0, 0.0, -1.0), max: DVec3::new(1.0, 2.0, 1.0) };
        let base = Camera::look_at(DVec3::new(3.0, 3.0, 5.0), DVec3::Y);
        let object = description(bounds, &[base]);
        let distance = |secs| Walk::Steady.camera(&object, 0, secs).eye.distance(DVec3::Y);
        let nearest = times().map(distance).fold(f64::INFINITY, f64::min);
        assert!((0.9..1.5).contains(&nearest), "{nearest}");
    }

    #[test]
    fn jumps_change_the_place_each_second_and_stand_still_in_between() {
        for (description, apart) in [(hall(), 2.0), (valley(), 10.0)] {
            for client in 0..4 {
                let eye = |secs| Walk::Jumps.camera(&description, client, secs).eye;
                let eyes: Vec<DVec3> = (0..20).map(|second| eye(f64::from(second))).collect();
                for (second, pair) in eyes.windows(2).enumerate() {
                    assert_eq!(eye(second as f64 + 0.9), pair[0]);
                    assert!(pair[0].distance(pair[1]) > apart, "{pair:?}");
                }
                assert_ne!(eyes[0], Walk::Jumps.camera(&description, client + 4, 0.0).eye);
            }
        }
    }

    #[test]
    fn jumps_look_down_at_a_scene_from_outside_and_cover_its_floor_inside() {
        let (valley, hall) = (valley(), hall());
        let mut columns = [false; 8];
        for second in 0..40 {
            let above = Walk::Jumps.camera(&valley, 0, f64::from(second));
            assert!(above.eye.y > 12.0 && above.target.distance(DVec3::new(4.0, 12.0, 0.0)) < 1e-9);
            let eye = Walk::Jumps.camera(&hall, 0, f64::from(second)).eye;
            assert!(eye.y <= hall.bounds.center().y, "{eye}");
            columns[((eye.x + 20.0) / 5.0) as usize] = true;
        }
        assert_eq!(columns, [true; 8]);
    }

    #[test]
    fn flat_and_empty_bounds_leave_every_walk_valid() {
        let camera = Camera::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO);
        let down = Camera { up: DVec3::Z, ..Camera::look_at(DVec3::Y * 5.0, DVec3::ZERO) };
        let point = |at| Bounds { min: at, max: at };
        let flat = Bounds { min: DVec3::new(-1.0, 0.0, -1.0), max: DVec3::new(1.0, 0.0, 1.0) };
        for bounds in [point(DVec3::ZERO), point(camera.eye), flat, Bounds::EMPTY] {
            for base in [camera, down, Camera { up: DVec3::new(0.3, -2.0, 0.1), ..camera }] {
                let description = description(bounds, &[base]);
                for walk in Walk::ALL {
                    for (client, secs) in (0..3).flat_map(|client| times().map(move |secs| (client, secs))) {
                        walk.camera(&description, client, secs).validate().unwrap();
                    }
                }
            }
        }
    }

    #[test]
    fn a_walk_far_from_the_origin_is_the_same_walk_moved() {
        let away = DVec3::new(1e6, -2e5, 3e6);
        let mut moved = valley();
        (moved.bounds.min, moved.bounds.max) = (moved.bounds.min + away, moved.bounds.max + away);
        for named in &mut moved.cameras {
            (named.camera.eye, named.camera.target) = (named.camera.eye + away, named.camera.target + away);
        }
        for (walk, secs) in Walk::ALL.into_iter().flat_map(|walk| times().map(move |secs| (walk, secs))) {
            let (here, there) = (walk.camera(&valley(), 1, secs), walk.camera(&moved, 1, secs));
            assert!((there.eye - away).distance(here.eye) < 1e-6, "{walk:?} {secs}");
        }
    }
}
