//! Compiles `proto/**/*.proto` without protoc: protox parses, tonic-prost-build generates.

use std::path::PathBuf;
use std::{env, error, fs};

use prost::Message;

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
    // Chunks are decoded as slices of the received buffer rather than copies.
    tonic_prost_build::configure()
        .bytes(".")
        .codec_path("crate::buffers::Frugal")
        .compile_fds(descriptors)?;
    Ok(())
}
