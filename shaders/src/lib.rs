//! Every GPU program of Argus.
//!
//! Programs are in a folder named after the crate that runs them: `shaders/sampler/x.wgsl` is the program of
//! `sampler/src/passes/x.rs`. `shaders/shared` has imported modules (`import package::shared::camera::…;`) without entry
//! points. `shaders/entry_points` has entry points that several programs share. `link/` links, validates and reflects
//! each program; crates under `papers/` have programs of their own, and link them likewise. So workgroup sizes and bindings are written once, in WGSL, and a missing program is a compile error.
//!
//! Structs of both sides are declared with [`mirror!`] in [`layout`]; a test compares them with the WGSL.

#[cfg(feature = "checks")]
pub mod checks;
pub mod layout;

include!(concat!(env!("OUT_DIR"), "/programs.rs"));

/// A linked WGSL module with its reflection.
#[derive(Debug, Clone, Copy)]
pub struct Program {
    /// `user/stem`: the program's path in the source tree.
    pub label: &'static str,
    /// Plain WGSL, imports resolved.
    pub source: &'static str,
    /// Entry points, in order of appearance.
    pub entry_points: &'static [EntryPoint],
}

impl Program {
    /// The entry point of that name.
    ///
    /// # Panics
    /// If there is none, which is a typo.
    pub fn entry_point(&self, name: &str) -> &'static EntryPoint {
        self.entry_points
            .iter()
            .find(|entry| entry.name == name)
            .unwrap_or_else(|| panic!("{} has no entry point `{name}`", self.label))
    }
}

/// An entry point.
#[derive(Debug, Clone, Copy)]
pub struct EntryPoint {
    /// Its name in WGSL.
    pub name: &'static str,
    /// Its stage.
    pub stage: Stage,
    /// Invocations of a workgroup; zeros unless [`Stage::Compute`].
    pub workgroup_size: [u32; 3],
    /// The resources that it or a function that it calls uses.
    pub bindings: &'static [Binding],
}

/// Pipeline stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// `@vertex`
    Vertex,
    /// `@fragment`
    Fragment,
    /// `@compute`
    Compute,
}

/// A module-scope variable with `@group` and `@binding`.
#[derive(Debug, Clone, Copy)]
pub struct Binding {
    /// `@group`
    pub group: u32,
    /// `@binding`
    pub index: u32,
    /// The variable's name, by which calls bind it.
    pub name: &'static str,
    /// Declared access.
    pub access: Access,
}

/// Access of a program to a resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Uniforms, sampled textures, samplers, read-only storage.
    Read,
    /// Write-only storage textures.
    Write,
    /// Read-write storage.
    ReadWrite,
}
