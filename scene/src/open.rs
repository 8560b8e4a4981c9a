//! Opens a scene by its name.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::Path;
use std::str::FromStr;

use crate::Scene;
use crate::load::{LoadError, load_environment, load_path};
use crate::procedural::{
    BALLS, DEFAULT_MIRRORS, DEFAULT_ROOMS_WALL_MM, DEFAULT_TERRAIN_TRIANGLES, MIRRORS, ROOMS_WALL_MM,
    TERRAIN_TRIANGLES, mirrors, rooms, terrain, with_balls,
};

/// Stands between a scene and the file of its environment map.
const ENVIRONMENT: &str = "?environment=";

/// `terrain`, `terrain:TRIANGLES`, `mirrors`, `mirrors:BALLS`, `rooms`, `rooms:WALL_MM`, or the path of a scene file. Each
/// may be followed by `+balls:N`, which adds N mirroring balls ([`with_balls`]), and then by an environment map: see
/// [`in_environment`].
///
/// # Errors
/// One line with the scene and the reason: an invalid number, one outside [`TERRAIN_TRIANGLES`], [`MIRRORS`],
/// [`ROOMS_WALL_MM`] or [`BALLS`], an unknown addition, no room for the balls, no such animation, or the error of [`load_path`] or
/// [`load_environment`].
pub fn open(spec: &str) -> Result<Scene, LoadError> {
    let (alone, environment) = split_environment(spec);
    let Some(file) = environment else { return open_alone(spec) };
    // A scene may take long to open, and a bad map is found at once.
    let (environment, bytes) = load_environment(file)?;
    let scene = open_alone(alone)?.with_environment(environment, &bytes);
    Ok(Scene { name: spec.to_owned(), ..scene })
}

/// The specification of a scene in an environment: `SCENE?environment=FILE`, where the file is a map as
/// [`load_environment`] takes it. It replaces an environment that the specification already names.
pub fn in_environment(spec: &str, file: &str) -> String {
    format!("{}{ENVIRONMENT}{file}", split_environment(spec).0)
}

/// The specification without its environment, and the file of that, if it names one.
pub fn split_environment(spec: &str) -> (&str, Option<&str>) {
    spec.split_once(ENVIRONMENT).map_or((spec, None), |(alone, file)| (alone, Some(file)))
}

/// Opens a scene without an environment.
fn open_alone(spec: &str) -> Result<Scene, LoadError> {
    // A wrong number is found before a large file is read.
    additions(spec)?;
    with_additions(open_base(base_of(spec))?, spec)
}

/// What a name adds to a scene.
enum Addition<'a> {
    /// So many mirroring balls.
    Balls(u32),
    /// The animation that plays before others.
    Animation(&'a str),
}

/// A scene's name without its additions: `sponza.glb` of `sponza.glb+balls:50`.
pub fn base_of(spec: &str) -> &str {
    let mut base = spec;
    while let Some((shorter, _, _)) = split(base) {
        base = shorter;
    }
    base
}

/// Adds what a name says to the scene that [`base_of`] the name stands for, and gives the scene that name. Other processes
/// open a scene file wherever they have it, and then add the same.
///
/// # Errors
/// An invalid number of balls, no room for them, or no such animation.
pub fn with_additions(base: Scene, spec: &str) -> Result<Scene, LoadError> {
    let mut scene = base;
    for addition in additions(spec)? {
        scene = match addition {
            Addition::Balls(balls) => with_balls(scene, balls).ok_or_else(|| {
                LoadError::new(spec, format!("there is no room for {balls} balls among its triangles"))
            })?,
            Addition::Animation(name) => scene.play(name).map_err(|reason| LoadError::new(spec, reason))?,
        };
    }
    // `terrain` is named with its number of triangles.
    Ok(if is_procedural(spec) { scene } else { Scene { name: spec.to_owned(), ..scene } })
}

/// A scene's name without its last addition, the addition's kind, and what is written after the kind's colon.
fn split(spec: &str) -> Option<(&str, &str, &str)> {
    let (base, addition) = spec.rsplit_once('+')?;
    let (kind, value) = addition.split_once(':').unwrap_or((addition, ""));
    ["balls", "animation"].contains(&kind).then_some((base, kind, value))
}

/// What a name adds, in its order; each kind once.
fn additions(spec: &str) -> Result<Vec<Addition<'_>>, LoadError> {
    let (mut base, mut kinds, mut found) = (spec, Vec::new(), Vec::new());
    while let Some((shorter, kind, value)) = split(base) {
        if kinds.contains(&kind) {
            let reason = format!("{kind} can be added once: write one `+{kind}:`");
            return Err(LoadError::new(spec, reason));
        }
        found.push(match kind {
            "balls" => Addition::Balls(number(spec, Some(value), 0, &BALLS, "added balls")?),
            _ => Addition::Animation(value),
        });
        kinds.push(kind);
        base = shorter;
    }
    found.reverse();
    Ok(found)
}

/// Opens a scene without additions.
fn open_base(spec: &str) -> Result<Scene, LoadError> {
    if let Some((base, addition)) = spec.rsplit_once('+') {
        let is_file = |path: &str| Path::new(path).exists();
        if !is_file(spec) && (is_procedural(base) || is_file(base)) {
            let reason =
                format!("`+{addition}` is no addition to a scene; known are +balls:N and +animation:NAME");
            return Err(LoadError::new(spec, reason));
        }
    }
    let (name, count) = spec.split_once(':').map_or((spec, None), |(name, count)| (name, Some(count)));
    match name {
        "terrain" => {
            let triangles = number(spec, count, DEFAULT_TERRAIN_TRIANGLES, &TERRAIN_TRIANGLES, "triangles")?;
            Ok(terrain(triangles))
        }
        "mirrors" => Ok(mirrors(number(spec, count, DEFAULT_MIRRORS, &MIRRORS, "balls")?)),
        "rooms" => {
            let what = "millimetres of a wall";
            Ok(rooms(number(spec, count, DEFAULT_ROOMS_WALL_MM, &ROOMS_WALL_MM, what)?))
        }
        _ if !Path::new(spec).exists() => {
            let reason = "no such file, nor a built-in scene: terrain[:TRIANGLES], mirrors[:BALLS] or rooms[:WALL_MM]; \
                          each may be followed by +balls:N";
            Err(LoadError::new(spec, reason))
        }
        _ => load_path(spec),
    }
}

/// The number after a built-in scene's name.
fn number<N: FromStr + PartialOrd + Display>(
    spec: &str,
    count: Option<&str>,
    default: N,
    range: &RangeInclusive<N>,
    of: &str,
) -> Result<N, LoadError> {
    let Some(count) = count else { return Ok(default) };
    count.parse::<N>().ok().filter(|count| range.contains(count)).ok_or_else(|| {
        let (least, most) = (range.start(), range.end());
        LoadError::new(spec, format!("the number of {of} must be {least} to {most}"))
    })
}

/// Whether `spec` names a built-in scene, which every process generates itself, and no file.
pub fn is_procedural(spec: &str) -> bool {
    if split_environment(spec).1.is_some() {
        return false;
    }
    let base = base_of(spec);
    let name = base.split_once(':').map_or(base, |(name, _)| name);
    ["terrain", "mirrors", "rooms"].contains(&name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_scenes_are_opened_by_name_and_number() {
        assert_eq!(open("terrain:2000").unwrap().name, "terrain:2000");
        assert_eq!(open("mirrors:12").unwrap().name, "mirrors:12");
        assert_eq!(open("mirrors").unwrap().name, format!("mirrors:{DEFAULT_MIRRORS}"));
        assert_eq!(open("rooms").unwrap().name, "rooms:20");
        assert!(
            ["terrain", "terrain:2000", "mirrors", "mirrors:3", "rooms:5"]
                .iter()
                .all(|spec| is_procedural(spec))
        );
        assert!(!is_procedural("terrains") && !is_procedural("mirror.glb"));
    }

    #[test]
    fn an_environment_is_named_after_its_scene_and_replaces_another() {
        let spec = in_environment("terrain:2000", "maps/noon.hdr");
        assert_eq!(spec, "terrain:2000?environment=maps/noon.hdr");
        assert_eq!(split_environment(&spec), ("terrain:2000", Some("maps/noon.hdr")));
        assert_eq!(in_environment(&spec, "dusk.exr"), "terrain:2000?environment=dusk.exr");
        assert_eq!(split_environment("terrain"), ("terrain", None));
        assert!(!is_procedural(&spec), "each process needs the file");
        assert_eq!(open("terrain?environment=no/such.hdr").unwrap_err().file, "no/such.hdr");
    }

    #[test]
    fn numbers_out_of_range_are_refused_with_the_range() {
        for spec in
            ["terrain:", "terrain:1999", "terrain:20000001", "terrain:-5", "terrain:1e5", "terrain:many"]
        {
            let error = open(spec).expect_err(spec).to_string();
            assert!(error.starts_with(spec) && error.contains("2000 to 20000000"), "{error}");
        }
        for spec in ["mirrors:0", "mirrors:1001", "mirrors:"] {
            let error = open(spec).expect_err(spec).to_string();
            assert!(error.contains("balls must be 1 to 1000"), "{error}");
        }
        assert!(open("rooms:501").unwrap_err().to_string().contains("must be 1 to 500"));
    }

    #[test]
    fn the_error_of_a_missing_file_names_the_built_in_scenes() {
        assert!(open("no/such.glb").unwrap_err().reason.contains("no such file"));
        assert!(open("terrains").unwrap_err().reason.contains("no such file"));
    }

    #[test]
    fn balls_are_added_to_built_in_scenes_and_to_files() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("floor+roof.obj");
        let quad = "v -5 0 -5\nv 5 0 -5\nv 5 0 5\nv -5 0 5\nf 4 3 2 1\n";
        std::fs::write(&file, quad).unwrap();
        let file = file.display().to_string();
        for base in ["rooms", "terrain:2000", &file] {
            let plain = open(base).unwrap();
            let spec = format!("{base}+balls:3");
            let with = open(&spec).unwrap();
            assert_eq!(with.name, format!("{}+balls:3", plain.name));
            assert_eq!(with.triangles(), plain.triangles() + 3 * 3072);
            assert_eq!(with.default_camera(), plain.default_camera());
            assert_eq!(base_of(&with.name), plain.name);
            assert_eq!(is_procedural(&spec), is_procedural(base));
            assert_eq!(open(&with.name).unwrap(), with, "a process that hears the name makes the same scene");
            assert_eq!(with_additions(open(base).unwrap(), &with.name).unwrap(), with);
            let none = open(&format!("{base}+balls:0")).unwrap();
            assert_eq!(none.triangles(), plain.triangles());
        }
    }

    #[test]
    fn a_wrong_number_of_balls_and_an_unknown_addition_are_refused_with_the_reason() {
        for number in ["", ":", ":2049", ":-1", ":many", ":1.5"] {
            let error = open(&format!("rooms+balls{number}")).expect_err(number).to_string();
            assert!(error.contains("added balls must be 0 to 2048"), "{error}");
        }
        for spec in ["rooms+cubes:3", "terrain:2000+ball:3", "rooms+balls:3+fog"] {
            let error = open(spec).expect_err(spec).to_string();
            assert!(
                error.contains("is no addition to a scene; known are +balls:N and +animation:NAME"),
                "{error}"
            );
        }
        let twice = open("rooms+balls:3+balls:4").unwrap_err().to_string();
        assert!(twice.contains("added once"), "{twice}");
        assert!(open("no/such.glb+balls:3").unwrap_err().reason.contains("no such file"));
    }
}
