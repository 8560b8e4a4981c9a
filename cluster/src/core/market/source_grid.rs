//! How much of a view a source sees, by the source's own depth at a grid of points.
//!
//! A view's grid has a ray through the middle of each of 12 × 9 cells. Along each, the surface that the source saw is found as a
//! warp finds it: a point on the ray is projected into the source, the source's range there gives the next point. A ray whose point
//! leaves the source's image is not seen. A viewer who stands behind a surface that the source saw sees none of what it shows.
//!
//! Two more numbers say how far a warp is off where the source sees something: the *parallax*, by which surfaces are seen from another
//! side, and the share of the view that is *disoccluded*, since near and far surfaces move apart. The latter follows from the second
//! differences of inverse range, which are zero on planes.

use argus_scene::{Camera, FrameSource};
use glam::{DMat3, DVec2, DVec3};

/// Columns and rows of a grid.
pub const COLUMNS: usize = FrameSource::GRID[0] as usize;
/// Rows of a grid.
pub const ROWS: usize = FrameSource::GRID[1] as usize;
/// Points of a grid.
pub const POINTS: usize = COLUMNS * ROWS;

/// Steps of the search for a point.
const STEPS: usize = 3;

/// Share of a range by which a viewer may be beyond it before it counts as behind the surface: ranges are those of a cell's middle.
const BEHIND: f64 = 1.05;

/// A view's rays, one through the middle of each cell.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewGrid {
    /// The eye, metres.
    pub eye: DVec3,
    /// Unit direction of view.
    pub axis: DVec3,
    /// Pixels over a unit of the image plane at unit depth.
    pub density: f64,
    /// Unit directions, row by row.
    rays: Vec<DVec3>,
}

impl ViewGrid {
    /// The grid of a pinhole view of `size` pixels.
    pub fn new(camera: &Camera, size: [u32; 2]) -> Self {
        let rays = camera.rays(size[0], size[1]);
        let cell = DVec2::new(f64::from(size[0]) / COLUMNS as f64, f64::from(size[1]) / ROWS as f64);
        let axis = (camera.target - camera.eye).normalize();
        let ray = |i: usize| {
            let middle = DVec2::new((i % COLUMNS) as f64 + 0.5, (i / COLUMNS) as f64 + 0.5) * cell;
            rays.direction(middle).unwrap_or(axis)
        };
        let density = density(camera, size);
        Self { eye: camera.eye, axis, density, rays: (0..POINTS).map(ray).collect() }
    }
}

#[cfg(test)]
impl ViewGrid {
    /// The unit direction through the middle of a cell.
    pub(in crate::core) fn ray(&self, cell: usize) -> DVec3 {
        self.rays[cell]
    }
}

/// What a source shows of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The rays of the view that the source sees, a bit each.
    pub points: u128,
    /// Distance of the eyes over the harmonic mean of the ranges that the source saw.
    pub parallax: f64,
    /// Share of what the source sees that is disoccluded, 0 to 1.
    pub disoccluded: f64,
}

/// Where a source stands, and how far what it sees is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The eye, metres.
    pub eye: DVec3,
    /// Unit direction of view.
    pub axis: DVec3,
    /// Mean inverse range, 1/m.
    pub mean_inverse: f64,
}

impl Place {
    /// Distance of a view's eye over the harmonic mean of the ranges that the source sees.
    pub fn parallax(&self, eye: DVec3) -> f64 {
        (eye - self.eye).length() * self.mean_inverse
    }

    /// The order in which sources are examined for a view: twice the parallax, plus the angle between the directions of view.
    /// Infinite beyond [`MOST_ANGLE`].
    pub fn distance(&self, view: &ViewGrid) -> f64 {
        let angle = self.axis.dot(view.axis).clamp(-1.0, 1.0).acos();
        // Written so that NaN is far.
        if angle < MOST_ANGLE { 2.0 * self.parallax(view.eye) + angle } else { f64::INFINITY }
    }
}

/// A source's place and depth.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceGrid {
    /// Its place.
    pub place: Place,
    /// Pixels over a unit of the image plane at unit depth.
    pub density: f64,
    view_from_world: DMat3,
    /// Half the image's extent at unit depth, and its middle.
    half: DVec2,
    center: DVec2,
    /// Inverse range in the middle of each cell, row by row, 1/m; 0: sky.
    inverse_ranges: Vec<f64>,
    /// Mean second difference of inverse range along rows and columns, summed over the image and divided by its extent, 1/m.
    roughness: DVec2,
}

impl SourceGrid {
    /// The grid of a source; `None` unless there is a range, finite and not negative, for each point.
    pub fn new(source: &FrameSource, inverse_ranges: &[f32]) -> Option<Self> {
        let is_range = |range: &f32| *range >= 0.0 && range.is_finite();
        if inverse_ranges.len() != POINTS || !inverse_ranges.iter().all(is_range) {
            return None;
        }
        let plane = source.camera.plane(source.width, source.height);
        let inverse_ranges: Vec<f64> = inverse_ranges.iter().map(|range| f64::from(*range)).collect();
        let mean_inverse = inverse_ranges.iter().sum::<f64>() / POINTS as f64;
        let roughness = roughness(&inverse_ranges, plane.half);
        let axis = (source.camera.target - source.camera.eye).normalize();
        Some(Self {
            place: Place { eye: source.camera.eye, axis, mean_inverse },
            density: density(&source.camera, [source.width, source.height]),
            view_from_world: source.camera.view_from_world(),
            half: plane.half,
            center: plane.center,
            inverse_ranges,
            roughness,
        })
    }

    /// What it shows of a view.
    pub fn seen(&self, view: &ViewGrid) -> Seen {
        let baseline = view.eye - self.place.eye;
        let parallax = self.place.parallax(view.eye);
        if self.hides(baseline) {
            return Seen { points: 0, parallax, disoccluded: 1.0 };
        }
        let mut points = 0_u128;
        for (i, ray) in view.rays.iter().enumerate() {
            points |= u128::from(self.sees(baseline, *ray)) << i;
        }
        let aside = (self.view_from_world * baseline).abs();
        // A step forward moves what is off the axis aside, too.
        let shift = DVec2::new(aside.x, aside.y) + aside.z * 0.5 * self.half;
        // Of the edges of surfaces, half open.
        let disoccluded = (0.5 * shift.dot(self.roughness)).clamp(0.0, 1.0);
        Seen { points, parallax, disoccluded }
    }

    /// Whether a viewer at this place, relative to the eye, is behind a surface that the source saw.
    fn hides(&self, baseline: DVec3) -> bool {
        let Some(cell) = self.cell(baseline) else { return false };
        baseline.length() * self.inverse_ranges[cell] > BEHIND
    }

    /// Whether the source sees what a ray meets.
    fn sees(&self, baseline: DVec3, ray: DVec3) -> bool {
        let mut inverse = self.place.mean_inverse;
        let mut cell = None;
        for _ in 0..STEPS {
            // The point on the ray, relative to the source's eye; at no inverse range its direction.
            let at = baseline * inverse + ray;
            cell = self.cell(at);
            let Some(cell) = cell else { return false };
            let range = self.inverse_ranges[cell];
            inverse = match range > 0.0 {
                true => ((at.normalize() / range - baseline).dot(ray)).recip(),
                false => 0.0,
            };
            // Written so that NaN is not seen: the surface lies behind the viewer.
            if !(inverse >= 0.0) {
                return false;
            }
        }
        cell.is_some()
    }

    /// The cell that shows a direction; `None` outside of the image.
    fn cell(&self, direction: DVec3) -> Option<usize> {
        let in_view = self.view_from_world * direction;
        if !(in_view.z < 0.0) {
            return None;
        }
        let at = (DVec2::new(in_view.x, -in_view.y) / -in_view.z - self.center) / self.half * 0.5 + 0.5;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < 1.0 && at.y < 1.0;
        inside.then(|| (at.y * ROWS as f64) as usize * COLUMNS + (at.x * COLUMNS as f64) as usize)
    }
}

/// Pixels of a camera's image over a unit of the image plane at unit depth.
fn density(camera: &Camera, [width, height]: [u32; 2]) -> f64 {
    f64::from(width) / (2.0 * camera.plane(width, height).half.x)
}

/// Angle between directions of view beyond which a source serves no view, radians.
///
/// Tuned: 1.2 (CROWD.md, rule 2).
const MOST_ANGLE: f64 = 1.2;

/// Sum of absolute second differences of inverse range along a mean row and a mean column, over the image's extent at unit depth. A
/// step in depth has two second differences of its height.
fn roughness(inverse_ranges: &[f64], half: DVec2) -> DVec2 {
    let at = |row: usize, column: usize| inverse_ranges[row * COLUMNS + column];
    let bend = |before: f64, middle: f64, after: f64| 0.5 * (before - 2.0 * middle + after).abs();
    let mut sum = DVec2::ZERO;
    for row in 0..ROWS {
        for column in 1..COLUMNS - 1 {
            sum.x += bend(at(row, column - 1), at(row, column), at(row, column + 1));
        }
    }
    for row in 1..ROWS - 1 {
        for column in 0..COLUMNS {
            sum.y += bend(at(row - 1, column), at(row, column), at(row + 1, column));
        }
    }
    sum / DVec2::new(ROWS as f64, COLUMNS as f64) / (2.0 * half)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [200, 150];
    const ALL: u32 = POINTS as u32;

    fn camera(eye: DVec3, target: DVec3) -> Camera {
        Camera { fov_deg: 60.0, ..Camera::look_at(eye, target) }
    }

    fn source(camera: Camera) -> FrameSource {
        FrameSource {
            camera,
            width: SIZE[0],
            height: SIZE[1],
            samples_per_pixel: 1,
            band_rows: 0,
            light: None,
        }
    }

    /// The grid of a source at `eye` that looks along −z at a wall at this distance, on one half perhaps at another one.
    fn wall(eye: DVec3, distance: f64, left: f64) -> SourceGrid {
        let camera = camera(eye, eye - DVec3::Z);
        let view = ViewGrid::new(&camera, SIZE);
        let range = |(i, ray): (usize, &DVec3)| {
            let distance = if i % COLUMNS < COLUMNS / 2 { left } else { distance };
            (-ray.z / distance) as f32
        };
        let ranges: Vec<f32> = view.rays.iter().enumerate().map(range).collect();
        SourceGrid::new(&source(camera), &ranges).unwrap()
    }

    fn seen(source: &SourceGrid, eye: DVec3, target: DVec3) -> Seen {
        source.seen(&ViewGrid::new(&camera(eye, target), SIZE))
    }

    #[test]
    fn a_source_at_the_viewers_eye_shows_all_of_it_without_parallax() {
        for origin in [DVec3::ZERO, DVec3::new(1e6, -1e6, 3e5)] {
            let source = wall(origin, 5.0, 5.0);
            let seen = seen(&source, origin, origin - DVec3::Z);
            assert_eq!((seen.points.count_ones(), seen.parallax, seen.disoccluded), (ALL, 0.0, 0.0));
        }
    }

    #[test]
    fn a_turned_view_is_seen_as_far_as_the_source_reaches() {
        let source = wall(DVec3::ZERO, 5.0, 5.0);
        let turned = seen(&source, DVec3::ZERO, DVec3::new(0.3, 0.0, -1.0));
        assert!((60..100).contains(&turned.points.count_ones()), "{}", turned.points.count_ones());
        assert_eq!(seen(&source, DVec3::ZERO, DVec3::Z).points, 0, "it looks the other way");
        let view = |target| ViewGrid::new(&camera(DVec3::ZERO, target), SIZE);
        assert_eq!(source.place.distance(&view(DVec3::Z)), f64::INFINITY);
        assert!((source.place.distance(&view(DVec3::new(1.0, 0.0, -1.0))) - 0.785).abs() < 0.01);
    }

    #[test]
    fn a_step_aside_uncovers_a_border_by_the_depth_of_what_is_seen() {
        let aside = |distance| {
            let source = wall(DVec3::ZERO, distance, distance);
            seen(&source, DVec3::X, DVec3::new(1.0, 0.0, -1.0)).points.count_ones()
        };
        assert!(aside(2.0) < aside(5.0) && aside(5.0) < aside(100.0) + 1, "{} {}", aside(2.0), aside(5.0));
        assert_eq!(aside(100.0), ALL);
    }

    #[test]
    fn a_viewer_behind_a_surface_sees_none_of_it() {
        // The right half is a cupboard, half a metre away.
        let source = wall(DVec3::ZERO, 0.5, 5.0);
        let behind = seen(&source, DVec3::new(0.3, 0.0, -1.0), DVec3::new(0.3, 0.0, -2.0));
        assert_eq!((behind.points, behind.disoccluded), (0, 1.0));
        let beside = seen(&source, DVec3::new(-0.3, 0.0, -1.0), DVec3::new(-0.3, 0.0, -2.0));
        assert!(beside.points.count_ones() > ALL / 3);
    }

    #[test]
    fn planes_disocclude_nothing_and_steps_in_depth_do_by_their_height() {
        let aside = |distance, left| {
            seen(&wall(DVec3::ZERO, distance, left), DVec3::X * 0.2, DVec3::new(0.2, 0.0, -1.0)).disoccluded
        };
        let (plane, small, large) = (aside(4.0, 4.0), aside(4.0, 3.0), aside(4.0, 1.0));
        assert!(plane < 0.01 && plane < small && small < large && large < 0.3, "{plane} {small} {large}");
    }

    #[test]
    fn sky_is_seen_by_direction_alone() {
        let camera = camera(DVec3::ZERO, DVec3::NEG_Z);
        let sky = SourceGrid::new(&source(camera), &[0.0; POINTS]).unwrap();
        let seen = seen(&sky, DVec3::X * 1e9, DVec3::new(1e9, 0.0, -1e3));
        assert_eq!((seen.points.count_ones(), seen.parallax), (ALL, 0.0));
    }

    #[test]
    fn ranges_that_are_none_make_no_grid() {
        let source = source(camera(DVec3::ZERO, DVec3::NEG_Z));
        assert!(SourceGrid::new(&source, &[1.0; POINTS - 1]).is_none());
        for odd in [f32::NAN, f32::INFINITY, -1.0] {
            let mut ranges = [1.0; POINTS];
            ranges[7] = odd;
            assert!(SourceGrid::new(&source, &ranges).is_none());
        }
    }
}
