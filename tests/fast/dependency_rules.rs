//! Rules of the workspace: allowed dependencies between crates, and the place of shaders.
//!
//! Dependencies are those that `cargo metadata` resolves, transitively and without dev-dependencies, so that a third
//! crate cannot bypass a rule.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Names of packages, and for each the names of its direct and indirect dependencies.
struct Graph {
    reached: BTreeMap<String, BTreeSet<String>>,
    metadata: Value,
}

impl Graph {
    fn of_this_workspace() -> Self {
        // This platform's packages are all here, since this test was built; other platforms' would be downloaded.
        let version = cargo(&["-vV"]);
        let host = version.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
        let metadata = cargo(&["metadata", "--format-version", "1", "--locked", "--filter-platform", host]);
        let metadata: Value = serde_json::from_str(&metadata).unwrap();

        let name_of: BTreeMap<&str, &str> = list(&metadata["packages"])
            .map(|package| (text(&package["id"]), text(&package["name"])))
            .collect();
        // A dev-dependency is not part of the built program.
        let built_with: BTreeMap<&str, Vec<&str>> = list(&metadata["resolve"]["nodes"])
            .map(|node| {
                let deps = list(&node["deps"])
                    .filter(|dep| list(&dep["dep_kinds"]).any(|kind| kind["kind"] != "dev"))
                    .map(|dep| text(&dep["pkg"]))
                    .collect();
                (text(&node["id"]), deps)
            })
            .collect();

        let members = list(&metadata["workspace_members"]).map(text);
        let reached = members
            .map(|member| {
                let mut seen = BTreeSet::new();
                let mut waiting = vec![member];
                while let Some(id) = waiting.pop() {
                    for &dep in &built_with[id] {
                        if seen.insert(name_of[dep].to_owned()) {
                            waiting.push(dep);
                        }
                    }
                }
                (name_of[member].to_owned(), seen)
            })
            .collect();
        Self { reached, metadata }
    }

    /// The dependencies of `package`, by name.
    fn of(&self, package: &str) -> &BTreeSet<String> {
        self.reached.get(package).unwrap_or_else(|| panic!("the workspace has no package {package}"))
    }

    fn never(&self, package: &str, forbidden: &[&str]) {
        for name in forbidden {
            assert!(
                !self.of(package).contains(*name),
                "{package} must not depend on {name}, not even indirectly"
            );
        }
    }
}

/// Standard output of cargo.
fn cargo(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO")).args(arguments).current_dir(root()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn text(value: &Value) -> &str {
    value.as_str().expect("cargo metadata: a string")
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().expect("cargo metadata: a list").iter()
}

pub(crate) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Every file of the repository, without build outputs and hidden folders.
pub(crate) fn files() -> Vec<PathBuf> {
    walkdir::WalkDir::new(root())
        .into_iter()
        .filter_entry(|entry| {
            let name = entry.file_name().to_string_lossy();
            entry.depth() == 0 || !(name.starts_with('.') || name == "target" || name == "out")
        })
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.file_type().is_file())
        .map(|entry| entry.into_path().strip_prefix(root()).unwrap().to_path_buf())
        .collect()
}

pub(crate) fn is_shader(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "wgsl" || e == "wesl")
}

#[test]
fn the_two_roles_depend_on_neither_each_other_nor_the_network() {
    let graph = Graph::of_this_workspace();
    let network = ["argus-proto", "argus-cluster", "argus-client", "tonic", "prost", "tokio"];
    for (role, other) in [("argus-sampler", "argus-compositor"), ("argus-compositor", "argus-sampler")] {
        graph.never(role, &[other]);
        graph.never(role, &network);
    }
}

#[test]
fn crates_that_run_without_a_gpu_are_built_without_one() {
    let graph = Graph::of_this_workspace();
    let gpu = ["wgpu", "argus-gpu", "argus-shaders", "argus-sampler", "argus-compositor"];
    for package in
        ["argus-cluster", "argus-client", "argus-proto", "argus-scene", "argus-local", "argus-plot"]
    {
        graph.never(package, &gpu);
    }
}

#[test]
fn the_product_never_depends_on_experiments() {
    let graph = Graph::of_this_workspace();
    let experiments = ["argus-studies", "argus-lab"];
    let product = graph.reached.keys().filter(|name| !experiments.contains(&name.as_str()));
    for package in product {
        graph.never(package, &experiments);
    }
    assert!(graph.of("argus-lab").contains("argus-studies"), "does this test look in the right place?");
}

/// The crates of papers, and those of other papers that each builds on.
const PAPERS: [(&str, &[&str]); 4] = [
    ("argus-megaviews", &[]),
    ("argus-manylods", &["argus-megaviews"]),
    ("argus-virtual-lights", &["argus-megaviews"]),
    ("argus-eye-points", &[]),
];

#[test]
fn no_crate_of_the_product_depends_on_a_papers() {
    let graph = Graph::of_this_workspace();
    let papers = PAPERS.map(|(paper, _)| paper);
    let may = [&papers[..], &["argus", "argus-studies", "argus-lab"]].concat();
    for package in graph.reached.keys().filter(|package| !may.contains(&package.as_str())) {
        graph.never(package, &papers);
    }
    let wired = "src/wiring/methods.rs";
    for file in files().iter().filter(|path| path.starts_with("src") && *path != Path::new(wired)) {
        let text = std::fs::read_to_string(root().join(file)).unwrap_or_default();
        let named = papers.iter().find(|paper| text.contains(&paper.replace('-', "_")));
        assert_eq!(named, None, "{} names a paper's crate; only {wired} may", file.display());
    }
    assert!(graph.of("argus").contains("argus-megaviews"), "does this test look in the right place?");
}

#[test]
fn papers_build_on_the_device_the_shaders_the_scene_and_the_samplers_traits() {
    let graph = Graph::of_this_workspace();
    let product = ["argus-gpu", "argus-sampler", "argus-scene", "argus-shader-link", "argus-shaders"];
    for (paper, others) in PAPERS {
        let ours = graph.of(paper).iter().map(String::as_str).filter(|name| name.starts_with("argus"));
        let strange: Vec<_> = ours.filter(|name| !product.contains(name) && !others.contains(name)).collect();
        assert!(strange.is_empty(), "{paper} must not depend on {strange:?}");
    }
}

#[test]
fn dependencies_within_the_workspace_point_one_way() {
    let graph = Graph::of_this_workspace();
    let allowed: &[(&str, &[&str])] = &[
        ("argus-scene", &[]),
        ("argus-shader-link", &[]),
        ("argus-shaders", &["argus-shader-link"]),
        ("argus-proto", &["argus-scene"]),
        ("argus-gpu", &["argus-scene", "argus-shader-link", "argus-shaders"]),
        ("argus-sampler", &["argus-gpu", "argus-scene", "argus-shader-link", "argus-shaders"]),
        ("argus-compositor", &["argus-gpu", "argus-scene", "argus-shader-link", "argus-shaders"]),
        ("argus-cluster", &["argus-proto", "argus-scene"]),
        ("argus-client", &["argus-proto", "argus-scene"]),
        ("argus-plot", &[]),
        ("argus-local", &["argus-client", "argus-cluster", "argus-proto", "argus-scene"]),
    ];
    for (package, allowed) in allowed {
        let ours: Vec<&String> = graph.of(package).iter().filter(|name| name.starts_with("argus")).collect();
        let strange: Vec<_> = ours.iter().filter(|name| !allowed.contains(&name.as_str())).collect();
        assert!(strange.is_empty(), "{package} must not depend on {strange:?}");
    }
}

#[test]
fn the_thin_client_builds_only_the_vocabulary_of_the_scene_crate() {
    let graph = Graph::of_this_workspace();
    for package in list(&graph.metadata["packages"]) {
        if !["argus-client", "argus-proto", "argus-cluster"].contains(&text(&package["name"])) {
            continue;
        }
        for dep in list(&package["dependencies"]).filter(|dep| dep["kind"] != "dev") {
            if text(&dep["name"]) == "argus-scene" {
                let features: Vec<_> = list(&dep["features"]).collect();
                assert!(features.is_empty(), "{} asks argus-scene for {features:?}", package["name"]);
            }
        }
    }
}

#[test]
fn gpu_programs_are_only_in_shaders_and_in_those_of_papers() {
    let files = files();
    assert!(
        files.iter().any(|path| is_shader(path)),
        "no shader found: does this test look in the right place?"
    );
    for path in files.iter().filter(|path| !path.starts_with("shaders")) {
        let mut folders = path.iter().map(|folder| folder.to_str().unwrap_or_default());
        let is_of_paper = folders.next() == Some("papers") && folders.nth(1) == Some("shaders");
        assert!(!is_shader(path) || is_of_paper, "{} belongs in shaders/", path.display());
        if path.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(root().join(path)).unwrap();
            for stage in ["compute", "vertex", "fragment"] {
                let attribute = format!("@{stage}\n");
                let inline = format!("@{stage} ");
                assert!(
                    !text.contains(&attribute) && !text.contains(&inline),
                    "{} holds a {stage} program; it belongs in shaders/",
                    path.display()
                );
            }
        }
    }
}

#[test]
fn a_pass_and_its_program_have_the_same_stem() {
    let files = files();
    let papers = ["megaviews", "virtual-lights"].map(|paper| Path::new("papers").join(paper));
    let of_papers = papers.map(|paper| (paper.join("src/passes"), paper.join("shaders")));
    let of_product = ["sampler", "compositor", "gpu"]
        .map(|user| (Path::new(user).join("src/passes"), Path::new("shaders").join(user)));
    for (passes, programs) in of_product.into_iter().chain(of_papers) {
        for pass in files.iter().filter(|path| path.parent() == Some(&passes)) {
            let stem = pass.file_stem().unwrap().to_string_lossy();
            if stem == "mod" {
                continue;
            }
            let program = programs.join(format!("{stem}.wgsl"));
            assert!(files.contains(&program), "{} has no program at {}", pass.display(), program.display());
        }
    }
}

#[test]
fn shared_shader_files_have_no_entry_points() {
    let is_shared = |path: &&PathBuf| path.iter().any(|folder| folder == "shared") && is_shader(path);
    for path in files().iter().filter(is_shared) {
        let text = std::fs::read_to_string(root().join(path)).unwrap();
        for stage in ["@compute", "@vertex", "@fragment"] {
            assert!(!text.contains(stage), "{} has an entry point", path.display());
        }
    }
}
