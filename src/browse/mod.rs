//! `argus browse`: a scene in a web browser.
//!
//! A thin client that serves a page. The page sends its camera over a WebSocket. This process requests the view in a
//! session, with its own token and connection, and forwards the image. So the service speaks gRPC only. What a
//! browser cannot do (TLS with the cluster's own authority, tokens from files) stays here. A coordinator serves the same
//! page itself ([`host`]), by the same way.
//!
//! The page redraws the last images from wherever its viewer is (`page/warp.js`), by the relief that comes with each, and
//! asks for another image when its redraws may be wrong (`page/request.js`).

mod access;
mod assets;
mod bridge;
mod guard;
mod host;
mod listen;
mod logins;
mod messages;
mod pages;
mod query;
mod simulated_link;
mod site;
mod viewers;

use std::future::IntoFuture;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use serde_json::json;
use tokio::net::TcpListener;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

use self::access::{Access, SharedClient};
pub(crate) use self::host::{Page, Place};
use self::listen::PageListener;
use self::logins::CONNECTIONS;
use self::simulated_link::LinkSettings;
use self::site::Site;
use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, credentials, output, shutdown};

/// Serves a page in which a browser shows the scene and walks through it.
///
/// Drag or touch to look around, with shift or the right button to orbit, W A S D or the arrow keys to move, Q and E for down
/// and up, the wheel for the speed, two fingers to move ahead or back. Between images, the page redraws the last two from
/// where the viewer is, at the rate of the display. It asks for an image when a redraw may show something wrong, for smaller
/// ones while the viewer moves, and for one of the full size once it rests. It shows how each image was rendered, what it
/// cost, and how many arrive a second. A checkbox renders every image from the triangles, and so does ?direct in the address;
/// a slider compares what is shown with that. The address holds the view: copy it to share the view. Of a service with several
/// scenes, ?scene=NAME in the address shows another than the first. Up to 16 pages can be
/// open at a time; they show one another's viewers if asked to.
///
/// For scripts: GET /frame?eye=X,Y,Z&target=X,Y,Z&size=WxH (and &scene=NAME) returns one JPEG, with its description as JSON in the header
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
    /// Simulate a link between the page and this process: round trip, its jitter, and rate, such as 40ms±20,20mbit
    #[arg(long, value_name = "LINK")]
    simulate_link: Option<LinkSettings>,
    #[command(flatten)]
    plan: args::Plan,
}

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
    let settings = args.server.settings(sources)?;
    let (scene, url) = (client.description().scene_name.clone(), format!("http://{address}"));
    match args.json {
        true => output::json(&json!({ "url": url, "scene": scene }))?,
        false => println!("{scene} at {url}"),
    }
    let client = SharedClient::from(client);
    let shutdown = shutdown::requested(args.exit_with_stdin);
    let kept = {
        let client = client.clone();
        credentials::keep_client(settings, CONNECTIONS, move |next| client.replace(next))
    };
    tokio::spawn(shutdown.clone().run_until_cancelled_owned(kept));
    let site = Site::new(
        Access::Shared(client),
        args.plan.request(),
        address.ip().is_loopback(),
        args.simulate_link,
    );
    serve(site, PageListener::Plain(listener), shutdown).await
}

async fn serve(site: Site, listener: PageListener, shutdown: CancellationToken) -> anyhow::Result<()> {
    let (site, stop) = (Arc::new(site), shutdown.clone());
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
