//! Assembles frames of direct views from tiles.

use argus_scene::{
    Frame, Images, InvalidField, Output, Plan, Provenance, Scene, Specification, Stage, ViewJob,
};
use bytes::Bytes;

use crate::tile::Tile;

/// Most sub-samples along a side of a pixel.
const MAX_SIDE: u32 = 8;

/// The side of the grid of sub-samples that a plan asks for.
///
/// # Errors
/// The plan is not direct, or its number of samples is not a square up to 64.
pub(crate) fn grid_side(plan: &Plan) -> Result<u32, InvalidField> {
    let Plan::Direct { samples_per_pixel, .. } = plan else {
        return Err(InvalidField::new("plan", "a sampler renders direct views only"));
    };
    let side = samples_per_pixel.isqrt();
    if side * side != *samples_per_pixel || !(1..=MAX_SIDE).contains(&side) {
        let most = MAX_SIDE * MAX_SIDE;
        let reason = format!("must be a square number from 1 to {most}, not {samples_per_pixel}");
        return Err(InvalidField::new("plan.samples_per_pixel", reason));
    }
    Ok(side)
}

/// An image that is assembled from tiles.
pub(crate) struct Image {
    size: [u32; 2],
    pixel_bytes: usize,
    bytes: Bytes,
    /// Used in place of `bytes` if there are several tiles.
    joined: Vec<u8>,
}

impl Image {
    pub(crate) fn new(size: [u32; 2], pixel_bytes: usize) -> Self {
        Self { size, pixel_bytes, bytes: Bytes::new(), joined: Vec::new() }
    }

    /// Takes the pixels of a tile, rows tightly packed. Bytes beyond the last pixel are ignored.
    pub(crate) fn place(&mut self, tile: &Tile, mut pixels: Bytes) {
        let row = tile.size[0] as usize * self.pixel_bytes;
        if tile.size == self.size {
            pixels.truncate(row * tile.size[1] as usize);
            self.bytes = pixels;
            return;
        }
        let pitch = self.size[0] as usize * self.pixel_bytes;
        self.joined.resize(pitch * self.size[1] as usize, 0);
        let [x, y] = tile.begin.map(|texels| texels as usize);
        for (i, from) in pixels.chunks_exact(row).take(tile.size[1] as usize).enumerate() {
            let at = (y + i) * pitch + x * self.pixel_bytes;
            self.joined[at..at + row].copy_from_slice(from);
        }
    }

    pub(crate) fn into_bytes(self) -> Bytes {
        if self.joined.is_empty() { self.bytes } else { self.joined.into() }
    }
}

/// The frame of a direct view. Mask, source and confidence say that no sample was used.
pub(crate) fn frame(
    view: &ViewJob,
    scene: &Scene,
    specification: Specification,
    device: &str,
    parts: Images,
    stages: Vec<Stage>,
) -> Frame {
    let pixels = view.width as usize * view.height as usize;
    let constant = |output, value: u8| view.outputs.has(output).then(|| Bytes::from(vec![value; pixels]));
    let provenance = Provenance {
        specification: Some(specification),
        device: device.to_owned(),
        ..Provenance::of_plan(scene.hash, view.state, view.plan.clone())
    };
    Frame {
        images: parts
            .with(Output::Mask, constant(Output::Mask, 0))
            .with(Output::Source, constant(Output::Source, 0))
            .with(Output::Confidence, constant(Output::Confidence, 255)),
        stages,
        ..Frame::without_images(view.width, view.height, provenance)
    }
}
