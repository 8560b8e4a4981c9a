//! Alert rules: whole, well-formed, and the same for Prometheus and for its operator. That each metric exists is shown by
//! `dashboards_and_scaling_use_only_exported_metrics_and_labels` in `cluster/`.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::Path;
use std::process::Stdio;

use serde_json::Value;

use crate::manifests::{Tools, deploy, list};
use crate::support::stderr;

/// Parses queries; what is wrong with the first bad one, if there is any.
fn wrong(tools: &Tools, queries: &[&str]) -> Option<String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/queries.py");
    let mut command = tools.command("python");
    let mut child =
        command.arg(script).stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("Python starts");
    child.stdin.take().unwrap().write_all(queries.join("\n").as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    (!output.status.success()).then(|| stderr(&output))
}

#[test]
fn alert_rules_are_whole_and_their_queries_are_well_formed() {
    let Some(tools) = Tools::ready() else { return };
    let rules = tools.document(&deploy("prometheus.rules.yaml"));
    let mut names = BTreeSet::new();
    let mut queries = Vec::new();
    for rule in list(&rules["groups"]).flat_map(|group| list(&group["rules"])) {
        let text = |value: &Value| value.as_str().unwrap_or_default().trim().to_owned();
        let name = text(&rule["alert"]);
        assert!(name.starts_with("Argus") && names.insert(name.clone()), "{rule:#}");
        assert!(["critical", "warning"].contains(&&*text(&rule["labels"]["severity"])), "{name}");
        for part in ["summary", "description"] {
            assert!(text(&rule["annotations"][part]).ends_with('.'), "{name} has no {part}");
        }
        for key in rule.as_object().unwrap().keys() {
            assert!(["alert", "expr", "for", "labels", "annotations"].contains(&&**key), "{name}: {key}");
        }
        if let Some(time) = rule["for"].as_str() {
            let number = time.strip_suffix('m').and_then(|minutes| minutes.parse::<u32>().ok());
            assert!(number.is_some_and(|minutes| minutes > 0), "{name}: {time}");
        }
        queries.push(rule["expr"].as_str().unwrap().trim());
    }
    assert!(names.len() >= 10, "{names:?}");
    assert_eq!(wrong(&tools, &queries), None);
    // A query that is none is found.
    assert!(wrong(&tools, &["sum(rate(argus_views_total[5m])"]).is_some());
}

#[test]
fn the_operators_rules_are_those_of_prometheus() {
    let Some(tools) = Tools::ready() else { return };
    let file = deploy("kubernetes/keda/prometheusrule.yaml");
    let (plain, custom) = (tools.document(&deploy("prometheus.rules.yaml")), tools.document(&file));
    assert_eq!(custom["spec"], plain);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/custom_resources.py");
    let checked = tools.command("python").arg(script).arg(&file).output().unwrap();
    assert!(checked.status.success(), "{}", stderr(&checked));
    // Prometheus of both compose files reads the rules.
    for (config, compose) in
        [("prometheus.yaml", "compose.yaml"), ("prometheus.tls.yaml", "compose.tls.yaml")]
    {
        let read = tools.document(&deploy(config))["rule_files"][0].as_str().unwrap().to_owned();
        let service = &tools.document(&deploy(compose))["services"]["prometheus"];
        let mounted = format!("./prometheus.rules.yaml:{read}:ro");
        assert!(list(&service["volumes"]).any(|volume| volume == &*mounted), "{compose}: {service:#}");
    }
}
