//! Outputs that follow from a frame's range and its camera: depth and flow.

use bytes::Bytes;
use glam::{DMat3, DVec2, DVec3};
#[cfg(any(feature = "loaders", feature = "reference"))]
use rayon::prelude::*;

use crate::lens::ImagePlane;
use crate::{Camera, Frame, Output, Outputs, RayList};

/// The outputs that follow from range.
const DERIVED: Outputs = Outputs::only(Output::Depth).with(Output::Flow);

/// What has to be rendered for the outputs that are asked for.
pub fn rendered(asked: Outputs) -> Outputs {
    let direct = asked.without(Output::Depth).without(Output::Flow);
    if asked.has_any(DERIVED) { direct.with(Output::Range) } else { direct }
}

/// Adds depth and flow to a frame with range, as far as they are asked for. A camera of listed rays comes with its list. Nothing is added without range, nor flow without the
/// camera that it leads to.
pub fn complete(
    frame: &mut Frame,
    asked: Outputs,
    (camera, list): (&Camera, Option<&RayList>),
    flow_to: Option<&Camera>,
) {
    let Some(range) = frame.images[Output::Range].clone() else { return };
    let pixels = Pixels { camera, list, size: [frame.width, frame.height], range: &range };
    if asked.has(Output::Depth) {
        let axis = (camera.target - camera.eye).normalize();
        // Nothing is infinitely far away, also behind a camera that sees all around.
        let depth = |_, direction: DVec3, range: f64| match range.is_finite() {
            true => [(range * direction.dot(axis)) as f32],
            false => [f32::INFINITY],
        };
        frame.images[Output::Depth] = Some(pixels.map(depth));
    }
    if let Some(to) = flow_to.filter(|_| asked.has(Output::Flow)) {
        let to = Projection::new(to, pixels.size);
        let flow = |pixel: DVec2, direction: DVec3, range: f64| {
            // What is infinitely far away turns with the camera.
            let seen = if range.is_finite() { camera.eye + direction * range - to.eye } else { direction };
            to.pixel(seen).map_or([f32::INFINITY; 2], |at| (at - pixel).as_vec2().to_array())
        };
        frame.images[Output::Flow] = Some(pixels.map(flow));
    }
}

/// The pixels of a view.
struct Pixels<'a> {
    camera: &'a Camera,
    list: Option<&'a RayList>,
    size: [u32; 2],
    /// f32 little-endian, metres.
    range: &'a [u8],
}

impl Pixels<'_> {
    /// An image of a function of each pixel's centre, its unit direction, and its range in metres.
    fn map<const N: usize>(&self, value: impl Fn(DVec2, DVec3, f64) -> [f32; N] + Sync) -> Bytes {
        let [width, height] = self.size;
        let rays = self.camera.rays_of(self.list, width, height);
        // Where a lens has no ray, nothing is seen.
        let axis = (self.camera.target - self.camera.eye).normalize();
        let of = |(at, range): (usize, &[u8; 4])| {
            let pixel = DVec2::new((at as u32 % width).into(), (at as u32 / width).into()) + 0.5;
            let range = f64::from(f32::from_le_bytes(*range));
            value(pixel, rays.direction(pixel).unwrap_or(axis), range).map(f32::to_le_bytes)
        };
        let ranges = self.range.as_chunks::<4>().0;
        // Whoever renders has threads for it; thin clients do not need these images.
        #[cfg(any(feature = "loaders", feature = "reference"))]
        let ranges = ranges.par_iter();
        #[cfg(not(any(feature = "loaders", feature = "reference")))]
        let ranges = ranges.iter();
        let values: Vec<[[u8; 4]; N]> = ranges.enumerate().map(of).collect();
        Bytes::from(values.as_flattened().as_flattened().to_vec())
    }
}

/// Where a pinhole camera shows what.
struct Projection {
    eye: DVec3,
    view_from_world: DMat3,
    plane: ImagePlane,
    size: DVec2,
}

impl Projection {
    fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        Self {
            eye: camera.eye,
            view_from_world: camera.view_from_world(),
            plane: camera.plane(width, height),
            size: DVec2::new(width.into(), height.into()),
        }
    }

    /// The place in the image, pixels, of what lies `away` from the eye; `None` if that is not in front of it.
    fn pixel(&self, away: DVec3) -> Option<DVec2> {
        let at = self.view_from_world * away;
        let ndc = (DVec2::new(at.x, -at.y) / -at.z - self.plane.center) / self.plane.half;
        (at.z < 0.0 && ndc.is_finite()).then(|| (ndc + 1.0) * 0.5 * self.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Images, Plan, Provenance, SceneHash, SceneState};

    const SIZE: [u32; 2] = [9, 7];

    fn camera() -> Camera {
        Camera { fov_deg: 70.0, ..Camera::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 0.5, 2.0)) }
    }

    /// A frame of a plane that is perpendicular to the axis, 5 m away, with sky in its first pixel.
    fn frame() -> Frame {
        let [width, height] = SIZE;
        let axis = (camera().target - camera().eye).normalize();
        let range = |i: u32| {
            let pixel = DVec2::new((i % width).into(), (i / width).into()) + 0.5;
            (5.0 / camera().direction(pixel, width, height).dot(axis)) as f32
        };
        let ranges = (0..width * height).map(|i| if i == 0 { f32::INFINITY } else { range(i) });
        let provenance = Provenance::of_plan(SceneHash([0; 32]), SceneState::default(), Plan::direct(1));
        let images = Images::from([(Output::Range, ranges.flat_map(f32::to_le_bytes).collect())]);
        Frame { images, ..Frame::without_images(width, height, provenance) }
    }

    fn completed(asked: Outputs, flow_to: Option<&Camera>) -> Vec<f32> {
        let mut frame = frame();
        complete(&mut frame, asked, (&camera(), None), flow_to);
        let image = asked.iter().find_map(|output| frame.images[output].clone()).unwrap_or_default();
        image.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    }

    #[test]
    fn depth_lies_along_the_axis_and_is_infinite_in_the_sky() {
        let depth = completed(Outputs::only(Output::Depth), None);
        assert_eq!((depth.len(), depth[0]), (63, f32::INFINITY));
        assert!(depth[1..].iter().all(|depth| (depth - 5.0).abs() <= 5e-6), "{depth:?}");
    }

    #[test]
    fn flow_leads_to_where_the_second_camera_shows_the_same() {
        let flow = Outputs::only(Output::Flow);
        let still = completed(flow, Some(&camera()));
        assert!(still.iter().all(|pixels| pixels.abs() < 1e-4), "{still:?}");
        // Sideways by one metre: all that is 5 m away moves by the same number of pixels, and the sky by none.
        let right = camera().view_from_world().transpose().x_axis;
        let to = Camera { eye: camera().eye + right, target: camera().target + right, ..camera() };
        let moved = completed(flow, Some(&to));
        let pixels = -(1.0 / 5.0) / camera().tan_half_fov(SIZE[0], SIZE[1]).x * 0.5 * f64::from(SIZE[0]);
        assert!(moved[..2].iter().all(|sky| sky.abs() < 1e-4), "{moved:?}");
        for [x, y] in moved[2..].as_chunks::<2>().0 {
            assert!((f64::from(*x) - pixels).abs() < 1e-4 && y.abs() < 1e-4, "{x} {y}, not {pixels}");
        }
    }

    #[test]
    fn what_is_behind_the_second_camera_has_no_flow() {
        let back = Camera { target: 2.0 * camera().eye - camera().target, ..camera() };
        let flow = completed(Outputs::only(Output::Flow), Some(&back));
        assert_eq!((flow.len(), flow.iter().all(|value| *value == f32::INFINITY)), (126, true));
    }

    #[test]
    fn range_is_rendered_where_something_follows_from_it() {
        for asked in [Output::Depth, Output::Flow].map(|output| Outputs::COLOR.with(output)) {
            assert_eq!(rendered(asked), Outputs::COLOR.with(Output::Range));
        }
        assert_eq!(rendered(Outputs::COLOR), Outputs::COLOR);
    }
}
