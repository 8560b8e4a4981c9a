//! Assembles frames from pieces that were read back from the device.

use argus_scene::{Frame, Output, Outputs, Provenance, Served, Stage};
use bytes::Bytes;

use crate::layout::{Chunk, Piece};
use crate::radiance::from_half;

/// A frame that is assembled piece by piece.
#[derive(Debug)]
pub(crate) struct FrameAssembly {
    width: u32,
    height: u32,
    /// The images that are asked for.
    images: Vec<(Output, Vec<u8>)>,
    served: Served,
}

/// The images of a chunk after readback. Images that no view asked for are empty.
#[derive(Debug)]
pub(crate) struct ChunkImages {
    /// Four bytes a pixel: sRGB and the source.
    pub(crate) srgb: Bytes,
    /// Eight bytes a sub-pixel: radiance and the source, half floats.
    pub(crate) linear: Bytes,
    /// Metres, an f32 a pixel.
    pub(crate) range: Bytes,
    /// Four bytes a pixel, the first is the confidence.
    pub(crate) confidence: Bytes,
}

/// Source that programs write for a pixel that no sample saw.
const UNRESOLVED: u8 = 255;

/// Added to the source of a pixel whose colour and depth come from different samples: `shaders/shared/pixel.wgsl`.
const OTHER_SAMPLE: u8 = 64;

/// What a compositor makes; all else follows from range or from the triangles.
const COMPOSED: Outputs =
    Outputs::SHADED.with(Output::Range).with(Output::Mask).with(Output::Source).with(Output::Confidence);

/// The mean radiance of the sub-pixels of a piece's pixel.
fn mean_radiance(linear: &[u8], chunk: &Chunk, piece: &Piece, [column, row]: [usize; 2]) -> [f32; 3] {
    let (side, texels) = (piece.side as usize, linear.as_chunks::<8>().0);
    let pitch = chunk.size[0] as usize * side;
    let [x, y] = [(piece.target[0] as usize + column) * side, (piece.target[1] as usize + row) * side];
    let mut sum = [0.0; 3];
    for texel in (0..side).flat_map(|line| &texels[(y + line) * pitch + x..][..side]) {
        let channels = texel.as_chunks::<2>().0;
        sum.iter_mut().zip(channels).for_each(|(sum, half)| *sum += from_half(u16::from_le_bytes(*half)));
    }
    sum.map(|sum| sum / (side * side) as f32)
}

impl FrameAssembly {
    pub(crate) fn new(width: u32, height: u32, outputs: Outputs) -> Self {
        let pixels = width as usize * height as usize;
        let composed = outputs.within(COMPOSED);
        let images = composed.iter().map(|output| (output, vec![0; pixels * output.pixel_bytes()])).collect();
        Self { width, height, images, served: Served::default() }
    }

    /// Copies a piece from a chunk's images.
    pub(crate) fn add(&mut self, chunk: &Chunk, piece: &Piece, images: &ChunkImages) {
        let ChunkImages { srgb, linear, range, confidence } = images;
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
            for (output, image) in &mut self.images {
                let bytes = output.pixel_bytes();
                let out = &mut image[bytes * to..bytes * (to + columns)];
                match output {
                    Output::Color => {
                        let out = out.as_chunks_mut::<3>().0;
                        out.iter_mut().zip(pixels).for_each(|(out, p)| out.copy_from_slice(&p[..3]));
                    }
                    Output::Mask => out
                        .iter_mut()
                        .zip(pixels)
                        .for_each(|(out, p)| *out = if p[3] == UNRESOLVED { 255 } else { 0 }),
                    Output::Source => out.iter_mut().zip(pixels).for_each(|(out, p)| {
                        *out = if p[3] == UNRESOLVED { 0 } else { p[3] & !OTHER_SAMPLE }
                    }),
                    Output::Radiance => {
                        let pixel = |column| mean_radiance(linear, chunk, piece, [column, row]);
                        let values = (0..columns).flat_map(pixel).map(f32::to_le_bytes);
                        out.as_chunks_mut::<4>()
                            .0
                            .iter_mut()
                            .zip(values)
                            .for_each(|(out, value)| *out = value);
                    }
                    Output::Depth | Output::Normal | Output::Instance | Output::Material | Output::Flow => {}
                    Output::Confidence => {
                        let bytes = confidence[4 * from..4 * (from + columns)].as_chunks::<4>().0;
                        out.iter_mut().zip(bytes).for_each(|(out, b)| *out = b[0]);
                    }
                    Output::Range => {
                        let metres = range[4 * from..4 * (from + columns)].as_chunks::<4>().0;
                        // The device stores 0 for no surface; frames store infinity.
                        out.as_chunks_mut::<4>().0.iter_mut().zip(metres).for_each(|(out, &m)| {
                            *out = if f32::from_le_bytes(m) > 0.0 { m } else { f32::INFINITY.to_le_bytes() };
                        });
                    }
                }
            }
        }
    }

    /// The finished frame, once all pieces are added.
    pub(crate) fn finish(self, provenance: Provenance, stages: Vec<Stage>) -> Frame {
        let pixels = u64::from(self.width) * u64::from(self.height);
        Frame {
            width: self.width,
            height: self.height,
            images: self.images.into_iter().map(|(output, image)| (output, image.into())).collect(),
            served: self.served,
            predicted: None,
            decision: None,
            unresolved_fraction: self.served.unresolved as f64 / pixels.max(1) as f64,
            provenance,
            stages,
        }
    }
}
