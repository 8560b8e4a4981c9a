//! A sample camera, judged by the targets of a view.

use glam::{DVec2, DVec3};

use super::VisibilityQuery;
use super::target::{Target, added};
use crate::camera::{Face, OmniLayout, cube_face_of};
use crate::{FaceMask, SampleCamera};

/// One sample camera, judged by the targets of a view. Bit i of a mask stands for target i.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Judged {
    pub(super) index: u64,
    at: DVec3,
    /// Targets that the camera would show without occluders.
    pub(super) framed: u64,
    /// Targets at which its texels are fine.
    pub(super) near: u64,
    /// Targets that it has sent a ray to.
    asked: u64,
    /// Targets that it shows, by its rays.
    pub(super) seen: u64,
    /// Its worth for each target, if it shows it.
    worths: Vec<f64>,
    /// The faces around the direction of each target.
    around: Vec<FaceMask>,
    /// The face that each target is looked up in; 0 for a single image.
    face: Vec<usize>,
}

/// Results of a camera's rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct RayResults {
    pub(super) asked: u64,
    pub(super) seen: u64,
}

impl Judged {
    /// A camera with results of earlier rays. `texel_pixels` returns the pixels of the view that a texel covers at a
    /// target, to a side. A texel that covers at most `most_pixels` is fine.
    pub(super) fn new(
        (index, camera): (u64, &SampleCamera),
        (eye, targets): (DVec3, &[Target]),
        results: RayResults,
        texel_pixels: impl Fn(&Target) -> f64,
        most_pixels: f64,
    ) -> Self {
        let at = camera.center();
        let faces = if sees_all_around(camera) { Vec::new() } else { camera.faces() };
        let directions = || targets.iter().map(|target| target.direction_from(at));
        let mut judged = Self {
            index,
            at,
            framed: 0,
            near: 0,
            asked: 0,
            seen: 0,
            worths: vec![0.0; targets.len()],
            around: directions().map(|direction| FaceMask::around(camera, direction)).collect(),
            face: match sees_all_around(camera) {
                true => directions().map(cube_face_of).collect(),
                false => vec![0; targets.len()],
            },
        };
        for (i, target) in targets.iter().enumerate() {
            let framed = match sees_all_around(camera) {
                true => target.direction_from(at).abs().max_element() > 0.0,
                false => frames(&faces, at, target),
            };
            if framed {
                judged.framed |= 1 << i;
                judged.worths[i] = target.worth(at, eye);
                judged.near |= u64::from(texel_pixels(target) <= most_pixels) << i;
            }
        }
        judged.asked = results.asked & judged.framed;
        judged.seen = results.seen & judged.asked;
        judged
    }

    /// Results of its rays.
    pub(super) fn results(&self) -> RayResults {
        RayResults { asked: self.asked, seen: self.seen }
    }

    /// Targets that it shows with fine texels.
    pub(super) fn fine(&self) -> u64 {
        self.seen & self.near
    }

    /// The targets that lie in these faces.
    pub(super) fn within(&self, faces: FaceMask) -> u64 {
        if faces == FaceMask::ALL {
            return u64::MAX;
        }
        let within = |(i, face): (usize, &usize)| u64::from(faces.has(*face)) << i;
        self.face.iter().enumerate().map(within).fold(0, |all, target| all | target)
    }

    /// The faces in which it shows targets, with those whose borders are near one.
    pub(super) fn faces(&self) -> FaceMask {
        let shown = self.around.iter().enumerate().filter(|(i, _)| self.seen >> i & 1 == 1);
        shown.fold(FaceMask::NONE, |all, (_, around)| all.union(*around))
    }

    /// Share of the rays that met their targets, as an estimate for the other targets. By Laplace's rule of
    /// succession: two rays that miss do not prove that all will.
    fn share(&self) -> f64 {
        match self.asked {
            0 => 1.0,
            _ => f64::from(self.seen.count_ones() + 1) / f64::from(self.asked.count_ones() + 2),
        }
    }

    /// Its worth for each target, as far as it is known.
    pub(super) fn worths(&self) -> impl Iterator<Item = f64> {
        let share = self.share();
        self.worths.iter().enumerate().map(move |(i, worth)| {
            match (self.seen >> i & 1 == 1, self.asked >> i & 1 == 1) {
                (true, _) => *worth,
                (false, true) => 0.0,
                (false, false) => worth * share,
            }
        })
    }

    /// Its worth for each target, by these faces alone.
    pub(super) fn worths_within(&self, faces: FaceMask) -> impl Iterator<Item = f64> {
        let within = self.within(faces);
        self.worths().enumerate().map(move |(i, worth)| if within >> i & 1 == 1 { worth } else { 0.0 })
    }

    /// Its gain over cameras that show each target as well as `shown`, by these faces alone.
    pub(super) fn gain(&self, shown: &[f64], faces: FaceMask) -> f64 {
        self.worths_within(faces).zip(shown).map(|(worth, shown)| added(worth, *shown)).sum()
    }

    /// Sends rays to `some` of the targets, unless that is done already; returns whether any was sent.
    pub(super) fn ask(
        &mut self,
        some: u64,
        targets: &[Target],
        sight: &dyn VisibilityQuery,
        time_secs: f64,
    ) -> bool {
        let open = self.framed & some & !self.asked;
        let asked: Vec<usize> = (0..targets.len()).filter(|target| open >> target & 1 == 1).collect();
        if asked.is_empty() {
            return false;
        }
        let points: Vec<Target> = asked.iter().map(|&target| targets[target]).collect();
        let shown = sight.shows(self.at, &points, time_secs);
        self.asked |= open;
        for (target, _) in asked.iter().zip(shown).filter(|(_, shown)| *shown) {
            self.seen |= 1 << target;
        }
        true
    }
}

/// Whether a camera's faces show every direction.
fn sees_all_around(camera: &SampleCamera) -> bool {
    matches!(camera, SampleCamera::Omni { layout: OmniLayout::CubeFaces { .. }, .. })
}

/// Whether a target lies within one of the faces of a camera at a position, without occluders.
fn frames(faces: &[Face], at: DVec3, target: &Target) -> bool {
    let direction = target.direction_from(at);
    faces.iter().any(|face| {
        let p = face.view_from_world * direction;
        let at = DVec2::new(p.x, -p.y) / -p.z - face.tan_center;
        p.z < 0.0 && at.abs().cmple(face.tan_half_fov).all()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Camera;

    #[test]
    fn a_perspective_sample_frames_only_targets_within_its_image() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X);
        let sample = SampleCamera::Perspective { camera, width: 40, height: 30 };
        let faces = sample.faces();
        let frames = |point| frames(&faces, sample.center(), &Target::Surface(point));
        assert!(frames(DVec3::new(5.0, 0.1, 0.1)));
        assert!(!frames(DVec3::new(-5.0, 0.1, 0.1)));
        assert!(!frames(DVec3::new(1.0, 3.0, 0.0)));
        assert!(!frames(DVec3::ZERO), "at the camera itself");
    }

    #[test]
    fn a_cube_frames_every_direction_but_not_its_own_position() {
        let cube = SampleCamera::Omni { center: DVec3::ONE, layout: OmniLayout::CubeFaces { face: 8 } };
        let targets = [DVec3::ZERO, DVec3::ONE, DVec3::new(1.0, 9.0, 1.0), DVec3::NAN].map(Target::Surface);
        let judged = Judged::new((1, &cube), (DVec3::Y * 3.0, &targets), RayResults::default(), |_| 1.0, 2.0);
        assert_eq!(judged.framed, 0b101);
        let by_faces: Vec<bool> =
            targets.iter().map(|target| frames(&cube.faces(), cube.center(), target)).collect();
        assert_eq!(by_faces, [true, false, true, false]);
    }
}
