//! `argus config`: the settings in effect and their sources.

use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::output;
use crate::settings::{Flags, Sources};

/// Prints the settings in effect and where each comes from.
///
/// In rising precedence, a setting comes from its default, the configuration file (--config, else ARGUS_CONFIG, else
/// argus.toml in this folder), the environment (ARGUS_LIMITS__VIEWS is views in the section limits), or a flag (its own,
/// such as --listen, or --set). The output is itself a configuration file.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  argus config > argus.toml                            a file to begin with
  ARGUS_LIMITS__VIEWS=100 argus config --json
  argus config --config site.toml --set limits.views=100")]
pub(crate) struct Args {
    /// Print one JSON object: file, settings: {section: {key: {value, source, from}}}
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    file: Option<PathBuf>,
    settings: Map<String, Value>,
}

pub(crate) fn run(args: &Args, sources: &Sources) -> anyhow::Result<()> {
    let effective = sources.load(Flags::default())?;
    if args.json {
        let mut settings = Map::new();
        for (name, value, source) in effective.values {
            let Some((section, key)) = name.split_once('.') else { continue };
            let section = settings.entry(section).or_insert_with(|| json!({}));
            let mut entry = serde_json::to_value(&source)?;
            entry["value"] = value;
            section[key] = entry;
        }
        return output::json(&Report { file: effective.file, settings });
    }
    let mut last = "";
    for (name, value, source) in &effective.values {
        let Some((section, key)) = name.split_once('.') else { continue };
        if section != last {
            println!("{}[{section}]", if last.is_empty() { "" } else { "\n" });
            last = section;
        }
        let line = match value {
            Value::Null => format!("# {key} is not set"),
            // JSON texts, numbers and booleans are valid TOML.
            value => format!("{key} = {value}"),
        };
        println!("{line:<48} # {source}");
    }
    Ok(())
}
