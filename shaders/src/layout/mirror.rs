//! What the layout test compares with WGSL.

/// Layout of a mirror, for the test.
#[derive(Debug, Clone, Copy)]
pub struct Mirror {
    /// Name of the struct in Rust and in WGSL.
    pub name: &'static str,
    /// Size in bytes, which is the stride of an array.
    pub size: usize,
    /// Names and offsets of the fields. Fields whose name starts with `_` are padding that WGSL implies.
    pub fields: &'static [(&'static str, usize)],
}
