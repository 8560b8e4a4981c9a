//! Selects the texels of a sample that a view is splatted from: tiles inside its frustum, at a stride of 1, 2, 4 or 8
//! texels.
//!
//! Culling runs on the host in f64, because the range of each tile was measured when the sample was uploaded. It costs a
//! few thousand multiplications a view. The density of visible texels also decides the size of the view's cells.

use glam::{DVec2, DVec3, DVec4, Vec4Swizzles as _};

use argus_scene::camera::Face;

use crate::geometry::{PixelFromFace, ViewGeometry};

/// Side of a face's tiles in texels. A face has about thirty tiles a side whatever its size, so the host's work does not
/// grow with the samples.
pub(crate) fn tile_side(face: &Face) -> u32 {
    (face.size[0].max(face.size[1]) / TILES).next_power_of_two().clamp(2 * BLOCK, 8 * BLOCK)
}

/// Approximate number of tiles on a face's longer side.
const TILES: u32 = 32;

/// Texels on a side of the block that a workgroup splats.
const BLOCK: u32 = 8;

/// Bounds of inverse range of one face's tiles.
#[derive(Debug, Clone, Default)]
pub(crate) struct FaceTiles {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// Least and greatest inverse range, 1/metres; 0 and 0 where a tile shows no surface.
    pub(crate) inverse_range: Vec<[f32; 2]>,
}

/// A tile that the view may show.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VisibleTile {
    column: u32,
    row: u32,
    /// Pixels of the view along the edge of a texel, both facing the surface.
    pixels_per_texel: f64,
    /// Bounding box of its texels in the view, pixels. Infinite if the tile reaches behind the eye.
    min: DVec2,
    max: DVec2,
    /// Pixels of the box's longer edge for each texel of the tile's side. Neighbouring texels are farther apart only
    /// where the surface is seen at a grazing angle.
    spread: f64,
}

/// The tiles of a face that the view may show.
pub(crate) fn visible_tiles(
    view: &ViewGeometry,
    face: &Face,
    pixel_from_face: &PixelFromFace,
    tiles: &FaceTiles,
) -> Vec<VisibleTile> {
    let (texel, top_left) = (face.texel(), face.top_left());
    let side = tile_side(face);
    let corner = |column: u32, row: u32| {
        let x = f64::from((column * side).min(face.size[0])) * texel.x + top_left.x;
        let y = f64::from((row * side).min(face.size[1])) * texel.y + top_left.y;
        DVec3::new(x, -y, -1.0)
    };
    // Four tiles share a corner, so it is projected once.
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
        // Lower bound for the length of the tile's directions: the shortest corner less the tile's extent.
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

/// A corner of a tile at depth 1, in homogeneous pixel coordinates, without the translation of the face.
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

/// Bounding box in pixels, and depth in the view, of the hull of four directions between two depths. `None` if the hull
/// lies outside the image.
fn footprint(
    four: &[&Corner; 4],
    depths: [f64; 2],
    offset: DVec3,
    size: DVec2,
) -> Option<(DVec2, DVec2, f64)> {
    let (mut min, mut max) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let (mut nearest, mut farthest) = (f64::MAX, f64::MIN);
    // One bit for each plane of the frustum that all points so far lie outside.
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

/// Share of the image whose texels may be sparser than the cells.
const SPARSE: f64 = 0.5;

/// Share of the image whose texels are at most as dense as the finer mip level.
const DENSE: f64 = 0.9;

/// Two distances between texels, in pixels of the view: [`DENSE`] and [`SPARSE`] of the image have at least that
/// distance.
pub(crate) fn spacings<'a>(tiles: impl Iterator<Item = &'a VisibleTile>, size: DVec2) -> [f64; 2] {
    let mut spacing: Vec<(f64, f64)> = tiles
        .map(|tile| {
            let covered = (tile.max.min(size) - tile.min.max(DVec2::ZERO)).max(DVec2::ZERO);
            (tile.pixels_per_texel, covered.x * covered.y)
        })
        .collect();
    spacing.sort_by(|a, b| b.0.total_cmp(&a.0));
    let area: f64 = spacing.iter().map(|&(_, area)| area).sum();
    // The distance that this share of the image has at least.
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

/// Pixels along the edge of the view's cells. Most of the image then has a texel in each cell.
///
/// Samples denser than the view give cells of one pixel. For sparser samples, one-pixel cells would stay empty between
/// texels.
pub(crate) fn cell_size(spacing: f64, size: DVec2) -> u32 {
    let pixels = spacing.ceil();
    // A cell larger than the image is a single cell.
    pixels.clamp(1.0, size.max_element().max(1.0)) as u32
}

/// Distance of splatted texels, in cells. Denser texels cost more and add error: a cell keeps the nearest of several
/// texels, which enlarges the foreground (terrain, 800×600 texels: FLIP 0.0371 at 0.8, 0.0366 at 1.2).
pub(crate) const DENSITY: f64 = 1.2;

/// Distance of texels, in cells, beyond which they are splatted as squares. Smaller gaps are filled by the fill pass.
const MAX_SPREAD: f64 = 2.0;

/// Appends the blocks of 8×8 texels that overlap a part of the image (pixels) to `blocks`, and returns their number.
/// `sparse` selects tiles whose texels are farther apart than cells; otherwise all other tiles.
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
        // The largest stride whose texels are dense enough.
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
