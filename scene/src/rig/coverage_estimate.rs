//! Coverage estimate of a view by a coarse grid of rays, and how well samples would cover it.
//!
//! An estimate has two shares before a render. *Coverage*: the share of the view's surfaces that the samples see
//! at all. *Fineness*: the share where a sample's texel, projected into the view, is no larger than a few pixels.
//! Both come from few rays; the rendered frame's pixels are counted as well.

use glam::{DVec2, DVec3};

use super::VisibilityQuery;
use super::judged::{Judged, RayResults};
use super::target::Target;
use crate::{Camera, FaceMask, Rig, SampleCamera};

/// Columns and rows of an estimate's rays: fewer rays than the bits of a [`u64`].
pub(super) const GRID: [u32; 2] = [8, 6];

/// Rays are listed by blocks of this many columns and rows. Neighbours in the list are neighbours in the view, which
/// helps a [`VisibilityQuery`] that traces several rays at once.
const BLOCK: [u32; 2] = [4, 2];

/// Number of an estimate's rays.
pub(super) const RAYS: usize = (GRID[0] * GRID[1]) as usize;

/// Estimated shares of a view that samples would show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Share of the targets that one of the samples sees.
    pub covered: f64,
    /// Share of the targets that one of the samples sees with texels of the requested fineness.
    pub fine: f64,
}

/// A view's targets, and the sample cameras judged by them.
#[derive(Debug, Clone, PartialEq)]
pub struct CoverageEstimate {
    pub(super) eye: DVec3,
    /// Unit vector of the direction of view.
    pub(super) ahead: DVec3,
    /// Scene time of the estimate, seconds.
    pub(super) time_secs: f64,
    /// Angle of a pixel in the middle of the view, radians.
    pixel_angle: f64,
    /// Mean distance of the visible surfaces, metres; 0 without any.
    pub(super) reach: f64,
    pub(super) targets: Vec<Target>,
    /// Eye from which each target was met: this view's or an earlier one's.
    pub(super) met_from: Vec<DVec3>,
    pub(super) judged: Vec<Judged>,
    /// Ray results of earlier estimates for cameras that this one has not judged.
    pub(super) results: Vec<(u64, RayResults)>,
}

impl CoverageEstimate {
    /// Sends the rays of a view of `width` × `height` pixels at a time of the scene, seconds.
    pub fn new(camera: &Camera, size: [u32; 2], sight: &dyn VisibilityQuery, time_secs: f64) -> Self {
        Self::without_targets(camera, size, time_secs).renewed(camera, size, sight, time_secs)
    }

    /// An estimate without targets.
    pub(super) fn without_targets(camera: &Camera, [width, height]: [u32; 2], time_secs: f64) -> Self {
        Self {
            eye: camera.eye,
            ahead: (camera.target - camera.eye).normalize(),
            time_secs,
            pixel_angle: 2.0 * camera.tan_half_fov(width, height).y / f64::from(height.max(1)),
            reach: 0.0,
            targets: Vec::with_capacity(RAYS),
            met_from: Vec::with_capacity(RAYS),
            judged: Vec::new(),
            results: Vec::new(),
        }
    }

    /// Judges one of the rig's cameras by all targets, unless it is judged already. A texel is fine if it covers at most
    /// `most_pixels` pixels of the view to a side.
    pub fn judge(
        &mut self,
        rig: &Rig,
        index: u64,
        sight: &dyn VisibilityQuery,
        time_secs: f64,
        most_pixels: f64,
    ) {
        let Some(mut judged) = self.introduced(rig, index, most_pixels) else { return };
        judged.ask(u64::MAX, &self.targets, sight, time_secs);
        self.judged.push(judged);
    }

    /// Judges a camera that is not of a rig, under a number of its own, like [`Self::judge`].
    pub fn judge_camera(
        &mut self,
        (number, camera): (u64, &SampleCamera),
        sight: &dyn VisibilityQuery,
        time_secs: f64,
        most_pixels: f64,
    ) {
        if self.judged.iter().any(|judged| judged.index == number) {
            return;
        }
        let mut judged = self.introduced_as(number, camera, most_pixels);
        judged.ask(u64::MAX, &self.targets, sight, time_secs);
        self.judged.push(judged);
    }

    /// Judges cameras with only the rays needed to choose `count` of them: each gets rays to targets that those
    /// before it do not show with fine texels. For cameras that [`Self::choose`] takes, [`Self::coverage`] is as
    /// exact as after [`Self::judge`]; for other cameras it may be too low, never too high.
    pub fn judge_few(
        &mut self,
        rig: &Rig,
        indices: &[u64],
        count: usize,
        (sight, time_secs): (&dyn VisibilityQuery, f64),
        most_pixels: f64,
    ) {
        let begin = self.judged.len();
        for &index in indices {
            self.judged.extend(self.introduced(rig, index, most_pixels));
        }
        let mut left: Vec<usize> = (begin..self.judged.len()).collect();
        // Where no camera has fine texels, coarse ones are the best.
        let attainable = self.judged[begin..].iter().fold(0, |all, judged| all | judged.near & judged.framed);
        let (mut shown, mut open) = (vec![0.0; self.targets.len()], u64::MAX);
        for _ in 0..count {
            let mut gains: Vec<f64> =
                left.iter().map(|&at| self.judged[at].gain(&shown, FaceMask::ALL)).collect();
            let chosen = loop {
                let Some(most) = first_of_most(&gains) else { return };
                let judged = &mut self.judged[left[most]];
                if !judged.ask(open, &self.targets, sight, time_secs) {
                    break &self.judged[left.remove(most)];
                }
                gains[most] = judged.gain(&shown, FaceMask::ALL);
            };
            shown.iter_mut().zip(chosen.worths()).for_each(|(shown, worth)| *shown = worth.max(*shown));
            open &= !(chosen.fine() | chosen.seen & !attainable);
        }
    }

    /// A camera without rays so far; `None` if it is judged already or the rig has no such camera.
    fn introduced(&self, rig: &Rig, index: u64, most_pixels: f64) -> Option<Judged> {
        if self.judged.iter().any(|judged| judged.index == index) {
            return None;
        }
        Some(self.introduced_as(index, &rig.camera(index).ok()?, most_pixels))
    }

    /// A camera without rays so far, under a number.
    fn introduced_as(&self, index: u64, camera: &SampleCamera, most_pixels: f64) -> Judged {
        let (at, texel_angle) = (camera.center(), camera.texel_angle());
        let results = self.results.iter().find(|(camera, _)| *camera == index).map(|(_, results)| *results);
        let texel_pixels = |target: &Target| self.texel_pixels(at, texel_angle, target);
        let view = (self.eye, &self.targets[..]);
        Judged::new((index, camera), view, results.unwrap_or_default(), texel_pixels, most_pixels)
    }

    /// Pixels of the view, to a side, that a texel of a sample at a position covers at a target.
    fn texel_pixels(&self, at: DVec3, texel_angle: f64, target: &Target) -> f64 {
        let nearer = match *target {
            Target::Sky(_) => 1.0,
            Target::Surface(point) => point.distance(at) / point.distance(self.eye),
        };
        // A target at the eye gives NaN or infinity, which exceeds every limit.
        nearer * texel_angle / self.pixel_angle
    }

    /// Mean angle, radians, between the view's rays and the nearest of these eyes' rays to the same surfaces; at most 1 for
    /// each. 0 for the sky, which looks alike from everywhere. 1 without eyes.
    pub fn parallax(&self, eyes: &[DVec3]) -> f64 {
        let nearest = eyes.iter().map(|eye| eye.distance(self.eye)).fold(f64::INFINITY, f64::min);
        let angle = |target: &Target| match target {
            Target::Sky(_) => 0.0,
            // A surface at the eye gives NaN or infinity, which count as 1.
            Target::Surface(point) => (nearest / point.distance(self.eye)).min(1.0),
        };
        self.targets.iter().map(angle).sum::<f64>() / self.targets.len().max(1) as f64
    }

    /// The judged cameras.
    pub fn cameras(&self) -> impl Iterator<Item = u64> {
        self.judged.iter().map(|judged| judged.index)
    }

    /// The cameras, among those judged and allowed, that together show most of the view, best first.
    pub fn choose(&self, allowed: impl Fn(u64) -> bool, count: usize) -> Vec<u64> {
        let faces = |index| if allowed(index) { FaceMask::ALL } else { FaceMask::NONE };
        self.choose_by_faces(faces, count).into_iter().map(|(index, _)| index).collect()
    }

    /// The cameras, among those judged, that together show most of the view by these faces of theirs, best first, each with
    /// its faces. A camera without faces is not chosen.
    pub fn choose_by_faces(&self, faces: impl Fn(u64) -> FaceMask, count: usize) -> Vec<(u64, FaceMask)> {
        let with_faces = self.judged.iter().map(|judged| (judged, faces(judged.index)));
        let mut left: Vec<(&Judged, FaceMask)> = with_faces.filter(|(_, faces)| !faces.is_empty()).collect();
        let mut shown = vec![0.0; self.targets.len()];
        let mut best = Vec::new();
        while best.len() < count && !left.is_empty() {
            let gains: Vec<f64> = left.iter().map(|(judged, faces)| judged.gain(&shown, *faces)).collect();
            let Some((chosen, faces)) = first_of_most(&gains).map(|most| left.remove(most)) else { break };
            let worths = chosen.worths_within(faces);
            shown.iter_mut().zip(worths).for_each(|(shown, worth)| *shown = worth.max(*shown));
            best.push((chosen.index, faces));
        }
        best
    }

    /// The faces of a judged camera in which it shows the view, with those whose borders are near: between two rays, the view
    /// may cross a border. All faces for a camera that is not judged.
    pub fn faces(&self, index: u64) -> FaceMask {
        let judged = self.judged.iter().find(|judged| judged.index == index);
        judged.map_or(FaceMask::ALL, Judged::faces)
    }

    /// Coverage of the view by these cameras together, in the order of a plan; a camera that is not judged covers nothing.
    pub fn coverage(&self, indices: &[u64]) -> Coverage {
        let whole: Vec<(u64, FaceMask)> = indices.iter().map(|index| (*index, FaceMask::ALL)).collect();
        self.coverage_by_faces(&whole)
    }

    /// Coverage of the view by these faces of cameras together, in the order of a plan; a camera that is not judged covers
    /// nothing. A target is shown by the first camera that sees it, as in a frame from these samples.
    pub fn coverage_by_faces(&self, cameras: &[(u64, FaceMask)]) -> Coverage {
        if self.targets.is_empty() {
            // A view without targets misses nothing.
            return Coverage { covered: 1.0, fine: 1.0 };
        }
        let (mut seen, mut fine) = (0_u64, 0_u64);
        for (index, faces) in cameras {
            let Some(judged) = self.judged.iter().find(|judged| judged.index == *index) else { continue };
            let within = judged.within(*faces);
            fine |= judged.fine() & within & !seen;
            seen |= judged.seen & within;
        }
        let share = |mask: u64| f64::from(mask.count_ones()) / self.targets.len() as f64;
        Coverage { covered: share(seen), fine: share(fine) }
    }
}

/// Index of the largest gain; of equals the first, which was judged first.
fn first_of_most(gains: &[f64]) -> Option<usize> {
    (0..gains.len()).rev().max_by(|&a, &b| gains[a].total_cmp(&gains[b]))
}

impl SampleCamera {
    /// Angle of a texel in the middle of a face, radians; infinite for an image without faces.
    pub fn texel_angle(&self) -> f64 {
        let faces = self.faces();
        faces.first().map_or(f64::INFINITY, |face| 2.0 * face.tan_half_fov.y / f64::from(face.size[1].max(1)))
    }
}

/// Index of the ray whose cell holds a position, given as shares of width and height from the top left, below 1.
pub(super) fn ray_at(share: DVec2) -> u32 {
    let [column, row] = (share * DVec2::from(GRID.map(f64::from))).to_array().map(|x| x as u32);
    let [columns, rows] = BLOCK;
    let block = row / rows * (GRID[0] / columns) + column / columns;
    block * columns * rows + row % rows * columns + column % columns
}

/// Column and row of an estimate's ray.
pub(super) fn place(ray: u32) -> DVec2 {
    let [columns, rows] = BLOCK;
    let (block, within) = (ray / (columns * rows), ray % (columns * rows));
    let blocks = GRID[0] / columns;
    let column = block % blocks * columns + within % columns;
    let row = block / blocks * rows + within / columns;
    DVec2::new(f64::from(column), f64::from(row))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bounds;

    /// A single plane at x = `at`, visible from both sides.
    #[derive(Debug)]
    struct Wall(f64);

    impl VisibilityQuery for Wall {
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

    fn estimate(camera: &Camera, rig: &Rig, most_pixels: f64) -> (CoverageEstimate, Vec<u64>) {
        let mut estimate = CoverageEstimate::new(camera, [320, 240], &Wall(10.0), 0.0);
        let near = rig.nearest(camera, 8);
        near.iter().for_each(|&index| estimate.judge(rig, index, &Wall(10.0), 0.0, most_pixels));
        (estimate, near)
    }

    #[test]
    fn samples_beside_the_viewer_cover_a_wall_and_those_behind_it_nothing() {
        let here = Camera::look_at(DVec3::new(0.3, 0.4, 0.5), DVec3::new(9.0, 0.4, 0.5));
        let (estimate, near) = estimate(&here, &rig(512), 4.0);
        assert_eq!(estimate.coverage(&near), Coverage { covered: 1.0, fine: 1.0 });
        assert_eq!(estimate.coverage(&[]), Coverage { covered: 0.0, fine: 0.0 });
        let behind = rig(512).nearest(&Camera::look_at(DVec3::splat(30.0), DVec3::ZERO), 4);
        assert_eq!(estimate.coverage(&behind).covered, 0.0, "they were never judged");
    }

    #[test]
    fn a_viewer_close_to_a_wall_sees_too_coarse_texels() {
        let at = |x| Camera::look_at(DVec3::new(x, 0.1, 0.2), DVec3::new(20.0, 0.1, 0.2));
        let fine = |x, most_pixels| {
            let (estimate, _) = estimate(&at(x), &rig(512), most_pixels);
            estimate.coverage(&estimate.choose(|_| true, 4)).fine
        };
        assert_eq!(fine(1.1, 2.0), 1.0);
        // From a tenth of a metre, the nearest camera on the viewer's side is about two metres away.
        assert!(fine(9.95, 2.0) < 0.1, "{}", fine(9.95, 2.0));
    }

    #[test]
    fn the_choice_holds_at_most_the_requested_number_of_allowed_cameras() {
        let here = Camera::look_at(DVec3::new(0.3, 0.4, 0.5), DVec3::X * 9.0);
        let (estimate, near) = estimate(&here, &rig(64), 4.0);
        assert_eq!(estimate.choose(|_| true, 3).len(), 3);
        assert_eq!(estimate.choose(|index| index == near[5], 3), [near[5]]);
        assert_eq!(estimate.choose(|_| false, 3), [0; 0]);
    }

    /// A wall behind one sphere, which hides a part of it from each camera; it counts rays.
    #[derive(Debug)]
    struct Counted(std::sync::atomic::AtomicUsize);

    impl VisibilityQuery for Counted {
        fn sees(&self, _: DVec3, _: DVec3) -> bool {
            true
        }

        fn targets(&self, eye: DVec3, directions: &[DVec3], time_secs: f64) -> Vec<Target> {
            Wall(10.0).targets(eye, directions, time_secs)
        }

        fn shows(&self, from: DVec3, targets: &[Target], _: f64) -> Vec<bool> {
            self.0.fetch_add(targets.len(), std::sync::atomic::Ordering::Relaxed);
            let shows = |target: &Target| {
                let Target::Surface(point) = *target else { return false };
                let (way, to_ball) = ((point - from).normalize(), DVec3::new(6.0, 0.5, 0.5) - from);
                (to_ball - way * to_ball.dot(way)).length() > 0.7
            };
            targets.iter().map(shows).collect()
        }
    }

    #[test]
    fn few_rays_choose_the_same_cameras_with_the_same_coverage() {
        let mut sent = [0; 2];
        for (place, face) in [(0.3, 512), (0.7, 512), (1.4, 256), (2.6, 1024), (4.9, 512)] {
            let eye = DVec3::new(place, 0.4, 0.9 - place * 0.1);
            let camera = Camera::look_at(eye, DVec3::new(9.0, 0.4, 0.5));
            let near = rig(face).nearest(&camera, 8);
            let (few, all) = (Counted(0.into()), Counted(0.into()));
            let mut by_few = CoverageEstimate::new(&camera, [320, 240], &few, 0.0);
            by_few.judge_few(&rig(face), &near, 4, (&few, 0.0), 1.5);
            let mut by_all = CoverageEstimate::new(&camera, [320, 240], &all, 0.0);
            near.iter().for_each(|&index| by_all.judge(&rig(face), index, &all, 0.0, 1.5));
            let chosen = by_few.choose(|_| true, 4);
            assert_eq!(chosen.len(), 4);
            assert_eq!(chosen[0], by_all.choose(|_| true, 1)[0], "{place}");
            // The chosen cameras' coverage is exact; a single camera's may be too low.
            let (of_few, of_all) = (by_few.coverage(&chosen), by_all.coverage(&chosen));
            assert_eq!(of_few.fine, of_all.fine, "{place}: {of_few:?} {of_all:?}");
            assert!(of_few.covered <= of_all.covered && of_few.covered >= of_all.fine);
            for index in &near {
                let (few, whole) = (by_few.coverage(&[*index]), by_all.coverage(&[*index]));
                assert!(few.covered <= whole.covered && few.fine <= whole.fine);
            }
            let [few, all] = [few, all].map(|sight| sight.0.into_inner());
            assert!(few < all, "{place}: {few} of {all} rays");
            sent = [sent[0] + few, sent[1] + all];
        }
        assert!(3 * sent[0] < 2 * sent[1], "{sent:?}");
    }

    #[test]
    fn extreme_views_give_shares_between_0_and_1() {
        let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
        let tiles = Rig::TileCorners { bounds, tiles: [1, 1], height: 1.0, size: [40, 30] };
        let far = DVec3::splat(1e6);
        for rig in [rig(8), tiles] {
            for eye in [DVec3::ZERO, DVec3::X * 10.0, DVec3::X * 20.0, far, rig.camera(0).unwrap().center()] {
                let camera = Camera::look_at(eye, eye + DVec3::new(1.0, 0.1, 0.0));
                let (estimate, near) = estimate(&camera, &rig, 2.0);
                let Coverage { covered, fine } = estimate.coverage(&near);
                assert!((0.0..=1.0).contains(&covered) && (0.0..=covered).contains(&fine), "{eye}");
                estimate.choose(|_| true, 8);
            }
        }
    }

    #[test]
    fn each_ray_of_a_estimate_has_its_own_cell() {
        let mut places: Vec<[u32; 2]> =
            (0..RAYS as u32).map(|ray| place(ray).to_array().map(|x| x as u32)).collect();
        assert_eq!(places[..5], [[0, 0], [1, 0], [2, 0], [3, 0], [0, 1]]);
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), RAYS);
        assert!(places.iter().all(|place| place[0] < GRID[0] && place[1] < GRID[1]));
        let cells = DVec2::from(GRID.map(f64::from));
        assert!((0..RAYS as u32).all(|ray| ray_at((place(ray) + 0.5) / cells) == ray));
    }
}
