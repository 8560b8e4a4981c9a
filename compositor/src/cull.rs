//! Which texels of a sample a view is splatted from: tiles inside of its frustum, every texel or every second, fourth or eighth.
//!
//! The tiles' ranges are known from when the sample was taken in, so this is done on the host, in f64, some
//! thousand multiplications a view; the density of what is visible also says how large the view's cells must be.

use glam::{DVec2, DVec3, DVec4, Vec4Swizzles as _};

use argus_scene::camera::Face;

use crate::geometry::{PixelFromFace, ViewGeometry};

/// Edge of a face's tiles in texels: some thirty tiles a side, whatever the face's size, so that the host's work for a view
/// does not grow with its samples.
pub(crate) fn tile_side(face: &Face) -> u32 {
    (face.size[0].max(face.size[1]) / TILES).next_power_of_two().clamp(2 * BLOCK, 8 * BLOCK)
}

/// Tiles on a face's longer side, about.
const TILES: u32 = 32;

/// Texels on a side that a workgroup splats.
const BLOCK: u32 = 8;

/// Range of what one face's tiles show.
#[derive(Debug, Clone, Default)]
pub(crate) struct FaceTiles {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// Least and greatest inverse range, 1/metres; 0 and 0 where a tile shows no surface.
    pub(crate) inverse_range: Vec<[f32; 2]>,
}

/// A tile that the view may see.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VisibleTile {
    column: u32,
    row: u32,
    /// Pixels of the view on the edge of a texel, as if both were seen frontally.
    pixels_per_texel: f64,
    /// Box that holds all of its texels in the view, in pixels; unbounded where it reaches behind the eye.
    min: DVec2,
    max: DVec2,
    /// Pixels on the longer edge of that box for each of the tile's texels: none are farther apart, but where its surface
    /// grazes the view.
    spread: f64,
}

/// The tiles of a face that the view may see.
pub(crate) fn visible_tiles(
    view: &ViewGeometry,
    face: &Face,
    pixel_from_face: &PixelFromFace,
    tiles: &FaceTiles,
) -> Vec<VisibleTile> {
    let texel = 2.0 * face.tan_half_fov / DVec2::new(f64::from(face.size[0]), f64::from(face.size[1]));
    let side = tile_side(face);
    let corner = |column: u32, row: u32| {
        let x = f64::from((column * side).min(face.size[0])) * texel.x - face.tan_half_fov.x;
        let y = f64::from((row * side).min(face.size[1])) * texel.y - face.tan_half_fov.y;
        DVec3::new(x, -y, -1.0)
    };
    // Each corner is four tiles': projected once.
    let edge = (tiles.columns + 1) as usize;
    let corners: Vec<Corner> = (0..(tiles.columns + 1) * (tiles.rows + 1))
        .map(|i| Corner::new(corner(i % (tiles.columns + 1), i / (tiles.columns + 1)), pixel_from_face))
        .collect();
    let offset = DVec3::new(pixel_from_face.x.w, pixel_from_face.y.w, pixel_from_face.w.w);
    let pixel = view.pixel_at_unit_depth().max_element();
    let mut visible = Vec::new();
    for (i, &[least, most]) in tiles.inverse_range.iter().enumerate() {
        if !(most > 0.0) {
            continue;
        }
        let (column, row) = (i as u32 % tiles.columns, i as u32 / tiles.columns);
        let at = row as usize * edge + column as usize;
        let four = [&corners[at], &corners[at + 1], &corners[at + edge], &corners[at + edge + 1]];
        let longest = four.iter().fold(0.0, |l: f64, c| l.max(c.length));
        // The shortest direction of the tile is at least as long as at its corners, less its own extent.
        let extent = texel.max_element() * f64::from(side);
        let shortest = (four.iter().fold(f64::MAX, |l: f64, c| l.min(c.length)) - extent).max(1.0);
        let depths = [1.0 / (f64::from(most) * longest), 1.0 / (f64::from(least) * shortest)];
        let Some((min, max, w)) = footprint(&four, depths, offset, view.size) else { continue };
        let depth = 1.0 / (f64::from(least + most) * 0.5 * longest);
        let pixels_per_texel = texel.max_element() * depth / (pixel * w.max(1e-30));
        let spread = (max - min).max_element() / f64::from(side);
        visible.push(VisibleTile { column, row, pixels_per_texel, min, max, spread });
    }
    visible
}

/// A corner of a tile at depth 1, in pixel coordinates times w, without the face's own place.
struct Corner {
    projected: DVec3,
    length: f64,
}

impl Corner {
    fn new(direction: DVec3, m: &PixelFromFace) -> Self {
        let dot = |row: DVec4| row.xyz().dot(direction);
        Self { projected: DVec3::new(dot(m.x), dot(m.y), dot(m.w)), length: direction.length() }
    }
}

/// Box in pixels, and depth in the view, of the hull of four directions between two depths; `None` if it lies
/// outside of the image.
fn footprint(
    four: &[&Corner; 4],
    depths: [f64; 2],
    offset: DVec3,
    size: DVec2,
) -> Option<(DVec2, DVec2, f64)> {
    let (mut min, mut max) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let (mut nearest, mut farthest) = (f64::MAX, f64::MIN);
    // One bit for each side of the frustum that all points so far are outside of.
    let mut outside = 0b1_1111;
    for depth in depths {
        for corner in four {
            let p = corner.projected * depth + offset;
            let sides = [p.x < 0.0, p.x > size.x * p.z, p.y < 0.0, p.y > size.y * p.z, p.z <= 0.0];
            outside &= sides.iter().enumerate().fold(0, |bits, (i, &out)| bits | (u32::from(out) << i));
            nearest = nearest.min(p.z);
            farthest = farthest.max(p.z);
            let pixel = p.truncate() / p.z;
            min = min.min(pixel);
            max = max.max(pixel);
        }
    }
    if outside != 0 {
        return None;
    }
    if !(nearest > 1e-6 * farthest) {
        return Some((DVec2::NEG_INFINITY, DVec2::INFINITY, 0.5 * farthest));
    }
    Some((min, max, 0.5 * (nearest + farthest)))
}

/// Share of the image that may have sparser texels than its cells hold.
const SPARSE: f64 = 0.5;

/// Share of the image that has texels not much denser.
const DENSE: f64 = 0.9;

/// Pixels of the view on the edge of a texel: nearly all of the image has none that are denser than the first, most of it
/// has a texel of some sample as near as the second.
pub(crate) fn spacings<'a>(tiles: impl Iterator<Item = &'a VisibleTile>, size: DVec2) -> [f64; 2] {
    let mut spacing: Vec<(f64, f64)> = tiles
        .map(|tile| {
            let covered = (tile.max.min(size) - tile.min.max(DVec2::ZERO)).max(DVec2::ZERO);
            (tile.pixels_per_texel, covered.x * covered.y)
        })
        .collect();
    spacing.sort_by(|a, b| b.0.total_cmp(&a.0));
    let area: f64 = spacing.iter().map(|&(_, area)| area).sum();
    // The spacing that this share of the image has at least.
    let at = |share: f64| {
        let mut left = share * area;
        let found = spacing.iter().find(|&&(_, area)| {
            left -= area;
            left <= 0.0
        });
        found.map_or(1.0, |&(pixels, _)| pixels)
    };
    [at(DENSE), at(SPARSE)]
}

/// Pixels on an edge of the view's cells: so many that most of the image has a texel of some sample in each.
///
/// A sample that is denser than the view gives cells of one pixel; of one that is sparser, one-pixel cells would
/// stay empty between its texels.
pub(crate) fn cell_size(spacing: f64, size: DVec2) -> u32 {
    let pixels = spacing.ceil();
    // Cells beyond the image's size would all be one.
    pixels.clamp(1.0, size.max_element().max(1.0)) as u32
}

/// Cells on the distance of texels that are splatted. Denser ones would cost more and show less: of several texels in a cell
/// the nearest stays, so that what is in front grows (terrain, 800x600 texels: FLIP 0.0371 at 0.8, 0.0366 at 1.2).
pub(crate) const DENSITY: f64 = 1.2;

/// Cells on the distance of texels from which on they are splatted as squares: gaps of one are closed without.
const MAX_SPREAD: f64 = 2.0;

/// Appends the blocks of 8×8 texels that reach into a part of the image (in pixels) to `blocks`, those of tiles whose texels
/// lie farther apart than cells or those of all others, and returns how many.
pub(crate) fn push_blocks(
    tiles: &[VisibleTile],
    sparse: bool,
    part: [DVec2; 2],
    cell: u32,
    face: &Face,
    blocks: &mut Vec<u32>,
) -> u32 {
    let before = blocks.len();
    let side = tile_side(face);
    for tile in tiles.iter().filter(|tile| (tile.spread > MAX_SPREAD * f64::from(cell)) == sparse) {
        if tile.max.cmplt(part[0]).any() || tile.min.cmpgt(part[1]).any() {
            continue;
        }
        // Every second texel, fourth or eighth where even those are dense enough.
        let dense_enough =
            |stride: &u32| f64::from(*stride) * tile.pixels_per_texel <= DENSITY * f64::from(cell);
        let stride = [8, 4, 2].into_iter().filter(|s| s * BLOCK <= side).find(dense_enough).unwrap_or(1);
        let step = BLOCK * stride;
        for y in (0..side).step_by(step as usize) {
            for x in (0..side).step_by(step as usize) {
                let (x, y) = (tile.column * side + x, tile.row * side + y);
                if x < face.size[0] && y < face.size[1] {
                    blocks.push(x | y << 14 | stride << 28);
                }
            }
        }
    }
    (blocks.len() - before) as u32
}
