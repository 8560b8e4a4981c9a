//! Third-party packages: their licences and sources, and the checks of cargo-deny if it is installed.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Packages of this platform's build, as cargo resolves them.
fn packages() -> Vec<Value> {
    let cargo = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO")).args(arguments).current_dir(root()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let version = cargo(&["-vV"]);
    let host = version.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
    let metadata = cargo(&["metadata", "--format-version", "1", "--locked", "--filter-platform", host]);
    let metadata: Value = serde_json::from_str(&metadata).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

/// The licences that deny.toml allows.
fn allowed() -> BTreeSet<String> {
    let text = std::fs::read_to_string(root().join("deny.toml")).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let allowed = table["licenses"]["allow"].as_array().unwrap();
    allowed.iter().map(|licence| licence.as_str().unwrap().to_owned()).collect()
}

/// Whether an SPDX expression is satisfied by these licences; `/` is an old form of OR.
fn holds(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let (holds, rest) = either(&words, allowed);
    assert!(rest.is_empty(), "{expression} is no expression of licences");
    holds
}

fn either<'a>(words: &'a [&'a str], allowed: &BTreeSet<String>) -> (bool, &'a [&'a str]) {
    let (mut holds, mut rest) = both(words, allowed);
    while let ["OR", more @ ..] = rest {
        let (other, left) = both(more, allowed);
        (holds, rest) = (holds | other, left);
    }
    (holds, rest)
}

fn both<'a>(words: &'a [&'a str], allowed: &BTreeSet<String>) -> (bool, &'a [&'a str]) {
    let (mut holds, mut rest) = one(words, allowed);
    while let ["AND", more @ ..] = rest {
        let (other, left) = one(more, allowed);
        (holds, rest) = (holds & other, left);
    }
    (holds, rest)
}

fn one<'a>(words: &'a [&'a str], allowed: &BTreeSet<String>) -> (bool, &'a [&'a str]) {
    match words {
        ["(", inner @ ..] => {
            let (holds, rest) = either(inner, allowed);
            (holds, rest.strip_prefix(&[")"]).unwrap_or(rest))
        }
        [licence, "WITH", exception, rest @ ..] => {
            (allowed.contains(&format!("{licence} WITH {exception}")), rest)
        }
        [licence, rest @ ..] => (allowed.contains(*licence), rest),
        [] => (false, words),
    }
}

#[test]
fn licence_expressions_are_evaluated_correctly() {
    let allowed: BTreeSet<String> =
        ["MIT", "Zlib", "Apache-2.0 WITH LLVM-exception"].map(str::to_owned).into();
    for fine in ["MIT", "GPL-3.0 OR MIT", "GPL-3.0/MIT", "MIT AND Zlib", "(MIT OR GPL-3.0) AND Zlib"] {
        assert!(holds(fine, &allowed), "{fine}");
    }
    assert!(holds("Apache-2.0 WITH LLVM-exception OR GPL-3.0", &allowed));
    for wrong in
        ["GPL-3.0", "MIT AND GPL-3.0", "MIT AND (GPL-3.0 OR AGPL-3.0)", "Apache-2.0", "GPL-3.0 OR AGPL-3.0"]
    {
        assert!(!holds(wrong, &allowed), "{wrong}");
    }
}

#[test]
fn all_packages_have_permissive_licences_and_come_from_one_registry() {
    let allowed = allowed();
    let mut sources = BTreeSet::new();
    for package in packages() {
        let name = package["name"].as_str().unwrap();
        let licence = package["license"].as_str().unwrap_or_else(|| panic!("{name} has no licence"));
        assert!(holds(licence, &allowed), "{name}: {licence} is not allowed by deny.toml");
        // The workspace's own packages have no source.
        sources.extend(package["source"].as_str().map(str::to_owned));
    }
    assert!(
        sources.len() == 1 && sources.iter().all(|source| source.starts_with("registry+")),
        "{sources:?}"
    );
}

#[test]
fn cargo_deny_accepts_the_build_and_finds_forbidden_packages() {
    let deny = |arguments: &[&str]| {
        let mut command = Command::new(root().join("scripts/deny"));
        let output = command.args(arguments).env("CARGO_TERM_COLOR", "never").output().unwrap();
        let said = [output.stdout.as_slice(), &output.stderr].concat();
        (output.status.success(), String::from_utf8_lossy(&said).into_owned())
    };
    let (clean, said) = deny(&[]);
    said.lines().filter(|line| line.contains("SKIPPED")).for_each(crate::support::say);
    assert!(clean, "{said}");
    if said.contains("deny: SKIPPED") {
        return;
    }
    // One rule that half of all packages break, and one that an indispensable package breaks.
    let rules = std::fs::read_to_string(root().join("deny.toml")).unwrap();
    let stricter = rules.replace("    \"MIT\",\n", "").replace("\"openssl-sys\"", "\"tokio\"");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("deny.toml");
    std::fs::write(&file, stricter).unwrap();
    let (clean, said) = deny(&["--config", file.to_str().unwrap()]);
    assert!(!clean && said.contains("bans FAILED, licenses FAILED, sources ok"), "{said}");
}
