//! Settings of light cells.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::PathSettings;
use crate::InvalidField;

/// Settings of light cells: sky and indirect light are kept on surfaces, and looked up by all views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellSettings {
    /// What the rays of cells find on surfaces, and the light of views whose cells are not filled yet.
    pub paths: PathSettings,
    /// Edge of a cell in pixels of the view that looks it up, 1 to 64. Twice as much takes a quarter of the time to fill, and
    /// blurs light over twice the distance.
    pub pixels: u32,
    /// Rays of each side of a cell at best: 16, 64 or 256. Views begin with 16; cells in use are refined while nothing else is
    /// to do. Four times as many halve the noise.
    pub rays: u32,
}

impl Default for CellSettings {
    fn default() -> Self {
        Self { paths: PathSettings::default(), pixels: 4, rays: 256 }
    }
}

impl fmt::Display for CellSettings {
    /// All fields in short form, for provenance.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { paths, pixels, rays } = self;
        match paths.bounces {
            0 => write!(f, "cells of {pixels} pixels, {rays} rays a side, of the sky alone"),
            _ => write!(f, "cells of {pixels} pixels, {rays} rays a side, {paths}"),
        }
    }
}

impl CellSettings {
    /// Cells that keep what is seen of the sky, and no light of surfaces.
    pub fn of_sky() -> Self {
        let default = Self::default();
        Self { paths: PathSettings { bounces: 0, ..default.paths }, ..default }
    }

    /// Rays of a side that a cell may have.
    pub const RAYS: [u32; 3] = [16, 64, 256];

    /// Rays of a side before it is refined: those of samples and of first views.
    pub const FIRST_RAYS: u32 = 16;

    /// Checks all ranges.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn validate(&self) -> Result<(), InvalidField> {
        // Without bounces, cells keep the sky alone.
        PathSettings { bounces: self.paths.bounces.max(1), ..self.paths }.validate()?;
        InvalidField::within("indirect.pixels", self.pixels, 1..=64)?;
        if !Self::RAYS.contains(&self.rays) {
            let reason = format!("must be 16, 64 or 256, not {}", self.rays);
            return Err(InvalidField::new("indirect.cell_rays", reason));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_out_of_range_is_named() {
        let default = CellSettings::default();
        assert_eq!(default.validate(), Ok(()));
        let paths = PathSettings { level: 0, ..default.paths };
        let cases = [
            (CellSettings { paths, ..default }, "indirect.level"),
            (CellSettings { pixels: 0, ..default }, "indirect.pixels"),
            (CellSettings { rays: 32, ..default }, "indirect.cell_rays"),
        ];
        for (settings, field) in cases {
            assert_eq!(settings.validate().unwrap_err().field, field);
        }
    }
}
