//! Names of other systems and machines in scene files.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong
#![allow(clippy::type_complexity)] // rows of a table

use argus_scene::load::{bundle_files, load_bundle, load_path};
use bytes::Bytes;

use super::{bundle, load, png, same};

const QUAD: &str = "usemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n";
const PLY: &str = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float s\n\
    property float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n\
    1 1 0 1 1\n3 0 1 2\n";

/// A file of each format that refers to an image by a name: its own name, its content, and another file that it needs.
fn files(image: &str) -> [(&'static str, String, Option<(&'static str, String)>); 3] {
    let material = format!("newmtl m\nKd 1 1 1\nmap_Kd {image}\n");
    let ply = format!("ply\nformat ascii 1.0\ncomment TextureFile {image}\n{PLY}");
    let uri = image.replace('\\', "\\\\");
    let gltf = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
        "textures":[{{"source":0}}],"images":[{{"uri":"{uri}"}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
        {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}}],
        "buffers":[{{"byteLength":60,"uri":"data:application/octet-stream;base64,{}"}}]}}"#,
        "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAACAPwAAgD8AAAAAAAAAAAAAAAAAAIA/AAAAAAAAgD8AAIA/"
    );
    [
        ("a.obj", format!("mtllib a.mtl\n{QUAD}"), Some(("a.mtl", material))),
        ("a.ply", ply, None),
        ("a.gltf", gltf, None),
    ]
}

/// Names that other machines would give `maps/brick.png`, and the file that stands for each.
const NAMES: [(&str, &str); 8] = [
    (r"D:\projects\tower\brick.png", "brick.png"),
    (r"D:\projects\tower\maps\brick.png", "maps/brick.png"),
    ("/home/someone/tower/brick.png", "brick.png"),
    ("../textures/brick.png", "brick.png"),
    ("../../maps/brick.png", "maps/brick.png"),
    ("Brick.PNG", "brick.png"),
    ("MAPS/Brick.png", "maps/brick.png"),
    (r"Maps\brick.png", "maps/brick.png"),
];

#[test]
fn names_of_other_systems_stand_for_files_beside_the_scene() {
    let image = png(2, 2, |_, _| [180, 80, 60, 255]);
    for (name, place) in NAMES {
        for (i, (main, content, other)) in files(name).into_iter().enumerate() {
            let (_, twin, twin_other) = &files(place)[i];
            let together = |content: &str, other: &Option<(&'static str, String)>| {
                let mut all = vec![(main, content.as_bytes().to_vec()), (place, image.clone())];
                all.extend(other.as_ref().map(|(name, content)| (*name, content.as_bytes().to_vec())));
                all
            };
            let refer = |all: &[(&'static str, Vec<u8>)]| {
                load(&all.iter().map(|(name, bytes)| (*name, &bytes[..])).collect::<Vec<_>>())
            };
            let all = together(&content, &other);
            let scene = refer(&all);
            assert_eq!(scene.textures.len(), 1, "{main} {name}: {:?}", scene.warnings);
            assert!(same(&scene, &refer(&together(twin, twin_other))), "{main} {name}");
            let where_from = if place.contains('/') { "within the file's folder" } else { "beside the file" };
            let told = format!("{place} taken from {where_from}");
            assert!(scene.warnings.len() == 1 && scene.warnings[0].ends_with(&told), "{:?}", scene.warnings);
            travels(main, &all);
        }
    }
}

/// Checks that a bundle on disk, and what travels of it, is the scene in memory.
fn travels(main: &str, all: &[(&str, Vec<u8>)]) {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in all {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    std::fs::write(folder.path().join("unused.png"), b"no part of the scene").unwrap();
    let path = folder.path().join(main);
    let mut on_disk = load_path(&path).unwrap();
    let sent = bundle_files(&path).unwrap().into_iter();
    let sent = sent.map(|(name, path)| (name, Bytes::from(std::fs::read(path).unwrap()))).collect();
    let fetched = load_bundle(main, &sent).unwrap();
    on_disk.name.clone_from(&fetched.name);
    assert!(on_disk == fetched, "{main}: {:?} {:?}", on_disk.warnings, fetched.warnings);
}

#[test]
fn libraries_are_found_as_textures_are() {
    for line in [r"C:\work\Scene.MTL", "../scene.mtl", "SCENE.mtl", "scene.mtl none.mtl"] {
        let obj = format!("mtllib {line}\n{QUAD}");
        let scene = load(&[("a.obj", obj.as_bytes()), ("scene.mtl", b"newmtl m\nKd 1 0 0\n")]);
        assert_eq!(scene.materials[0].base_color.to_array(), [1.0, 0.0, 0.0, 1.0], "{line}");
        assert!(scene.warnings.len() <= 1, "{:?}", scene.warnings);
    }
    // Textures lie beside their library, or else beside the scene.
    let image = png(1, 1, |_, _| [0, 0, 0, 255]);
    for (place, name) in [("lib/a.png", "a.png"), ("a.png", "../a.png"), ("lib/maps/a.png", "maps/a.png")] {
        let obj = format!("mtllib lib/scene.mtl\n{QUAD}");
        let library = format!("newmtl m\nmap_Kd {name}\n");
        let files = [("a.obj", obj.as_bytes()), ("lib/scene.mtl", library.as_bytes()), (place, &image)];
        let scene = load(&files);
        assert_eq!((scene.textures.len(), scene.warnings.len()), (1, 0), "{name}: {:?}", scene.warnings);
    }
}

#[test]
fn no_name_leads_out_of_the_folder() {
    let outer = tempfile::tempdir().unwrap();
    let inner = outer.path().join("scene");
    std::fs::create_dir(&inner).unwrap();
    let image = png(1, 1, |_, _| [0, 0, 0, 255]);
    std::fs::write(outer.path().join("secret.png"), &image).unwrap();
    let secret = outer.path().join("secret.png").display().to_string();
    for name in ["../secret.png", secret.as_str(), "x/../../secret.png"] {
        for (main, content, other) in files(name) {
            std::fs::write(inner.join(main), content).unwrap();
            other.into_iter().for_each(|(name, content)| std::fs::write(inner.join(name), content).unwrap());
            let scene = load_path(inner.join(main)).unwrap();
            assert_eq!(
                (scene.textures.len(), scene.warnings.len()),
                (0, 1),
                "{main} {name}: {:?}",
                scene.warnings
            );
        }
    }
    assert!(load_bundle("a.ply", &bundle(&[("a.obj", b"")])).is_err());
}
