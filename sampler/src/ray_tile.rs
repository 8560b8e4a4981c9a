//! Tiles of images that are no pinhole's: each sub-sample has a ray of its own.

use argus_scene::camera::CameraRays;
use glam::DVec2;
use rayon::prelude::*;

use crate::tile::Tile;

/// A tile with the directions of its sub-samples.
pub(crate) struct RayTile {
    /// The tile. Its face tells the size of pixels in the middle of the image; its rays are not used.
    pub(crate) tile: Tile,
    /// Unit directions, world axes, row by row; zero where the lens has no ray. The fourth component is not used.
    pub(crate) directions: Vec<[f32; 4]>,
}

impl RayTile {
    /// The rays of a tile of a camera's image.
    pub(crate) fn new(rays: &CameraRays, tile: Tile) -> Self {
        let [width, height] = tile.sub_samples();
        let begin = DVec2::from(tile.begin.map(f64::from));
        let direction = |at: u32| {
            let place = DVec2::new(f64::from(at % width), f64::from(at / width)) + 0.5;
            let through = rays.direction(begin + place / f64::from(tile.side));
            through.map_or([0.0; 4], |direction| direction.as_vec3().extend(0.0).to_array())
        };
        let directions = (0..width * height).into_par_iter().with_min_len(1024).map(direction).collect();
        Self { tile, directions }
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::{Camera, Distortion, Intrinsics, Lens, SampleCamera};
    use glam::DVec3;

    use super::*;
    use crate::tile::tiles;

    #[test]
    fn directions_of_tiles_are_those_of_their_places_in_the_image() {
        let distortion = Distortion::Rational([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let (focal, center) = (DVec2::splat(700.0), DVec2::new(750.0, 450.0));
        let lens = Some(Lens::Intrinsics(Intrinsics { focal, center, distortion }));
        let camera = Camera { lens, ..Camera::look_at(DVec3::ZERO, DVec3::new(1.0, -2.0, 3.0)) };
        let faces = SampleCamera::Perspective { camera, width: 1500, height: 900 }.faces();
        let (rays, mut without) = (camera.rays(1500, 900), 0);
        for tile in tiles(&faces, 2) {
            let cast = RayTile::new(&rays, tile);
            let [width, height] = tile.sub_samples();
            assert_eq!(cast.directions.len(), (width * height) as usize);
            without += cast.directions.iter().filter(|direction| **direction == [0.0; 4]).count();
            let [x, y] = tile.begin.map(f64::from);
            let expected = rays.direction(DVec2::new(x + 17.25, y + 33.75));
            let [found_x, found_y, found_z, _] = cast.directions[(67 * width + 34) as usize];
            let found = DVec3::new(found_x.into(), found_y.into(), found_z.into());
            assert!(found.distance(expected.unwrap_or_default()) < 1e-7);
        }
        assert!(without > 0, "the corners lie beyond the fold");
    }
}
