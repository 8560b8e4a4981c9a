//! What a view will show, told by a coarse grid of rays, and how well samples would cover that.
//!
//! A survey answers two questions before anything is rendered. *Coverage*: which share of what the view shows do the
//! samples see at all? *Fineness*: for which share is a texel of a sample, projected into the view, no larger than a few
//! pixels? Both are estimates from few rays: whoever renders the frame looks at its pixels as well.

use glam::{DVec2, DVec3};

use super::Sight;
use crate::{Camera, Rig, SampleCamera};

/// Rays of a survey: columns and rows. Their number is that of the bits of a [`u64`], less some.
const GRID: [u32; 2] = [8, 6];

/// Rays of a survey.
const RAYS: usize = (GRID[0] * GRID[1]) as usize;

/// A camera is worth this share of what it shows for what others show already: between the rays, near the edges of
/// things, it sees what they do not.
pub(crate) const BESIDES: f64 = 0.3;

/// What a ray of a view meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// A surface at a point, metres, world space.
    Surface(DVec3),
    /// Nothing, in this direction.
    Sky(DVec3),
}

impl Target {
    /// How well a camera shows this target to a viewer, 0 to 1, where it sees it: less from aside and from afar, and less
    /// the farther the camera is from the viewer, since more between the rays is hidden from it.
    pub fn worth(&self, camera: DVec3, eye: DVec3) -> f64 {
        let Self::Surface(point) = *self else { return 1.0 };
        let (from_camera, from_eye) = (point - camera, point - eye);
        let (distance, near) = (from_camera.length(), from_eye.length());
        if !(distance > 0.0 && near > 0.0) {
            return 0.0;
        }
        let aside = (from_camera.dot(from_eye) / (distance * near)).max(0.0);
        aside * (near / distance).min(1.0).sqrt() * near / (near + camera.distance(eye))
    }
}

/// One sample camera, judged by the targets of a view. Bit i of a mask stands for target i.
#[derive(Debug, Clone, PartialEq)]
struct Judged {
    index: u64,
    seen: u64,
    fine: u64,
    worths: Vec<f64>,
}

/// What samples would show of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Share of the targets that one of the samples sees.
    pub covered: f64,
    /// Share of the targets that one of the samples sees with texels as fine as was asked for.
    pub fine: f64,
}

/// A view's targets, and the sample cameras that were judged by them.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    eye: DVec3,
    /// Angle of a pixel in the middle of the view, radians.
    pixel_angle: f64,
    targets: Vec<Target>,
    judged: Vec<Judged>,
}

impl Survey {
    /// Sends the rays of a view of `width` × `height` pixels at a time of the scene, seconds.
    pub fn new(camera: &Camera, [width, height]: [u32; 2], sight: &dyn Sight, time_secs: f64) -> Self {
        let cell = DVec2::new(f64::from(width), f64::from(height)) / DVec2::from(GRID.map(f64::from));
        let directions: Vec<DVec3> = (0..GRID[0] * GRID[1])
            .map(|i| {
                let place = DVec2::new(f64::from(i % GRID[0]), f64::from(i / GRID[0]));
                camera.direction((place + 0.5) * cell, width, height)
            })
            .collect();
        let targets = sight.targets(camera.eye, &directions, time_secs);
        let pixel_angle = 2.0 * camera.tan_half_fov(width, height).y / f64::from(height.max(1));
        Self { eye: camera.eye, pixel_angle, targets, judged: Vec::new() }
    }

    /// Judges one of the rig's cameras, unless it has been judged. A texel counts as fine where it covers at most
    /// `most_pixels` pixels of the view to a side.
    pub fn judge(&mut self, rig: &Rig, index: u64, sight: &dyn Sight, time_secs: f64, most_pixels: f64) {
        if self.judged.iter().any(|judged| judged.index == index) {
            return;
        }
        let Ok(camera) = rig.camera(index) else { return };
        let at = camera.center();
        let shown = sight.shows(at, &self.targets, time_secs);
        let mut judged = Judged { index, seen: 0, fine: 0, worths: vec![0.0; self.targets.len()] };
        for (i, target) in self.targets.iter().enumerate().take(RAYS) {
            if shown.get(i) != Some(&true) || !camera.frames(target) {
                continue;
            }
            judged.seen |= 1 << i;
            judged.worths[i] = target.worth(at, self.eye);
            if self.texel_pixels(&camera, target) <= most_pixels {
                judged.fine |= 1 << i;
            }
        }
        self.judged.push(judged);
    }

    /// Pixels of the view that a texel of a sample covers at a target, to a side.
    fn texel_pixels(&self, camera: &SampleCamera, target: &Target) -> f64 {
        let nearer = match *target {
            Target::Sky(_) => 1.0,
            Target::Surface(point) => point.distance(camera.center()) / point.distance(self.eye),
        };
        // A target at the eye itself gives NaN or infinity, which no limit admits.
        nearer * camera.texel_angle() / self.pixel_angle
    }

    /// The cameras, of those that were judged and are allowed, that together show most of the view, best first.
    pub fn choose(&self, allowed: impl Fn(u64) -> bool, count: usize) -> Vec<u64> {
        let mut left: Vec<&Judged> = self.judged.iter().filter(|judged| allowed(judged.index)).collect();
        let mut shown = vec![0.0; self.targets.len()];
        let mut best = Vec::new();
        while best.len() < count && !left.is_empty() {
            let gain = |judged: &Judged| -> f64 {
                judged.worths.iter().zip(&shown).map(|(worth, shown)| added(*worth, *shown)).sum()
            };
            let gains: Vec<f64> = left.iter().map(|judged| gain(judged)).collect();
            // Of equals the first one that was judged.
            let most = (0..gains.len()).rev().max_by(|&a, &b| gains[a].total_cmp(&gains[b]));
            let Some(chosen) = most.map(|most| left.remove(most)) else { break };
            shown.iter_mut().zip(&chosen.worths).for_each(|(shown, worth)| *shown = worth.max(*shown));
            best.push(chosen.index);
        }
        best
    }

    /// How well these cameras together cover the view; a camera that was not judged covers nothing.
    pub fn coverage(&self, indices: &[u64]) -> Coverage {
        let of = |mask: fn(&Judged) -> u64| {
            let chosen = self.judged.iter().filter(|judged| indices.contains(&judged.index));
            let together = chosen.fold(0, |all, judged| all | mask(judged));
            // A view without targets shows nothing that could be missed.
            f64::from(together.count_ones()) / (self.targets.len().max(1)) as f64
        };
        match self.targets.is_empty() {
            true => Coverage { covered: 1.0, fine: 1.0 },
            false => Coverage { covered: of(|judged| judged.seen), fine: of(|judged| judged.fine) },
        }
    }
}

/// What a camera that shows a target so well adds to others.
pub(crate) fn added(worth: f64, shown: f64) -> f64 {
    (worth - shown).max(0.0) + BESIDES * worth
}

impl SampleCamera {
    /// Angle of a texel in the middle of a face, radians; infinite for an image without faces.
    pub fn texel_angle(&self) -> f64 {
        let faces = self.faces();
        faces.first().map_or(f64::INFINITY, |face| 2.0 * face.tan_half_fov.y / f64::from(face.size[1].max(1)))
    }

    /// Whether a target lies within one of the camera's faces, whatever stands before it.
    fn frames(&self, target: &Target) -> bool {
        let direction = match *target {
            Target::Surface(point) => point - self.center(),
            Target::Sky(direction) => direction,
        };
        self.faces().iter().any(|face| {
            let p = face.view_from_world * direction;
            let (x, y) = (p.x / -p.z, p.y / -p.z);
            p.z < 0.0 && x.abs() <= face.tan_half_fov.x && y.abs() <= face.tan_half_fov.y
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bounds;

    /// A plane at x = `at`, seen from either side, and nothing else.
    #[derive(Debug)]
    struct Wall(f64);

    impl Sight for Wall {
        fn best(&self, _: &Camera, candidates: &[(u64, DVec3)], count: usize) -> Vec<u64> {
            candidates.iter().map(|(index, _)| *index).take(count).collect()
        }

        fn sees(&self, from: DVec3, to: DVec3) -> bool {
            (from.x - self.0) * (to.x - self.0) > 0.0
        }

        fn targets(&self, eye: DVec3, directions: &[DVec3], _: f64) -> Vec<Target> {
            let target = |direction: &DVec3| {
                let t = (self.0 - eye.x) / direction.x;
                if t > 0.0 { Target::Surface(eye + *direction * t) } else { Target::Sky(*direction) }
            };
            directions.iter().map(target).collect()
        }

        fn shows(&self, from: DVec3, targets: &[Target], _: f64) -> Vec<bool> {
            targets.iter().map(|target| matches!(target, Target::Surface(_)) && from.x < self.0).collect()
        }
    }

    fn rig(face: u32) -> Rig {
        Rig::Cell { origin: DVec3::ZERO, spacing: 2.0, face }
    }

    fn survey(camera: &Camera, rig: &Rig, most_pixels: f64) -> (Survey, Vec<u64>) {
        let mut survey = Survey::new(camera, [320, 240], &Wall(10.0), 0.0);
        let near = rig.nearest(camera, 8);
        near.iter().for_each(|&index| survey.judge(rig, index, &Wall(10.0), 0.0, most_pixels));
        (survey, near)
    }

    #[test]
    fn samples_at_the_viewers_side_cover_a_wall_and_those_behind_it_nothing() {
        let here = Camera::look_at(DVec3::new(0.3, 0.4, 0.5), DVec3::new(9.0, 0.4, 0.5));
        let (survey, near) = survey(&here, &rig(512), 4.0);
        assert_eq!(survey.coverage(&near), Coverage { covered: 1.0, fine: 1.0 });
        assert_eq!(survey.coverage(&[]), Coverage { covered: 0.0, fine: 0.0 });
        let behind = rig(512).nearest(&Camera::look_at(DVec3::splat(30.0), DVec3::ZERO), 4);
        assert_eq!(survey.coverage(&behind).covered, 0.0, "they were never judged");
    }

    #[test]
    fn a_viewer_that_walks_up_to_a_wall_finds_texels_too_coarse() {
        let at = |x| Camera::look_at(DVec3::new(x, 0.1, 0.2), DVec3::new(20.0, 0.1, 0.2));
        let fine = |x, most_pixels| {
            let (survey, _) = survey(&at(x), &rig(512), most_pixels);
            survey.coverage(&survey.choose(|_| true, 4)).fine
        };
        assert_eq!(fine(1.1, 2.0), 1.0);
        // From a tenth of a metre, the nearest camera at the wall's side is some two metres away.
        assert!(fine(9.95, 2.0) < 0.1, "{}", fine(9.95, 2.0));
    }

    #[test]
    fn the_choice_holds_no_more_than_is_asked_for_and_only_what_is_allowed() {
        let here = Camera::look_at(DVec3::new(0.3, 0.4, 0.5), DVec3::X * 9.0);
        let (survey, near) = survey(&here, &rig(64), 4.0);
        assert_eq!(survey.choose(|_| true, 3).len(), 3);
        assert_eq!(survey.choose(|index| index == near[5], 3), [near[5]]);
        assert_eq!(survey.choose(|_| false, 3), [0; 0]);
    }

    #[test]
    fn hard_cases_give_shares_between_0_and_1() {
        let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
        let tiles = Rig::TileCorners { bounds, tiles: [1, 1], height: 1.0, size: [40, 30] };
        let far = DVec3::splat(1e6);
        for rig in [rig(8), tiles] {
            for eye in [DVec3::ZERO, DVec3::X * 10.0, DVec3::X * 20.0, far, rig.camera(0).unwrap().center()] {
                let camera = Camera::look_at(eye, eye + DVec3::new(1.0, 0.1, 0.0));
                let (survey, near) = survey(&camera, &rig, 2.0);
                let Coverage { covered, fine } = survey.coverage(&near);
                assert!((0.0..=1.0).contains(&covered) && (0.0..=covered).contains(&fine), "{eye}");
                survey.choose(|_| true, 8);
            }
        }
    }

    #[test]
    fn a_perspective_sample_covers_what_lies_within_its_image_alone() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
        let sample = SampleCamera::Perspective { camera, width: 40, height: 30 };
        assert!(sample.frames(&Target::Surface(DVec3::new(5.0, 0.1, 0.1))));
        assert!(!sample.frames(&Target::Surface(DVec3::new(-5.0, 0.1, 0.1))));
        assert!(!sample.frames(&Target::Surface(DVec3::new(1.0, 3.0, 0.0))));
        assert!(!sample.frames(&Target::Surface(DVec3::ZERO)), "at the camera itself");
    }
}
