//! `argus browse`: a scene in a web browser.
//!
//! A thin client that serves a page. The page says over a WebSocket where its camera is; this process asks the
//! service for that view in a session, with its own token and over its own connection, and sends the image on. So the
//! service speaks gRPC only, and what a browser cannot do (TLS by the cluster's own authority, tokens from files)
//! stays here.

mod bridge;
mod guard;
mod messages;
mod pages;
mod query;

use std::future::IntoFuture;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use axum::serve::ListenerExt;
use serde_json::json;
use tokio::net::TcpListener;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

use self::pages::Site;
use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, output, shutdown};

/// Serves a page in which a browser shows the scene and walks through it.
///
/// Drag or touch to look around, W A S D or the arrow keys to move, Q and E for down and up, the wheel for the speed,
/// two fingers to move ahead or back. The page shows how each image was made, what it cost, and how many arrive a
/// second. While the camera moves and fewer than 10 images a second arrive, smaller images are asked for; a camera at
/// rest gets one image of the full size. A box renders every image from the triangles, for comparison, and so does
/// ?direct in the address. The address holds the view: copy it to show others the same view. Up to 16 pages can be
/// open at a time.
///
/// For scripts: GET /frame?eye=X,Y,Z&target=X,Y,Z&size=WxH is one JPEG, with its description as JSON in the header
/// argus-frame.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus browse                                    then open http://127.0.0.1:7480
  argus browse --server https://host-a:7400 --ca certs/ca.pem --token-file certs/view.token --holes trace")]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Where the page is
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7480")]
    listen: String,
    /// Serve the page beyond this machine, to whoever can reach it: they all see what this client may see
    #[arg(long)]
    insecure: bool,
    /// Print one JSON object once the page is there: url, scene
    #[arg(long)]
    json: bool,
    /// Also stop when standard input ends
    #[arg(long, hide = true)]
    exit_with_stdin: bool,
    #[command(flatten)]
    plan: args::Plan,
}

/// Connections to the service, which all pages share.
const CONNECTIONS: usize = 2;

/// How long pages and requests may take to end when this process is asked to stop.
const GRACE: Duration = Duration::from_secs(5);

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let listener = TcpListener::bind(&args.listen).await.with_context(|| {
        format!("cannot listen on {}: choose another address with --listen, such as 127.0.0.1:0", args.listen)
    })?;
    let address = listener.local_addr()?;
    if !address.ip().is_loopback() && !args.insecure {
        return Err(bad_arguments(format!(
            "a page at {address} would show the scene to everybody who can reach this machine: listen on 127.0.0.1, or say \
             --insecure if that is what you want"
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
        // An image waits for no acknowledgement of the one before.
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
    // WebSockets are no longer the server's: they are told to end, and get as long as requests do.
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
