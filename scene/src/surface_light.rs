//! How the light of sky and surfaces in a frame was found.

use std::fmt;

use serde::{Deserialize, Serialize};

/// How sky and indirect light of a direct view were found. All of a view is lit alike, so that it can be repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceLight {
    /// By rays from each pixel.
    #[default]
    Rays,
    /// From light cells ([`crate::Indirect::Cells`]).
    Cells {
        /// Rays of each side of a cell.
        rays: u32,
        /// Whether what reflections show is lit by cells, too: of [`crate::CellSettings::FIRST_RAYS`]. Else rays light it.
        reflected: bool,
    },
    /// From light cells, of which some are still those of an earlier pose, since something moved and they are not filled anew yet.
    /// Only frames say so. Requests and pins cannot ask for it: which cells were old depends on what the worker had filled by then, so
    /// such a frame cannot be rendered again.
    OlderCells {
        /// Rays of each side of a cell.
        rays: u32,
        /// Whether what reflections show is lit by cells, too.
        reflected: bool,
    },
}

/// What the light cells of a sampler are.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct CellReport {
    /// Pages of 8³ cells held.
    pub pages: usize,
    /// Cells held, those without surfaces included.
    pub cells: usize,
    /// Bytes of them.
    pub bytes: usize,
    /// Cells filled or refined since the sampler was made.
    pub filled: u64,
    /// Milliseconds spent on that.
    pub fill_ms: f64,
    /// Corners of cells that wait to be filled, since views lacked them.
    pub waiting: usize,
    /// Pixels, reflected points and texels that asked for cells since the sampler was made.
    pub pixels: u64,
    /// Those of them that cells lit. Rays lit all others.
    pub pixels_lit: u64,
    /// Pages that other samplers sent since the sampler was made.
    pub pages_taken: u64,
    /// Milliseconds spent on that.
    pub take_ms: f64,
    /// Pages that were kept when something moved, since its boxes and its light touched nothing of them, since the sampler was made.
    pub pages_kept: u64,
    /// Pages that were touched then, and are filled anew.
    pub pages_touched: u64,
    /// Pages of an earlier pose that show until they are filled anew.
    pub pages_older: usize,
    /// Faces of samples that were taken over from an earlier version after something moved, since nothing of them had changed.
    pub faces_kept: u64,
    /// Faces that were rendered again then.
    pub faces_changed: u64,
    /// Whether there is anything to fill, or to refine.
    pub is_due: bool,
}

impl fmt::Display for SurfaceLight {
    /// `rays`, `cells:N`, or `cells:N+rays` where rays light what reflections show; `older-` before it for cells of an earlier pose.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rays => f.write_str("rays"),
            Self::Cells { rays, reflected } => {
                write!(f, "cells:{rays}{}", if *reflected { "" } else { "+rays" })
            }
            Self::OlderCells { rays, reflected } => {
                write!(f, "older-{}", Self::Cells { rays: *rays, reflected: *reflected })
            }
        }
    }
}
