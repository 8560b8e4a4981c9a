//! The paths that a Rust source file names: those of its `use` items, and those that its code spells out.
//!
//! This reads text, not meaning: enough for sources that `rustfmt` has formatted and that no macro hides.

/// The names in one file. Paths are as written, segment by segment; a glob ends in `*`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Source {
    /// Modules that it declares.
    pub(crate) children: Vec<String>,
    /// Modules that it declares for tests alone.
    pub(crate) test_children: Vec<String>,
    /// Paths of private `use` items, and paths in code that begin with `crate`, `self`, `super` or a child.
    pub(crate) named: Vec<Vec<String>>,
    /// Names that it re-exports, each with its path, and whether its own code uses the name as well.
    pub(crate) exported: Vec<(String, Vec<String>, bool)>,
}

impl Source {
    /// Reads a file's text. What is compiled for tests alone is left out.
    pub(crate) fn read(text: &str) -> Self {
        let all = words(&without_comments_and_strings(text));
        let (code, tests) = without_tests(&all);
        let mut source =
            Self { children: declared(&code), test_children: declared(&tests), ..Self::default() };
        let (uses, rest) = split_uses(&code);
        for (is_public, tree) in uses {
            for (path, name) in flatten(&tree) {
                match is_public {
                    true => source.exported.push((name.clone(), path, rest.contains(&name))),
                    false => source.named.push(path),
                }
            }
        }
        source.named.extend(spelt_out(&rest, &source.children));
        source
    }
}

/// Comments, strings and characters become spaces.
fn without_comments_and_strings(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(first) = rest.chars().next() {
        let skipped = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |end| end + 2)
        } else if rest.starts_with("r#\"") {
            rest.find("\"#").map_or(rest.len(), |end| end + 2)
        } else if first == '"' {
            quoted(rest, '"')
        } else if first == '\'' && is_character(rest) {
            quoted(rest, '\'')
        } else {
            0
        };
        match skipped {
            0 => {
                out.push(first);
                rest = &rest[first.len_utf8()..];
            }
            _ => {
                out.push(' ');
                rest = &rest[skipped..];
            }
        }
    }
    out
}

/// The length of what begins with a quote and ends with the next one that is not escaped.
fn quoted(text: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            c if c == quote => return at + 1,
            _ => {}
        }
    }
    text.len()
}

/// Whether a single quote begins a character and not a lifetime.
fn is_character(text: &str) -> bool {
    let mut chars = text.chars().skip(1);
    matches!((chars.next(), chars.next()), (Some('\\'), _) | (_, Some('\'')))
}

/// Identifiers, `::`, and other characters one by one.
fn words(text: &str) -> Vec<String> {
    let (mut out, mut rest) = (Vec::new(), text.trim_start());
    let is_of_name = |c: char| c.is_alphanumeric() || c == '_';
    while let Some(first) = rest.chars().next() {
        let length = match first {
            c if is_of_name(c) => rest.find(|c| !is_of_name(c)).unwrap_or(rest.len()),
            ':' if rest.starts_with("::") => 2,
            c => c.len_utf8(),
        };
        out.push(rest[..length].to_owned());
        rest = rest[length..].trim_start();
    }
    out
}

/// Splits words into those that are always built, and those for tests: `cfg(test)`, `cfg(all(test, …))`.
fn without_tests(words: &[String]) -> (Vec<String>, Vec<String>) {
    const ATTRIBUTE: [&str; 4] = ["#", "[", "cfg", "("];
    let (mut code, mut tests, mut at) = (Vec::new(), Vec::new(), 0);
    while at < words.len() {
        let is_condition = words[at..].iter().take(ATTRIBUTE.len()).eq(ATTRIBUTE);
        let condition = words[at..].iter().take_while(|word| is_condition && *word != "]");
        let condition: Vec<_> = condition.map(String::as_str).collect();
        if matches!(condition[..], [_, _, _, _, "test", ..] | [_, _, _, _, "all", _, "test", ..]) {
            let item = at + condition.len() + 1;
            at = item + item_length(&words[item..]);
            tests.extend_from_slice(&words[item..at]);
        } else {
            code.push(words[at].clone());
            at += 1;
        }
    }
    (code, tests)
}

/// Words of the item at the front: up to its semicolon, or to the end of its block.
fn item_length(words: &[String]) -> usize {
    let mut depth = 0_usize;
    for (at, word) in words.iter().enumerate() {
        match word.as_str() {
            ";" if depth == 0 => return at + 1,
            "{" => depth += 1,
            "}" if depth <= 1 => return at + 1,
            "}" => depth -= 1,
            _ => {}
        }
    }
    words.len()
}

/// Modules that are declared and stand in files of their own.
fn declared(words: &[String]) -> Vec<String> {
    let files = words.windows(3).filter(|three| three[0] == "mod" && three[2] == ";");
    files.map(|three| three[1].clone()).collect()
}

/// The trees of all `use` items, each with whether it is public, and all other words.
fn split_uses(words: &[String]) -> (Vec<(bool, Vec<String>)>, Vec<String>) {
    let (mut uses, mut rest, mut at) = (Vec::new(), Vec::<String>::new(), 0);
    while at < words.len() {
        // `use<…>` in a type is a bound on what is captured.
        if words[at] == "use" && words.get(at + 1).is_some_and(|next| next != "<") {
            let end = at + words[at..].iter().position(|word| word == ";").unwrap_or(words.len() - at);
            let is_public = rest.last().is_some_and(|last| last == "pub" || last == ")");
            uses.push((is_public, words[at + 1..end].to_vec()));
            at = end;
        } else {
            rest.push(words[at].clone());
        }
        at += 1;
    }
    (uses, rest)
}

/// The paths of a `use` tree, each with the name that it brings in.
fn flatten(tree: &[String]) -> Vec<(Vec<String>, String)> {
    let Some(brace) = tree.iter().position(|word| word == "{") else {
        let alias = tree.iter().position(|word| word == "as");
        let path: Vec<String> =
            tree[..alias.unwrap_or(tree.len())].iter().filter(|word| *word != "::").cloned().collect();
        let name = alias.and_then(|at| tree.get(at + 1)).or(path.last()).cloned().unwrap_or_default();
        return vec![(path, name)];
    };
    let stem: Vec<String> = tree[..brace].iter().filter(|word| *word != "::").cloned().collect();
    let inner = &tree[brace + 1..tree.len() - 1];
    let mut out = Vec::new();
    for branch in branches(inner) {
        for (path, name) in flatten(branch) {
            // `a::{self}` is `a`.
            let path: Vec<String> = match path.as_slice() {
                [only] if only == "self" => stem.clone(),
                _ => stem.iter().chain(&path).cloned().collect(),
            };
            let name = if name == "self" { path.last().cloned().unwrap_or_default() } else { name };
            out.push((path, name));
        }
    }
    out
}

/// The branches between commas at the outermost level.
fn branches(words: &[String]) -> impl Iterator<Item = &[String]> {
    let mut depth = 0_i32;
    let outermost = move |word: &String| {
        depth += i32::from(word == "{") - i32::from(word == "}");
        depth == 0 && word == ","
    };
    words.split(outermost).filter(|branch| !branch.is_empty())
}

/// Paths that code spells out, from `crate`, `self`, `super` or a child on.
fn spelt_out(words: &[String], children: &[String]) -> Vec<Vec<String>> {
    let (mut out, mut at) = (Vec::new(), 0);
    while at < words.len() {
        let begins =
            ["crate", "self", "super"].contains(&words[at].as_str()) || children.contains(&words[at]);
        // `pub(in crate::a)` says who may see an item, and imports nothing.
        let is_first = at == 0 || !["::", "in"].contains(&words[at - 1].as_str());
        let mut path = vec![words[at].clone()];
        while begins && is_first && words.get(at + 1).is_some_and(|word| word == "::") {
            path.extend(words.get(at + 2).cloned());
            at += 2;
        }
        if path.len() > 1 {
            out.push(path);
        }
        at += 1;
    }
    out
}
