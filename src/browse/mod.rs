//! `argus browse`: a scene in a web browser.
//!
//! A thin client that has a page in place of a file: the browser says where its camera is, this process asks the service for that
//! view, with its own token and over its own connection, and hands the image on. So the service speaks gRPC only, and what a
//! browser cannot do (TLS by the cluster's own authority, tokens from files) stays here.

mod pages;
mod query;

use std::sync::Arc;

use anyhow::Context as _;
use serde_json::json;
use tokio::net::TcpListener;
use tokio_stream::wrappers::TcpListenerStream;
use tokio_util::sync::CancellationToken;
use tonic::service::Routes;

use self::pages::Site;
use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, output, shutdown};

/// Serves a page in which a browser looks at the scene and walks through it.
///
/// Drag to look around, W A S D or the arrow keys to move, Q and E for down and up, the wheel for speed. The page shows what each
/// image cost and how much of it no sample saw, and compares it with the view from the triangles.
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

/// Connections to the service: each page has one view in flight.
const CONNECTIONS: usize = 2;

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
    tonic::transport::Server::builder()
        .accept_http1(true)
        .add_routes(Routes::from(pages::router(Arc::new(site))))
        .serve_with_incoming_shutdown(TcpListenerStream::new(listener), shutdown.cancelled())
        .await
        .context("the page can no longer be served")
}
