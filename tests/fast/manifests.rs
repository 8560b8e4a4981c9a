//! Deployed files: they follow the published schemas and name only what exists. The tests need the tools of
//! scripts/manifest-tools, but no cluster and no container engine.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::support::{argus, json, run, skip, stderr, succeed, there};
use serde_json::Value;

/// Prints all documents of YAML files as one list.
const AS_JSON: &str = "import json, sys, yaml
print(json.dumps([document for path in sys.argv[1:] for document in yaml.safe_load_all(open(path))]))";

/// Fields of KEDA's Prometheus trigger, by its documentation; its schema allows any.
const PROMETHEUS_TRIGGER: [&str; 11] = [
    "serverAddress",
    "query",
    "queryParameters",
    "threshold",
    "activationThreshold",
    "namespace",
    "authModes",
    "ignoreNullValues",
    "unsafeSsl",
    "timeout",
    "customHeaders",
];

pub(crate) fn deploy(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(path)
}

/// Programs that read manifests.
pub(crate) struct Tools(PathBuf);

impl Tools {
    /// `None`, with a notice, if they cannot be installed.
    pub(crate) fn ready() -> Option<Self> {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/manifest-tools");
        let output = Command::new(script).stdin(Stdio::null()).output().unwrap();
        if output.status.success() {
            return Some(Self(String::from_utf8_lossy(&output.stdout).trim().into()));
        }
        let why =
            format!("scripts/manifest-tools installs nothing to check manifests with: {}", stderr(&output));
        skip("ARGUS_REQUIRE_KUBERNETES_VALIDATE", why.trim());
        None
    }

    pub(crate) fn command(&self, program: &str) -> Command {
        Command::new(self.0.join("bin").join(program))
    }

    /// All documents of YAML files.
    fn documents(&self, files: &[&Path]) -> Vec<Value> {
        let printed = succeed(self.command("python").args(["-c", AS_JSON]).args(files));
        serde_json::from_str(&printed).unwrap()
    }

    pub(crate) fn document(&self, file: &Path) -> Value {
        let [document] = self.documents(&[file]).try_into().unwrap();
        document
    }

    /// The rendered kustomization of a folder, as a file and as its documents.
    fn rendered(&self, folder: &Path) -> (tempfile::NamedTempFile, Vec<Value>) {
        let text = succeed(self.command("kubectl").arg("kustomize").arg(folder));
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        let documents = self.documents(&[file.path()]);
        (file, documents)
    }
}

/// An overlay with both components, built as deploy/README.md describes.
fn with_components(overlay: &str) -> (tempfile::TempDir, PathBuf) {
    let tree = tempfile::tempdir().unwrap();
    succeed(Command::new("cp").arg("-r").arg(deploy("kubernetes")).arg(tree.path()));
    let folder = tree.path().join("kubernetes/mine");
    std::fs::create_dir(&folder).unwrap();
    let readme = std::fs::read_to_string(deploy("README.md")).unwrap();
    let lines = ["    resources: ", "    components: "].map(|begin| {
        let line = readme.lines().find(|line| line.starts_with(begin)).unwrap();
        format!("{}\n", line.trim().replace("overlays/gpu", &format!("overlays/{overlay}")))
    });
    std::fs::write(folder.join("kustomization.yaml"), lines.concat()).unwrap();
    (tree, folder)
}

/// YAML files below a folder: kustomizations or all others.
fn files(folder: &Path, kustomizations: bool) -> Vec<PathBuf> {
    let files = walkdir::WalkDir::new(folder).into_iter().map(|entry| entry.unwrap().into_path());
    let wanted = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "yaml")
            && path.ends_with("kustomization.yaml") == kustomizations
    };
    files.filter(wanted).collect()
}

fn find<'d>(documents: &'d [Value], kind: &str, name: &str) -> Option<&'d Value> {
    documents.iter().find(|document| document["kind"] == kind && document["metadata"]["name"] == name)
}

/// The entries of a list; none if the value is not a list.
pub(crate) fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn strings(value: &Value) -> Vec<&str> {
    list(value).map(|entry| entry.as_str().unwrap()).collect()
}

/// The pod of a Deployment or StatefulSet, and its single container.
fn pod(document: &Value) -> (&Value, &Value) {
    let pod = &document["spec"]["template"]["spec"];
    assert_eq!(list(&pod["containers"]).count(), 1, "{pod:#}");
    (pod, &pod["containers"][0])
}

/// Names of the files that `argus certs` makes.
fn certificates() -> BTreeSet<String> {
    let folder = tempfile::tempdir().unwrap();
    let made = json(&["certs", folder.path().join("certs").to_str().unwrap(), "--json"]);
    strings(&made["files"]).into_iter().map(str::to_owned).collect()
}

/// Names of files in /certs within a text.
fn in_certs(text: &str) -> BTreeSet<String> {
    let name =
        |rest: &str| rest.split(|c: char| !c.is_ascii_alphanumeric() && c != '.').next().map(str::to_owned);
    text.split("/certs/").skip(1).filter_map(name).filter(|name| !name.is_empty()).collect()
}

/// Checks that a command line of argus has an existing subcommand and existing flags.
fn exists(command: &[&str], whence: &str) {
    let help = run(&[command[0], "--help"]);
    assert!(help.status.success(), "{whence}: argus has no {}", command[0]);
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    let known: BTreeSet<&str> = help.split(|c: char| !c.is_ascii_alphanumeric() && c != '-').collect();
    for flag in command.iter().filter(|argument| argument.starts_with("--")) {
        let flag = flag.split('=').next().unwrap();
        assert!(known.contains(flag), "{whence}: argus {} has no {flag}", command[0]);
    }
}

/// Checks that a variable of the environment with the prefix of settings is one.
fn is_a_setting(name: &str, value: &str, whence: &str) {
    if name.starts_with("ARGUS_") && name.contains("__") {
        let output = argus(&["config"]).env(name, value).output().unwrap();
        assert!(output.status.success(), "{whence}: {}", stderr(&output));
    }
}

#[test]
fn kubernetes_manifests_follow_the_published_schemas() {
    let Some(tools) = Tools::ready() else { return };
    let validate = |file: &Path| {
        let output = tools.command("kubernetes-validate").args(["--strict", "--quiet"]).arg(file).output();
        let output = output.unwrap();
        (output.status.success(), format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output)))
    };
    let mut rendered = Vec::new();
    for overlay in ["cpu", "gpu"] {
        let (_tree, both) = with_components(overlay);
        for folder in [deploy("kubernetes/overlays").join(overlay), both] {
            let (file, documents) = tools.rendered(&folder);
            let (valid, said) = validate(file.path());
            assert!(valid, "{}: {said}", folder.display());
            for document in &documents {
                assert_eq!(document["metadata"]["namespace"], "argus", "{document:#}");
            }
            rendered.extend(documents);
        }
    }
    // An unknown field is found.
    let text = std::fs::read_to_string(deploy("kubernetes/base/worker.yaml")).unwrap();
    let wrong = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(wrong.path(), text.replace("replicas:", "replica:")).unwrap();
    assert!(!validate(wrong.path()).0);

    // Every file was rendered, except those for other operators.
    for file in files(&deploy("kubernetes"), false) {
        for document in tools.documents(&[&file]) {
            let (kind, name) =
                (document["kind"].as_str().unwrap(), document["metadata"]["name"].as_str().unwrap());
            let of_operators = file.starts_with(deploy("kubernetes/keda"));
            assert!(of_operators || find(&rendered, kind, name).is_some(), "{}: {name}", file.display());
        }
    }
    // A patch without a target changes nothing without an error.
    for file in files(&deploy("kubernetes"), true) {
        for patch in list(&tools.document(&file)["patches"]) {
            let target = |key: &str| patch["target"][key].as_str().unwrap();
            let found = find(&rendered, target("kind"), target("name"));
            assert!(found.is_some(), "{}: {patch:#}", file.display());
        }
    }
}

#[test]
fn overlays_and_components_change_what_they_are_named_for() {
    let Some(tools) = Tools::ready() else { return };
    let worker = |documents: &[Value]| find(documents, "Deployment", "argus-worker").unwrap().clone();
    let roll_out = |worker: &Value| {
        let how = &worker["spec"]["strategy"]["rollingUpdate"];
        (how["maxUnavailable"].as_u64(), how["maxSurge"].as_u64())
    };

    let (_, cpu) = tools.rendered(&deploy("kubernetes/overlays/cpu"));
    let on_cpu = worker(&cpu);
    assert_eq!(roll_out(&on_cpu), (Some(0), Some(1)));
    let (pod_on_cpu, container) = pod(&on_cpu);
    assert!(list(&container["env"]).any(|variable| variable["name"] == "LP_NUM_THREADS"), "{container:#}");
    // A worker's pod has only its own secrets.
    let secret = list(&pod_on_cpu["volumes"]).find(|volume| volume["name"] == "certs").unwrap();
    let items: BTreeSet<&str> =
        list(&secret["secret"]["items"]).map(|item| item["path"].as_str().unwrap()).collect();
    assert_eq!(items, BTreeSet::from(["ca.pem", "worker.key", "worker.pem"]));

    let (_, gpu) = tools.rendered(&deploy("kubernetes/overlays/gpu"));
    let on_gpu = worker(&gpu);
    // With all GPUs in use, an additional worker would wait forever.
    assert_eq!(roll_out(&on_gpu), (Some(1), Some(0)));
    assert_eq!(pod(&on_gpu).1["resources"]["limits"]["nvidia.com/gpu"], "1");

    let (_tree, both) = with_components("cpu");
    let (_, both) = tools.rendered(&both);
    let redirecting = worker(&both);
    // A node's port is exclusive too.
    assert_eq!(roll_out(&redirecting), (Some(1), Some(0)));
    let (_, container) = pod(&redirecting);
    let port = &container["ports"][0];
    assert_eq!(port["hostPort"], port["containerPort"]);
    let public = format!("--public-address=https://$(HOST_IP):{}", port["hostPort"]);
    assert!(strings(&container["args"]).contains(&public.as_str()), "{container:#}");
    let open = &find(&both, "NetworkPolicy", "argus-worker-clients").unwrap()["spec"]["ingress"][0];
    assert_eq!((&open["ports"][0]["port"], &open["from"]), (&port["containerPort"], &Value::Null));

    let scene = both.iter().find(|document| document["kind"] == "ConfigMap").unwrap();
    let scene = scene["data"]["ARGUS_COORDINATOR__SCENE"].as_str().unwrap();
    let (pod, container) = pod(find(&both, "Deployment", "argus-coordinator").unwrap());
    let mount = list(&container["volumeMounts"]).find(|mount| mount["name"] == "scenes").unwrap();
    assert!(scene.starts_with(&format!("{}/", mount["mountPath"].as_str().unwrap())), "{scene}: {mount}");
    let volume = list(&pod["volumes"]).find(|volume| volume["name"] == "scenes").unwrap();
    let claim = volume["persistentVolumeClaim"]["claimName"].as_str().unwrap();
    assert!(find(&both, "PersistentVolumeClaim", claim).is_some(), "{claim}");
}

#[test]
fn kubernetes_manifests_name_only_arguments_settings_and_files_that_exist() {
    let Some(tools) = Tools::ready() else { return };
    let certificates = certificates();
    let (_tree, folder) = with_components("cpu");
    let (_, documents) = tools.rendered(&folder);
    let mut looked_at = 0;
    for document in documents.iter().filter(|document| document["kind"] == "Deployment") {
        let name = document["metadata"]["name"].as_str().unwrap();
        let (pod, container) = pod(document);
        let arguments = strings(&container["args"]);
        exists(&arguments, name);
        for variable in list(&container["env"]) {
            let value = variable["value"].as_str().unwrap_or_default();
            is_a_setting(variable["name"].as_str().unwrap(), value, name);
        }
        for argument in &arguments {
            for variable in argument.split("$(").skip(1).map(|rest| rest.split(')').next().unwrap()) {
                let known = list(&container["env"]).any(|known| known["name"] == variable);
                assert!(known, "{name}: {argument} is of no variable");
            }
        }
        // Files come from `argus certs`; named ones come from the volume.
        let secret = list(&pod["volumes"]).find(|volume| volume["name"] == "certs").unwrap();
        let item = |key: &'static str| {
            list(&secret["secret"]["items"]).map(move |item| item[key].as_str().unwrap().to_owned())
        };
        let (keys, paths): (BTreeSet<_>, BTreeSet<_>) = (item("key").collect(), item("path").collect());
        assert!(keys.is_subset(&certificates), "{name}: {keys:?}");
        assert!(in_certs(&arguments.join(" ")).is_subset(&paths), "{name}: {arguments:?}");
        looked_at += 1;
    }
    assert_eq!(looked_at, 2);
    for map in documents.iter().filter(|document| document["kind"] == "ConfigMap") {
        for (name, value) in map["data"].as_object().unwrap() {
            is_a_setting(name, value.as_str().unwrap(), "the ConfigMap");
        }
    }
}

#[test]
fn files_for_other_operators_follow_their_schemas_and_name_existing_objects() {
    let Some(tools) = Tools::ready() else { return };
    let check = |files: &[&Path]| {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/custom_resources.py");
        tools.command("python").arg(script).args(files).output().unwrap()
    };
    let [scaling, collecting] =
        ["scaledobject.yaml", "podmonitor.yaml"].map(|file| deploy("kubernetes/keda").join(file));
    let checked = check(&[&scaling, &collecting]);
    assert!(checked.status.success(), "{}", stderr(&checked));
    // An unknown field is found.
    let wrong = tempfile::NamedTempFile::new().unwrap();
    let text = std::fs::read_to_string(&scaling).unwrap();
    std::fs::write(wrong.path(), text.replace("pollingInterval", "pollInterval")).unwrap();
    let found = check(&[wrong.path()]);
    assert!(stderr(&found).contains("has fields that ScaledObject has not"), "{}", stderr(&found));

    let (_, base) = tools.rendered(&deploy("kubernetes/overlays/cpu"));
    let namespace = &find(&base, "Deployment", "argus-worker").unwrap()["metadata"]["namespace"];
    let (scaling, collecting) = (tools.document(&scaling), tools.document(&collecting));
    for resource in [&scaling, &collecting] {
        assert_eq!(&resource["metadata"]["namespace"], namespace);
    }
    let target = scaling["spec"]["scaleTargetRef"]["name"].as_str().unwrap();
    assert!(find(&base, "Deployment", target).is_some(), "{target}");
    let trigger = &scaling["spec"]["triggers"][0]["metadata"];
    for key in trigger.as_object().unwrap().keys() {
        assert!(PROMETHEUS_TRIGGER.contains(&key.as_str()), "a Prometheus trigger has no {key}");
    }
    assert!(trigger["serverAddress"].is_string() && trigger["query"].is_string(), "{trigger:#}");
    assert!(trigger["threshold"].as_str().unwrap().parse::<f64>().unwrap() > 0.0, "{trigger:#}");

    let monitor = &collecting["spec"];
    let endpoint = &monitor["podMetricsEndpoints"][0];
    for app in strings(&monitor["selector"]["matchExpressions"][0]["values"]) {
        let (_, container) = pod(find(&base, "Deployment", app).unwrap());
        assert!(list(&container["ports"]).any(|port| port["name"] == endpoint["port"]), "{app}");
    }
    let certificates = certificates();
    let tls = &endpoint["tlsConfig"];
    for key in [&tls["ca"]["secret"]["key"], &tls["cert"]["secret"]["key"], &tls["keySecret"]["key"]] {
        assert!(certificates.contains(key.as_str().unwrap()), "{key}");
    }
}

#[test]
fn compose_files_name_only_services_arguments_and_files_that_exist() {
    let Some(tools) = Tools::ready() else { return };
    let [plain, tls] = ["compose.yaml", "compose.tls.yaml"].map(deploy);
    let (plain, tls) = (tools.document(&plain), tools.document(&tls));
    let services = |file: &Value| file["services"].as_object().unwrap().clone();
    let base = services(&plain);
    for (name, service) in services(&plain).iter().chain(&services(&tls)) {
        assert!(base.contains_key(name) || service["image"].is_string(), "{name} is in no file whole");
        if service["command"].is_array() {
            exists(&strings(&service["command"]), name);
        }
        if let ["CMD", "argus", probe @ ..] = &strings(&service["healthcheck"]["test"])[..] {
            exists(probe, name);
        }
        // A shell script with commands, one of which is argus's.
        if let ["sh", "-c", script] = &strings(&service["entrypoint"])[..] {
            let words: Vec<&str> = script.split_whitespace().collect();
            let begin = words.iter().position(|&word| word == "argus").unwrap() + 1;
            let end = words[begin..].iter().position(|&word| word == "&&").unwrap() + begin;
            exists(&words[begin..end], name);
        }
        for volume in strings(&service["volumes"]) {
            let source = volume.split(':').next().unwrap();
            let there = match source {
                file if file.starts_with('.') => deploy(file).exists(),
                // A variable with its default, or a path in the container.
                other if other.starts_with(['$', '/']) => true,
                named => tls["volumes"].as_object().unwrap().contains_key(named),
            };
            assert!(there, "{name}: {volume}");
        }
        for needed in service["depends_on"].as_object().into_iter().flat_map(|needed| needed.keys()) {
            assert!(base.contains_key(needed) || services(&tls).contains_key(needed), "{name}: {needed}");
        }
    }
    let certificates = certificates();
    let collected = std::fs::read_to_string(deploy("prometheus.tls.yaml")).unwrap();
    let mut named = in_certs(&collected);
    named.extend(services(&tls).values().flat_map(|service| in_certs(&service.to_string())));
    assert!(named.len() >= 5 && named.is_subset(&certificates), "{named:?}");

    // Compose itself, if it is installed, merges the files.
    if there("ARGUS_REQUIRE_ENGINE", "docker-compose", &["version"]) {
        let mut command = Command::new("docker-compose");
        for file in ["compose.yaml", "compose.tls.yaml"] {
            command.arg("-f").arg(deploy(file));
        }
        let merged = succeed(command.arg("config"));
        assert!(merged.contains("--certificate") && !merged.contains("--insecure"), "{merged}");
    }
}

#[test]
fn the_image_is_built_from_every_crate_of_the_workspace() {
    let read =
        |file: &str| std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
    let workspace: toml::Table = read("Cargo.toml").parse().unwrap();
    let members = workspace["workspace"]["members"].as_array().unwrap();
    let sent = read(".dockerignore");
    for member in
        members.iter().map(|member| member.as_str().unwrap()).chain(["src", "scripts", "Cargo.lock"])
    {
        let folder = member.split('/').next().unwrap();
        assert!(sent.lines().any(|line| line == format!("!{folder}")), "{member} is not in .dockerignore");
    }
}
