//! Arguments of the study, and the rows that they ask for.

use std::path::PathBuf;

use argus_sampler::{Indirect, MapSource, PointSettings, VplSettings};

use crate::arguments::{Viewer, count, or_quick, size};
use crate::papers::megaviews::{Emitter, parse_light};

/// Measures indirect light by virtual point lights: error and time over their number, maps, samples per pixel and filter
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method virtual-lights --scene sponza.glb --light spot:0,10,0:0,-1,0:35 --eye=-11,3,0 --target 0,4,0 --out figures")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:50000", "terrain:2000"))]
    pub scene: String,
    /// One light in place of the scene's lights and sky: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    pub light: Option<Emitter>,
    #[command(flatten)]
    pub(super) viewer: Viewer,
    /// Size of a view in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = or_quick("192x144", "48x36"))]
    pub size: [u32; 2],
    /// Greatest number of reflections between a light and a visible surface
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4), default_value = "1")]
    pub bounces: u32,
    /// Number of measured rounds; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Folder for the images of all rows
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
    /// VPLs of the first row; each other row changes one of its settings
    #[arg(skip = or_quick(VplSettings::default().vpls, 256))]
    pub base_vpls: u32,
    /// Numbers of VPLs
    #[arg(skip = or_quick(vec![256, 1024, 4096, 16384], vec![64]))]
    pub vpls: Vec<u32>,
    /// Sides of VPL maps in texels
    #[arg(skip = or_quick(vec![8, 16, 32, 64], vec![8]))]
    pub sides: Vec<u32>,
    /// Levels of the scene octree
    #[arg(skip = or_quick(vec![7, 8, 9], vec![4]))]
    pub levels: Vec<u32>,
    /// VPLs from which a pixel gathers
    #[arg(skip = or_quick(vec![4, 16, 64, 256], vec![64]))]
    pub samples: Vec<u32>,
    /// Radii of the filter in pixels
    #[arg(skip = or_quick(vec![0, 4, 8], vec![0]))]
    pub filters: Vec<u32>,
    /// Groups of VPLs that a block keeps
    #[arg(skip = or_quick(vec![16, 32, 64], vec![32]))]
    pub groups: Vec<u32>,
    /// Cut-off distances, as shares of the scene's diagonal
    #[arg(skip = or_quick(vec![0.1, 0.2, 0.4], vec![0.2]))]
    pub cutoffs: Vec<f64>,
    /// Distances below which a VPL's light does not increase, as shares of the scene's diagonal
    #[arg(skip = or_quick(vec![0.0, 0.01, 0.05], vec![0.05]))]
    pub clamps: Vec<f64>,
    /// Levels of the octree of the first row of points
    #[arg(skip = or_quick(PointSettings::default().levels, 5))]
    pub points_levels: u32,
    /// Levels of the points' octree
    #[arg(skip = or_quick(vec![6, 8, 9], vec![4]))]
    pub point_levels: Vec<u32>,
    /// Sides of receivers' maps in texels
    #[arg(skip = or_quick(vec![8, 32], vec![8]))]
    pub point_sides: Vec<u32>,
    /// Sides of pixel blocks in pixels
    #[arg(skip = or_quick(vec![4, 16], vec![4]))]
    pub blocks: Vec<u32>,
    /// Number of VPLs and side of maps of the reference by VPLs
    #[arg(skip = or_quick((4096, 64), (512, 32)))]
    pub most: (u32, u32),
    /// Paths per pixel of the path-traced reference
    #[arg(skip = or_quick(1024_u32, 16))]
    pub paths: u32,
}

impl Options {
    /// Settings of the first row.
    pub(super) fn base(&self) -> VplSettings {
        VplSettings { vpls: self.base_vpls, bounces: self.bounces, ..VplSettings::default() }
    }

    /// The first row, and a row for each changed setting.
    pub(super) fn rows(&self) -> Vec<(&'static str, Indirect)> {
        let base = self.base();
        let mut rows = vec![("as given", base)];
        rows.extend(self.vpls.iter().map(|&vpls| ("VPLs", VplSettings { vpls, ..base })));
        rows.extend(self.sides.iter().map(|&map_side| ("resolution", VplSettings { map_side, ..base })));
        rows.extend(MapSource::ALL.iter().map(|&maps| ("source", VplSettings { maps, ..base })));
        rows.extend(self.samples.iter().map(|&samples| ("samples", VplSettings { samples, ..base })));
        rows.extend(self.filters.iter().map(|&filter| ("filter", VplSettings { filter, ..base })));
        rows.extend(self.clamps.iter().map(|&clamp| ("clamp", VplSettings { clamp, ..base })));
        rows.extend(
            self.levels
                .iter()
                .map(|&levels| ("octree levels", VplSettings { maps: MapSource::MegaViews, levels, ..base })),
        );
        // Culling and weighting are compared without the filter, which would hide their effect.
        let bare = VplSettings { filter: 0, ..base };
        for (cull, weigh) in [(false, false), (true, false), (false, true), (true, true)] {
            rows.push(("culling", VplSettings { cull, weigh, ..bare }));
        }
        for filter in [0, base.filter] {
            rows.extend(self.groups.iter().map(|&groups| ("groups", VplSettings { filter, groups, ..base })));
        }
        rows.extend(
            self.cutoffs.iter().map(|&cutoff| ("cut-off", VplSettings { cutoff, weigh: false, ..bare })),
        );
        // As many texels as the first row, in a few large maps.
        let few = (base.vpls * base.map_side * base.map_side / (128 * 128)).max(1);
        let large = VplSettings { vpls: few, map_side: 128, samples: base.samples.min(few), ..base };
        rows.push(("few large maps", large));
        let mut rows: Vec<_> =
            rows.into_iter().map(|(differs, settings)| (differs, Indirect::Vpl(settings))).collect();
        rows.extend(self.point_rows().map(|(differs, settings)| (differs, Indirect::Points(settings))));
        let mut unique: Vec<(&'static str, Indirect)> = Vec::new();
        for row in rows {
            if unique.iter().all(|(_, settings)| *settings != row.1) {
                unique.push(row);
            }
        }
        unique
    }

    /// The rows of light by points.
    fn point_rows(&self) -> impl Iterator<Item = (&'static str, PointSettings)> {
        let (levels, bounces) = (self.points_levels, self.bounces);
        let base = PointSettings { levels, bounces, ..PointSettings::default() };
        let levels = self.point_levels.iter().map(move |&levels| PointSettings { levels, ..base });
        let sides = self.point_sides.iter().map(move |&map_side| PointSettings { map_side, ..base });
        let blocks = self.blocks.iter().map(move |&block| PointSettings { block, ..base });
        let alone = PointSettings { sharing: false, ..base };
        std::iter::once(("points", base))
            .chain(levels.map(|settings| ("points, levels", settings)))
            .chain(sides.map(|settings| ("points, resolution", settings)))
            .chain(blocks.map(|settings| ("points, block", settings)))
            .chain(std::iter::once(("points, own maps", alone)))
    }
}

#[cfg(test)]
mod tests {
    use argus_sampler::SamplerSettings;

    use super::*;

    #[test]
    fn every_row_differs_from_all_rows_before_it() {
        let options: Options = crate::arguments::options(false);
        let rows = options.rows();
        assert_eq!(rows[0].1, Indirect::Vpl(options.base()));
        for (index, (_, settings)) in rows.iter().enumerate() {
            SamplerSettings { indirect: *settings, ..SamplerSettings::default() }.validate().unwrap();
            assert!(rows[..index].iter().all(|(_, other)| other != settings));
        }
        assert!(rows.len() > 15);
    }
}
