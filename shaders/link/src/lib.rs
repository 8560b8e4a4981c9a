//! Links GPU programs for the crates that run them: called by their build scripts.
//!
//! A program is a file in the folder of its *user*, which is a folder of `shaders/` or `papers/NAME/shaders`. Imports are paths
//! of files: `package::shared::camera` is `shaders/shared/camera.wgsl`, and `package::virtual_lights::shared::vpl` is
//! `papers/virtual-lights/shaders/shared/vpl.wgsl`. Each program is linked with WESL and validated with naga. A Rust module carries
//! its source and what reflection says of it: entry points, workgroup sizes, bindings.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, ImageClass, Module, ShaderStage, StorageAccess, TypeInner};
use wesl::{FileResolver, ModulePath, ResolveError, Resolver};

/// Writes `programs.rs` into the build script's folder of outputs: for each user a module with its programs, and `ALL` with all of
/// them. `types` is the Rust path of the crate that declares `Program`.
///
/// # Panics
/// With the error of a program that cannot be linked or is not valid: it ends the build.
pub fn write_programs(types: &str, users: &[&str]) {
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets it"));
    let (mut rust, mut all) = (String::new(), String::new());
    let product = root().join("shaders");
    let modules = if users.iter().all(|user| product.join(user).is_dir()) { Vec::new() } else { papers() };
    for folder in [folder_of("shared"), folder_of("entry_points")].into_iter().chain(modules) {
        println!("cargo::rerun-if-changed={}", folder.display());
    }
    for user in users {
        let folder = folder_of(user);
        println!("cargo::rerun-if-changed={}", folder.display());
        let mut stems: Vec<String> = fs::read_dir(&folder)
            .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
            .filter_map(|entry| {
                let path = entry.expect("readable folder").path();
                let is_program = path.extension().is_some_and(|e| e == "wgsl");
                is_program.then(|| path.file_stem().expect("has a stem").to_string_lossy().into_owned())
            })
            .collect();
        stems.sort();
        writeln!(
            rust,
            "/// Programs of `{user}`.\n#[allow(unused_imports)]\npub mod {user} {{\n    use {types}::*;"
        )
        .expect("String");
        for stem in stems {
            program(&out, user, &stem, &mut rust);
            write!(all, "&{user}::{}, ", stem.to_uppercase()).expect("String");
        }
        rust.push_str("}\n");
    }
    writeln!(rust, "/// Every program, for tests.\npub const ALL: &[&{types}::Program] = &[{all}];")
        .expect("String");
    fs::write(out.join("programs.rs"), rust).expect("OUT_DIR is writable");
}

/// The root of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The folder whose files are modules `package::name::…`.
fn folder_of(name: &str) -> PathBuf {
    let product = root().join("shaders").join(name);
    if product.is_dir() {
        product
    } else {
        root().join("papers").join(name.replace('_', "-")).join("shaders")
    }
}

/// The folders of modules that programs of papers share.
fn papers() -> Vec<PathBuf> {
    let folders = fs::read_dir(root().join("papers")).into_iter().flatten().flatten();
    folders.map(|folder| folder.path().join("shaders/shared")).filter(|folder| folder.is_dir()).collect()
}

/// Links, validates and reflects one program, and appends its constant to `rust`.
fn program(out: &Path, user: &str, stem: &str, rust: &mut String) {
    let source = link(user, stem);
    let linked = out.join(format!("{user}_{stem}.wgsl"));
    fs::write(&linked, &source).expect("OUT_DIR is writable");
    let at = linked.display().to_string();
    let module = naga::front::wgsl::parse_str(&source).unwrap_or_else(|error| {
        panic!("{user}/{stem}.wgsl:\n{}", error.emit_to_string_with_path(&source, &at))
    });
    let info = Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).unwrap_or_else(
        |error| panic!("{user}/{stem}.wgsl:\n{}", error.emit_to_string_with_path(&source, &at)),
    );
    writeln!(rust, "    /// `{stem}.wgsl`, linked.").expect("String");
    writeln!(rust, "    pub const {}: Program = Program {{", stem.to_uppercase()).expect("String");
    writeln!(rust, "        label: \"{user}/{stem}\",\n        source: include_str!({at:?}),")
        .expect("String");
    writeln!(rust, "        entry_points: &[").expect("String");
    for (index, entry) in module.entry_points.iter().enumerate() {
        let stage = match entry.stage {
            ShaderStage::Vertex => "Vertex",
            ShaderStage::Fragment => "Fragment",
            _ => "Compute",
        };
        let uses = bindings(&module, &info, index);
        writeln!(
            rust,
            "            EntryPoint {{ name: {:?}, stage: Stage::{stage}, workgroup_size: {:?}, bindings: &[{uses}] }},",
            entry.name, entry.workgroup_size,
        )
        .expect("String");
    }
    writeln!(rust, "        ],\n    }};").expect("String");
}

/// What a program defines that is to be linked with the entry points of all searches.
const SEARCH: &str = "fn pixel(at: vec2f) -> Pixel";

/// The module's path of whichever program is being linked.
const PROGRAM: &str = "package::program";

/// Follows the imports of one program and returns plain WGSL.
fn link(user: &str, stem: &str) -> String {
    let file = folder_of(user).join(format!("{stem}.wgsl"));
    let source = fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let first = if source.contains(SEARCH) { "package::entry_points::search" } else { PROGRAM };
    let mut linker = wesl::Wesl::new(root()).set_custom_resolver(Modules {
        alias: module(PROGRAM),
        program: module(&format!("package::{user}::{stem}")),
    });
    linker.set_mangler(wesl::ManglerKind::None).use_sourcemap(true).keep_all_entrypoints();
    let linked =
        linker.compile(&module(first)).unwrap_or_else(|error| panic!("{user}/{stem}.wgsl:\n{error}"));
    linked.to_string()
}

fn module(path: &str) -> ModulePath {
    path.parse().expect("folders and stems are WGSL identifiers")
}

/// Modules are files, but for one: WESL has no generics, so that what is written once for several programs imports what
/// is theirs from [`PROGRAM`], the one that it is linked for.
struct Modules {
    alias: ModulePath,
    program: ModulePath,
}

impl Modules {
    fn file<'a>(&'a self, path: &'a ModulePath) -> &'a ModulePath {
        if *path == self.alias { &self.program } else { path }
    }

    /// The files that a module is among, and its path there.
    fn place(&self, path: &ModulePath) -> (FileResolver, ModulePath) {
        let mut path = self.file(path).clone();
        let folder = if path.components.is_empty() { root() } else { folder_of(&path.components.remove(0)) };
        (FileResolver::new(folder), path)
    }
}

impl Resolver for Modules {
    fn resolve_source<'a>(&'a self, path: &ModulePath) -> Result<Cow<'a, str>, ResolveError> {
        let (files, path) = self.place(path);
        Ok(Cow::Owned(files.resolve_source(&path)?.into_owned()))
    }

    fn display_name(&self, path: &ModulePath) -> Option<String> {
        let (files, path) = self.place(path);
        files.display_name(&path)
    }
}

/// The resources that an entry point uses, as Rust source.
fn bindings(module: &Module, info: &ModuleInfo, entry: usize) -> String {
    let uses = info.get_entry_point(entry);
    let mut list = String::new();
    for (handle, variable) in module.global_variables.iter() {
        let (Some(binding), false) = (&variable.binding, uses[handle].is_empty()) else { continue };
        let access = match (variable.space, &module.types[variable.ty].inner) {
            (AddressSpace::Storage { access }, _) => access_name(access),
            (_, TypeInner::Image { class: ImageClass::Storage { access, .. }, .. }) => access_name(*access),
            _ => "Read",
        };
        let name = variable.name.as_deref().expect("WGSL globals have names");
        write!(
            list,
            "Binding {{ group: {}, index: {}, name: {name:?}, access: Access::{access} }}, ",
            binding.group, binding.binding
        )
        .expect("String");
    }
    list
}

fn access_name(access: StorageAccess) -> &'static str {
    match (access.contains(StorageAccess::LOAD), access.contains(StorageAccess::STORE)) {
        (true, true) => "ReadWrite",
        (false, true) => "Write",
        _ => "Read",
    }
}
