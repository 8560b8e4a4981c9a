//! The configuration: precedence of its sources, and errors for mistakes.

use std::path::Path;
use std::process::Output;

use crate::support::{SMALL, argus, stderr};
use serde_json::Value;

/// Runs in a folder with an environment.
fn run_in(folder: &Path, variables: &[(&str, &str)], arguments: &[&str]) -> Output {
    let mut command = argus(arguments);
    command.current_dir(folder).envs(variables.iter().copied()).output().unwrap()
}

/// One setting's entry in `argus config --json`.
fn setting(folder: &Path, variables: &[(&str, &str)], arguments: &[&str], key: &str) -> Value {
    let output = run_in(folder, variables, &[&["config", "--json"], arguments].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let config: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (section, key) = key.split_once('.').unwrap();
    config["settings"][section][key].clone()
}

#[test]
fn each_source_overrides_those_below_it_and_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let views = |variables: &[(&str, &str)], arguments: &[&str]| {
        setting(folder.path(), variables, arguments, "limits.views")
    };
    assert_eq!(views(&[], &[])["source"], "default");

    std::fs::write(folder.path().join("argus.toml"), "[limits]\nviews = 10\n").unwrap();
    let by_file = views(&[], &[]);
    assert_eq!((&by_file["value"], &by_file["source"]), (&10.into(), &"file".into()));
    assert!(by_file["from"].as_str().unwrap().ends_with("argus.toml"), "{by_file}");

    let variable = ("ARGUS_LIMITS__VIEWS", "20");
    let by_variable = views(&[variable], &[]);
    assert_eq!((&by_variable["value"], &by_variable["source"]), (&20.into(), &"environment".into()));
    assert_eq!(by_variable["from"], "ARGUS_LIMITS__VIEWS");

    let by_flag = views(&[variable], &["--set", "limits.views=30"]);
    assert_eq!((&by_flag["value"], &by_flag["source"]), (&30.into(), &"flag".into()));
    // A named file overrides the found one, and an empty name means no file.
    std::fs::write(folder.path().join("other.toml"), "[limits]\nviews = 40\n").unwrap();
    assert_eq!(views(&[("ARGUS_CONFIG", "other.toml")], &[])["value"], 40);
    assert_eq!(views(&[("ARGUS_CONFIG", "argus.toml")], &["--config", "other.toml"])["value"], 40);
    assert_eq!(views(&[], &["--config="])["source"], "default");
    // A variable that a compose file leaves empty is not set.
    assert_eq!(views(&[("ARGUS_LIMITS__VIEWS", "")], &[])["value"], 10);
}

#[test]
fn a_printed_configuration_has_the_same_effect() {
    let folder = tempfile::tempdir().unwrap();
    let printed = |arguments: &[&str]| {
        let output = run_in(folder.path(), &[], &[&["config"], arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let first = printed(&["--set", "limits.pixels_per_sec=1e6", "--set", "client.server=http://a:1"]);
    std::fs::write(folder.path().join("again.toml"), &first).unwrap();
    let again = printed(&["--config", "again.toml"]);
    let values = |text: &str| -> Vec<String> {
        text.lines().map(|line| line.split(" # ").next().unwrap().trim().to_owned()).collect()
    };
    assert_eq!(values(&first), values(&again));
    assert!(first.contains("# default") && again.contains("again.toml"), "{first}\n{again}");
}

#[test]
fn mistakes_end_with_2_and_name_source_and_key() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("typo.toml"), "[limits]\nveiws = 10\n").unwrap();
    std::fs::write(folder.path().join("kind.toml"), "[limits]\nviews = \"ten\"\n").unwrap();
    let variable = [("ARGUS_LIMITS__VEIWS", "10")];
    for (variables, arguments, words) in [
        (&[][..], &["--config", "typo.toml"][..], ["typo.toml", "limits.veiws"]),
        (&[], &["--config", "kind.toml"], ["kind.toml", "limits.views"]),
        (&[], &["--config", "missing.toml"], ["missing.toml", "cannot be read"]),
        (&variable, &[], ["ARGUS_LIMITS__VEIWS", "limits.veiws"]),
        (&[], &["--set", "limits.views=ten"], ["--set limits.views", "invalid"]),
        (&[], &["--set", "limits.views"], ["--set", "SECTION.KEY=VALUE"]),
    ] {
        // Every subcommand with settings rejects them before any work.
        for command in [&["config"][..], &["status"], &["coordinator", "--scene", SMALL]] {
            let output = run_in(folder.path(), variables, &[command, arguments].concat());
            let message = stderr(&output);
            assert_eq!(output.status.code(), Some(2), "{command:?} {arguments:?}: {message}");
            for word in words {
                assert!(message.contains(word), "{command:?} {arguments:?} does not say `{word}`: {message}");
            }
        }
    }
}

#[test]
fn clients_and_services_use_the_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[client]\nserver = \"ftp://x\"\n[coordinator]\nlisten = \"256.0.0.1:1\"\n";
    std::fs::write(folder.path().join("argus.toml"), text).unwrap();
    let status = stderr(&run_in(folder.path(), &[], &["status"]));
    assert!(status.contains("ftp://x"), "{status}");
    let by_flag = stderr(&run_in(folder.path(), &[], &["status", "--server", "gopher://y"]));
    assert!(by_flag.contains("gopher://y"), "{by_flag}");
    let coordinator = stderr(&run_in(folder.path(), &[], &["coordinator", "--scene", SMALL]));
    assert!(coordinator.contains("256.0.0.1:1"), "{coordinator}");
    let worker = stderr(&run_in(folder.path(), &[], &["worker"]));
    assert!(worker.contains("--coordinator"), "{worker}");
}
