//! No files of this folder import one another in a circle, so that each can be read after those that it is made of.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names of files that a file imports from its folder: what follows `super::` outside of comments and tests.
fn imports(text: &str) -> BTreeSet<String> {
    let code: Vec<&str> = text
        .lines()
        .take_while(|line| !line.starts_with("#[cfg(test)]"))
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect();
    let code = code.join(" ");
    code.split("super::").skip(1).flat_map(first_segments).collect()
}

/// First segments of the paths at the beginning of a text: of `a::B` it is `a`, of `{a, b::{C, D}}` they are `a` and `b`.
fn first_segments(text: &str) -> Vec<String> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let name = |text: &str| text.trim_start().chars().take_while(|c| is_name(*c)).collect::<String>();
    let Some(group) = text.strip_prefix('{') else { return vec![name(text)] };
    let (mut depth, mut names, mut begin) = (0, Vec::new(), 0);
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                names.push(name(&group[begin..]));
                begin = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

/// A way from a file back to itself.
fn circle(graph: &BTreeMap<String, BTreeSet<String>>) -> Option<Vec<String>> {
    fn walk(
        graph: &BTreeMap<String, BTreeSet<String>>,
        way: &mut Vec<String>,
        done: &mut BTreeSet<String>,
    ) -> Option<Vec<String>> {
        let last = way.last()?.clone();
        for next in graph.get(&last).into_iter().flatten() {
            if let Some(from) = way.iter().position(|name| name == next) {
                return Some(way[from..].to_vec());
            }
            if !done.contains(next) {
                way.push(next.clone());
                if let Some(circle) = walk(graph, way, done) {
                    return Some(circle);
                }
                way.pop();
            }
        }
        done.insert(last);
        None
    }
    let mut done = BTreeSet::new();
    graph.keys().find_map(|name| walk(graph, &mut vec![name.clone()], &mut done))
}

#[test]
fn no_files_of_the_worker_import_one_another_in_a_circle() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/worker");
    let mut graph = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        // The folder's own file names all of them, and none of them names it.
        if path.is_file() && !["mod", "imports"].contains(&name.as_str()) {
            graph.insert(name, imports(&std::fs::read_to_string(path).unwrap()));
        }
    }
    assert!(graph.len() > 10, "{graph:?}");
    for (name, imported) in &graph {
        let strangers: Vec<_> = imported.iter().filter(|name| !graph.contains_key(*name)).collect();
        assert!(strangers.is_empty(), "{name} imports {strangers:?} through mod.rs, which imports all");
    }
    assert_eq!(circle(&graph), None);
}

#[test]
fn a_circle_of_imports_is_found() {
    let text = "use super::a::B;\n// super::comment\nuse super::{c, d::{E, F},\n    g};\n#[cfg(test)]\nuse super::h;";
    assert_eq!(imports(text).into_iter().collect::<Vec<_>>(), ["a", "c", "d", "g"]);
    let graph = |edges: &[(&str, &str)]| {
        let mut graph: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for (from, to) in edges {
            graph.entry((*from).to_owned()).or_default().insert((*to).to_owned());
        }
        circle(&graph)
    };
    assert_eq!(graph(&[("a", "b"), ("b", "c"), ("a", "c")]), None);
    assert_eq!(graph(&[("x", "a"), ("a", "b"), ("b", "a")]).unwrap(), ["a", "b"]);
}
