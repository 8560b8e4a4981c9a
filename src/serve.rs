//! `argus serve`: a whole cluster on this machine.

use crate::coordinator::Service;
use crate::{args, processes};

/// Serves a scene from this machine: a coordinator, and worker processes beside it.
///
/// Workers that end are started again; all of them end with this process. Ctrl-C finishes what is in work and
/// exits 0.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus serve                                   the built-in scene at http://127.0.0.1:7400
  argus serve --scene model.glb --workers 4
  argus serve --scene room.glb --rig cell --cell 0.5 --listen 0.0.0.0:7400")]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply) or `terrain[:TRIANGLES]`
    #[arg(long, value_name = "S", default_value = "terrain")]
    scene: String,
    /// Worker processes [default: one a core, at least 2 and at most 4]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    #[command(flatten)]
    sampling: args::Sampling,
    #[command(flatten)]
    service: Service,
}

pub(crate) async fn run(args: Args) -> anyhow::Result<()> {
    let ready = args.service.prepare(&args.scene).await?;
    let count = args.workers.map_or_else(processes::default_count, usize::from);
    args.service.announce(&ready, count)?;

    // Workers stop first, so that they can still say goodbye; a coordinator that fails takes them with it.
    let shutdown = ready.shutdown.clone();
    let url = ready.url.clone();
    let sampling = args.sampling.to_arguments();
    let (served, kept) = tokio::join!(
        async {
            let served = ready.serve().await;
            shutdown.cancel();
            served
        },
        processes::keep(count, &url, &sampling, shutdown.clone()),
    );
    served.and(kept)
}
