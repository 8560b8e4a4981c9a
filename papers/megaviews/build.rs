//! Links this crate's GPU programs.

fn main() {
    argus_shader_link::write_programs("argus_shaders", &["megaviews"]);
}
