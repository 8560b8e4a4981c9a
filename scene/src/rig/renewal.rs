//! An estimate of a view that reuses the estimate of an earlier view near it.
//!
//! A camera's visibility of a point does not depend on the viewer. So points in both views keep the results of their
//! rays, and new rays are sent only for the rest of the view. A viewer who walks or turns mostly sees the same points
//! as a moment ago. A point may become hidden from the viewer, so it is kept only while the viewer has moved little
//! relative to its distance.

use glam::{DVec2, DVec3};

use super::VisibilityQuery;
use super::coverage_estimate::{CoverageEstimate, GRID, RAYS, place, ray_at};
use super::judged::RayResults;
use super::target::Target;
use crate::Camera;

/// A point is kept until the viewer has moved by this share of its distance. Nearer surfaces then hide it by less than a
/// cell of the grid, which is 0.13 wide at distance 1 for a field of view of 60°.
const MOST_MOVED: f64 = 0.1;

impl CoverageEstimate {
    /// The estimate of another view, at a time in seconds, with as many kept targets as possible.
    pub fn renewed(
        &self,
        camera: &Camera,
        size: [u32; 2],
        sight: &dyn VisibilityQuery,
        time_secs: f64,
    ) -> Self {
        let kept = match time_secs == self.time_secs {
            true => self.kept(camera, size),
            false => [None; RAYS],
        };
        let mut estimate = Self::without_targets(camera, size, time_secs);
        let rays: Vec<u32> = (0..RAYS as u32).filter(|ray| kept[*ray as usize].is_none()).collect();
        let [width, height] = size;
        let cell = DVec2::new(f64::from(width), f64::from(height)) / DVec2::from(GRID.map(f64::from));
        let directions: Vec<DVec3> =
            rays.iter().map(|ray| camera.direction((place(*ray) + 0.5) * cell, width, height)).collect();
        let mut new = sight.targets(camera.eye, &directions, time_secs).into_iter();
        for (ray, before) in kept.iter().enumerate() {
            let (target, from) = match before {
                Some(before) => (self.targets[*before], self.met_from[*before]),
                // If a sight returns too few targets, the rest counts as sky.
                None => {
                    let direction = || camera.direction((place(ray as u32) + 0.5) * cell, width, height);
                    (new.next().unwrap_or_else(|| Target::Sky(direction())), camera.eye)
                }
            };
            estimate.targets.push(target);
            estimate.met_from.push(from);
        }
        estimate.reach = estimate.mean_range();
        let moved = |mask: u64| {
            let kept = kept.iter().enumerate();
            let bits = kept.filter_map(|(ray, before)| Some((mask >> (*before)? & 1) << ray));
            bits.fold(0, |all, bit| all | bit)
        };
        let moved =
            |results: RayResults| RayResults { asked: moved(results.asked), seen: moved(results.seen) };
        let judged = self.judged.iter().map(|judged| (judged.index, judged.results()));
        let earlier =
            self.results.iter().filter(|(at, _)| self.judged.iter().all(|judged| judged.index != *at));
        estimate.results = judged.chain(earlier.copied()).map(|(at, results)| (at, moved(results))).collect();
        estimate.results.retain(|(_, results)| results.asked != 0);
        estimate
    }

    /// For each ray of another view, the index of a target of this estimate in the ray's cell of the view.
    fn kept(&self, camera: &Camera, [width, height]: [u32; 2]) -> [Option<usize>; RAYS] {
        let mut kept = [None; RAYS];
        let (view_from_world, plane) = (camera.view_from_world(), camera.plane(width, height));
        for (i, (target, from)) in self.targets.iter().zip(&self.met_from).enumerate() {
            let direction = target.direction_from(camera.eye);
            let distance = match target {
                Target::Surface(_) => direction.length(),
                // Sky is hidden by the surfaces around it.
                Target::Sky(_) => self.reach,
            };
            if !(camera.eye.distance(*from) <= MOST_MOVED * distance) {
                continue;
            }
            let p = view_from_world * direction;
            let share = ((DVec2::new(p.x, -p.y) / -p.z - plane.center) / plane.half + 1.0) * 0.5;
            // A NaN is in no cell.
            let is_within = p.z < 0.0 && share.cmpge(DVec2::ZERO).all() && share.cmplt(DVec2::ONE).all();
            if is_within {
                kept[ray_at(share) as usize].get_or_insert(i);
            }
        }
        kept
    }

    /// Mean distance of the visible surfaces; 0 without any.
    fn mean_range(&self) -> f64 {
        let range = |target: &Target| match target {
            Target::Surface(point) => Some(point.distance(self.eye)),
            Target::Sky(_) => None,
        };
        let (sum, count) =
            self.targets.iter().filter_map(range).fold((0.0, 0.0), |(s, n), r| (s + r, n + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Distance of a view from this estimate's view; 0 for the same view.
    pub fn apart(&self, camera: &Camera) -> f64 {
        let moved = self.eye.distance(camera.eye) / (MOST_MOVED * self.reach).max(f64::MIN_POSITIVE);
        let turned = self.ahead.distance((camera.target - camera.eye).normalize());
        let apart = moved + turned;
        if apart.is_nan() { f64::INFINITY } else { apart }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::Rig;

    /// A room of ten metres with a pillar in its middle, at any distance from the world's zero; it counts rays.
    #[derive(Debug)]
    struct Room {
        middle: DVec3,
        met: AtomicUsize,
        shown: AtomicUsize,
    }

    impl Room {
        fn at(middle: DVec3) -> Self {
            Self { middle, met: AtomicUsize::new(0), shown: AtomicUsize::new(0) }
        }

        /// Range along a unit direction, metres.
        fn range(&self, from: DVec3, unit: DVec3) -> f64 {
            let from = from - self.middle;
            let wall = (DVec3::splat(5.0) * unit.signum() - from) / unit;
            // A pillar of half a metre along y.
            let (a, b) = (unit.x * unit.x + unit.z * unit.z, from.x * unit.x + from.z * unit.z);
            let root = (b * b - a * (from.x * from.x + from.z * from.z - 0.25)).sqrt();
            let pillar = (-b - root) / a;
            let wall = wall.min_element();
            if pillar > 0.0 { wall.min(pillar) } else { wall }
        }

        fn rays(&self) -> [usize; 2] {
            [&self.met, &self.shown].map(|count| count.swap(0, Ordering::Relaxed))
        }
    }

    impl VisibilityQuery for Room {
        fn sees(&self, _: DVec3, _: DVec3) -> bool {
            true
        }

        fn targets(&self, eye: DVec3, directions: &[DVec3], _: f64) -> Vec<Target> {
            self.met.fetch_add(directions.len(), Ordering::Relaxed);
            directions.iter().map(|d| Target::Surface(eye + *d * self.range(eye, *d))).collect()
        }

        fn shows(&self, from: DVec3, targets: &[Target], _: f64) -> Vec<bool> {
            self.shown.fetch_add(targets.len(), Ordering::Relaxed);
            let shows = |target: &Target| {
                let way = target.direction_from(from);
                self.range(from, way.normalize()) >= 0.999 * way.length()
            };
            targets.iter().map(shows).collect()
        }
    }

    const SIZE: [u32; 2] = [320, 240];

    fn judged(mut estimate: CoverageEstimate, room: &Room, camera: &Camera) -> CoverageEstimate {
        let rig = Rig::Cell { origin: room.middle, spacing: 2.0, face: 512 };
        estimate.judge_few(&rig, &rig.nearest(camera, 8), 4, (room, estimate.time_secs), 1.5);
        estimate
    }

    fn camera(room: &Room, step: f64) -> Camera {
        let eye = room.middle + DVec3::new(-3.3 + 0.1 * step, 0.4, 0.7);
        Camera::look_at(eye, eye + DVec3::new(1.0, 0.0, 0.05 * step))
    }

    #[test]
    fn the_same_view_again_sends_no_ray_and_gives_the_same_estimate() {
        let room = Room::at(DVec3::ZERO);
        let here = camera(&room, 0.0);
        let first = judged(CoverageEstimate::new(&here, SIZE, &room, 0.0), &room, &here);
        assert_eq!(room.rays()[0], RAYS);
        let again = judged(first.renewed(&here, SIZE, &room, 0.0), &room, &here);
        assert_eq!(room.rays(), [0, 0]);
        assert_eq!(
            (again.targets.clone(), again.judged.clone()),
            (first.targets.clone(), first.judged.clone())
        );
        assert_eq!(first.apart(&here), 0.0);
    }

    #[test]
    fn a_viewer_who_walks_and_turns_sends_few_rays_for_the_same_coverage() {
        for middle in [DVec3::ZERO, DVec3::new(1e6, -2e6, 3e6)] {
            let room = Room::at(middle);
            let mut estimate = CoverageEstimate::new(&camera(&room, 0.0), SIZE, &room, 0.0);
            let (mut rays, mut apart) = (0, 0.0_f64);
            for step in 1..=20 {
                room.rays();
                let here = camera(&room, f64::from(step));
                estimate = judged(estimate.renewed(&here, SIZE, &room, 0.0), &room, &here);
                rays += room.rays().iter().sum::<usize>();
                let anew = judged(CoverageEstimate::new(&here, SIZE, &room, 0.0), &room, &here);
                let [renewed, whole] = [&estimate, &anew].map(|s| s.coverage(&s.choose(|_| true, 4)));
                apart =
                    apart.max((renewed.covered - whole.covered).abs().max((renewed.fine - whole.fine).abs()));
                assert!(estimate.results.len() < 64);
            }
            // An estimate without an earlier one sends 48 rays and about 60 more.
            assert!(rays < 20 * 50, "{rays} rays at {middle}");
            assert!(apart <= 6.0 / RAYS as f64, "{apart} at {middle}");
        }
    }

    #[test]
    fn at_another_time_or_place_no_target_is_kept() {
        let room = Room::at(DVec3::ZERO);
        let here = camera(&room, 0.0);
        let first = judged(CoverageEstimate::new(&here, SIZE, &room, 0.0), &room, &here);
        room.rays();
        let later = first.renewed(&here, SIZE, &room, 1.0);
        assert_eq!((room.rays()[0], later.results.len()), (RAYS, 0));
        let back = Camera::look_at(here.eye, here.eye - DVec3::X);
        assert_eq!(first.renewed(&back, SIZE, &room, 0.0).results.len(), 0);
        assert!(first.apart(&back) > 1.0);
        let odd = Camera { eye: DVec3::NAN, ..here };
        assert_eq!(first.apart(&odd), f64::INFINITY);
        assert_eq!(first.renewed(&odd, SIZE, &room, 0.0).targets.len(), RAYS);
    }
}
