//! Arguments of `argus-lab study warp`.

use argus::args;
use argus_scene::Search;
use argus_studies::warp::{Options, run};
use argus_studies::{Effort as _, Report};
use indicatif::ProgressBar;

use super::arguments::{Scene, Size, blocking};

/// Measures accuracy against time: every search × its steps × samples × supersampling, over a walk that reveals hidden
/// surfaces
///
/// Without --scene: terrain:500000; without --size: 200x150.
#[derive(clap::Args)]
pub(super) struct Warp {
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    size: Size,
    /// Number of views in the walk [default: 12]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    views: Option<u16>,
    /// Searches to measure; leaves out the rows with other sample resolutions
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = args::search())]
    searches: Option<Vec<Search>>,
    #[command(flatten)]
    rig: args::Rig,
}

impl Warp {
    pub(super) async fn run(self, quick: bool, progress: &ProgressBar) -> anyhow::Result<Report> {
        let mut options = Options::of(quick);
        self.scene.replace(&mut options.scene);
        self.size.replace(&mut options.size);
        options.views = self.views.map_or(options.views, usize::from);
        options.rig = self.rig.knobs();
        if let Some(samples) = self.rig.samples {
            options.samples = vec![samples as usize];
        }
        if let Some(searches) = self.searches {
            options.searches = searches;
            options.resolutions.clear();
        }
        blocking(options, progress, run).await
    }
}
