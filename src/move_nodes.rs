//! `argus move`: moves a node of the served scene.

use argus_client::{Client, Node, NodeSetter, SetTransform, Space};
use argus_proto::convert::affine;
use glam::{DAffine3, DQuat, DVec3};

use crate::exit::bad_arguments;
use crate::settings::Sources;
use crate::{args, output};

/// Moves a node of the served scene, for all viewers.
///
/// The node gets another transform, in place of that of the file, until `--reset` or until the coordinator restarts. What hangs from
/// it moves along. The first move of a node takes longer than later ones. With TLS it needs a token of the role author. Prints the
/// revision that frames show from then on.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus move --list                                           the nodes of the scene
  argus move --node crate --translate 2,0,1                   to that place, upright and unscaled
  argus move --node 17 --world --matrix 1,0,0,2,0,1,0,0,0,0,1,0
  argus move --node crate --reset                             as in the file
  argus move --setters --json                                 who set which node last")]
pub(crate) struct Args {
    #[command(flatten)]
    server: args::Server,
    /// Name of the node, or its index if no node has that name
    #[arg(long, value_name = "NODE", required_unless_present_any = ["list", "setters"])]
    node: Option<String>,
    /// New transform: 16 numbers of a 4x4 matrix, or 12 without its last row, row by row, the translation in the last column; metres
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',', allow_hyphen_values = true, group = "to")]
    matrix: Option<Vec<f64>>,
    /// New place, metres. The node is not turned there
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        group = "to"
    )]
    translate: Option<Vec<f64>>,
    /// Scale factor at the new place
    #[arg(long, value_name = "FACTOR", default_value = "1", requires = "translate", value_parser = args::positive)]
    scale: f64,
    /// The transform leads to the world, and not to the space of the node's parent
    #[arg(long, requires = "to")]
    world: bool,
    /// Give the node the transform of the file again
    #[arg(long, group = "to")]
    reset: bool,
    /// Move nothing if this is not the newest revision: another client was first
    #[arg(long, value_name = "REVISION")]
    expect: Option<u64>,
    /// List the nodes
    #[arg(long, conflicts_with_all = ["node", "to", "setters"])]
    list: bool,
    /// List who set which node last
    #[arg(long, conflicts_with_all = ["node", "to"])]
    setters: bool,
    /// Print one JSON object: revision, stale_samples, pages_to_check, movers. With --list: nodes; with --setters: setters, each with
    /// node, revision, client
    #[arg(long)]
    json: bool,
}

/// The JSON output of a move.
#[derive(serde::Serialize)]
struct Report {
    revision: u64,
    stale_samples: u64,
    pages_to_check: u64,
    movers: u32,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let client = args.server.connect(sources, 1).await?;
    if args.list {
        let nodes = client.node_names().await?;
        if args.json {
            return output::json(&serde_json::json!({ "nodes": nodes }));
        }
        nodes.iter().enumerate().for_each(|(index, name)| println!("{index:>6}  {name}"));
        return Ok(());
    }
    if args.setters {
        let setters = client.node_setters().await?;
        if args.json {
            let row = |NodeSetter { node, revision, client }: &NodeSetter| serde_json::json!({ "node": node, "revision": revision, "client": client });
            return output::json(
                &serde_json::json!({ "setters": setters.iter().map(row).collect::<Vec<_>>() }),
            );
        }
        let line = |by: &NodeSetter| println!("{:>6}  revision {}  by {}", by.node, by.revision, by.client);
        setters.iter().for_each(line);
        return Ok(());
    }
    let space = if args.world { Space::World } else { Space::Parent };
    let node = node_of(&client, args.node.as_deref().unwrap_or_default()).await?;
    let set = SetTransform { node, matrix: matrix_of(&args)?, space };
    let moved = client.set_transforms(&[set], args.expect).await?;
    if args.json {
        let argus_client::Moved { revision, stale_samples, pages_to_check, movers } = moved;
        return output::json(&Report { revision, stale_samples, pages_to_check, movers });
    }
    println!("revision {}", moved.revision);
    Ok(())
}

/// The node of that name, or else of that index.
async fn node_of(client: &Client, text: &str) -> anyhow::Result<Node> {
    Ok(match text.parse() {
        Ok(index) if !client.node_names().await?.iter().any(|name| name == text) => Node::Index(index),
        _ => Node::Name(text.to_owned()),
    })
}

/// The new transform; `None`: that of the file.
fn matrix_of(args: &Args) -> anyhow::Result<Option<DAffine3>> {
    if let Some(numbers) = &args.matrix {
        return affine(numbers).map(Some).map_err(|reason| bad_arguments(format!("--matrix: {reason}")));
    }
    match args.translate.as_deref() {
        Some(&[x, y, z]) => {
            let (scale, at) = (DVec3::splat(args.scale), DVec3::new(x, y, z));
            Ok(Some(DAffine3::from_scale_rotation_translation(scale, DQuat::IDENTITY, at)))
        }
        Some(other) => {
            Err(bad_arguments(format!("--translate: must be three numbers X,Y,Z, not {}", other.len())))
        }
        None if args.reset => Ok(None),
        None => Err(bad_arguments("--node: say where to, by --matrix, --translate or --reset")),
    }
}
