//! What a view begins from of an earlier frame: whether that shows enough of what the view does, and which of its pixels
//! leave their depth where.
//!
//! The earlier frame's pixels land in cells of the view by the function that splatted texels use (`shaders/shared/landing.wgsl`). They are
//! used if they show fifteen sixteenths of the view, which a grid of its pixels tells on the CPU, and for at most six frames in a row,
//! since what a search missed those after it miss as well. `argus study history` measures the gain: less error, and no time, since
//! refining takes eighty times what the coarse splat takes.

use std::sync::Arc;

use argus_scene::camera::Face;
use argus_scene::{History, SampleCamera, SampleId};
use argus_shaders::layout::compositor::{Landing, Recall};
use glam::{DVec2, DVec3};

use crate::cull::DENSITY;
use crate::geometry::{PixelFromFace, ViewGeometry};

/// An earlier frame that a view begins from.
#[derive(Debug)]
pub(crate) struct Recalled {
    history: Arc<History>,
    face: Face,
    pixel_from_face: PixelFromFace,
    /// Sub-pixels of the view from pixel to pixel of the history, as if both looked from one place.
    spacing: f64,
    /// Position in the plan's list of each of the history's samples, three bits each.
    sources: u32,
}

/// Pixels on a side that are looked at to see what an earlier frame shows of a view.
const LOOKED_AT: u32 = 32;
/// Parts on a side of the view. A part is shown if one of those pixels lands in it.
const PARTS: u32 = 8;
/// Parts that it must show. What it does not show is searched from the far end of the scene, where other surfaces
/// are found: after a turn by 10° of 58° views of terrain err more than from samples (`argus study history`: FLIP
/// 0.082 and 0.081), after one by 5° less (0.078).
const ENOUGH: u32 = PARTS * PARTS * 15 / 16;

impl Recalled {
    /// Of a view with these samples, where no more than so many frames begin one from the other.
    ///
    /// # Errors
    /// Why the history is of no use to it: a function of both and of nothing else.
    pub(crate) fn new(
        history: &Arc<History>,
        geometry: &ViewGeometry,
        samples: &[SampleId],
        longest_chain: u32,
    ) -> Result<Self, &'static str> {
        if history.links() >= longest_chain {
            return Err("enough frames have begun one from the other");
        }
        let [width, height] = history.size();
        let camera = SampleCamera::Perspective { camera: *history.camera(), width, height };
        let faces = camera.faces();
        let face = faces.first().ok_or("the earlier frame has no image")?;
        let pixel_from_face = geometry.pixel_from_face(camera.center(), face);
        let shown = shown(history, face, &pixel_from_face, geometry.size);
        if !shown.surface {
            return Err("the view shows no surface of the earlier frame");
        }
        if shown.parts.count_ones() < ENOUGH {
            return Err("the earlier frame shows too little of what the view does");
        }
        let position =
            |id: &SampleId| samples.iter().position(|other| is_place_of(other, id)).unwrap_or(0) as u32;
        let sources =
            history.samples().iter().enumerate().fold(0, |bits, (i, id)| bits | (position(id) << (3 * i)));
        let spacing = (pixel_of(face) / geometry.pixel_at_unit_depth()).max_element();
        Ok(Self { history: history.clone(), face: *face, pixel_from_face, spacing, sources })
    }

    /// Sub-pixels of the view from pixel to pixel of the history.
    pub(crate) fn spacing(&self) -> f64 {
        self.spacing
    }

    /// The pixels of a history that one piece of the view looks at; their words are appended to `words`. `landing` has all
    /// but the image in it.
    pub(crate) fn call(&self, landing: Landing, cell: u32, words: &mut Vec<u32>) -> Recall {
        let [width, height] = self.history.size();
        // As dense as the texels of samples are splatted.
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
        let pixel = pixel_of(&self.face);
        // The middle of every stride-th pixel is the middle of a texel that is as many pixels wide.
        let shift = f64::from(first) + 0.5 - 0.5 * f64::from(stride);
        let landing = self.pixel_from_face.landing(
            landing,
            cell,
            pixel * f64::from(stride),
            pixel * shift - self.face.tan_half_fov,
        );
        Recall { landing, columns: along(width), rows: along(height), first_word, sources: self.sources }
    }
}

/// Extent of a pixel at depth 1.
fn pixel_of(face: &Face) -> DVec2 {
    2.0 * face.tan_half_fov / DVec2::new(f64::from(face.size[0]), f64::from(face.size[1]))
}

/// Whether two samples were taken from one place, in whichever version.
fn is_place_of(one: &SampleId, other: &SampleId) -> bool {
    one.camera == other.camera
}

/// What a view sees of an earlier frame.
#[derive(Debug, Default)]
struct Shown {
    /// A bit for each part of the view that a pixel lands in. Sky lands where it lies, infinitely far.
    parts: u64,
    /// One of them is a surface's.
    surface: bool,
}

fn shown(history: &History, face: &Face, to: &PixelFromFace, size: DVec2) -> Shown {
    let [width, height] = history.size();
    let pixel = pixel_of(face);
    let at = |i: u32, side: u32| (u64::from(2 * i + 1) * u64::from(side) / u64::from(2 * LOOKED_AT)) as u32;
    let mut shown = Shown::default();
    for (column, row) in
        (0..LOOKED_AT * LOOKED_AT).map(|i| (at(i % LOOKED_AT, width), at(i / LOOKED_AT, height)))
    {
        let word = history.words()[row as usize * width as usize + column as usize];
        let position = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) * pixel - face.tan_half_fov;
        let direction = DVec3::new(position.x, -position.y, -1.0);
        let p = direction.extend(f64::from(History::inverse_range(word)) * direction.length());
        let w = to.w.dot(p);
        let part = DVec2::new(to.x.dot(p), to.y.dot(p)) / w / size * f64::from(PARTS);
        // Written so that what is not a number is nowhere.
        let inside =
            w > 0.0 && part.cmpge(DVec2::ZERO).all() && part.cmplt(DVec2::splat(f64::from(PARTS))).all();
        if inside {
            shown.parts |= 1 << (part.y as u32 * PARTS + part.x as u32);
            shown.surface |= word != 0;
        }
    }
    shown
}
