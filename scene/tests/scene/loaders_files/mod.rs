//! OBJ, MTL and PLY files made here: every statement of their formats, and files that are said to look alike.
#![allow(clippy::unwrap_used)] // a test ends at the first thing that goes wrong

mod mtl;
mod obj;
mod paths;
mod ply;

use std::collections::BTreeMap;
use std::io::Cursor;

use argus_scene::load::load_bundle;
use argus_scene::{Material, Scene};
use bytes::Bytes;

/// What becomes of a statement or field of a format.
enum Expect {
    /// It changes the scene in this way, without a warning.
    Shown(fn(&Scene) -> bool),
    /// It changes nothing, and one warning says so with these words.
    Warned(&'static str),
    /// It changes nothing, and needs no warning.
    NotApplicable,
}

/// Loads the first of some files of a bundle.
fn load(files: &[(&str, &[u8])]) -> Scene {
    let bundle = files.iter().map(|(name, bytes)| ((*name).to_owned(), Bytes::copy_from_slice(bytes)));
    load_bundle(files[0].0, &bundle.collect()).unwrap_or_else(|error| panic!("{error}"))
}

/// Checks what became of a statement: `with` is the scene with it, `without` that without it.
fn check(statement: &str, expect: &Expect, with: &Scene, without: &Scene) {
    assert!(without.warnings.is_empty(), "{:?}", without.warnings);
    let warnings = &with.warnings;
    match expect {
        Expect::Shown(is_shown) => {
            assert!(is_shown(with), "{statement} is not shown: {:?}", with.materials);
            assert!(warnings.is_empty(), "{statement} is shown and warned of: {warnings:?}");
        }
        Expect::Warned(words) => {
            assert!(warnings.len() == 1 && warnings[0].contains(words), "{statement}: {warnings:?}");
            assert!(same(with, without), "{statement} changes the scene");
        }
        Expect::NotApplicable => {
            assert!(warnings.is_empty(), "{statement}: {warnings:?}");
            assert!(same(with, without), "{statement} changes the scene");
        }
    }
}

/// Whether two scenes look alike: triangle by triangle they have the same corners on the same materials.
fn same(a: &Scene, b: &Scene) -> bool {
    let textures = |scene: &Scene| -> Vec<_> {
        scene.textures.iter().map(|t| (t.width, t.height, t.rgba.clone(), t.srgb, t.wrap, t.filter)).collect()
    };
    corners(a) == corners(b) && textures(a) == textures(b)
}

/// A corner's position, normal, texture coordinates and colour as bits, and the material of its triangle.
type Corner = ([u32; 12], String);

/// The corners of all triangles, triangle by triangle in a fixed order.
fn corners(scene: &Scene) -> Vec<[Corner; 3]> {
    let mut all = Vec::new();
    for mesh in &scene.meshes {
        let material = Material { name: String::new(), ..scene.materials[mesh.material as usize].clone() };
        let material = format!("{material:?}");
        all.extend(mesh.indices.chunks_exact(3).map(|triangle| {
            [0, 1, 2].map(|k| {
                let i = triangle[k] as usize;
                let position = (mesh.origin + mesh.positions[i].as_dvec3()).as_vec3();
                let uv = mesh.uvs.get(i).copied().unwrap_or_default();
                let color = mesh.colors.get(i).copied().unwrap_or_default();
                let values = [position.to_array(), mesh.normals[i].to_array()];
                let mut bits = [0.0; 12];
                bits[..6].copy_from_slice(values.as_flattened());
                bits[6..8].copy_from_slice(&uv.to_array());
                bits[8..].copy_from_slice(&color.to_array());
                // Zero has two signs.
                (bits.map(|value: f32| (value + 0.0).to_bits()), material.clone())
            })
        }));
    }
    all.sort();
    all
}

/// A PNG file.
fn png(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
    let image = image::RgbaImage::from_fn(width, height, |x, y| image::Rgba(texel(x, y)));
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A file's bundle as it travels: by name.
fn bundle(files: &[(&str, &[u8])]) -> BTreeMap<String, Bytes> {
    files.iter().map(|(name, bytes)| ((*name).to_owned(), Bytes::copy_from_slice(bytes))).collect()
}
