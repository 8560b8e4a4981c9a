//! The release script, with the program under test in place of one that is built for long.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::manifests::Tools;
use crate::support::{stderr, succeed};

fn release(arguments: &[&str]) -> Command {
    let mut command = Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/release"));
    command.args(arguments).stdin(Stdio::null());
    command
}

fn output(arguments: &[&str]) -> Output {
    release(arguments).output().unwrap()
}

#[test]
fn a_release_has_a_stripped_program_and_checksums_and_is_the_same_when_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str| {
        let out = folder.path().join(name);
        let arguments =
            ["--binary", env!("CARGO_BIN_EXE_argus"), "--no-wheel", "--allow-changes", "--json", "--out"];
        let mut command = release(&[&arguments[..], &[out.to_str().unwrap()]].concat());
        // No container engine: the image is skipped, and that is said.
        command.env("DOCKER_HOST", "unix:///nowhere/docker.sock");
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(stderr(&output).contains("SKIPPED: no image"), "{}", stderr(&output));
        (out, serde_json::from_slice::<Value>(&output.stdout).unwrap())
    };
    let (first, told) = make("first");
    let mut files = told["files"].as_array().unwrap().iter().filter_map(Value::as_str);
    let archive = files.find(|file| file.ends_with("-linux-gnu.tar.gz")).unwrap().to_owned();
    assert!(told["skipped"][0].as_str().unwrap().contains("docker"), "{told:#}");
    succeed(Command::new("sha256sum").args(["--check", "SHA256SUMS"]).current_dir(&first));

    succeed(Command::new("tar").arg("-xzf").arg(first.join(&archive)).arg("-C").arg(folder.path()));
    let unpacked = folder.path().join(archive.trim_end_matches(".tar.gz"));
    let build = std::fs::read_to_string(unpacked.join("BUILD")).unwrap();
    let glibc = told["glibc"].as_str().unwrap();
    assert!(glibc.starts_with("2.") && build.contains(&format!("glibc {glibc} or later")), "{build}");
    let said = succeed(Command::new(unpacked.join("argus")).arg("--version"));
    assert!(said.contains(told["version"].as_str().unwrap()), "{said}");
    let sections =
        succeed(Command::new("readelf").args(["--wide", "--sections"]).arg(unpacked.join("argus")));
    assert!(!sections.contains(".debug_info") && !sections.contains(".symtab"), "{sections}");

    let (second, _) = make("second");
    let read = |folder: &Path| std::fs::read(folder.join(&archive)).unwrap();
    assert!(read(&first) == read(&second), "the archives differ");
    // A folder with files is not overwritten.
    let again = output(&[
        "--binary",
        env!("CARGO_BIN_EXE_argus"),
        "--allow-changes",
        "--out",
        first.to_str().unwrap(),
    ]);
    assert_eq!(again.status.code(), Some(1));
    assert!(stderr(&again).contains("must be an empty folder"), "{}", stderr(&again));
}

#[test]
fn a_part_that_cannot_be_made_ends_a_release_that_requires_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let arguments = ["--dry-run", "--no-wheel", "--out", out.to_str().unwrap()];
    let mut command = release(&arguments);
    command.env("DOCKER_HOST", "unix:///nowhere/docker.sock").env("ARGUS_REQUIRE_RELEASE", "1");
    let required = command.output().unwrap();
    assert_eq!(required.status.code(), Some(1));
    assert!(stderr(&required).contains("no image"), "{}", stderr(&required));
    assert!(!out.exists(), "a dry run makes nothing");
}

#[test]
fn the_release_script_teaches_and_refuses_what_it_does_not_know() {
    let help = output(&["--help"]);
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    for word in ["--out", "--binary", "--static", "--no-image", "--dry-run", "SHA256SUMS", "Examples:"] {
        assert!(help.contains(word), "{word}: {help}");
    }
    for (wrong, word) in [
        (&["--bogus"][..], "--bogus"),
        (&["--out"], "needs a path"),
        (&["--binary", "/nowhere/argus", "--allow-changes"], "/nowhere/argus"),
    ] {
        let refused = output(wrong);
        assert!(!refused.status.success() && stderr(&refused).contains(word), "{}", stderr(&refused));
    }
    let Some(tools) = Tools::ready() else { return };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/release");
    succeed(tools.command("shellcheck").arg(script));
}
