//! No files of a folder import one another in a circle, so that each can be read after those that it builds on.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// What each file of a folder imports from the others. A subfolder counts as the file that it belongs to.
type Imports = BTreeMap<String, BTreeSet<String>>;

/// Folders of this crate whose files import one another in order.
const ORDERED: [&str; 1] = ["coordinator"];

/// Adds what the text of a file imports that lies `depth` modules below the folder's own.
fn add(imports: &mut Imports, of: &str, text: &str, depth: usize, files: &BTreeSet<String>) {
    let own = text.split("#[cfg(test)]").next().unwrap_or_default();
    let code: String = own.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
    let supers = "super::".repeat(depth);
    let mut found = BTreeSet::new();
    for (at, _) in code.match_indices(&supers) {
        let nested = code[..at].ends_with("super::") || code[at + supers.len()..].starts_with("super::");
        if nested {
            continue;
        }
        let rest = &code[at + supers.len()..];
        let names = match rest.strip_prefix('{') {
            Some(list) => list.split('}').next().unwrap_or_default(),
            None => rest.split([':', ';', ',', '(', ' ', '<', '>', ')']).next().unwrap_or_default(),
        };
        for name in names.split(',') {
            let name = name.trim().split("::").next().unwrap_or_default();
            // What is no file is an item of the folder's own module.
            let file = if files.contains(name) { name } else { "mod" };
            found.insert(file.to_owned());
        }
    }
    imports.entry(of.to_owned()).or_default().extend(found.into_iter().filter(|file| file != of));
}

fn imports(folder: &Path) -> Imports {
    let entries = || std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let stem = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_owned();
    let files: BTreeSet<String> = entries().map(|path| stem(&path)).filter(|stem| stem != "mod").collect();
    let mut imports = Imports::new();
    for path in entries() {
        let of = stem(&path);
        match path.is_dir() {
            true => {
                for nested in std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()) {
                    let depth = if stem(&nested) == "mod" { 1 } else { 2 };
                    if nested.is_file() && stem(&nested) != "tests" {
                        add(&mut imports, &of, &std::fs::read_to_string(&nested).unwrap(), depth, &files);
                    }
                }
            }
            // The folder's own module imports all of its files.
            false if of == "mod" => drop(imports.insert(of, files.clone())),
            false => add(&mut imports, &of, &std::fs::read_to_string(&path).unwrap(), 1, &files),
        }
    }
    imports
}

/// Files that import one another in a circle, if any do.
fn circle(imports: &Imports) -> Option<BTreeSet<String>> {
    let mut left = imports.clone();
    loop {
        let done: Vec<String> = left
            .iter()
            .filter(|(_, of)| of.iter().all(|f| !left.contains_key(f)))
            .map(|(f, _)| f.clone())
            .collect();
        if done.is_empty() {
            return (!left.is_empty()).then(|| left.into_keys().collect());
        }
        done.iter().for_each(|file| drop(left.remove(file)));
    }
}

#[test]
fn no_files_of_an_ordered_folder_import_one_another_in_a_circle() {
    for folder in ORDERED {
        let imports = imports(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(folder));
        assert!(imports.values().any(|of| !of.is_empty()), "nothing was found in {folder}");
        assert_eq!(circle(&imports), None, "in {folder}: {imports:#?}");
    }
}

#[test]
fn a_circle_is_found_and_so_is_what_depends_on_it() {
    let files: BTreeSet<String> = ["a", "b", "c"].map(str::to_owned).into();
    let of = |texts: [(&str, &str); 3]| {
        let mut imports = Imports::new();
        texts.iter().for_each(|(of, text)| add(&mut imports, of, text, 1, &files));
        circle(&imports).map(|circle| circle.into_iter().collect::<String>())
    };
    assert_eq!(
        of([("a", "use super::b::X;"), ("b", "use super::{c, c::Y};"), ("c", "// use super::a;")]),
        None
    );
    let back = "#[cfg(test)] mod tests { use super::a; }";
    assert_eq!(of([("a", "use super::b;"), ("b", "use super::c;"), ("c", back)]), None);
    assert_eq!(of([("a", "use super::b;"), ("b", "x(super::a::y())"), ("c", "")]).as_deref(), Some("ab"));
    // An item of the folder's own module, which imports all.
    let mut imports = Imports::from([("mod".to_owned(), files.clone())]);
    add(&mut imports, "a", "use super::Config;", 1, &files);
    assert!(circle(&imports).is_some());
}
