//! Reprojection: a seeded search starts from the depths of the session's previous frame, if that frame covers enough of
//! the view.
//!
//! The frame's pixels are projected into cells by the function that splats use (`shaders/shared/cell_projection.wgsl`). A
//! frame is used if it covers 15/16 of the view, measured on the CPU with a grid of its pixels. At most six frames in a
//! row are reprojected, because errors of a search persist in them. `argus-lab study views reprojection` measures less error and no gain
//! in time: refinement takes eighty times as long as the coarse splat.

use std::sync::Arc;

use argus_scene::camera::Face;
use argus_scene::{History, SampleCamera, SampleId};
use argus_shaders::layout::compositor::{CellProjection, Reproject};
use glam::{DVec2, DVec3};

use crate::cull::DENSITY;
use crate::geometry::{PixelFromFace, ViewGeometry};

/// An earlier frame that a view starts from.
#[derive(Debug)]
pub(crate) struct Reprojection {
    history: Arc<History>,
    face: Face,
    pixel_from_face: PixelFromFace,
    /// Distance of the history's pixels in sub-pixels of the view, as if both cameras had one centre.
    spacing: f64,
    /// For each of the history's samples its position in the plan's list, three bits each.
    sources: u32,
}

/// Pixels on a side of the grid that measures how much of a view an earlier frame covers.
const GRID_SIDE: u32 = 32;
/// Parts on a side of the view. A part is covered if a pixel of the grid is projected into it.
const PARTS: u32 = 8;
/// Fewest covered parts of a frame that is used. Uncovered parts are searched from the far end of the scene, which may
/// find other surfaces. `argus-lab study views reprojection`, terrain, field of view 58°: FLIP is 0.081 from samples, 0.078 after a turn
/// by 5°, 0.082 after a turn by 10°.
const MIN_COVERED_PARTS: u32 = PARTS * PARTS * 15 / 16;

impl Reprojection {
    /// The reprojection of a history into a view with these samples. At most `max_reprojections` frames in a row are
    /// reprojected.
    ///
    /// # Errors
    /// Why the history cannot be used. The reason depends only on history and view.
    pub(crate) fn new(
        history: &Arc<History>,
        geometry: &ViewGeometry,
        samples: &[SampleId],
        max_reprojections: u32,
    ) -> Result<Self, &'static str> {
        if history.links() >= max_reprojections {
            return Err("enough frames have begun one from the other");
        }
        let [width, height] = history.size();
        let camera = SampleCamera::Perspective { camera: *history.camera(), width, height };
        let faces = camera.faces();
        let face = faces.first().ok_or("the earlier frame has no image")?;
        let pixel_from_face = geometry.pixel_from_face(camera.center(), face);
        let overlap = overlap(history, face, &pixel_from_face, geometry.size);
        if !overlap.surface {
            return Err("the view shows no surface of the earlier frame");
        }
        if overlap.parts.count_ones() < MIN_COVERED_PARTS {
            return Err("the earlier frame shows too little of what the view does");
        }
        let position =
            |id: &SampleId| samples.iter().position(|other| same_camera(other, id)).unwrap_or(0) as u32;
        let sources =
            history.samples().iter().enumerate().fold(0, |bits, (i, id)| bits | (position(id) << (3 * i)));
        let spacing = (face.texel() / geometry.pixel_at_unit_depth()).max_element();
        Ok(Self { history: history.clone(), face: *face, pixel_from_face, spacing, sources })
    }

    /// Distance of the history's pixels, in sub-pixels of the view.
    pub(crate) fn spacing(&self) -> f64 {
        self.spacing
    }

    /// The dispatch that reprojects the history into one piece. Its pixels are appended to `words`. `projection` has the
    /// fields of the cells.
    pub(crate) fn call(&self, projection: CellProjection, cell: u32, words: &mut Vec<u32>) -> Reproject {
        let [width, height] = self.history.size();
        // The density of splatted texels.
        let stride = (DENSITY * f64::from(cell) / self.spacing) as u32;
        let stride = stride.clamp(1, width.min(height));
        let first_word = words.len() as u32;
        let first = stride / 2;
        for row in
            self.history.words().chunks_exact(width as usize).skip(first as usize).step_by(stride as usize)
        {
            words.extend(row.iter().skip(first as usize).step_by(stride as usize));
        }
        let along = |side: u32| (side - first).div_ceil(stride);
        let pixel = self.face.texel();
        // Every stride-th pixel is the centre of a texel `stride` pixels wide.
        let shift = f64::from(first) + 0.5 - 0.5 * f64::from(stride);
        let projection = self.pixel_from_face.projection(
            projection,
            cell,
            pixel * f64::from(stride),
            pixel * shift + self.face.top_left(),
        );
        Reproject {
            projection,
            columns: along(width),
            rows: along(height),
            first_word,
            sources: self.sources,
        }
    }
}

/// Whether two samples have the same camera, in any version.
fn same_camera(one: &SampleId, other: &SampleId) -> bool {
    one.camera == other.camera
}

/// The part of a view that an earlier frame covers.
#[derive(Debug, Default)]
struct Overlap {
    /// One bit for each covered part. Sky is projected as infinitely far.
    parts: u64,
    /// Whether a projected pixel is of a surface.
    surface: bool,
}

fn overlap(history: &History, face: &Face, to: &PixelFromFace, size: DVec2) -> Overlap {
    let [width, height] = history.size();
    let pixel = face.texel();
    let at = |i: u32, side: u32| (u64::from(2 * i + 1) * u64::from(side) / u64::from(2 * GRID_SIDE)) as u32;
    let mut overlap = Overlap::default();
    for (column, row) in
        (0..GRID_SIDE * GRID_SIDE).map(|i| (at(i % GRID_SIDE, width), at(i / GRID_SIDE, height)))
    {
        let word = history.words()[row as usize * width as usize + column as usize];
        let position = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) * pixel + face.top_left();
        let direction = DVec3::new(position.x, -position.y, -1.0);
        let p = direction.extend(f64::from(History::inverse_range(word)) * direction.length());
        let w = to.w.dot(p);
        let part = DVec2::new(to.x.dot(p), to.y.dot(p)) / w / size * f64::from(PARTS);
        // False for NaN.
        let inside =
            w > 0.0 && part.cmpge(DVec2::ZERO).all() && part.cmplt(DVec2::splat(f64::from(PARTS))).all();
        if inside {
            overlap.parts |= 1 << (part.y as u32 * PARTS + part.x as u32);
            overlap.surface |= word != 0;
        }
    }
    overlap
}
