//! Pages of light cells, as workers send them to one another.

/// Packed pages.
pub fn corpus() -> Vec<Vec<u8>> {
    argus_sampler::fuzzed_pages()
}

/// Reads a page as a sampler does, and passes it on.
pub fn page(bytes: &[u8]) -> Result<(), String> {
    argus_sampler::read_page(bytes).map_err(|error| error.to_string())
}
