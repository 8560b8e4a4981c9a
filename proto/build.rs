//! Compiles `proto/**/*.proto` without protoc: protox parses, tonic-prost-build generates.

use std::path::PathBuf;
use std::{env, error, fs};

use prost::Message;
use prost_types::field_descriptor_proto::Type;

/// The messages of a cluster's status. Serialised, they are the output of `argus status --json`.
const STATUS: [&str; 8] = [
    "StatusResponse",
    "SceneStatus",
    "WorkerStatus",
    "Counters",
    "Refinements",
    "Market",
    "Cost",
    "LightCells",
];

/// Fields of a status whose JSON is not the field's value, and the attribute that says what it is.
const OWN_JSON: [(&str, &str); 8] = [
    ("StatusResponse.protocol_version", "skip"),
    ("StatusResponse.scene", "serialize_with = \"crate::cluster_status::scene\""),
    ("SceneStatus.scene", "serialize_with = \"crate::cluster_status::scene\""),
    ("StatusResponse.visibility", "serialize_with = \"crate::cluster_status::visibility\""),
    ("StatusResponse.light", "serialize_with = \"crate::cluster_status::light\""),
    ("StatusResponse.counters", "serialize_with = \"crate::cluster_status::or_default\""),
    ("StatusResponse.refinements", "serialize_with = \"crate::cluster_status::or_default\""),
    ("WorkerStatus.role", "serialize_with = \"crate::cluster_status::role\""),
];

fn main() -> Result<(), Box<dyn error::Error>> {
    let package = "proto/argus/v1";
    println!("cargo::rerun-if-changed={package}");
    let mut files: Vec<PathBuf> =
        fs::read_dir(package)?.map(|entry| Ok(entry?.path())).collect::<Result<_, std::io::Error>>()?;
    files.retain(|path| path.extension().is_some_and(|extension| extension == "proto"));
    // The order of a directory differs between machines; the descriptor set should not.
    files.sort();

    let descriptors = protox::compile(&files, ["proto"])?;
    // `compile_fds` does not write the set that server reflection answers from.
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("argus_descriptors.bin"), descriptors.encode_to_vec())?;
    let mut generator = tonic_prost_build::configure();
    for message in descriptors.file.iter().flat_map(|file| &file.message_type) {
        if !STATUS.contains(&message.name()) {
            continue;
        }
        let path = format!("argus.v1.{}", message.name());
        generator = generator.message_attribute(&path, "#[derive(serde::Serialize)]");
        for field in &message.field {
            if field.r#type() == Type::Double && !field.proto3_optional() {
                let number = "#[serde(serialize_with = \"crate::cluster_status::number\")]";
                generator = generator.field_attribute(format!("{path}.{}", field.name()), number);
            }
        }
    }
    for (field, json) in OWN_JSON {
        generator = generator.field_attribute(format!("argus.v1.{field}"), format!("#[serde({json})]"));
    }
    // Chunks are decoded as slices of the received buffer rather than copies.
    generator.bytes(".").codec_path("crate::buffers::Frugal").compile_fds(descriptors)?;
    Ok(())
}
