//! Every statement of OBJ.

use argus_scene::Scene;
use glam::{DVec3, Vec3, Vec4};

use super::{Expect, check, load, same};
use Expect::{NotApplicable, Shown, Warned};

const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nf 1 2 3\n";

fn with(statements: &str) -> Scene {
    let materials = b"newmtl red\nKd 1 0 0\n";
    load(&[("a.obj", format!("{QUAD}{statements}\n").as_bytes()), ("a b.mtl", materials), ("c.mtl", b"")])
}

/// The statements of the format's definition, version 3.0, superseded ones included.
const STATEMENTS: &[(&str, Expect)] = &[
    ("v 5 5 5\nf 1 2 -1", Shown(|scene| scene.bounds().max == DVec3::splat(5.0))),
    ("v 5 5 5 1\nf 1 2 -1", Shown(|scene| scene.meshes[0].colors.is_empty())),
    (
        "v 0 0 9 1 0 0\nf 1 2 -1",
        Shown(|scene| scene.meshes[0].colors.contains(&Vec4::new(1.0, 0.0, 0.0, 1.0))),
    ),
    ("vt 0.25 0.5\nf 1/1 2/2 3/-1", Shown(|scene| scene.meshes[0].uvs.contains(&glam::Vec2::new(0.25, 0.5)))),
    ("vn 1 0 0\nf 1//2 2//2 4//2", Shown(|scene| scene.meshes[0].normals.contains(&Vec3::X))),
    ("f 1 3 4", Shown(|scene| scene.triangles() == 2)),
    ("fo 1 3 4", Shown(|scene| scene.triangles() == 2)),
    ("s 1\nf 1 2 3\nf 1 3 4", Shown(|scene| scene.meshes[0].positions.len() == 3 + 4)),
    (
        "mtllib a b.mtl\nusemtl red\nf 1 3 4",
        Shown(|scene| scene.materials[1].base_color == Vec4::new(1., 0., 0., 1.)),
    ),
    ("mtllib c.mtl", NotApplicable),
    ("mtllib none.mtl", Warned("material library \"none.mtl\" cannot be read")),
    ("p 1 2", Warned("p (points)")),
    ("l 1 2", Warned("l (lines)")),
    ("curv 0 1 1 2 3", Warned("curv")),
    ("surf 0 1 0 1 1 2 3 4", Warned("surf")),
    ("cstype bezier", NotApplicable),
    ("deg 3 3", NotApplicable),
    ("bmat u 1 0 0 1", NotApplicable),
    ("step 1 1", NotApplicable),
    ("vp 0.5", NotApplicable),
    ("curv2 1 2", NotApplicable),
    ("parm u 0 1", NotApplicable),
    ("trim 0 1 1", NotApplicable),
    ("hole 0 1 1", NotApplicable),
    ("scrv 0 1 1", NotApplicable),
    ("sp 1", NotApplicable),
    ("end", NotApplicable),
    ("con 1 0 1 1 2 0 1 1", NotApplicable),
    ("ctech cparm 1", NotApplicable),
    ("stech cparma 1 1", NotApplicable),
    ("g door", NotApplicable),
    ("o house", NotApplicable),
    ("mg 1 0.5", NotApplicable),
    ("lod 1", NotApplicable),
    ("bevel on", Warned("bevel")),
    ("bevel off", NotApplicable),
    ("c_interp on", Warned("c_interp")),
    ("c_interp off", NotApplicable),
    ("d_interp on", Warned("d_interp")),
    ("d_interp off", NotApplicable),
    ("maplib a.map", NotApplicable),
    ("usemap wood", Warned("usemap")),
    ("usemap off", NotApplicable),
    ("shadow_obj a.obj", Warned("shadow_obj")),
    ("trace_obj a.obj", Warned("trace_obj")),
    ("call a.obj", Warned("call")),
    ("csh ls", Warned("csh")),
    ("bsp 1 2 3", Warned("bsp")),
    ("bzp 1 2 3", Warned("bzp")),
    ("cdc 1 2 3", Warned("cdc")),
    ("cdp 1 2 3", Warned("cdp")),
    ("res 3 3", NotApplicable),
    ("# usemap wood", NotApplicable),
    ("telepathy 3", Warned("telepathy")),
];

#[test]
fn every_statement_of_obj_is_shown_or_warned_of_or_changes_nothing() {
    let without = with("");
    for (statement, expect) in STATEMENTS {
        check(statement, expect, &with(statement), &without);
    }
}

#[test]
fn colours_of_vertices_are_display_values_in_either_range() {
    let colored = |colors: [&str; 3]| {
        let vertices: String = (0..3).map(|i| format!("v {} {} 0 {}\n", i % 2, i / 2, colors[i])).collect();
        load(&[("a.obj", format!("{vertices}f 1 2 3\n").as_bytes())])
    };
    let scene = colored(["0.5 0 1", "1 1 1", "0 0 0"]);
    assert_eq!(scene.materials[0].base_color, Vec4::ONE, "the colours are the surface's own");
    let half = scene.meshes[0].colors[0];
    assert!((half - Vec4::new(0.21404, 0.0, 1.0, 1.0)).abs().max_element() < 1e-4, "{half}");
    let bytes = colored(["127.5 0 255", "255 255 255", "0 0 0"]);
    assert!(same(&scene, &bytes));
}
