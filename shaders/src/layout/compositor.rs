//! `shaders/compositor/*.wgsl` and what they share: the compositor's side of the GPU.

use super::Mirror;
use super::shared::{Lighting, ProbeUniform};

/// All of this file's.
pub(super) const MIRRORS: &[Mirror] = &[
    ViewSample::MIRROR,
    ViewUniform::MIRROR,
    CellProjection::MIRROR,
    Splat::MIRROR,
    Reproject::MIRROR,
    Fill::MIRROR,
    SkyMask::MIRROR,
    Resolve::MIRROR,
    TileBounds::MIRROR,
    BuildPyramid::MIRROR,
    Mips::MIRROR,
];

/// Samples that one view can be made of.
pub const MAX_SAMPLES: usize = 8;

mirror! {
    /// A sample as the pixels of one view look it up: `shared/fetch.wgsl`.
    pub struct ViewSample {
        /// Direction in world axes to texture coordinate u times w; perspective only, as are v and w.
        pub u_from_world: [f32; 3],
        /// Layer of the texture arrays.
        pub layer: u32,
        /// To v times w.
        pub v_from_world: [f32; 3],
        /// WGSL aligns vectors of three to 16 bytes.
        pub _pad_v: f32,
        /// To w, the depth along the sample camera's axis.
        pub w_from_world: [f32; 3],
        /// WGSL aligns vectors of three to 16 bytes.
        pub _pad_w: f32,
        /// The view's eye as seen from the sample's centre, metres, world axes.
        pub eye_from_center: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: f32,
    }
}

mirror! {
    /// One view, or a piece of a large one: `shared/fetch.wgsl`.
    pub struct ViewUniform {
        /// Direction of the image's top left corner, at depth 1, world axes.
        pub corner: [f32; 3],
        /// How many of `samples` there are.
        pub sample_count: u32,
        /// Change of direction from pixel to pixel.
        pub right: [f32; 3],
        /// Steps of the linear search.
        pub steps: u32,
        /// Change of direction from row to row.
        pub down: [f32; 3],
        /// First of this view's lights.
        pub first_light: u32,
        /// The scene's bounds relative to the eye.
        pub bounds_min: [f32; 3],
        /// Pixels on an edge of a splat cell.
        pub cell: f32,
        /// The scene's bounds relative to the eye.
        pub bounds_max: [f32; 3],
        /// First of this piece's cells.
        pub first_cell: u32,
        /// The view's axis, unit.
        pub forward: [f32; 3],
        /// Relative difference of range up to which a texel is taken for the surface that is looked for.
        pub tolerance: f32,
        /// Image position of the piece's first pixel, in pixels.
        pub piece_origin: [f32; 2],
        /// Where the piece lies in the target.
        pub target_origin: [f32; 2],
        /// Column and row of the view's cells at which this piece's begin.
        pub cell_origin: [i32; 2],
        /// Columns of this piece's cells.
        pub cell_columns: i32,
        /// First of this piece's places in the list of pixels that are not settled.
        pub first_unsettled: u32,
        /// Index of this piece among the chunk's.
        pub piece: u32,
        /// Texels of a sample on the edge of a sub-pixel, at equal distance.
        pub footprint: f32,
        /// Columns and rows of the piece's pixels.
        pub piece_size: [u32; 2],
        /// Sky, exposure and number of lights.
        pub lighting: Lighting,
        /// Where maps of surroundings lie about the eye.
        pub probes: ProbeUniform,
        /// The plan's samples, in its order.
        pub samples: [ViewSample; MAX_SAMPLES],
        /// As many as make 768 bytes, so that an array's elements lie where uniforms may.
        pub _pad: [f32; 12],
    }
}

mirror! {
    /// One pinhole image as one piece of one view sees it: `shared/cell_projection.wgsl`.
    pub struct CellProjection {
        /// Position in the image's axes times its inverse depth, and that inverse depth, to column times w.
        pub column: [f32; 4],
        /// To row times w.
        pub row: [f32; 4],
        /// To w.
        pub depth: [f32; 4],
        /// Texel of the image to its direction: factor.
        pub scale: [f32; 2],
        /// Texel of the image to its direction: summand.
        pub bias: [f32; 2],
        /// First of the piece's cells.
        pub first_cell: u32,
        /// Columns of the piece's cells.
        pub cell_columns: i32,
        /// Rows of the piece's cells.
        pub cell_rows: i32,
        /// Column of the view's cells at which the piece's begin.
        pub origin_column: i32,
        /// Row of the view's cells at which the piece's begin.
        pub origin_row: i32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 3],
    }
}

mirror! {
    /// One face of one sample as one view sees it: `compositor/splat.wgsl`.
    pub struct Splat {
        /// Where its texels land.
        pub projection: CellProjection,
        /// Where the face lies in the sample, texels.
        pub face_offset: [u32; 2],
        /// Its size, texels.
        pub face_size: [u32; 2],
        /// Layer of the texture array.
        pub layer: u32,
        /// First of this dispatch's blocks.
        pub first_block: u32,
        /// Position of the sample in the plan's list.
        pub source: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// Pixels of an earlier frame as one view sees them: `compositor/reproject.wgsl`.
    pub struct Reproject {
        /// Where they land.
        pub projection: CellProjection,
        /// Pixels in a row.
        pub columns: u32,
        /// Rows of pixels.
        pub rows: u32,
        /// First of their words.
        pub first_word: u32,
        /// Position in the plan's list of each of the earlier frame's samples, three bits each.
        pub sources: u32,
    }
}

mirror! {
    /// The cells of one piece: `compositor/fill.wgsl`.
    pub struct Fill {
        /// First of its cells.
        pub first_cell: u32,
        /// Columns.
        pub columns: i32,
        /// Rows.
        pub rows: i32,
    }
}

mirror! {
    /// The cells of one piece: `compositor/sky_mask.wgsl`.
    pub struct SkyMask {
        /// Columns.
        pub columns: u32,
        /// Rows.
        pub rows: u32,
        /// Cells on the edge of a block.
        pub side: u32,
    }
}

mirror! {
    /// One supersampled piece: `compositor/resolve.wgsl`.
    pub struct Resolve {
        /// Where it lies in the supersampled target.
        pub source_origin: [u32; 2],
        /// Where it lies in the final target.
        pub target_origin: [u32; 2],
        /// Supersampled pixels on the edge of a final one.
        pub side: u32,
        /// Radiance to display-linear.
        pub exposure: f32,
    }
}

mirror! {
    /// One level of a sample's radiance: `compositor/mips.wgsl`.
    pub struct Mips {
        /// Texels of this level.
        pub size: [u32; 2],
        /// Texels of the finer one.
        pub finer: [u32; 2],
        /// Layer of the texture arrays.
        pub layer: u32,
        /// Whether the finer level's inverse ranges are the sample's own.
        pub from_sample: u32,
        /// First of the finer level's inverse ranges.
        pub finer_range: u32,
        /// First of this level's.
        pub range: u32,
        /// First word of this level's texels.
        pub word: u32,
        /// Words from row to row.
        pub pitch: u32,
        /// Radiance to display-linear.
        pub exposure: f32,
        /// Whether samples carry what specular needs.
        pub glossy: u32,
        /// Row of this level at which a dispatch begins.
        pub first_row: u32,
        /// WGSL's padding to a multiple of 8 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// One face of a sample that is taken in: `compositor/bounds.wgsl`.
    pub struct TileBounds {
        /// Where the face lies in the sample, texels.
        pub face_offset: [u32; 2],
        /// Its size, texels.
        pub face_size: [u32; 2],
        /// Layer of the texture array.
        pub layer: u32,
        /// First of its tiles in the result.
        pub first_tile: u32,
        /// Tiles in a row.
        pub tile_columns: u32,
        /// Rows of tiles.
        pub tile_rows: u32,
        /// Texels on the edge of a tile.
        pub tile_side: u32,
        /// WGSL rounds the struct up to 8 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// One sample whose pyramid is made: `compositor/build_pyramid.wgsl`.
    pub struct BuildPyramid {
        /// Layer of the texture arrays.
        pub layer: u32,
        /// Texels of the sample: columns.
        pub width: u32,
        /// Rows.
        pub height: u32,
    }
}
