//! Tiles: parts of an image that are rendered one at a time.

use argus_scene::camera::Face;
use argus_scene::{FaceMask, InvalidField, RenderError, SampleCamera};
use argus_shaders::layout::sampler::Rays;
use glam::{DVec2, DVec3, DVec4};

/// Most sub-samples on a side of a tile. 2048² of them take 64 MiB of radiance, half of the smallest binding limit of
/// known drivers, and 48 MiB of visibility and depth.
pub(crate) const MAX_SIDE: u32 = 2048;

/// A rectangle of a face's texels, with a number of sub-samples in each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile {
    /// The face that it is a part of.
    pub face: Face,
    /// First texel: column, row of the face.
    pub begin: [u32; 2],
    /// Texels: columns, rows.
    pub size: [u32; 2],
    /// Sub-samples along each side of a texel.
    pub side: u32,
}

/// Cuts faces into tiles of at most [`MAX_SIDE`] sub-samples a side, row by row.
pub(crate) fn tiles(faces: &[Face], side: u32) -> Vec<Tile> {
    let most = (MAX_SIDE / side).max(1);
    let mut tiles = Vec::new();
    for face in faces {
        for y in (0..face.size[1]).step_by(most as usize) {
            for x in (0..face.size[0]).step_by(most as usize) {
                let size = [most.min(face.size[0] - x), most.min(face.size[1] - y)];
                tiles.push(Tile { face: *face, begin: [x, y], size, side });
            }
        }
    }
    tiles
}

/// The tiles of a sample camera.
pub(crate) fn sample_tiles(camera: &SampleCamera, side: u32) -> Result<Vec<Tile>, RenderError> {
    tiles_of_faces(camera, FaceMask::ALL, side)
}

/// The tiles of some faces of a sample camera.
pub(crate) fn tiles_of_faces(
    camera: &SampleCamera,
    mask: FaceMask,
    side: u32,
) -> Result<Vec<Tile>, RenderError> {
    let faces = camera.faces();
    if faces.is_empty() {
        let reason = "triangles are not rasterised into dual paraboloids; use cube faces";
        return Err(InvalidField::new("sample.camera", reason).into());
    }
    let wanted = faces.into_iter().enumerate().filter(|(face, _)| mask.has(*face));
    Ok(tiles(&wanted.map(|(_, face)| face).collect::<Vec<Face>>(), side))
}

impl Tile {
    /// The tile as bands of whole rows of texels, each of about `most` sub-samples.
    pub(crate) fn bands(self, most: u32) -> impl Iterator<Item = Self> {
        let rows = self.size[1];
        let in_band = (most / (self.size[0] * self.side * self.side).max(1)).max(1);
        // All bands but the last have the same height.
        self.rows(rows.div_ceil(rows.div_ceil(in_band).max(1)))
    }

    /// The tile as bands of so many rows of texels; the last may have fewer.
    pub(crate) fn rows(self, height: u32) -> impl Iterator<Item = Self> {
        let (rows, height) = (self.size[1], height.max(1));
        (0..rows).step_by(height as usize).map(move |row| Self {
            begin: [self.begin[0], self.begin[1] + row],
            size: [self.size[0], height.min(rows - row)],
            ..self
        })
    }

    /// The tile with one sub-sample a texel.
    pub fn of_texels(self) -> Self {
        Self { side: 1, ..self }
    }

    /// Sub-samples: columns, rows.
    pub fn sub_samples(&self) -> [u32; 2] {
        self.size.map(|texels| texels * self.side)
    }

    /// Angle of a texel in the middle of the face, radians.
    pub(crate) fn pixel_angle(&self) -> f32 {
        (self.face.tan_half_fov.y * 2.0 / f64::from(self.face.size[1].max(1))) as f32
    }

    /// The tile's first texel within the whole image.
    pub(crate) fn offset(&self) -> [u32; 2] {
        [self.face.offset[0] + self.begin[0], self.face.offset[1] + self.begin[1]]
    }

    /// The tile in the plane at unit depth: its top left corner and half its extent (x right, y up).
    fn extent(&self) -> (DVec2, DVec2) {
        let image = DVec2::new(f64::from(self.face.size[0]), f64::from(self.face.size[1]));
        let at = |texel: [u32; 2]| {
            let ndc = DVec2::new(f64::from(texel[0]), f64::from(texel[1])) / image * 2.0 - 1.0;
            let on_plane = ndc * self.face.tan_half_fov + self.face.tan_center;
            DVec2::new(on_plane.x, -on_plane.y)
        };
        let top_left = at(self.begin);
        let bottom_right = at([self.begin[0] + self.size[0], self.begin[1] + self.size[1]]);
        (top_left, (bottom_right - top_left) * 0.5)
    }

    /// Rows x, y and w of the transform from world axes about the eye to the tile's clip space.
    pub(crate) fn clip_from_eye(&self) -> [DVec3; 3] {
        let (top_left, half) = self.extent();
        let middle = top_left + half;
        let axes = self.face.view_from_world.transpose();
        let (right, up, back) = (axes.x_axis, axes.y_axis, axes.z_axis);
        // half.y is negative, because rows go down.
        [(right + back * middle.x) / half.x, (up + back * middle.y) / -half.y, -back]
    }

    /// The rays of the tile's sub-samples.
    pub(crate) fn rays(&self) -> Rays {
        let (top_left, half) = self.extent();
        let world_from_view = self.face.view_from_world.transpose();
        let [width, height] = self.sub_samples();
        let step = half * 2.0 / DVec2::new(f64::from(width), f64::from(height));
        let world = |v: DVec3| (world_from_view * v).as_vec3().to_array();
        Rays {
            top_left: world(top_left.extend(-1.0)),
            side: self.side,
            right: world(DVec3::X * step.x),
            width,
            down: world(DVec3::Y * step.y),
            height,
        }
    }
}

/// Half spaces that contain everything a tile shows, in mesh space.
pub(crate) struct Frustum([DVec4; 5]);

impl Frustum {
    /// The frustum of the rows x, y, w of a transform to clip space.
    pub(crate) fn new([x, y, w]: [DVec4; 3]) -> Self {
        Self([w + x, w - x, w + y, w - y, w])
    }

    /// Whether a box (centre, half extent) may be visible. Never false for a visible box.
    pub(crate) fn may_show(&self, middle: DVec3, half: DVec3) -> bool {
        self.0.iter().all(|plane| {
            let normal = plane.truncate();
            let farthest = plane.w + normal.dot(middle) + normal.abs().dot(half);
            // Slack for rounding to f32 on the device. NaN counts as visible.
            let slack = 1e-5 * (plane.w.abs() + normal.abs().dot(middle.abs() + half));
            !(farthest < -slack)
        })
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::Camera;

    use super::*;

    #[test]
    fn tiles_cover_every_texel_once_and_stay_within_bounds() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
        let faces = SampleCamera::Perspective { camera, width: 1030, height: 700 }.faces();
        let mut seen = vec![0u8; 1030 * 700];
        for tile in tiles(&faces, 4) {
            assert!(tile.sub_samples().iter().all(|&s| s <= MAX_SIDE));
            for y in 0..tile.size[1] {
                for x in 0..tile.size[0] {
                    let [ox, oy] = tile.offset();
                    seen[((oy + y) * 1030 + ox + x) as usize] += 1;
                }
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
    }

    #[test]
    fn bands_cover_a_tile_once_and_are_alike_but_for_the_last() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z);
        for [width, height] in [[400, 300], [1, 1], [1024, 7], [3, 1000]] {
            let faces = SampleCamera::Perspective { camera, width, height }.faces();
            let [tile] = tiles(&faces, 2)[..] else { panic!("one tile") };
            for most in [1, 5000, 1 << 16, u32::MAX] {
                let bands: Vec<Tile> = tile.bands(most).collect();
                let mut row = 0;
                for band in &bands {
                    assert_eq!((band.begin, band.size[0]), ([0, row], width));
                    assert!(band.size[1] == bands[0].size[1] || row + band.size[1] == height);
                    let [columns, rows] = band.sub_samples();
                    assert!(band.size[1] == 1 || columns * rows <= most, "{band:?}");
                    row += band.size[1];
                }
                assert_eq!(row, height, "{most}");
            }
        }
    }

    #[test]
    fn a_tile_rasterises_a_point_at_the_sub_sample_whose_ray_meets_it() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::new(1.0, -2.0, 3.0));
        let faces = SampleCamera::Perspective { camera, width: 1500, height: 900 }.faces();
        for tile in tiles(&faces, 2) {
            let rays = tile.rays();
            let v = |a: [f32; 3]| glam::Vec3::from_array(a).as_dvec3();
            let at = DVec2::new(17.5, 33.5);
            let direction = v(rays.top_left) + v(rays.right) * at.x + v(rays.down) * at.y;
            let [x, y, w] = tile.clip_from_eye().map(|row| row.dot(direction * 7.0));
            let ndc = DVec2::new(x / w, -y / w);
            let [width, height] = tile.sub_samples().map(f64::from);
            let found = (ndc * 0.5 + 0.5) * DVec2::new(width, height);
            assert!((found - at).length() < 1e-3, "{found} {at}");
        }
    }
}
