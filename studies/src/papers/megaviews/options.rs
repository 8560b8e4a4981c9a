//! Arguments of the study.

use anyhow::{Context as _, Result, ensure};
use argus_megaviews::many_views::{Occlusion, Settings, Texel};
use glam::DVec3;

use super::placement::{Emitter, Placement};
use crate::arguments::{count, one_of, or_quick, positive};

/// How maps are rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Scene octree and view octree are traversed together.
    #[value(name = "megaviews")]
    MegaViews,
    /// The scene octree is traversed for each view.
    #[value(name = "manylods")]
    ManyLods,
    /// Every leaf of the scene octree descends the view octree: no scene hierarchy.
    FlatScene,
    /// Every triangle is rasterised for every view.
    Raster,
}

impl Method {
    /// The name in options and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::MegaViews => "megaviews",
            Self::ManyLods => "manylods",
            Self::FlatScene => "flat-scene",
            Self::Raster => "raster",
        }
    }
}

/// Measures maps of very many views (MegaViews) beside ManyLoDs and brute force, against the number of views, their
/// placement and resolution, and the levels of the octree
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method megaviews --scene sponza.glb --views 4096,65536 --light spot:0,10,0:0,-1,0:35 --out figures
  argus-lab study method megaviews --scene sponza.glb --views 4096 --placement random --resolution 16,32,64
  argus-lab study method megaviews --scene sponza.glb --views 65536 --texel node-64,node-32,range-32,range-16")]
pub struct Options {
    /// A file, `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`; `+balls:N` after it for mirroring balls,
    /// `?environment=FILE` for another sky
    #[arg(long, value_name = "S", default_value = or_quick("terrain:50000", "terrain:20000"))]
    pub scene: String,
    /// Numbers of views
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=4_194_304), default_value = or_quick("256,1024,4096,16384,65536", "64,256"))]
    pub views: Vec<u32>,
    /// Placement of views
    #[arg(
        long = "placement",
        value_name = "HOW",
        value_delimiter = ',',
        default_value = "single-bounce,four-bounce,random"
    )]
    pub placements: Vec<Placement>,
    /// Side of a hemisphere's map in texels
    #[arg(long = "resolution", value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(8..=1024), default_value = "16")]
    pub resolutions: Vec<u32>,
    /// Levels of the scene's octree below its root
    #[arg(long, value_name = "L", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=10), default_value = or_quick("9", "5"))]
    pub levels: Vec<u32>,
    /// Levels of the view octree [default: few enough that each view lies within one or two cells of the scene's
    /// octree of the point from which its map is rendered]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    pub view_levels: Option<u32>,
    /// Leave out the lowest level of the view octree, which groups the views of a cell by direction; the paper has no
    /// such level
    #[arg(long)]
    no_view_directions: bool,
    /// Methods to compare
    #[arg(long = "method", value_name = "METHOD", value_delimiter = ',', default_value = or_quick("megaviews,manylods,raster", "megaviews,manylods,flat-scene,raster"))]
    pub methods: Vec<Method>,
    /// Light that places the views: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG [default: the scene's first point or
    /// spot light, else a spot light above its middle]
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    pub light: Option<Emitter>,
    /// Also render what no view sees
    #[arg(long)]
    no_culling: bool,
    /// Occlusion culling: on (skip what is hidden behind the maps so far), off, or known (count what the finished
    /// maps would hide). The maps are the same
    #[arg(long, value_name = "HOW", value_delimiter = ',', value_parser = one_of(&Occlusion::ALL, Occlusion::name), default_value = "off")]
    pub occlusion: Vec<Occlusion>,
    /// Texel format: depth and node in 64 or 32 bits, or depth alone in 32 or 16
    #[arg(long = "texel", value_name = "TEXEL", value_delimiter = ',', value_parser = one_of(&Texel::ALL, Texel::name), default_value = "range-32")]
    pub texels: Vec<Texel>,
    /// Radius of a node's disc as a share of its ball, in maps of single views and in shared maps; 0.8165 leaves no
    /// gap in a surface
    #[arg(long = "disc", value_name = "OWN:SHARED", value_delimiter = ',', value_parser = parse_discs, default_value = "0.5:0.4")]
    pub discs: Vec<[f32; 2]>,
    /// Leave maps sparse, for lookups texel by texel
    #[arg(long)]
    no_fusion: bool,
    /// Number of measured frames, after one that is not counted; times are their median
    #[arg(long, value_name = "N", value_parser = count, default_value = or_quick("3", "1"))]
    pub rounds: usize,
    /// Longest expected time of a frame in seconds; slower rows are extrapolated
    #[arg(long = "patience", value_name = "SECONDS", value_parser = positive, default_value = "60")]
    pub patience_secs: f64,
}

impl Options {
    /// Settings of a traversal that all rows share.
    pub(super) fn settings(&self) -> Settings {
        Settings {
            tells_directions: !self.no_view_directions,
            culling: !self.no_culling,
            fusion: !self.no_fusion,
            view_depth: self.view_levels,
            ..Settings::default()
        }
    }
}

/// Parses `OWN:SHARED` in radii of a node's ball.
///
/// # Errors
/// The text is not of this form.
fn parse_discs(text: &str) -> Result<[f32; 2]> {
    let both = text.split_once(':').and_then(|(own, shared)| Some([own.parse().ok()?, shared.parse().ok()?]));
    both.filter(|discs: &[f32; 2]| discs.iter().all(|disc| *disc > 0.0 && *disc <= 1.0))
        .with_context(|| format!("`{text}` is not OWN:SHARED, each above 0 and at most 1"))
}

/// Parses `point:X,Y,Z` or `spot:X,Y,Z:DX,DY,DZ:HALF_DEG`, in metres and degrees.
///
/// # Errors
/// The text is not of this form.
pub(crate) fn parse_light(text: &str) -> Result<Emitter> {
    let vector = |text: &str| -> Result<DVec3> {
        let parts = text.split(',').map(str::parse::<f64>).collect::<Result<Vec<_>, _>>();
        let [x, y, z] =
            parts.ok().and_then(|p| p.try_into().ok()).with_context(|| format!("`{text}` is not X,Y,Z"))?;
        let vector = DVec3::new(x, y, z);
        ensure!(vector.is_finite(), "`{text}` must be finite");
        Ok(vector)
    };
    match text.split(':').collect::<Vec<_>>()[..] {
        ["point", position] => Ok(Emitter::Point { position: vector(position)? }),
        ["spot", position, direction, angle] => {
            let half_deg: f64 =
                angle.parse().with_context(|| format!("`{angle}` is not a number of degrees"))?;
            ensure!(
                half_deg > 0.0 && half_deg <= 180.0,
                "the half angle must be above 0 and at most 180 degrees"
            );
            let direction = vector(direction)?;
            ensure!(direction.length() > 0.0, "the direction must have a length");
            Ok(Emitter::Spot { position: vector(position)?, direction, half_angle: half_deg.to_radians() })
        }
        _ => anyhow::bail!("a light is point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG, not `{text}`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_are_two_numbers_in_their_range() {
        assert_eq!(parse_discs("0.5:0.25").unwrap(), [0.5, 0.25]);
        for wrong in ["0.5", "0:1", "1:2", "nan:1", "a:b"] {
            assert!(parse_discs(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn lights_are_parsed_and_errors_name_the_expected_form() {
        let spot = parse_light("spot:0,10,0:0,-1,0:35").unwrap();
        let Emitter::Spot { position, half_angle, .. } = spot else { panic!("{spot:?}") };
        assert_eq!(position, DVec3::new(0.0, 10.0, 0.0));
        assert!((half_angle.to_degrees() - 35.0).abs() < 1e-12);
        assert_eq!(
            parse_light("point:1,2,-3").unwrap(),
            Emitter::Point { position: DVec3::new(1.0, 2.0, -3.0) }
        );
        for wrong in
            ["sun", "point:1,2", "point:1,2,nan", "spot:0,0,0:0,0,0:35", "spot:0,0,0:0,1,0:0", "spot:0,0,0"]
        {
            assert!(parse_light(wrong).is_err(), "{wrong}");
        }
    }
}
