//! Every statement of MTL and every option of its textures.

use argus_scene::material::{Filter, Wrap};
use argus_scene::{AlphaMode, Material, Scene, Texture, TextureRef};
use glam::{Vec2, Vec3, Vec4};

use super::{Expect, check, load, png, same};
use Expect::{NotApplicable, Shown, Warned};

const QUAD: &str =
    "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n";

/// Colours, a cut-out, a soft mask, roughness over a ramp, normals and heights, each 4×4.
fn images() -> Vec<(&'static str, Vec<u8>)> {
    let grey = |value: u32| [value as u8, value as u8, value as u8, 255];
    vec![
        ("color.png", png(4, 4, |_, _| [200, 100, 50, 255])),
        ("cut.png", png(4, 4, |x, _| grey(if x < 2 { 0 } else { 255 }))),
        ("soft.png", png(4, 4, |x, _| grey(x * 85))),
        ("alpha.png", png(4, 4, |x, _| [255, 255, 255, if x < 2 { 0 } else { 255 }])),
        ("rgba.png", png(4, 4, |x, _| [200, 100, 50, if x < 2 { 0 } else { 255 }])),
        ("orm.png", png(4, 4, |_, _| [10, 51, 204, 255])),
        ("normal.png", png(4, 4, |x, y| if x == y { [200, 128, 232, 255] } else { [128, 128, 255, 255] })),
        // As a vector this grey would have the length of a normal.
        ("even.png", png(4, 4, |_, _| grey(201))),
        ("height.png", png(4, 4, |x, _| grey(if x < 2 { 0 } else { 255 }))),
    ]
}

fn with(statements: &str) -> Scene {
    let library = format!("newmtl m\n{statements}\n");
    let images = images();
    let mut files = vec![("a.obj", QUAD.as_bytes()), ("a.mtl", library.as_bytes())];
    files.extend(images.iter().map(|(name, bytes)| (*name, &bytes[..])));
    load(&files)
}

fn material(scene: &Scene) -> &Material {
    &scene.materials[0]
}

fn texture(scene: &Scene, reference: Option<TextureRef>) -> &Texture {
    &scene.textures[reference.expect("a texture").texture as usize]
}

/// The first texels of a texture's first row.
fn texels<const N: usize>(scene: &Scene, reference: Option<TextureRef>) -> [[u8; 4]; N] {
    let rgba = &texture(scene, reference).rgba;
    std::array::from_fn(|x| [0, 1, 2, 3].map(|k| rgba[4 * x + k]))
}

fn color<const N: usize>(scene: &Scene) -> [[u8; 4]; N] {
    texels(scene, material(scene).base_color_texture)
}

/// Green and blue of the first texel: roughness and metallicity.
fn gloss(scene: &Scene) -> [u8; 2] {
    let [[_, g, b, _]] = texels(scene, material(scene).metallic_roughness_texture);
    [g, b]
}

/// The roughness of a Phong exponent in a texture.
fn rough(exponent: f32) -> u8 {
    ((2.0 / (exponent + 2.0)).powf(0.25) * 255.0 + 0.5) as u8
}

fn approximately(value: f32, expected: f32) -> bool {
    (value - expected).abs() < 1e-5
}

/// The statements of the format's definition and of its extension for physically based materials.
const STATEMENTS: &[(&str, Expect)] = &[
    ("Ka 1 1 1", NotApplicable),
    ("Kd 1 0.5 0", Shown(|s| material(s).base_color == Vec4::new(1.0, 0.5, 0.0, 1.0))),
    ("Kd 0.5", Shown(|s| material(s).base_color == Vec4::new(0.5, 0.5, 0.5, 1.0))),
    ("Kd spectral a.rfl", Warned("Kd (a colour as a spectrum or in XYZ)")),
    ("Kd xyz 0.3 0.3 0.3", Warned("Kd (a colour")),
    ("Ks 0.5 0.5 0.5\nNs 30", Shown(|s| approximately(material(s).roughness, 0.5))),
    ("Ks 0 0 0\nNs 30", NotApplicable),
    ("Ks 0.5 0.5 0.5\nNs 30\nillum 1", NotApplicable),
    ("illum 2", NotApplicable),
    ("Ke 2 1 0", Shown(|s| material(s).emissive == Vec3::new(2.0, 1.0, 0.0))),
    ("Tf 1 0 0", NotApplicable),
    (
        "d 0.25\nTf 1 0.5 0.5\nillum 7",
        Shown(|s| {
            approximately(material(s).transmission, 0.75)
                && material(s).base_color == Vec4::new(1.0, 0.5, 0.5, 1.0)
        }),
    ),
    ("d 0.25", Shown(|s| material(s).alpha == AlphaMode::Blend && material(s).base_color.w == 0.25)),
    ("d 1", NotApplicable),
    ("Tr 0.75", Shown(|s| material(s).alpha == AlphaMode::Blend && material(s).base_color.w == 0.25)),
    ("Tr 0", NotApplicable),
    ("Tr 1", NotApplicable),
    ("Ni 1.33", Shown(|s| material(s).ior == 1.33)),
    ("sharpness 60", NotApplicable),
    ("Pr 0.25", Shown(|s| material(s).roughness == 0.25)),
    ("Pm 0.75", Shown(|s| material(s).metallic == 0.75)),
    ("Ps 0.5", Warned("Ps (sheen)")),
    ("Ps 0", NotApplicable),
    ("Pc 0.5", Warned("Pc (clearcoat)")),
    ("Pc 0", NotApplicable),
    ("Pcr 0.5", NotApplicable),
    ("aniso 0.5", Warned("aniso")),
    ("aniso 0", NotApplicable),
    ("anisor 0.5", NotApplicable),
    ("map_Kd color.png", Shown(|s| color(s) == [[200, 100, 50, 255]] && material(s).base_color == Vec4::ONE)),
    ("Kd 0 0 0\nmap_Kd color.png", Shown(|s| material(s).base_color == Vec4::ONE)),
    ("Kd 0.5 1 1\nmap_Kd color.png", Shown(|s| material(s).base_color.x == 0.5)),
    ("map_Kd rgba.png", Shown(|s| material(s).alpha == AlphaMode::Mask(0.5))),
    ("map_Kd color.png\nmap_Ka none.png", Shown(|s| color(s) == [[200, 100, 50, 255]])),
    ("map_Ka color.png", Shown(|s| color(s) == [[200, 100, 50, 255]])),
    (
        "map_Ks color.png\nNs 30",
        Shown(|s| {
            texels(s, material(s).specular_color_texture) == [[200, 100, 50, 255]]
                && material(s).roughness == 0.5
        }),
    ),
    (
        "Kd 0 0 0\nmap_Ks color.png\nNs 30",
        Shown(|s| color(s) == [[200, 100, 50, 255]] && material(s).metallic == 1.0),
    ),
    (
        "Ks 1 1 1\nNs 100\nmap_Ns soft.png",
        Shown(|s| {
            texels(s, material(s).metallic_roughness_texture).map(|[_, g, b, _]| [g, b])
                == [[rough(0.0), 255], [rough(100.0 / 3.0), 255]]
                && material(s).roughness == 1.0
        }),
    ),
    (
        "map_Pr soft.png",
        Shown(|s| gloss(s) == [0, 255] && material(s).roughness == 1.0 && material(s).metallic == 0.0),
    ),
    ("map_Pm cut.png", Shown(|s| gloss(s) == [255, 0] && material(s).metallic == 1.0)),
    ("map_Pr -imfchan g orm.png\nmap_Pm -imfchan b orm.png", Shown(|s| gloss(s) == [51, 204])),
    ("map_ORM orm.png", Shown(|s| gloss(s) == [51, 204])),
    ("map_RMA orm.png", Shown(|s| gloss(s) == [10, 51])),
    ("Pr 0\nmap_Pr soft.png", Shown(|s| material(s).roughness == 1.0)),
    (
        "map_Ke color.png",
        Shown(|s| {
            material(s).emissive == Vec3::ONE
                && texels(s, material(s).emissive_texture) == [[200, 100, 50, 255]]
        }),
    ),
    (
        "map_d cut.png",
        Shown(|s| {
            material(s).alpha == AlphaMode::Mask(0.5)
                && color(s) == [[255, 255, 255, 0], [255, 255, 255, 0], [255; 4]]
        }),
    ),
    (
        "map_d soft.png",
        Shown(|s| material(s).alpha == AlphaMode::Blend && color::<2>(s)[1] == [255, 255, 255, 85]),
    ),
    ("map_d alpha.png", Shown(|s| material(s).alpha == AlphaMode::Mask(0.5) && color::<1>(s)[0][3] == 0)),
    (
        "map_Kd color.png\nmap_d cut.png",
        Shown(|s| color(s) == [[200, 100, 50, 0], [200, 100, 50, 0], [200, 100, 50, 255]]),
    ),
    (
        "map_Kd rgba.png\nmap_d rgba.png",
        Shown(|s| color::<3>(s)[1..] == [[200, 100, 50, 0], [200, 100, 50, 255]]),
    ),
    ("d 0\nmap_d cut.png", Shown(|s| material(s).base_color.w == 1.0)),
    (
        "d 0.5\nmap_d cut.png",
        Shown(|s| material(s).alpha == AlphaMode::Blend && material(s).base_color.w == 0.5),
    ),
    ("norm normal.png", Shown(|s| texels(s, material(s).normal_texture) == [[200, 128, 232, 255]])),
    ("map_Kn normal.png", Shown(|s| texels(s, material(s).normal_texture) == [[200, 128, 232, 255]])),
    (
        "map_Bump -bm 0.5 normal.png",
        Shown(|s| {
            texels(s, material(s).normal_texture) == [[200, 128, 232, 255]] && material(s).normal_scale == 0.5
        }),
    ),
    (
        "bump -bm 20 height.png",
        Shown(|s| {
            // The height rises by one over two texels of a quarter: 20 · 0.01 · 4 / 2 is the slope to the right.
            let n = texels::<3>(s, material(s).normal_texture)
                .map(|t| Vec3::new(t[0].into(), t[1].into(), t[2].into()) / 127.5 - 1.0);
            let expected = Vec3::new(-0.4, 0.0, 1.0).normalize();
            [n[1], n[2]].iter().all(|n| (*n - expected).abs().max_element() < 0.01)
                && !s.meshes[0].tangents.is_empty()
        }),
    ),
    ("bump height.png\nnorm normal.png", Warned("height.png is not shown: normal.png gives the normals")),
    ("bump even.png", Shown(|s| texels(s, material(s).normal_texture) == [[128, 128, 255, 255]])),
    ("map_aat on", NotApplicable),
    ("disp height.png", Warned("disp (displacement)")),
    ("decal color.png", Warned("decal")),
    ("refl -type sphere color.png", Warned("refl")),
    ("map_refl color.png", Warned("refl")),
    ("map_Ps cut.png", Warned("map_Ps (sheen)")),
    ("map_Pc cut.png", Warned("map_Pc (clearcoat)")),
    ("map_aniso cut.png", Warned("map_aniso")),
    ("telepathy 1", Warned("telepathy (not a statement that is known)")),
    ("map_Kd none.png", Warned("none.png")),
    ("map_Ke none.png", Warned("none.png")),
    ("map_Pm none.png", Warned("none.png")),
    ("map_d none.png", Warned("none.png")),
];

#[test]
fn every_statement_of_mtl_is_shown_or_warned_of_or_changes_nothing() {
    let without = with("");
    for (statement, expect) in STATEMENTS {
        // A second map of normals is beside the first.
        let base = statement.split_once('\n').filter(|_| statement.starts_with("bump height.png\n"));
        let without = base.map_or_else(|| without.clone(), |(_, base)| with(base));
        check(statement, expect, &with(statement), &without);
    }
}

/// The options of a texture of colours, but for those of scalars.
const OPTIONS: &[(&str, Expect)] = &[
    ("-s 2 3 1", Shown(|s| material(s).base_color_texture.is_some_and(|r| r.scale == Vec2::new(2.0, 3.0)))),
    (
        "-o 0.25 0.5 0",
        Shown(|s| material(s).base_color_texture.is_some_and(|r| r.offset == Vec2::new(0.25, -0.5))),
    ),
    ("-t 1 1 1", Warned("-t (turbulence")),
    ("-t 0 0 0", NotApplicable),
    ("-clamp on", Shown(|s| s.textures[0].wrap == [Wrap::Clamp; 2])),
    ("-clamp off", NotApplicable),
    ("-blendu off -blendv off", Shown(|s| s.textures[0].filter == Filter::Nearest)),
    ("-blendu off", Warned("-blendu off")),
    ("-blendu on -blendv on", NotApplicable),
    ("-mm 0.5 0.25", Shown(|s| color(s) == [[178, 153, 140, 255]])),
    ("-mm 0 1", NotApplicable),
    ("-bm 3", NotApplicable),
    ("-imfchan l", NotApplicable),
    ("-texres 512", NotApplicable),
    ("-boost 2", Warned("-boost")),
    ("-cc on", Warned("-cc (colour correction")),
    ("-cc off", NotApplicable),
    ("-type sphere", Warned("-type")),
    ("-colorspace linear", NotApplicable),
];

#[test]
fn every_option_of_a_texture_is_shown_or_warned_of_or_changes_nothing() {
    let without = with("map_Kd color.png");
    for (option, expect) in OPTIONS {
        check(option, expect, &with(&format!("map_Kd {option} color.png")), &without);
    }
    let gain = with("map_Pr -mm 0.2 0.4 -imfchan g orm.png");
    assert_eq!(gloss(&gain)[0], ((0.2f32 + 0.4 * 0.2) * 255.0 + 0.5) as u8);
}

#[test]
fn a_lost_texture_leaves_its_factor_but_neither_glow_nor_metal() {
    let lost = with("Kd 0.5 0.5 0.5\nKe 1 1 1\nPm 1\nmap_Kd none.png\nmap_Ke none.png\nmap_Pm none.png");
    let Material { base_color, emissive, metallic, .. } = *material(&lost);
    assert_eq!((base_color.x, emissive, metallic), (0.5, Vec3::ZERO, 0.0));
    assert_eq!(lost.warnings.len(), 1, "{:?}", lost.warnings);
    // A file that is there and is no image is lost, too.
    let broken = with("Ke 1 1 1\nmap_Ke a.obj");
    assert_eq!((material(&broken).emissive, broken.warnings.len()), (Vec3::ZERO, 1), "{:?}", broken.warnings);
}

#[test]
fn a_mask_beside_a_colour_looks_like_one_image_of_both() {
    assert!(same(&with("map_Kd color.png\nmap_d cut.png"), &with("map_Kd rgba.png")));
    // The larger size counts, and the mask's own place.
    let colors = png(2, 2, |_, _| [200, 100, 50, 255]);
    let mask = png(8, 8, |x, _| [if x < 4 { 0 } else { 255 }, 0, 0, 255]);
    let library = b"newmtl m\nmap_Kd color.png\nmap_d -s 2 1 -imfchan r mask.png\n";
    let scene =
        load(&[("a.obj", QUAD.as_bytes()), ("a.mtl", library), ("color.png", &colors), ("mask.png", &mask)]);
    let texture = texture(&scene, material(&scene).base_color_texture);
    assert_eq!((texture.width, texture.height), (8, 8));
    let alpha: Vec<u8> = texture.rgba[..32].chunks(4).map(|texel| texel[3]).collect();
    // Two repeats of the mask within one of the colours, each half transparent.
    assert!(alpha[0] < 128 && alpha[2] > 128 && alpha[4] < 128 && alpha[6] > 128, "{alpha:?}");
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn textures_without_coordinates_are_told_and_left_out() {
    let bare = QUAD.replace("/1", "").replace("/2", "").replace("/3", "");
    let image = png(2, 2, |_, _| [0, 0, 0, 255]);
    let scene = load(&[
        ("a.obj", bare.as_bytes()),
        ("a.mtl", b"newmtl m\nKd 1 0 0\nmap_Kd a.png"),
        ("a.png", &image),
    ]);
    assert_eq!(material(&scene).base_color_texture, None);
    assert!(
        scene.warnings.len() == 1 && scene.warnings[0].contains("need coordinates"),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn only_what_a_file_uses_is_read_and_warned_of() {
    let library = b"newmtl m\nKd 1 0 0\nnewmtl unused\ndisp a.png\nmap_Kd none.png\n";
    let scene = load(&[("a.obj", QUAD.as_bytes()), ("a.mtl", library)]);
    assert_eq!((scene.materials.len(), scene.warnings.len()), (1, 0), "{:?}", scene.warnings);
}
