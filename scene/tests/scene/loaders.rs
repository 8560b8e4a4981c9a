//! Every file of the scene collection in `ARGUS_SCENES`. Real scenes have their known triangles and bounds; deliberately
//! broken ones give a scene or an error of one line.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use argus_scene::load::{bundle_files, load_bundle, load_path};
use argus_scene::{AlphaMode, Effect, Material, RigKind, Scene};
use bytes::Bytes;
use glam::DVec3;

/// The collection's folder; `None`, with a notice, if it is not set and not required.
fn collection() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("ARGUS_SCENES") {
        return Some(PathBuf::from(folder));
    }
    let required = std::env::var_os("ARGUS_REQUIRE_SCENES").is_some_and(|value| value == "1");
    assert!(!required, "ARGUS_REQUIRE_SCENES=1, but ARGUS_SCENES is not set");
    // Print macros of a passing test are not shown.
    let _ = writeln!(std::io::stderr(), "SKIPPED: ARGUS_SCENES is not set");
    None
}

fn load(path: &Path) -> Scene {
    let scene = load_path(path).unwrap_or_else(|error| panic!("{error}"));
    check(&scene);
    scene
}

/// Checks the invariants of a scene from any file.
fn check(scene: &Scene) {
    let name = &scene.name;
    assert!(!scene.materials.is_empty(), "{name}");
    for mesh in &scene.meshes {
        let count = mesh.positions.len();
        assert_eq!(mesh.normals.len(), count, "{name}");
        for length in [mesh.tangents.len(), mesh.uvs.len(), mesh.colors.len()] {
            assert!(length == 0 || length == count, "{name}");
        }
        assert!(mesh.indices.len() % 3 == 0 && mesh.triangles() > 0, "{name}");
        assert!(mesh.indices.iter().all(|&i| (i as usize) < count), "{name}");
        assert!(mesh.positions.iter().all(|p| p.is_finite()), "{name}");
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{name}");
        assert!(mesh.tangents.iter().all(|t| (t.truncate().length() - 1.0).abs() < 1e-3), "{name}");
        assert!((mesh.material as usize) < scene.materials.len(), "{name}");
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len(), "{name}");
        assert!(instance.world_from_mesh.is_finite(), "{name}");
        assert!(instance.node.is_none_or(|node| (node as usize) < scene.nodes.len()), "{name}");
    }
    for (i, node) in scene.nodes.iter().enumerate() {
        assert!(node.parent.is_none_or(|parent| (parent as usize) < i), "{name}");
    }
    for material in &scene.materials {
        let Material {
            base_color_texture, metallic_roughness_texture, normal_texture, emissive_texture, ..
        } = material;
        let slots = [base_color_texture, metallic_roughness_texture, normal_texture, emissive_texture];
        assert!(slots.into_iter().flatten().all(|t| (t.texture as usize) < scene.textures.len()), "{name}");
    }
    for texture in &scene.textures {
        assert_eq!(texture.rgba.len(), texture.width as usize * texture.height as usize * 4, "{name}");
    }
    for camera in &scene.cameras {
        camera.camera.validate().expect("a valid camera");
    }
    assert!(scene.warnings.iter().all(|line| !line.contains('\n')), "{name}");
}

/// A scene file, its triangles, its bounds, how exactly those are known, and its rig.
type ExpectedScene = (&'static str, usize, [f64; 3], [f64; 3], f64, RigKind);

/// Counts and bounds from the collection's own page, each taken by two other programs.
const REAL: [ExpectedScene; 26] = {
    use RigKind::{Cell, TileCorners};
    const BUNNY: ([f64; 3], [f64; 3]) = ([-0.095, 0.033, -0.062], [0.061, 0.187, 0.059]);
    const BOX: ([f64; 3], [f64; 3]) = ([-1.02, 0.0, -1.04], [1.0, 1.99, 0.99]);
    const LOW: ([f64; 3], [f64; 3]) = ([-1.02, 0.0, -1.04], [1.0, 1.59, 0.99]);
    [
        ("sponza/sponza.glb", 262_267, [-19.21, -1.26, -11.83], [18.0, 14.29, 11.05], 0.01, Cell),
        (
            "salle_de_bain/salle_de_bain.glb",
            653_694,
            [-13.75, -6.41, -11.64],
            [12.64, 16.11, 17.62],
            0.01,
            Cell,
        ),
        ("bunny/bun_zipper.ply", 69_451, BUNNY.0, BUNNY.1, 0.001, Cell),
        ("bunny/bun_zipper_res2.ply", 16_301, BUNNY.0, BUNNY.1, 0.003, Cell),
        ("bunny/bun_zipper_res3.ply", 3_851, BUNNY.0, BUNNY.1, 0.004, Cell),
        ("bunny/bun_zipper_res4.ply", 948, BUNNY.0, BUNNY.1, 0.006, Cell),
        ("cornell_box/CornellBox-Original.obj", 36, BOX.0, BOX.1, 1e-6, Cell),
        ("cornell_box/CornellBox-Mirror.obj", 36, BOX.0, BOX.1, 1e-6, Cell),
        ("cornell_box/CornellBox-Empty-CO.obj", 12, BOX.0, BOX.1, 1e-6, Cell),
        ("cornell_box/CornellBox-Empty-RG.obj", 12, BOX.0, BOX.1, 1e-6, Cell),
        ("cornell_box/CornellBox-Empty-White.obj", 12, BOX.0, BOX.1, 1e-6, Cell),
        ("cornell_box/CornellBox-Empty-Squashed.obj", 12, LOW.0, LOW.1, 1e-6, Cell),
        ("cornell_box/CornellBox-Glossy.obj", 1_112, LOW.0, LOW.1, 2e-4, Cell),
        ("cornell_box/CornellBox-Glossy-Floor.obj", 1_112, LOW.0, LOW.1, 2e-4, Cell),
        ("cornell_box/CornellBox-Sphere.obj", 2_188, LOW.0, LOW.1, 1e-6, Cell),
        ("cornell_box/CornellBox-Water.obj", 7_088, LOW.0, LOW.1, 5e-3, Cell),
        ("cornell_box/water.obj", 4_900, [-1.0, 0.0, -1.02], [1.0041, 0.2524, 0.989], 1e-4, Cell),
        ("terrain/oaks_on_terrain.glb", 1_362_152, [-256.0, 0.0, -256.0], [262.1, 83.1, 256.0], 0.1, Cell),
        (
            "terrain/pines_on_terrain.glb",
            218_368,
            [-256.0, 0.0, -319.0],
            [256.0, 47.5, 319.0],
            0.5,
            TileCorners,
        ),
        (
            "terrain/jacksboro_fault_terrain.glb",
            275_772,
            [-14971.0, 236.0, -15909.0],
            [14971.0, 1076.0, 15909.0],
            0.5,
            TileCorners,
        ),
        ("pine/scrubPine.obj", 527, [-374.0, 3.0, -432.0], [341.0, 934.0, 270.0], 0.6, Cell),
        (
            "gltf_folder_spaceship/craft_speederD.gltf",
            322,
            [-1.4, 0.0, -1.113],
            [1.4, 0.9, 1.113],
            1e-3,
            Cell,
        ),
        // Their files state the bounds of each accessor; the room's lines are not drawn.
        (
            "files_people_have/hotel_room/scene.glb",
            99_029,
            [6791.5, -66.1975, -11129.2],
            [13274.5, 2130.74, -1134.32],
            0.01,
            Cell,
        ),
        (
            "files_people_have/chess_board/chess-board.glb",
            178_848,
            [-157.491, -1.3465, -136.4902],
            [179.57, 42.2437, 136.4902],
            0.1,
            Cell,
        ),
        (
            "files_people_have/barn_lamp/AnisotropyBarnLamp.gltf",
            10_203,
            [-0.104_62, -0.198_30, -2.5e-6],
            [0.086_20, 0.056_95, 0.226_54],
            1e-4,
            Cell,
        ),
        ("nasty_obj/no_material.obj", 36, [0.0; 3], [556.0, 548.8, 559.2], 1e-3, Cell),
    ]
};

#[test]
fn real_scenes_have_the_triangles_and_bounds_that_are_known_of_them() {
    let Some(folder) = collection() else { return };
    for (name, triangles, min, max, tolerance, rig) in REAL {
        let scene = load(&folder.join(name));
        assert_eq!(scene.triangles(), triangles, "{name}");
        let bounds = scene.bounds();
        let off = (bounds.min - DVec3::from(min)).abs().max((bounds.max - DVec3::from(max)).abs());
        assert!(off.max_element() <= tolerance, "{name}: {bounds:?}");
        assert_eq!(scene.rig, rig, "{name}");
    }
}

#[test]
fn sponza_keeps_its_materials_cut_outs_and_normal_maps() {
    let Some(folder) = collection() else { return };
    let scene = load(&folder.join("sponza/sponza.glb"));
    assert_eq!((scene.instances.len(), scene.materials.len(), scene.textures.len()), (393, 25, 64));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let effects = scene.effects();
    assert!(effects.contains(&Effect::AlphaCutout) && effects.contains(&Effect::NormalMap));
    // The file has no tangents: the loader computes them for meshes with normal maps.
    for mesh in &scene.meshes {
        let mapped = scene.materials[mesh.material as usize].normal_texture.is_some();
        assert_eq!(!mesh.tangents.is_empty(), mapped, "{}", mesh.name);
    }
}

#[test]
fn the_bathroom_keeps_its_camera_metals_glass_and_emitter() {
    let Some(folder) = collection() else { return };
    let scene = load(&folder.join("salle_de_bain/salle_de_bain.glb"));
    let count = |test: fn(&Material) -> bool| scene.materials.iter().filter(|m| test(m)).count();
    assert_eq!(count(|m| m.metallic == 1.0), 3);
    assert_eq!(count(|m| m.transmission > 0.0), 5);
    assert_eq!(count(|m| m.emissive.max_element() > 1.0), 1);
    assert_eq!(scene.cameras.len(), 1);
    assert!(scene.bounds().contains(scene.cameras[0].camera.eye));
}

#[test]
fn instances_stay_instances() {
    let Some(folder) = collection() else { return };
    let unique = |scene: &Scene| scene.meshes.iter().map(|mesh| mesh.triangles()).sum::<usize>();
    let oaks = load(&folder.join("terrain/oaks_on_terrain.glb"));
    assert_eq!((unique(&oaks), oaks.meshes.len(), oaks.instances.len()), (30_758, 3, 121));
    let pines = load(&folder.join("terrain/pines_on_terrain.glb"));
    assert_eq!(unique(&pines), 33_295);
}

#[test]
fn cornell_boxes_keep_their_colours_and_emitters() {
    let Some(folder) = collection() else { return };
    let scene = load(&folder.join("cornell_box/CornellBox-Original.obj"));
    let material = |name: &str| scene.materials.iter().find(|m| m.name == name).unwrap();
    assert_eq!(material("leftWall").base_color.to_array(), [0.63, 0.065, 0.05, 1.0]);
    assert!(!material("leftWall").is_glossy());
    assert!(scene.effects().contains(&Effect::Emission));
    let glossy = load(&folder.join("cornell_box/CornellBox-Glossy.obj"));
    assert!(glossy.warnings.iter().any(|line| line.contains("\"light\"")), "{:?}", glossy.warnings);
    let mirror = load(&folder.join("cornell_box/CornellBox-Mirror.obj"));
    assert!(mirror.effects().contains(&Effect::Specular));
}

#[test]
fn the_pines_are_cut_out_by_their_texture() {
    let Some(folder) = collection() else { return };
    let scene = load(&folder.join("pine/scrubPine.obj"));
    assert_eq!(scene.textures.len(), 2);
    assert!(scene.materials.iter().any(|m| m.alpha == AlphaMode::Mask(0.5)));
}

#[test]
fn the_spaceships_doubly_listed_node_is_drawn_once() {
    let Some(folder) = collection() else { return };
    let scene = load(&folder.join("gltf_folder_spaceship/craft_speederD.gltf"));
    assert_eq!((scene.triangles(), scene.nodes.len()), (322, 1));
}

#[test]
fn a_bundle_in_memory_is_the_scene_on_disk() {
    let Some(folder) = collection() else { return };
    for name in
        ["gltf_folder_spaceship/craft_speederD.gltf", "pine/scrubPine.obj", "bunny/bun_zipper_res4.ply"]
    {
        let path = folder.join(name);
        let files: BTreeMap<String, Bytes> = bundle_files(&path)
            .unwrap()
            .into_iter()
            .map(|(name, path)| (name, Bytes::from(std::fs::read(path).unwrap())))
            .collect();
        let main = path.file_name().unwrap().to_str().unwrap();
        let (on_disk, mut fetched) = (load(&path), load_bundle(main, &files).unwrap());
        fetched.name.clone_from(&on_disk.name);
        assert!(on_disk == fetched, "{name}");
        // A changed byte anywhere gives another hash.
        for changed in files.keys() {
            let mut files = files.clone();
            let mut bytes = files[changed].to_vec();
            bytes.push(b'\n');
            files.insert(changed.clone(), Bytes::from(bytes));
            if let Ok(scene) = load_bundle(main, &files) {
                assert_ne!(scene.hash, on_disk.hash, "{name}: {changed}");
            }
        }
    }
}

fn files_below(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(files_below(&path, extensions));
        } else if path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Loads a broken file: a valid scene, or an error of one line that names the file.
fn answer(path: &Path) -> Option<Scene> {
    match load_path(path) {
        Ok(scene) => {
            check(&scene);
            Some(scene)
        }
        Err(error) => {
            let line = error.to_string();
            assert!(line.starts_with(&path.display().to_string()) && line.lines().count() == 1, "{line}");
            assert!(!error.reason.is_empty() && line.len() < 1000, "{line}");
            None
        }
    }
}

#[test]
fn every_broken_gltf_gives_a_scene_or_an_error_and_correct_ones_a_scene() {
    let Some(folder) = collection() else { return };
    let files = files_below(&folder.join("nasty_gltf"), &["gltf", "glb"]);
    assert_eq!(files.len(), 243);
    // Valid, but their meshes' bytes are in no file: "provided by other means".
    let absent = ["root/named_objects.gltf", "root/unused_objects.gltf"];
    let (mut scenes, mut animated) = (0, 0);
    for path in files {
        let scene = answer(&path);
        scenes += usize::from(scene.is_some());
        if let Some(scene) = &scene {
            animated += usize::from(!scene.animations.is_empty());
            play(scene);
        }
        let report = PathBuf::from(format!("{}.report.json", path.display()));
        let Ok(report) = std::fs::read_to_string(report) else { continue };
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        let correct = report["issues"]["numErrors"] == 0;
        if correct && !absent.iter().any(|name| path.ends_with(name)) {
            assert!(scene.is_some(), "{}: {}", path.display(), load_path(&path).unwrap_err());
        }
    }
    assert!(scenes > 180, "only {scenes} of 243 gave a scene");
    assert!(animated > 0, "none of 243 has an animation that can be read");
}

/// Checks that placed meshes stay within the bounds at every time, and return after a loop.
fn play(scene: &Scene) {
    let bounds = scene.bounds();
    for time_secs in [0.0, 0.1, 1.0, 1e9, -1.0, f64::NAN] {
        for instance in &scene.at(time_secs).instances {
            let mesh = &scene.meshes[instance.mesh as usize];
            for position in &mesh.positions {
                let point = instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3());
                let near = point.clamp(bounds.min, bounds.max) - point;
                let slack = 1e-9 * (1.0 + point.abs().max_element());
                assert!(!point.is_finite() || near.abs().max_element() <= slack, "{point} at {time_secs} s");
            }
        }
    }
    if let [animation] = &scene.animations[..] {
        assert_eq!(scene.at(animation.length_secs()), scene.at(0.0));
    }
}

#[test]
fn every_broken_obj_gives_a_scene() {
    let Some(folder) = collection() else { return };
    let files = files_below(&folder.join("nasty_obj"), &["obj"]);
    assert_eq!(files.len(), 47);
    for path in files {
        assert!(answer(&path).is_some(), "{}", path.display());
    }
    let load = |name: &str| load(&folder.join("nasty_obj").join(name));
    assert_eq!(load("test-nan.obj").triangles(), 34);
    assert_eq!(load("issue-140-zero-face-idx.obj").triangles(), 1);
    assert_eq!(load("invalid-relative-vertex-index.obj").triangles(), 0);
    assert_eq!(load("cube.obj").triangles(), 12);
    assert!(!load("cube-vertexcol.obj").meshes[0].colors.is_empty());
    let spaces = load("mtl filename with whitespace issue46.obj");
    assert!(spaces.warnings.is_empty(), "{:?}", spaces.warnings);
}

#[test]
fn files_that_are_not_scenes_are_refused() {
    let Some(folder) = collection() else { return };
    for name in ["SCENES.md", "sponza", "nasty_obj/cube.mtl", "none.glb"] {
        assert!(answer(&folder.join(name)).is_none(), "{name}");
    }
}
