//! `argus replay`: makes a recorded frame again.

use std::path::PathBuf;
use std::time::Duration;

use argus_client::{Answer, RenderOptions};

use crate::args;
use crate::settings::Sources;
use crate::view::images;
use crate::view::record::Record;

/// Makes the frame of a record again, and says whether its images are equal.
///
/// Prints `equal`, or a line for each thing that differs: the digest, and with it the device, the version, the scene, the plan or
/// the specification; or why the service refuses to repeat what the record pins. Exit code 0 if the images are equal, else 1.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  argus view --out view.png --provenance view.json
  argus replay view.json --out again.png")]
pub(crate) struct Args {
    /// Record of a frame: what `argus view --provenance` wrote
    #[arg(value_name = "FILE")]
    record: PathBuf,
    #[command(flatten)]
    server: args::Server,
    /// File to write; a folder if the record has several outputs
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Give up after this many seconds
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = args::positive)]
    timeout: f64,
}

pub(crate) async fn run(args: Args, sources: &Sources) -> anyhow::Result<()> {
    let record = Record::read(&args.record)?;
    let client = args.server.connect(sources, 1).await?;
    let mut differs = record.obstacles(client.description());
    if differs.is_empty() {
        let deadline =
            Duration::try_from_secs_f64(args.timeout).unwrap_or(Duration::from_secs(u64::from(u32::MAX)));
        let options = RenderOptions { deadline, ..RenderOptions::default() };
        let view = record.view();
        match client.render(&view, &options).await {
            Ok(Answer { frame, .. }) => {
                for (output, file) in images::files(&args.out, &record.outputs()) {
                    images::write(&file, output, &frame)?;
                }
                differs = record.differences(&Record::of(&view, &client.description().scene_name, &frame));
            }
            Err(error) => match Record::refusal(&error) {
                Some(reason) => differs.push(reason),
                None => return Err(error.into()),
            },
        }
    }
    if differs.is_empty() {
        println!("equal");
        return Ok(());
    }
    differs.iter().for_each(|line| println!("differs: {line}"));
    anyhow::bail!("the service does not make the frame of the record again")
}
