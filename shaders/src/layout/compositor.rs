//! Mirrors of structs of `shaders/compositor/*.wgsl` and of the modules that they share.

use super::Mirror;
use super::shared::{Lighting, ProbeUniform};

/// All mirrors of this file.
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

/// Most samples of a view.
pub const MAX_SAMPLES: usize = 8;

mirror! {
    /// A sample as one view looks it up: `shared/fetch.wgsl`.
    pub struct ViewSample {
        /// Row of the transform from directions in world axes to u × w. Perspective samples only.
        pub u_from_world: [f32; 3],
        /// Layer of the texture arrays.
        pub layer: u32,
        /// Row of v × w. Perspective samples only.
        pub v_from_world: [f32; 3],
        /// Faces of a cube that the plan uses, one bit each.
        pub faces: u32,
        /// Row of w, the depth along the sample camera's axis. Perspective samples only.
        pub w_from_world: [f32; 3],
        /// WGSL aligns vectors of three to 16 bytes.
        pub _pad_w: f32,
        /// The view's eye relative to the sample's centre, metres, world axes.
        pub eye_from_center: [f32; 3],
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: f32,
    }
}

mirror! {
    /// A piece of a view: `shared/fetch.wgsl`.
    pub struct ViewUniform {
        /// Direction of the image's top left corner, at depth 1, world axes.
        pub corner: [f32; 3],
        /// Number of valid entries of `samples`.
        pub sample_count: u32,
        /// Change of direction from pixel to pixel.
        pub right: [f32; 3],
        /// Steps of the linear search.
        pub steps: u32,
        /// Change of direction from row to row.
        pub down: [f32; 3],
        /// Index of this view's first light.
        pub first_light: u32,
        /// The scene's bounds relative to the eye.
        pub bounds_min: [f32; 3],
        /// Pixels along the edge of a cell.
        pub cell: f32,
        /// The scene's bounds relative to the eye.
        pub bounds_max: [f32; 3],
        /// Index of this piece's first cell.
        pub first_cell: u32,
        /// Unit axis of the view.
        pub forward: [f32; 3],
        /// Relative difference of range up to which a texel belongs to the surface at a depth.
        pub tolerance: f32,
        /// Position of the piece's first pixel in the view, pixels.
        pub piece_origin: [f32; 2],
        /// Position of the piece's first pixel in the target, pixels.
        pub target_origin: [f32; 2],
        /// First cell of this piece, in cells of the view.
        pub cell_origin: [i32; 2],
        /// Columns of this piece's cells.
        pub cell_columns: i32,
        /// Index of this piece's first word in `unsettled`.
        pub first_unsettled: u32,
        /// Index of this piece in the chunk.
        pub piece: u32,
        /// Texels of the nearest sample along the edge of a pixel, at equal distance from both.
        pub footprint: f32,
        /// Columns and rows of the piece's pixels.
        pub piece_size: [u32; 2],
        /// The scene's extent relative to the eye.
        pub extent_min: [f32; 3],
        /// Pixels along the edge of a texel that is too coarse where surfaces end.
        pub coarse_edge: f32,
        /// The scene's extent relative to the eye.
        pub extent_max: [f32; 3],
        /// Pixels along the edge of a texel that is too coarse anywhere.
        pub coarse: f32,
        /// Sky, exposure and number of lights.
        pub lighting: Lighting,
        /// Reflection probes relative to the eye.
        pub probes: ProbeUniform,
        /// The plan's samples, in its order.
        pub samples: [ViewSample; MAX_SAMPLES],
        /// Pads to 1024 bytes, a multiple of the alignment of uniforms.
        pub _pad: [f32; 32],
    }
}

mirror! {
    /// The transform from a pinhole image to the cells of a piece: `shared/cell_projection.wgsl`.
    pub struct CellProjection {
        /// Row of column × w, from (position × inverse depth, inverse depth) in the image's axes.
        pub column: [f32; 4],
        /// Row of row × w.
        pub row: [f32; 4],
        /// Row of w.
        pub depth: [f32; 4],
        /// Direction of a texel is `scale` × texel + `bias`.
        pub scale: [f32; 2],
        /// See `scale`.
        pub bias: [f32; 2],
        /// Index of the piece's first cell.
        pub first_cell: u32,
        /// Columns of the piece's cells.
        pub cell_columns: i32,
        /// Rows of the piece's cells.
        pub cell_rows: i32,
        /// First column of the piece, in cells of the view.
        pub origin_column: i32,
        /// First row of the piece, in cells of the view.
        pub origin_row: i32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: [u32; 3],
    }
}

mirror! {
    /// One face of one sample, projected into one view: `compositor/splat.wgsl`.
    pub struct Splat {
        /// Transform of its texels to cells.
        pub projection: CellProjection,
        /// Position of the face in the sample, texels.
        pub face_offset: [u32; 2],
        /// Its size, texels.
        pub face_size: [u32; 2],
        /// Layer of the texture array.
        pub layer: u32,
        /// Index of the dispatch's first block.
        pub first_block: u32,
        /// Position of the sample in the plan's list.
        pub source: u32,
        /// WGSL rounds the struct up to 16 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// Pixels of an earlier frame, projected into one view: `compositor/reproject.wgsl`.
    pub struct Reproject {
        /// Transform of the pixels to cells.
        pub projection: CellProjection,
        /// Pixels in a row.
        pub columns: u32,
        /// Rows of pixels.
        pub rows: u32,
        /// Index of their first word.
        pub first_word: u32,
        /// For each sample of the earlier frame its position in the plan's list, three bits each.
        pub sources: u32,
    }
}

mirror! {
    /// The cells of one piece: `compositor/fill.wgsl`.
    pub struct Fill {
        /// Index of its first cell.
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
        /// Cells along the edge of a block.
        pub side: u32,
    }
}

mirror! {
    /// One supersampled piece: `compositor/resolve.wgsl`.
    pub struct Resolve {
        /// Its first texel in the target of sub-pixels.
        pub source_origin: [u32; 2],
        /// Its first texel in the target of pixels.
        pub target_origin: [u32; 2],
        /// Sub-pixels along the edge of a pixel.
        pub side: u32,
        /// Factor from radiance to display-linear.
        pub exposure: f32,
    }
}

mirror! {
    /// One level of a sample's radiance: `compositor/mips.wgsl`.
    pub struct Mips {
        /// Size of this level, texels.
        pub size: [u32; 2],
        /// Size of the finer level, texels.
        pub finer: [u32; 2],
        /// Layer of the texture arrays.
        pub layer: u32,
        /// 1 if the finer level's inverse ranges are the sample's plane.
        pub from_sample: u32,
        /// Index of the finer level's first inverse range.
        pub finer_range: u32,
        /// Index of this level's first inverse range.
        pub range: u32,
        /// First word of this level's texels.
        pub word: u32,
        /// Words from one row to the next.
        pub pitch: u32,
        /// Factor from radiance to display-linear.
        pub exposure: f32,
        /// 1 if samples have a Specular plane.
        pub glossy: u32,
        /// First row of the dispatch.
        pub first_row: u32,
        /// WGSL's padding to a multiple of 8 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// One face of a sample that is uploaded: `compositor/bounds.wgsl`.
    pub struct TileBounds {
        /// Position of the face in the sample, texels.
        pub face_offset: [u32; 2],
        /// Its size, texels.
        pub face_size: [u32; 2],
        /// Layer of the texture array.
        pub layer: u32,
        /// Index of its first tile in the result.
        pub first_tile: u32,
        /// Tiles in a row.
        pub tile_columns: u32,
        /// Rows of tiles.
        pub tile_rows: u32,
        /// Texels on a side of a tile.
        pub tile_side: u32,
        /// WGSL rounds the struct up to 8 bytes.
        pub _pad: u32,
    }
}

mirror! {
    /// One sample whose pyramid is built: `compositor/build_pyramid.wgsl`.
    pub struct BuildPyramid {
        /// Layer of the texture arrays.
        pub layer: u32,
        /// Columns of the sample, texels.
        pub width: u32,
        /// Rows.
        pub height: u32,
    }
}
