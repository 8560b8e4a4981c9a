//! Rules for modules: no import cycles in any crate, and the parts of the cluster's core are read in one direction.

mod graph;
mod source;

use std::path::{Path, PathBuf};

use graph::Graph;
use source::Source;

/// The folders of all crates of the workspace, relative to its root.
fn crates() -> Vec<String> {
    let manifest = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().unwrap();
    let members = manifest["workspace"]["members"].as_array().unwrap();
    members.iter().map(|member| member.as_str().unwrap()).chain(["."]).map(str::to_owned).collect()
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn core() -> PathBuf {
    root().join("cluster/src/core")
}

#[test]
fn modules_of_a_crate_have_no_import_cycles() {
    for name in crates() {
        let circles = Graph::read(&root().join(&name).join("src"), &[]).circles();
        assert!(circles.is_empty(), "modules of {name} import one another:\n{}", circles.join("\n"));
    }
}

#[test]
fn the_cores_parts_are_read_in_one_direction() {
    let core = Graph::read(&core(), &["core"]);
    for (part, others) in [("workers", vec!["samples", "views"]), ("samples", vec!["views"])] {
        for other in others {
            let imports = core.between(part, other);
            assert!(imports.is_empty(), "{part} must not import {other}:\n{}", imports.join("\n"));
        }
        for above in ["machine", "status"] {
            assert!(core.between(part, above).is_empty(), "{part} must not import {above}");
        }
    }
    assert!(!core.between("samples", "workers").is_empty() && !core.between("views", "samples").is_empty());
}

#[test]
fn the_cores_parts_have_private_fields() {
    for (file, part) in [("workers", "Workers"), ("samples", "Samples"), ("views", "Views")] {
        let text = std::fs::read_to_string(core().join(file).join("mod.rs")).unwrap();
        let begin = text.find(&format!("struct {part} {{")).unwrap();
        let fields = &text[begin..begin + text[begin..].find("\n}").unwrap()];
        assert!(!fields.contains("pub"), "a field of {part} is not private");
    }
}

/// The import cycles of a folder of these files.
fn circles_of(files: &[(&str, &str)]) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    Graph::read(folder.path(), &["here"]).circles()
}

#[test]
fn an_import_cycle_is_found_however_it_is_written() {
    let found = circles_of(&[
        ("mod.rs", "mod a; mod b; mod c;"),
        ("a.rs", "use super::b::{self, B};"),
        ("b.rs", "fn f() -> crate::here::c::C { loop {} }"),
        ("c.rs", "use std::fmt; use crate::{other::X, here::{a::A as First}};"),
    ]);
    assert_eq!(found, ["a → b → c → a"]);
}

#[test]
fn a_folder_and_its_sibling_form_a_cycle_even_through_different_files() {
    let found = circles_of(&[
        ("mod.rs", "mod part; mod b;"),
        ("part/mod.rs", "mod x; mod y;"),
        ("part/x.rs", "use crate::here::b::B;"),
        ("part/y.rs", ""),
        ("b.rs", "use super::part::y::Y;"),
    ]);
    assert_eq!(found, ["b → part → b"]);
}

#[test]
fn a_re_exported_name_is_an_import_of_its_definition() {
    let passed_on = [
        ("mod.rs", "mod a; mod b; pub(crate) use a::A; struct Own;"),
        ("a.rs", "use super::Own;"),
        ("b.rs", "use super::A;"),
    ];
    assert_eq!(circles_of(&passed_on), [""; 0]);
    let used_as_well =
        [("mod.rs", "mod a; mod b; pub(crate) use a::A; struct Own(A);"), passed_on[1], passed_on[2]];
    assert_eq!(circles_of(&used_as_well), ["mod → a → mod"]);
}

#[test]
fn imports_of_tests_form_no_cycle() {
    let found = circles_of(&[
        ("mod.rs", "mod a; mod b; #[cfg(test)] mod scenarios;"),
        ("a.rs", "#[cfg(test)] mod tests { use super::*; use crate::here::b::B; fn f() { let _ = '{'; } }"),
        ("b.rs", "// use super::c::C;\nconst TEXT: &str = \"super::c::C\"; use super::a::A;"),
        ("scenarios.rs", "use super::a::A;"),
    ]);
    assert_eq!(found, [""; 0]);
}

#[test]
fn paths_of_a_source_are_read_whole() {
    let text = "use a::{b::{C, D as E}, f::*};\npub use g::H;\nfn f<'a>(x: &'a crate::i::J) -> self::k::L { super::m::n() }\npub(in crate::o) fn p() {}";
    let path = |path: &str| path.split("::").map(str::to_owned).collect::<Vec<_>>();
    let read = Source::read(text);
    let named = ["a::b::C", "a::b::D", "a::f::*", "crate::i::J", "self::k::L", "super::m::n"];
    assert_eq!(read.named, named.map(path));
    assert_eq!(read.exported, [("H".to_owned(), path("g::H"), false)]);
}
