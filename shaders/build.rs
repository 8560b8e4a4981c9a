//! Links the programs of the product's crates.

fn main() {
    argus_shader_link::write_programs("crate", &["gpu", "sampler", "compositor"]);
}
