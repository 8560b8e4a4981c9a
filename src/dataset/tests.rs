//! Files of cameras are read, written and read again, and malformed ones are refused by what is at fault.

use std::path::Path;

use argus_scene::{Camera, Distortion, Intrinsics, Lens, Output};
use glam::{DVec2, DVec3};

use super::shots::{Cameras, Format, MOST_SHOTS, Shot, intrinsics_of};
use super::{read, write_cameras};
use crate::args::{Axes, pose_of};

const IDENTITY: &str = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";

/// Cameras of several lenses, sizes and places.
fn cameras(format: Format) -> Cameras {
    let distortions = match format {
        Format::Bop => vec![Distortion::None],
        _ => vec![
            Distortion::None,
            Distortion::Rational([-0.2, 0.05, 1e-3, -2e-3, 0.0, 0.0, 0.0, 0.0]),
            Distortion::Rational([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.1, 0.02, 0.003]),
            Distortion::Rational([-0.2, 0.05, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0]),
            Distortion::Fisheye([0.01, -0.02, 0.003, -0.0004]),
        ],
    };
    let shot = |index: u32| {
        let at = f64::from(index);
        let eye = DVec3::new(100.0 * at, 1.0 / 3.0, -7.5 + at);
        let distortion = distortions[index as usize % distortions.len()];
        let (focal, center) = (DVec2::new(500.0 + at, 498.7), DVec2::new(319.25, 240.0 - at));
        let lens = Some(Lens::Intrinsics(Intrinsics { focal, center, distortion }));
        let target = eye + DVec3::new(at.sin(), -0.3, at.cos());
        let camera = Camera { up: DVec3::new(0.1, 0.9, 0.2), lens, ..Camera::look_at(eye, target) };
        let size = if format == Format::Bop || index < 7 { [640, 480] } else { [64, 48] };
        let name =
            if format == Format::Bop { format!("{index:06}.png") } else { format!("images/{index}.png") };
        Shot { name, id: index, camera, size, depth_unit: Some(1e-4) }
    };
    Cameras { format, shots: (0..10).map(shot).collect() }
}

/// Checks that cameras are equal within 10⁻⁶.
fn agree(first: &Cameras, second: &Cameras) {
    assert_eq!((first.format, first.shots.len()), (second.format, second.shots.len()));
    for (a, b) in first.shots.iter().zip(&second.shots) {
        assert_eq!((&a.name, a.id, a.size), (&b.name, b.id, b.size));
        let [pose, other] = [a, b].map(|shot| pose_of(&shot.camera, Axes::OpenCv));
        assert!(pose.abs_diff_eq(other, 1e-6), "{}: {pose} {other}", a.name);
        let [x, y] = [a, b].map(|shot| intrinsics_of(&shot.camera).unwrap());
        assert!(x.focal.abs_diff_eq(y.focal, 1e-6) && x.center.abs_diff_eq(y.center, 1e-6), "{x:?} {y:?}");
        let [x, y] = [a, b].map(|shot| shot.camera.rays(shot.size[0], shot.size[1]));
        for pixel in [DVec2::ZERO, DVec2::new(20.5, 40.5), DVec2::new(64.0, 48.0)] {
            let (x, y) = (x.direction(pixel).unwrap(), y.direction(pixel).unwrap());
            assert!(x.distance(y) < 1e-6, "{}: {x} {y}", a.name);
        }
    }
}

#[test]
fn each_format_is_read_written_and_read_again_with_the_same_cameras() {
    for format in [Format::Transforms, Format::ColmapText, Format::ColmapBinary, Format::Bop] {
        let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let made = cameras(format);
        let outputs = [Output::Color, Output::Depth, Output::Normal];
        write_cameras(&made, &outputs, first.path(), 1e-4).unwrap();
        let once = read::cameras(first.path(), None).unwrap();
        agree(&made, &once);
        write_cameras(&once, &outputs, second.path(), 1e-4).unwrap();
        let twice = read::cameras(second.path(), None).unwrap();
        agree(&once, &twice);
        let unit = twice.shots[3].depth_unit;
        let metres = matches!(format, Format::ColmapText | Format::ColmapBinary);
        assert!(metres || unit.is_some_and(|unit| (unit - 1e-4).abs() < 1e-12), "{format:?} {unit:?}");
    }
}

#[test]
fn one_place_is_the_same_camera_in_every_format() {
    // At (1, 2, 3), it looks along +x with +y up: OpenCV's axes in the world are z, −y and x.
    let focal = DVec2::splat(50.0);
    let lens = Some(Lens::Intrinsics(Intrinsics::pinhole(focal, DVec2::new(32.0, 24.0))));
    let eye = DVec3::new(1.0, 2.0, 3.0);
    let camera = Camera { lens, ..Camera::look_at(eye, eye + DVec3::X) };
    let read_text = |files: &[(&str, &str)]| {
        let folder = tempfile::tempdir().unwrap();
        files.iter().for_each(|(name, text)| std::fs::write(folder.path().join(name), text).unwrap());
        read::cameras(folder.path(), Some([64, 48])).unwrap().shots[0].clone()
    };
    let transforms = r#"{"fl_x": 50, "frames": [{"file_path": "a",
        "transform_matrix": [[0,0,-1,1],[0,1,0,2],[1,0,0,3],[0,0,0,1]]}]}"#;
    // Rows of the rotation from world to camera: z, −y, x.
    let bop = r#"{"0": {"cam_K": [50,0,31.5,0,50,23.5,0,0,1], "depth_scale": 0.1,
        "cam_R_w2c": [0,0,1,0,-1,0,1,0,0], "cam_t_w2c": [-3000,2000,-1000]}}"#;
    // The same rotation as a quaternion: half a turn about (1, 0, 1)/√2.
    let images = "1 0 0.7071067811865476 0 0.7071067811865476 -3 2 -1 5 a.png\n\n";
    let shots = [
        read_text(&[("transforms.json", transforms)]),
        read_text(&[("scene_camera.json", bop)]),
        read_text(&[("cameras.txt", "# cameras\n5 SIMPLE_PINHOLE 64 48 50 32 24\n"), ("images.txt", images)]),
    ];
    for shot in shots {
        assert_eq!((shot.size, shot.camera.lens), ([64, 48], camera.lens), "{}", shot.name);
        let (pose, expected) = (pose_of(&shot.camera, Axes::OpenCv), pose_of(&camera, Axes::OpenCv));
        assert!(pose.abs_diff_eq(expected, 1e-12), "{}: {pose} {expected}", shot.name);
    }
}

/// The error of a file with this text.
#[track_caller]
fn refused(name: &str, text: impl AsRef<[u8]>, more: &[(&str, &str)]) -> String {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), text).unwrap();
    more.iter().for_each(|(name, text)| std::fs::write(folder.path().join(name), text).unwrap());
    format!("{:#}", read::cameras(&folder.path().join(name), None).unwrap_err())
}

#[test]
fn a_malformed_transforms_json_is_refused_by_frame_and_field() {
    let frame = |path: &str, matrix: &str, more: &str| {
        format!(
            r#"{{"w": 64, "h": 48, {more} "frames": [{{"file_path": "{path}", "transform_matrix": {matrix}}}]}}"#
        )
    };
    let lens = r#""fl_x": 50,"#;
    let singular = "[[1,0,0,1],[1,0,0,2],[0,0,1,3],[0,0,0,1]]";
    let scaled = "[[2,0,0,1],[0,2,0,2],[0,0,2,3],[0,0,0,1]]";
    let nan = "[[NaN,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";
    for (text, words) in [
        (frame("a", singular, lens), ["frames[0]", "must be a rotation"]),
        (frame("a", scaled, lens), ["frames[0]", "without scale"]),
        (frame("a", nan, lens), ["no transforms.json", "line 1"]),
        (frame("a", "[[1,0,0,1]]", lens), ["transform_matrix", "4 rows"]),
        (frame("a", IDENTITY, ""), ["intrinsics are missing", "fl_x"]),
        (frame("../x", IDENTITY, lens), ["frames[0]", "leave --out"]),
        (frame("a", IDENTITY, r#""fl_x": 50, "w": 0.5,"#), ["duplicate field", "`w`"]),
        (frame("a", IDENTITY, r#""fl_x": -50,"#), ["frames[0]", "camera.intrinsics.fx"]),
        (frame("a", IDENTITY, r#""fl_x": 50, "k4": 0.1,"#), ["k4", "FULL_OPENCV"]),
        (
            frame("a", IDENTITY, r#""fl_x": 50, "camera_model": "THIN_PRISM","#),
            ["THIN_PRISM", "OPENCV_FISHEYE (5)"],
        ),
        (
            format!(r#"{{"fl_x": 50, "frames": [{{"file_path": "a", "transform_matrix": {IDENTITY}}}]}}"#),
            ["w and h", "--size"],
        ),
        (r#"{"frames": []}"#.to_owned(), ["no image", "at least one"]),
        (r#"{"frames": [{}]}"#.to_owned(), ["frames[0]", "file_path is missing"]),
        ("[".to_owned(), ["no transforms.json", "line 1"]),
    ] {
        let error = refused("transforms.json", &text, &[]);
        assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    }
    let twice = frame("a.jpg", IDENTITY, lens)
        .replace("}]}", &format!(r#"}}, {{"file_path": "a.png", "transform_matrix": {IDENTITY}}}]}}"#));
    assert!(refused("transforms.json", twice, &[]).contains("written to a.png"));
}

#[test]
fn a_million_cameras_are_refused_and_not_kept() {
    let text = format!(r#"{{"frames": [{}{{}}]}}"#, "{},".repeat(999_999));
    let error = refused("transforms.json", text, &[]);
    assert!(error.contains(&format!("more than {MOST_SHOTS} images")), "{error}");
    let images: String = (0..1_000_000).map(|id| format!("{id} 1 0 0 0 0 0 0 1 {id}.png\n\n")).collect();
    let error = refused("images.txt", images, &[("cameras.txt", "1 PINHOLE 64 48 50 50 32 24")]);
    assert!(error.contains("split it"), "{error}");
    let mut claim = 1_000_000_000u64.to_le_bytes().to_vec();
    claim.extend([0; 8]);
    let error = refused("images.bin", claim, &[("cameras.bin", "\0\0\0\0\0\0\0\0")]);
    assert!(error.contains("split it"), "{error}");
}

#[test]
fn a_malformed_model_of_colmap_is_refused_by_line_and_field() {
    let pinhole = "1 PINHOLE 64 48 50 50 32 24";
    let image = "7 1 0 0 0 0 0 0 1 a.png";
    for (cameras, images, words) in [
        ("1 FOV 64 48 50 50 32 24 0.1", image, ["line 1", "SIMPLE_PINHOLE (0)"]),
        ("1 PINHOLE 64 48 50 50 32", image, ["4 parameters", "not 3"]),
        ("1 PINHOLE 64 0 50 50 32 24", image, ["cameras.txt", "at least 1"]),
        ("1 PINHOLE 64 48 nan 50 32 24", image, ["image 7", "camera.intrinsics.fx"]),
        (pinhole, "7 0 0 0 0 0 0 0 1 a.png", ["image 7", "quaternion"]),
        (pinhole, "7 1 0 0 0 0 inf 0 1 a.png", ["image 7", "finite"]),
        (pinhole, "7 NaN 0 0 0 0 0 0 1 a.png", ["image 7", "quaternion"]),
        (pinhole, "7 1 0 0 0 0 0 0 2 a.png", ["image 7", "no camera 2"]),
        (pinhole, "7 1 0 0 0 0 0 0 1 ../a.png", ["image 7", "leave --out"]),
        (pinhole, "7 1 0 0 0 0 0 0 1", ["images.txt: line 1", "NAME"]),
        (pinhole, "# nothing", ["no image", "at least one"]),
    ] {
        let error = refused("cameras.txt", cameras, &[("images.txt", images)]);
        assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    }
    // Binary files that are cut off anywhere.
    let folder = tempfile::tempdir().unwrap();
    write_cameras(&cameras(Format::ColmapBinary), &[Output::Color], folder.path(), 1e-3).unwrap();
    for name in ["cameras.bin", "images.bin"] {
        let file = folder.path().join("sparse").join(name);
        let whole = std::fs::read(&file).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&file, &whole[..length]).unwrap();
            let error = read::cameras(folder.path(), None).unwrap_err();
            assert!(format!("{error:#}").contains(name), "{length}: {error:#}");
        }
        std::fs::write(&file, [&whole[..], &[0]].concat()).unwrap();
        assert!(format!("{:#}", read::cameras(folder.path(), None).unwrap_err()).contains("follow"));
        std::fs::write(&file, whole).unwrap();
    }
}

#[test]
fn a_malformed_scene_camera_json_is_refused_by_image_and_field() {
    let k = r#""cam_K": [50,0,32,0,50,24,0,0,1]"#;
    let r = r#""cam_R_w2c": [1,0,0,0,1,0,0,0,1]"#;
    let t = r#""cam_t_w2c": [0,0,0]"#;
    for (image, words) in [
        (format!("{r}, {t}"), ["image \"3\"", "cam_K is missing"]),
        (format!("{k}, {t}"), ["image \"3\"", "cam_R_w2c is missing"]),
        (format!("{k}, {r}"), ["image \"3\"", "cam_t_w2c is missing"]),
        (format!(r#""cam_K": [50,1,32,0,50,24,0,0,1], {r}, {t}"#), ["cam_K", "skew"]),
        (format!(r#""cam_K": [50,0,32], {r}, {t}"#), ["cam_K", "9 numbers"]),
        (format!(r#"{k}, "cam_R_w2c": [1,0,0,1,0,0,0,0,1], {t}"#), ["image \"3\"", "must be a rotation"]),
        (format!(r#"{k}, {r}, "cam_t_w2c": [0,1e999,0]"#), ["no scene_camera.json", "number out of range"]),
    ] {
        let sensor = ("camera.json", r#"{"width": 64, "height": 48}"#);
        let error = refused("scene_camera.json", format!(r#"{{"3": {{{image}}}}}"#), &[sensor]);
        assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    }
    let whole = format!("{k}, {r}, {t}");
    assert!(
        refused(
            "scene_camera.json",
            format!(r#"{{"x": {{{whole}}}}}"#),
            &[("camera.json", r#"{"width":1,"height":1}"#)]
        )
        .contains("number")
    );
    assert!(refused("scene_camera.json", format!(r#"{{"3": {{{whole}}}}}"#), &[]).contains("--size"));
}

#[test]
fn what_is_no_file_of_cameras_is_told_what_would_be() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |path: &Path| format!("{:#}", read::cameras(path, None).unwrap_err());
    assert!(refused(folder.path()).contains("transforms.json, scene_camera.json"));
    assert!(refused(&folder.path().join("none.json")).contains("cannot be read"));
    std::fs::write(folder.path().join("a.ply"), "ply").unwrap();
    assert!(refused(&folder.path().join("a.ply")).contains("COLMAP"));
}
