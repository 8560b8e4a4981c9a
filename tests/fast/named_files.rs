//! Comments and pages name files of the repository that exist: after a move, readers are sent to the new place.

use crate::dependency_rules::{files, root};

/// Names that stand for any file.
const ANY: [&str; 2] = ["x.rs", "x.wgsl"];

/// The paths with a folder that end in `.rs` or `.wgsl` in a line.
fn paths(line: &str) -> impl Iterator<Item = &str> {
    let is_of_path = |letter: char| letter.is_ascii_alphanumeric() || "_-./".contains(letter);
    let words = line.split(move |letter: char| !is_of_path(letter)).map(|word| word.trim_end_matches('.'));
    words.filter(|word| word.contains('/') && (word.ends_with(".rs") || word.ends_with(".wgsl")))
}

#[test]
fn files_that_comments_and_pages_name_exist() {
    let files = files();
    let is_there = |path: &str| {
        files.iter().any(|file| file.ends_with(path)) || ANY.iter().any(|any| path.ends_with(any))
    };
    let (mut named, mut missing) = (0, Vec::new());
    for file in &files {
        let Some(kind) = file.extension().and_then(|kind| kind.to_str()) else { continue };
        let Ok(text) = std::fs::read_to_string(root().join(file)) else { continue };
        for (number, line) in text.lines().enumerate() {
            let prose = match kind {
                "md" => line,
                "rs" | "wgsl" => line.split_once("//").map_or("", |(_, comment)| comment),
                _ => break,
            };
            for path in paths(prose).filter(|path| !path.starts_with("..")) {
                named += 1;
                if !is_there(path) {
                    missing.push(format!("{}:{}: {path}", file.display(), number + 1));
                }
            }
        }
    }
    assert!(named > 100, "does this test look in the right place?");
    assert!(missing.is_empty(), "no such files:\n{}", missing.join("\n"));
}
