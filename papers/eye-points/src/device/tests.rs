#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

use crate::layout::PointPiece;

use super::*;
use argus_gpu::GpuOptions;

/// A piece of one triangle in the plane z = −1, whose grid begins at its first corner.
fn piece(facet: u32, corners: [DVec3; 3], density: f64) -> PointPiece {
    let [origin, origin_low] = in_two_parts(corners[0]);
    let place = |corner: DVec3| ((corner - corners[0]).truncate() * density).as_vec2().to_array();
    PointPiece {
        origin,
        origin_low,
        density: density as f32,
        facet,
        right: [1.0, 0.0, 0.0],
        up: [0.0, 1.0, 0.0],
        places: corners.map(place),
        slack: 1.0 / 1024.0,
        ..bytemuck::Zeroable::zeroed()
    }
}

fn facet(corners: [DVec3; 3]) -> DeviceFacet {
    DeviceFacet { corners, instance: 0, both_sides: false, cutout: false, chance: 0.0 }
}

fn words(bytes: &[u8]) -> Vec<u64> {
    bytemuck::pod_collect_to_vec(bytes)
}

#[test]
fn a_cell_that_covers_a_whole_face_is_written_in_tiles_without_holes() {
    let passes = PointPasses::new(&Gpu::new(&GpuOptions::default()).unwrap());
    let corner = |x: f64, y: f64| DVec3::new(x, y, -1.0);
    let corners = [corner(-9.0, -9.0), corner(30.0, -9.0), corner(-9.0, 30.0)];
    let facets = passes.facets([facet(corners)].into_iter(), DVec3::ZERO);
    let cells = passes.count(&[piece(0, corners, 0.01)]).unwrap();
    assert_eq!(cells.cells(), 1);
    let (points, bytes) = passes.points(&cells).unwrap();
    assert_eq!(words(&bytes), [0]);
    let side = 200u32;
    // Seven tiles by seven.
    let map = |front| MapAround { center: DVec3::ZERO, side, front };
    // The second map sees what is to the right of x = 0.5 on the face, and the third map's bit is not set.
    let maps = [map(None), map(Some((DVec3::X, 0.5))), map(None)];
    let texels = passes.splat(&facets, &cells, &points, &[0b011], &maps).unwrap();
    assert_eq!(texels.len(), 3 * 6 * 200 * 200);
    let (face, count) = (200 * 200, 6 * 200 * 200);
    for row in 0..200 {
        for column in 0..200 {
            let at = |x: usize| (x as f32 + 0.5) / 100.0 - 1.0;
            let texel = 5 * face + row * 200 + column;
            let key = texels[texel];
            assert_eq!(key as u32, 0);
            let range = f32::from_bits((key >> 32) as u32).recip();
            let expected = (at(column).powi(2) + at(row).powi(2) + 1.0).sqrt();
            assert!((range / expected - 1.0).abs() < 1e-6, "{column} {row}: {range} {expected}");
            let right = at(column) > 0.5;
            assert_eq!(texels[count + texel] != 0, right, "{column} {row}");
        }
    }
    // Behind the map there is nothing.
    assert!(texels[4 * face..5 * face].iter().all(|&key| key == 0));
    assert!(texels[2 * count..].iter().all(|&key| key == 0));
}

#[test]
fn a_triangle_of_sixty_thousand_rows_has_points_in_each_of_them() {
    let passes = PointPasses::new(&Gpu::new(&GpuOptions::default()).unwrap());
    let corner = |x: f64, y: f64| DVec3::new(x, y, -1.0);
    let small = [corner(0.5, 0.5), corner(0.75, 0.5), corner(0.5, 0.75)];
    let tall = [corner(0.0, 0.0), corner(3.0, 0.0), corner(0.0, 60_000.0)];
    let cells = passes.count(&[piece(0, small, 1.0), piece(1, tall, 1.0), piece(0, small, 1.0)]).unwrap();
    let (_, bytes) = passes.points(&cells).unwrap();
    let points = words(&bytes);
    assert_eq!(points.len() as u32, cells.cells());
    assert!(points.is_sorted_by(|a, b| a < b), "in order, and none twice");
    assert_eq!((points[0], points[points.len() - 1]), (0, 2 << 32));
    let rows: Vec<u64> = points.iter().filter(|p| *p >> 32 == 1).map(|p| p >> 16 & 0xffff).collect();
    assert!((0..60_000u64).all(|row| rows.binary_search(&row).is_ok()));
    // Three columns, fewer in the upper rows: those whose left border is within the triangle.
    let expected: usize = (0..60_000).map(|row| (3.0 - f64::from(row) / 20_000.0).ceil() as usize).sum();
    assert!(rows.len().abs_diff(expected) < 1000, "{} {expected}", rows.len());
}

#[test]
fn nothing_is_made_of_nothing() {
    let passes = PointPasses::new(&Gpu::new(&GpuOptions::default()).unwrap());
    let facets = passes.facets(std::iter::empty(), DVec3::ZERO);
    let cells = passes.count(&[]).unwrap();
    assert_eq!(cells.cells(), 0);
    let (points, bytes) = passes.points(&cells).unwrap();
    assert!(bytes.is_empty());
    let map = MapAround { center: DVec3::ZERO, side: 8, front: None };
    assert_eq!(passes.splat(&facets, &cells, &points, &[], &[map]).unwrap(), [0; 6 * 64]);
    assert!(passes.splat(&facets, &cells, &points, &[], &[]).unwrap().is_empty());
}
