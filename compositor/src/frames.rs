//! Assembles frames from pieces that were read back from the device.

use argus_scene::{Frame, Outputs, Provenance, Served, Stage};
use bytes::Bytes;

use crate::layout::{Chunk, Piece};

/// A frame that is assembled piece by piece.
#[derive(Debug)]
pub(crate) struct FrameAssembly {
    width: u32,
    height: u32,
    color: Option<Vec<u8>>,
    range: Option<Vec<u8>>,
    mask: Option<Vec<u8>>,
    source: Option<Vec<u8>>,
    confidence: Option<Vec<u8>>,
    served: Served,
}

/// The images of a chunk after readback. Images that no view asked for are empty.
#[derive(Debug)]
pub(crate) struct ChunkImages {
    /// Four bytes a pixel: sRGB and the source.
    pub(crate) srgb: Bytes,
    /// Metres, an f32 a pixel.
    pub(crate) range: Bytes,
    /// Four bytes a pixel, the first is the confidence.
    pub(crate) confidence: Bytes,
}

/// Source that programs write for a pixel that no sample saw.
const UNRESOLVED: u8 = 255;

/// Added to the source of a pixel whose colour and depth come from different samples: `shaders/shared/pixel.wgsl`.
const OTHER_SAMPLE: u8 = 64;

impl FrameAssembly {
    pub(crate) fn new(width: u32, height: u32, outputs: Outputs) -> Self {
        let plane = |on: bool, bytes: usize| on.then(|| vec![0; width as usize * height as usize * bytes]);
        Self {
            width,
            height,
            color: plane(outputs.color, 3),
            range: plane(outputs.range, 4),
            mask: plane(outputs.mask, 1),
            source: plane(outputs.source, 1),
            confidence: plane(outputs.confidence, 1),
            served: Served::default(),
        }
    }

    /// Copies a piece from a chunk's images.
    pub(crate) fn add(&mut self, chunk: &Chunk, piece: &Piece, images: &ChunkImages) {
        let ChunkImages { srgb, range, confidence } = images;
        let (columns, row_pixels) = (piece.part.width as usize, chunk.size[0] as usize);
        for row in 0..piece.part.height as usize {
            let from = (piece.target[1] as usize + row) * row_pixels + piece.target[0] as usize;
            let to = (piece.part.y as usize + row) * self.width as usize + piece.part.x as usize;
            let pixels = srgb[4 * from..4 * (from + columns)].as_chunks::<4>().0;
            let unresolved = pixels.iter().filter(|p| p[3] == UNRESOLVED).count() as u64;
            let guided = pixels.iter().filter(|p| p[3] & OTHER_SAMPLE != 0).count() as u64;
            self.served.unresolved += unresolved;
            // `UNRESOLVED` contains that bit.
            self.served.other_sample += guided - unresolved;
            self.served.warped += pixels.len() as u64 - guided;
            if let Some(color) = &mut self.color {
                let out = color[3 * to..3 * (to + columns)].as_chunks_mut::<3>().0;
                out.iter_mut().zip(pixels).for_each(|(out, p)| out.copy_from_slice(&p[..3]));
            }
            if let Some(mask) = &mut self.mask {
                let out = &mut mask[to..to + columns];
                out.iter_mut()
                    .zip(pixels)
                    .for_each(|(out, p)| *out = if p[3] == UNRESOLVED { 255 } else { 0 });
            }
            if let Some(source) = &mut self.source {
                let out = &mut source[to..to + columns];
                out.iter_mut()
                    .zip(pixels)
                    .for_each(|(out, p)| *out = if p[3] == UNRESOLVED { 0 } else { p[3] & !OTHER_SAMPLE });
            }
            if let Some(out) = &mut self.confidence {
                let bytes = confidence[4 * from..4 * (from + columns)].as_chunks::<4>().0;
                out[to..to + columns].iter_mut().zip(bytes).for_each(|(out, b)| *out = b[0]);
            }
            if let Some(out) = &mut self.range {
                let out = out[4 * to..4 * (to + columns)].as_chunks_mut::<4>().0;
                let metres = range[4 * from..4 * (from + columns)].as_chunks::<4>().0;
                // The device stores 0 for no surface; frames store infinity.
                out.iter_mut().zip(metres).for_each(|(out, &m)| {
                    *out = if f32::from_le_bytes(m) > 0.0 { m } else { f32::INFINITY.to_le_bytes() };
                });
            }
        }
    }

    /// The finished frame, once all pieces are added.
    pub(crate) fn finish(self, provenance: Provenance, stages: Vec<Stage>) -> Frame {
        let pixels = u64::from(self.width) * u64::from(self.height);
        Frame {
            width: self.width,
            height: self.height,
            color: self.color.map(Bytes::from),
            range: self.range.map(Bytes::from),
            mask: self.mask.map(Bytes::from),
            source: self.source.map(Bytes::from),
            confidence: self.confidence.map(Bytes::from),
            served: self.served,
            predicted: None,
            decision: None,
            unresolved_fraction: self.served.unresolved as f64 / pixels.max(1) as f64,
            provenance,
            stages,
        }
    }
}
