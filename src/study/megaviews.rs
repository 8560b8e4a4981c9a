//! Arguments of `argus study megaviews`.

use argus_studies::megaviews::{
    Emitter, Method, Occlusion, Options, Placement, Texel, parse_discs, parse_light, run,
};
use argus_studies::{Effort as _, Report};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::ProgressBar;

use super::arguments::{Scene, blocking};

/// Maps from very many views at once: MegaViews beside ManyLoDs beside brute force, against the number of views,
/// their placement, resolution and the levels of the octree
///
/// Without --scene: terrain:50000.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus study megaviews --scene sponza.glb --views 4096,65536 --light spot:0,10,0:0,-1,0:35 --out figures
  argus study megaviews --scene sponza.glb --views 4096 --placement random --resolution 16,32,64
  argus study megaviews --scene sponza.glb --views 65536 --texel node-64,node-32,range-32,range-16")]
pub(super) struct MegaViews {
    #[command(flatten)]
    scene: Scene,
    /// Numbers of views, ascending [default: 256,1024,4096,16384,65536]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=4_194_304))]
    views: Vec<u32>,
    /// Where views are: where light meets surfaces first, there and three bounces on, or anywhere [default: all]
    #[arg(long, value_name = "HOW", value_delimiter = ',', value_parser = placement())]
    placement: Vec<Placement>,
    /// Texels of a hemisphere's side [default: 16]
    #[arg(long, value_name = "TEXELS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(8..=1024))]
    resolution: Vec<u32>,
    /// Levels of the scene's octree below its root [default: 9]
    #[arg(long, value_name = "L", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: Vec<u32>,
    /// Levels of the view octree [default: so few that views still lie within a cell or two of the scene's octree of the
    /// middle that their map is rendered from]
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(1..=10))]
    view_levels: Option<u32>,
    /// Leave out the level of the view octree, below the others, that tells views of a cell apart by the way they look; as
    /// the paper has it
    #[arg(long)]
    no_view_directions: bool,
    /// What is compared: scene and views traversed together, the scene for each view, each leaf of the scene's octree down
    /// that over the views, every triangle for every view [default: all but flat-scene]
    #[arg(long, value_name = "METHOD", value_delimiter = ',', value_parser = method())]
    method: Vec<Method>,
    /// Where light comes from: point:X,Y,Z or spot:X,Y,Z:DX,DY,DZ:HALF_DEG [default: the scene's first light that has
    /// a place, else a spot from above its middle]
    #[arg(long, value_name = "LIGHT", value_parser = parse_light, allow_hyphen_values = true)]
    light: Option<Emitter>,
    /// Render what no view sees too
    #[arg(long)]
    no_culling: bool,
    /// Leave out what is hidden behind what maps already hold (on), or not (off); maps are the same. What could be left
    /// out if the finished maps were known beforehand (known) [default: off]
    #[arg(long, value_name = "HOW", value_delimiter = ',', value_parser = occlusion())]
    occlusion: Vec<Occlusion>,
    /// What a texel holds: depth and node in 64 bits or in 32, or depth alone in 32 or 16 [default: range-32]
    #[arg(long, value_name = "TEXEL", value_delimiter = ',', value_parser = texel())]
    texel: Vec<Texel>,
    /// How much of its ball a node covers, in maps of single views and where several share it; 0.8165 leaves no gap in a
    /// surface [default: 0.5:0.4]
    #[arg(long, value_name = "OWN:SHARED", value_delimiter = ',', value_parser = parse_discs)]
    disc: Vec<[f32; 2]>,
    /// Leave maps sparse, to be looked up texel by texel
    #[arg(long)]
    no_fusion: bool,
    /// Frames that times are the median of, after one that is not counted [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: Option<u16>,
    /// Seconds that a frame may take; what would take longer is extrapolated [default: 60]
    #[arg(long, value_name = "SECONDS", value_parser = crate::args::positive)]
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
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
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
        options.knobs.tells_directions = !self.no_view_directions;
        options.knobs.culling = !self.no_culling;
        options.knobs.fusion = !self.no_fusion;
        blocking(options, progress, run).await
    }
}

fn replace<T>(given: Vec<T>, default: &mut Vec<T>) {
    if !given.is_empty() {
        *default = given;
    }
}
