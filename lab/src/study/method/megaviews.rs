//! Arguments of `argus-lab study method megaviews`.

use argus_studies::papers::megaviews::{
    Emitter, Method, Occlusion, Options, Placement, Texel, parse_discs, parse_light, run,
};
use argus_studies::{Effort as _, Report};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::ProgressBar;

use crate::study::arguments::{Scene, blocking};

/// Measures maps of very many views (MegaViews) beside ManyLoDs and brute force, against the number of views, their
/// placement and resolution, and the levels of the octree
///
/// Without --scene: terrain:50000.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus-lab study method megaviews --scene sponza.glb --views 4096,65536 --light spot:0,10,0:0,-1,0:35 --out figures
  argus-lab study method megaviews --scene sponza.glb --views 4096 --placement random --resolution 16,32,64
  argus-lab study method megaviews --scene sponza.glb --views 65536 --texel node-64,node-32,range-32,range-16")]
pub(in crate::study) struct MegaViews {
    #[command(flatten)]
    scene: Scene,
    /// Numbers of views, ascending [default: 256,1024,4096,16384,65536]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=4_194_304))]
    views: Vec<u32>,
    /// Placement of views: where light first meets surfaces, also after three bounces, or at random [default: all]
    #[arg(long, value_name = "HOW", value_delimiter = ',', value_parser = placement())]
    placement: Vec<Placement>,
    /// Side of a hemisphere's map in texels [default: 16]
    #[arg(long, value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(8..=1024))]
    resolution: Vec<u32>,
    /// Levels of the scene's octree below its root [default: 9]
    #[arg(long, value_name = "L", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: Vec<u32>,
    /// Levels of the view octree [default: few enough that each view lies within one or two cells of the scene's
    /// octree of the point from which its map is rendered]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    view_levels: Option<u32>,
    /// Leave out the lowest level of the view octree, which groups the views of a cell by direction; the paper has no
    /// such level
    #[arg(long)]
    no_view_directions: bool,
    /// Methods to compare: scene and views traversed together, the scene for each view, each leaf of the scene's octree
    /// through the view octree, every triangle for every view [default: all but flat-scene]
    #[arg(long, value_name = "METHOD", value_delimiter = ',', value_parser = method())]
    method: Vec<Method>,
    /// Light that places the views: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG [default: the scene's first point or
    /// spot light, else a spot light above its middle]
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    light: Option<Emitter>,
    /// Also render what no view sees
    #[arg(long)]
    no_culling: bool,
    /// Occlusion culling: on (skip what is hidden behind the maps so far), off, or known (count what the finished
    /// maps would hide). The maps are the same [default: off]
    #[arg(long, value_name = "HOW", value_delimiter = ',', value_parser = occlusion())]
    occlusion: Vec<Occlusion>,
    /// Texel format: depth and node in 64 or 32 bits, or depth alone in 32 or 16 [default: range-32]
    #[arg(long, value_name = "TEXEL", value_delimiter = ',', value_parser = texel())]
    texel: Vec<Texel>,
    /// Radius of a node's disc as a share of its ball, in maps of single views and in shared maps; 0.8165 leaves no
    /// gap in a surface [default: 0.5:0.4]
    #[arg(long, value_name = "OWN:SHARED", value_delimiter = ',', value_parser = parse_discs)]
    disc: Vec<[f32; 2]>,
    /// Leave maps sparse, for lookups texel by texel
    #[arg(long)]
    no_fusion: bool,
    /// Number of measured frames, after one that is not counted; times are their median [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
    /// Longest expected time of a frame in seconds; slower rows are extrapolated [default: 60]
    #[arg(long, value_name = "SECONDS", value_parser = argus::args::positive)]
    patience: Option<f64>,
}

fn placement() -> impl TypedValueParser<Value = Placement> {
    PossibleValuesParser::new(Placement::ALL.map(Placement::name))
        .map(|name| Placement::ALL.into_iter().find(|p| p.name() == name).unwrap_or(Placement::SingleBounce))
}

fn occlusion() -> impl TypedValueParser<Value = Occlusion> {
    PossibleValuesParser::new(Occlusion::ALL.map(Occlusion::name))
        .map(|name| Occlusion::ALL.into_iter().find(|how| how.name() == name).unwrap_or(Occlusion::Off))
}

fn texel() -> impl TypedValueParser<Value = Texel> {
    PossibleValuesParser::new(Texel::ALL.map(Texel::name))
        .map(|name| Texel::ALL.into_iter().find(|texel| texel.name() == name).unwrap_or(Texel::Range))
}

fn method() -> impl TypedValueParser<Value = Method> {
    PossibleValuesParser::new(Method::ALL.map(Method::name))
        .map(|name| Method::ALL.into_iter().find(|m| m.name() == name).unwrap_or(Method::MegaViews))
}

impl MegaViews {
    pub(in crate::study) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        replace(self.views, &mut options.views);
        replace(self.placement, &mut options.placements);
        replace(self.resolution, &mut options.resolutions);
        replace(self.levels, &mut options.levels);
        replace(self.method, &mut options.methods);
        replace(self.occlusion, &mut options.occlusion);
        replace(self.texel, &mut options.texels);
        replace(self.disc, &mut options.discs);
        options.views.sort_unstable();
        options.view_levels = self.view_levels.or(options.view_levels);
        options.rounds = self.rounds.map_or(options.rounds, usize::from);
        options.light = self.light.or(options.light);
        options.patience_secs = self.patience.unwrap_or(options.patience_secs);
        options.settings.tells_directions = !self.no_view_directions;
        options.settings.culling = !self.no_culling;
        options.settings.fusion = !self.no_fusion;
        blocking(options, progress, run).await
    }
}

fn replace<T>(given: Vec<T>, default: &mut Vec<T>) {
    if !given.is_empty() {
        *default = given;
    }
}
