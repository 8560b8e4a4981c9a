//! `argus browse`: a scene in a web browser.
//!
//! A thin client that serves a page. The page sends its camera over a WebSocket. This process requests the view in a
//! session, with its own token and connection, and forwards the image. So the service speaks gRPC only. What a
//! browser cannot do (TLS with the cluster's own authority, tokens from files) stays here.

mod bridge;
mod guard;
mod messages;
mod pages;
mod query;
mod site;

use std::future::IntoFuture;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use axum::serve::ListenerExt;
use serde_json::json;
use tokio::net::TcpListener;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

use self::site::Site;
use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, output, shutdown};

/// Serves a page in which a browser shows the scene and walks through it.
///
/// Drag or touch to look around, W A S D or the arrow keys to move, Q and E for down and up, the wheel for the speed,
/// two fingers to move ahead or back. The page shows how each image was rendered, what it cost, and how many arrive a
/// second. While the camera moves and fewer than 10 images a second arrive, it requests smaller images; a camera at
/// rest gets one image of the full size. A checkbox renders every image from the triangles, for comparison, and so does
/// ?direct in the address. The address holds the view: copy it to share the view. Up to 16 pages can be open at a time.
///
/// For scripts: GET /frame?eye=X,Y,Z&target=X,Y,Z&size=WxH returns one JPEG, with its description as JSON in the header
/// argus-frame.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus browse                                    then open http://127.0.0.1:7480
  argus browse --server https://host-a:7400 --ca certs/ca.pem --token-file certs/view.token --holes trace")]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Address of the page; port 0 takes a free port
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7480")]
    listen: String,
    /// Serve the page beyond this machine: everyone who can reach it sees what this client may see
    #[arg(long)]
    insecure: bool,
    /// Print one JSON object once the page is available: url, scene
    #[arg(long)]
    json: bool,
    /// Also stop when standard input ends
    #[arg(long, hide = true)]
    exit_with_stdin: bool,
    #[command(flatten)]
    plan: args::Plan,
}

/// Connections to the service, shared by all pages.
const CONNECTIONS: usize = 2;

/// Time for pages and requests to end when this process stops.
const GRACE: Duration = Duration::from_secs(5);

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let listener = TcpListener::bind(&args.listen).await.with_context(|| {
        format!("cannot listen on {}: choose another address with --listen, such as 127.0.0.1:0", args.listen)
    })?;
    let address = listener.local_addr()?;
    if !address.ip().is_loopback() && !args.insecure {
        return Err(bad_arguments(format!(
            "the page at {address} would show the scene to everyone who can reach this machine: listen on 127.0.0.1, or allow \
            it with --insecure"
        )));
    }
    let client = args.server.connect(sources, CONNECTIONS).await?;
    let (scene, url) = (&client.description().scene_name, format!("http://{address}"));
    match args.json {
        true => output::json(&json!({ "url": url, "scene": scene }))?,
        false => println!("{scene} at {url}"),
    }
    let site = Site::new(client, args.plan.request(), address.ip().is_loopback());
    serve(site, listener, shutdown::requested(args.exit_with_stdin)).await
}

async fn serve(site: Site, listener: TcpListener, shutdown: CancellationToken) -> anyhow::Result<()> {
    let (site, stop) = (Arc::new(site), shutdown.clone());
    let listener = listener.tap_io(|stream| {
        // Send each image at once, without waiting for the acknowledgement of the previous one.
        if let Err(error) = stream.set_nodelay(true) {
            tracing::debug!(%error, "a connection keeps its delay");
        }
    });
    let server = axum::serve(listener, pages::router(site.clone()))
        .with_graceful_shutdown(async move { stop.cancelled().await });
    let mut graceful = tokio::spawn(server.into_future());
    tokio::select! {
        () = shutdown.cancelled() => {}
        served = &mut graceful => return served?.context("the page can no longer be served"),
    }
    // WebSockets no longer belong to the server: tell them to end, with the same time limit as requests.
    site.closing.cancel();
    site.open.close();
    let ended = timeout(GRACE, async {
        site.open.wait().await;
        graceful.await
    });
    match ended.await {
        Ok(served) => served?.context("the page can no longer be served"),
        Err(_) => Ok(()),
    }
}
