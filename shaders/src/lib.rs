//! Every GPU program of Argus.
//!
//! Programs lie beside this crate in a folder named after the crate that runs them
//! (`shaders/sampler/x.wgsl` is the program of `sampler/src/passes/x.rs`); `shaders/shared` holds what
//! programs import (`import package::shared::camera::…;`) and has no entry points; `shaders/entry_points` holds those that
//! several programs have. `build.rs` links and validates each at build time and reflects it, so that a workgroup size or a
//! binding is typed once, in WGSL, and a program that does not exist does not compile.
//!
//! Structs that both sides know are declared with [`mirror!`] in [`layout`] and held to the WGSL by test.

pub mod layout;

include!(concat!(env!("OUT_DIR"), "/programs.rs"));

/// A linked WGSL module and what reflection says of it.
#[derive(Debug, Clone, Copy)]
pub struct Program {
    /// `user/stem`, the program's place in the source tree.
    pub label: &'static str,
    /// Plain WGSL, imports resolved.
    pub source: &'static str,
    /// In order of appearance.
    pub entry_points: &'static [EntryPoint],
}

impl Program {
    /// The entry point of that name.
    ///
    /// # Panics
    /// If there is none: a typo, found by the first test that makes the pipeline.
    pub fn entry_point(&self, name: &str) -> &'static EntryPoint {
        self.entry_points
            .iter()
            .find(|entry| entry.name == name)
            .unwrap_or_else(|| panic!("{} has no entry point `{name}`", self.label))
    }
}

/// A function that a pipeline starts with.
#[derive(Debug, Clone, Copy)]
pub struct EntryPoint {
    /// Its name in WGSL.
    pub name: &'static str,
    /// Which stage it is for.
    pub stage: Stage,
    /// Invocations of a workgroup; zeros unless [`Stage::Compute`].
    pub workgroup_size: [u32; 3],
    /// The resources that it, or a function it calls, uses.
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
    /// The variable's name, by which pass calls bind it.
    pub name: &'static str,
    /// Declared access.
    pub access: Access,
}

/// What a program may do with a resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Uniforms, sampled textures, samplers, read-only storage.
    Read,
    /// Write-only storage textures.
    Write,
    /// Read-write storage.
    ReadWrite,
}
