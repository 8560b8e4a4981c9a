//! The import graph of a crate's modules, or of one folder's, and its cycles.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

use super::source::Source;

/// A module within the folder, by its names from the folder on; the folder's own `mod.rs` has none.
pub(crate) type Name = Vec<String>;

/// Re-exports of re-exports that are followed.
const MOST_REEXPORTS: usize = 8;

/// The modules of one folder.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    sources: BTreeMap<Name, Source>,
    /// The modules that each module imports from, other than itself.
    pub(crate) imports: BTreeMap<Name, BTreeSet<Name>>,
}

impl Graph {
    /// Reads the folder of a module, which stands at `place` in its crate: of a whole crate where `place` is empty.
    /// Modules for tests alone are left out.
    pub(crate) fn read(folder: &Path, place: &[&str]) -> Self {
        let mut graph = Self::default();
        let roots = ["mod.rs", "lib.rs", "main.rs"].map(|name| folder.join(name));
        let root = roots.iter().find(|file| file.exists());
        let root = root.unwrap_or_else(|| panic!("{} is no module's folder", folder.display()));
        graph.add(folder, root, Vec::new());
        graph.imports =
            graph.sources.keys().map(|name| (name.clone(), graph.imports_of(name, place))).collect();
        graph
    }

    fn add(&mut self, folder: &Path, file: &Path, name: Name) {
        let text = std::fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let source = Source::read(&text);
        for child in &source.children {
            let name: Name = name.iter().chain([child]).cloned().collect();
            let inner = folder.join(child);
            match inner.join("mod.rs") {
                file if file.exists() => self.add(&inner, &file, name),
                _ => self.add(&inner, &folder.join(format!("{child}.rs")), name),
            }
        }
        self.sources.insert(name, source);
    }

    fn imports_of(&self, name: &Name, place: &[&str]) -> BTreeSet<Name> {
        let source = &self.sources[name];
        let used = source.exported.iter().filter(|(.., is_used)| *is_used).map(|(_, path, _)| path);
        let paths = source.named.iter().chain(used);
        let found = paths.filter_map(|path| self.found(name, path, place, MOST_REEXPORTS));
        found.filter(|other| other != name).collect()
    }

    /// The module in which a path that `from` names is defined; `None` outside of the folder.
    fn found(&self, from: &Name, path: &[String], place: &[&str], depth: usize) -> Option<Name> {
        let mut at: Option<Name> = Some(from.clone());
        let mut rest = path;
        match rest.first()?.as_str() {
            "crate" => {
                let inside = rest.len() > place.len() && rest[1..].iter().zip(place).all(|(a, b)| a == b);
                at = inside.then(Vec::new);
                rest = rest.get(1 + place.len()..)?;
            }
            "self" => rest = &rest[1..],
            "super" => {}
            first if self.sources[from].children.iter().any(|child| child == first) => {}
            _ => return None,
        }
        while rest.first().is_some_and(|word| word == "super") {
            let mut up = at?;
            // Beyond the folder's own module nothing is known.
            at = up.pop().map(|_| up);
            rest = &rest[1..];
        }
        let mut at = at?;
        while let Some(child) = rest.first().filter(|word| self.sources[&at].children.contains(word)) {
            at.push(child.clone());
            rest = &rest[1..];
        }
        let exported = &self.sources[&at].exported;
        let exported = rest.first().and_then(|word| exported.iter().find(|(name, ..)| name == word));
        match exported.filter(|_| depth > 0) {
            Some((_, path, _)) => self.found(&at, path, place, depth - 1).or(Some(at)),
            None => Some(at),
        }
    }

    /// A circle of imports through each module that is part of one, shortest first: between files, and between the parts
    /// of each folder.
    pub(crate) fn circles(&self) -> Vec<String> {
        let mut circles = circles(&self.imports);
        for folder in self.sources.keys().filter(|name| !self.sources[*name].children.is_empty()) {
            let part = |name: &Name| {
                let is_inside = name.len() > folder.len() && name.starts_with(folder);
                is_inside.then(|| name[..=folder.len()].to_vec())
            };
            let mut parts: BTreeMap<Name, BTreeSet<Name>> = BTreeMap::new();
            for (from, to) in &self.imports {
                let Some(from) = part(from) else { continue };
                let to = to.iter().filter_map(part).filter(|to| *to != from);
                parts.entry(from.clone()).or_default().extend(to);
            }
            circles.extend(self::circles(&parts));
        }
        circles.sort_by_key(|circle| (circle.len(), circle.clone()));
        circles.dedup();
        circles
    }

    /// The imports of what stands in `part` from what stands in `other`.
    pub(crate) fn between(&self, part: &str, other: &str) -> Vec<String> {
        let stands_in = |name: &Name, part: &str| name.first().is_some_and(|first| first == part);
        let from = self.imports.iter().filter(|(name, _)| stands_in(name, part));
        let pairs = from.flat_map(|(name, imports)| imports.iter().map(move |import| (name, import)));
        let found = pairs.filter(|(_, import)| stands_in(import, other));
        found.map(|(name, import)| format!("{} → {}", shown(name), shown(import))).collect()
    }
}

fn shown(name: &Name) -> String {
    if name.is_empty() { "mod".to_owned() } else { name.join("::") }
}

/// The shortest circle through each node, each circle once.
fn circles(edges: &BTreeMap<Name, BTreeSet<Name>>) -> Vec<String> {
    let mut seen = BTreeSet::new();
    let mut out = Vec::new();
    for start in edges.keys() {
        let Some(circle) = way_back(edges, start) else { continue };
        let members: BTreeSet<Name> = circle.iter().cloned().collect();
        if seen.insert(members) {
            out.push(circle.iter().map(shown).collect::<Vec<_>>().join(" → "));
        }
    }
    out
}

/// The shortest way from a node back to itself, if there is one.
fn way_back(edges: &BTreeMap<Name, BTreeSet<Name>>, start: &Name) -> Option<Vec<Name>> {
    let mut came_from: BTreeMap<&Name, &Name> = BTreeMap::new();
    let mut waiting = VecDeque::from([start]);
    while let Some(at) = waiting.pop_front() {
        for next in edges.get(at).into_iter().flatten() {
            if next == start {
                let mut circle = vec![start.clone()];
                let mut step = at;
                while step != start {
                    circle.insert(0, step.clone());
                    step = came_from[step];
                }
                circle.insert(0, start.clone());
                return Some(circle);
            }
            if !came_from.contains_key(next) {
                came_from.insert(next, at);
                waiting.push_back(next);
            }
        }
    }
    None
}
