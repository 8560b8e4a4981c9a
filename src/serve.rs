//! `argus serve`: a whole cluster on this machine.

use tokio_util::sync::CancellationToken;

use crate::browse::Place;
use crate::coordinator::Service;
use crate::processes;
use crate::served_scenes;
use crate::settings::{self, Settings, Sources};

/// Serves a scene from this machine: a coordinator and its worker processes.
///
/// Prints the link of a page that shows the scene in a browser (see `argus browse`). A worker that ends is restarted. All workers end with this process. Ctrl-C finishes the requests in work and exits 0.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus serve                                   the built-in scene at http://127.0.0.1:7400
  argus serve --scene model.glb --workers 4
  argus serve --scene model.glb --environment sky.hdr
  argus serve --scene hall.glb --scene town=model.glb     both; clients choose by --scene-name town
  argus serve --scene room.glb --rig cell --cell 0.5 --listen 127.0.0.1:7500")]
pub(crate) struct Args {
    /// A file (.glb, .gltf, .obj, .ply), `terrain[:TRIANGLES]`, `mirrors[:BALLS]` or `rooms[:WALL_MM]`, and `+balls:N`
    /// after it for mirroring balls [default: terrain]. Given several times, the service has several scenes, and moves workers between
    /// them; each may be NAME=S, else it has the name of its file
    #[arg(long, value_name = "S")]
    scene: Vec<String>,
    /// Number of worker processes [default: one a core, at least 2 and at most 4]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    /// Let sessions fetch their frames from the workers directly, instead of relaying them; for clients on this machine
    #[arg(long)]
    redirect: bool,
    #[command(flatten)]
    service: Service,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let mut settings = args.service.settings(&args.scene, sources)?;
    settings.coordinator.scene.get_or_insert_with(|| "terrain".to_owned());
    let scenes = served_scenes::of(&settings.coordinator)?;
    let first = scenes.first().map(|scene| scene.spec.clone()).unwrap_or_default();
    let count = args.workers.map_or_else(processes::default_count, usize::from);

    let listening = args.service.listen(&settings, Place::Usual).await?;
    let (url, shutdown) = (listening.url.clone(), listening.shutdown.clone());
    let worker = settings::Worker {
        coordinator: Some(url),
        listen: "127.0.0.1:0".to_owned(),
        // One advertised address cannot serve all workers.
        advertise: None,
        public_address: args.redirect.then(|| "advertised".to_owned()),
        ..settings.worker.clone()
    };
    let of_workers = Settings { worker, ..settings.clone() };
    // The first worker opens and prepares the scene while this process meters its light, and answers the first view. The
    // remaining workers would compete for the same cores, so they start once it has measured what views cost.
    let answers = CancellationToken::new();
    let start = processes::Start { count, settings: &of_workers, scene: &first, answers: answers.clone() };
    let kept = processes::keep(start, shutdown.clone());
    let served = async {
        let served = async {
            let ready = args.service.open(listening, scenes, &settings).await?;
            args.service.announce(&ready, count)?;
            ready.serve(answers).await
        };
        // Workers stop first, so that they can still leave in order. If the coordinator fails, they stop too.
        let served = served.await;
        shutdown.cancel();
        served
    };
    let (served, kept) = tokio::join!(served, kept);
    served.and(kept)
}
