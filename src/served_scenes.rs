//! The scenes that a service is to have, and their names.
//!
//! A scene is written as for all commands, or `NAME=SCENE`. Without a name it has that of its file without the extension, and a number
//! after it if another scene has that name.

use std::path::Path;

use argus_proto::{MAX_SCENE_NAME, check_scene_name, scene_name_like};

use crate::exit::bad_arguments;
use crate::settings;

/// A scene that a service is to have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NamedScene {
    /// The name by which clients choose it.
    pub(crate) name: String,
    /// The scene: a file, or what is generated.
    pub(crate) spec: String,
}

/// The scenes of a coordinator's settings, in their environment.
///
/// # Errors
/// A name that cannot be, or that two scenes have.
pub(crate) fn of(settings: &settings::Coordinator) -> anyhow::Result<Vec<NamedScene>> {
    let given: Vec<String> = settings.scene.iter().chain(&settings.more_scenes).cloned().collect();
    let mut scenes = named(&given, |file| Path::new(file).is_file())?;
    if let Some(file) = &settings.environment {
        for scene in &mut scenes {
            scene.spec = argus_scene::in_environment(&scene.spec, file);
        }
    }
    Ok(scenes)
}

/// The scenes that arguments or settings name, the first one first, with names that differ. `exists` tells whether there is a file.
///
/// # Errors
/// A name that cannot be, or that two scenes have.
pub(crate) fn named(given: &[String], exists: impl Fn(&str) -> bool) -> anyhow::Result<Vec<NamedScene>> {
    let mut scenes: Vec<NamedScene> = Vec::new();
    let parts: Vec<(Option<&str>, &str)> = given.iter().map(|given| split(given, &exists)).collect();
    for (name, _) in &parts {
        let Some(name) = name else { continue };
        check_scene_name(name).map_err(|at| bad_arguments(format!("--scene {name}=…: {}", at.reason)))?;
        if parts.iter().filter(|(other, _)| other == &Some(*name)).count() > 1 {
            return Err(bad_arguments(format!(
                "--scene {name}=…: two scenes have this name; choose another"
            )));
        }
    }
    for (name, spec) in &parts {
        let is_taken = |name: &str| {
            parts.iter().any(|(given, _)| *given == Some(name))
                || scenes.iter().any(|scene| scene.name == name)
        };
        let name = match name {
            Some(name) => (*name).to_owned(),
            None => free_name(&stem(spec), is_taken),
        };
        scenes.push(NamedScene { name, spec: (*spec).to_owned() });
    }
    Ok(scenes)
}

/// Splits `NAME=SCENE`. The name of an existing file is a scene, also if it has an equals sign.
fn split<'a>(given: &'a str, exists: &impl Fn(&str) -> bool) -> (Option<&'a str>, &'a str) {
    let is_path = |name: &str| name.contains(['/', '\\', ':', '+', '?']);
    match given.split_once('=') {
        Some((name, spec)) if !is_path(name) && !exists(given) => (Some(name), spec),
        _ => (None, given),
    }
}

/// The name of a scene that has none: that of its file without the extension, or of what generates it.
fn stem(spec: &str) -> String {
    let base = argus_scene::base_of(argus_scene::split_environment(spec).0);
    let stem = match argus_scene::is_procedural(base) {
        true => base.split(':').next(),
        false => Path::new(base).file_stem().and_then(|stem| stem.to_str()),
    };
    scene_name_like(stem.unwrap_or_default())
}

/// A name, or the first free one with a number after it.
fn free_name(wish: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let numbered = |number: usize| {
        let end = format!("-{number}");
        let most = MAX_SCENE_NAME - end.len();
        format!("{}{end}", &wish[..wish.len().min(most)])
    };
    let further = (2..).map(numbered);
    std::iter::once(wish.to_owned()).chain(further).find(|name| !is_taken(name)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(given: &[&str]) -> anyhow::Result<Vec<(String, String)>> {
        let given: Vec<String> = given.iter().map(|given| (*given).to_owned()).collect();
        let scenes = named(&given, |file| file == "odd=name.glb")?;
        Ok(scenes.into_iter().map(|scene| (scene.name, scene.spec)).collect())
    }

    fn pairs(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
        pairs.iter().map(|(name, spec)| ((*name).to_owned(), (*spec).to_owned())).collect()
    }

    #[test]
    fn scenes_have_the_names_of_their_files_or_those_that_are_given() {
        let given = ["a/sponza.glb", "hall=b/sponza.glb", "terrain:2000", "rooms+balls:4", "x.glb+balls:50"];
        let expected = [
            ("sponza", "a/sponza.glb"),
            ("hall", "b/sponza.glb"),
            ("terrain", "terrain:2000"),
            ("rooms", "rooms+balls:4"),
            ("x", "x.glb+balls:50"),
        ];
        assert_eq!(names(&given).unwrap(), pairs(&expected));
    }

    #[test]
    fn equal_names_are_numbered_unless_they_were_given() {
        let given = ["a/x.glb", "b/x.glb", "x-2=c.glb", "d/x.obj"];
        let expected = [("x", "a/x.glb"), ("x-3", "b/x.glb"), ("x-2", "c.glb"), ("x-4", "d/x.obj")];
        assert_eq!(names(&given).unwrap(), pairs(&expected));
        let twice = names(&["a=x.glb", "a=y.glb"]).unwrap_err().to_string();
        assert!(twice.contains("two scenes have this name"), "{twice}");
        let wrong = names(&["my scene=x.glb"]).unwrap_err().to_string();
        assert!(wrong.contains("my scene") && wrong.contains("letters"), "{wrong}");
    }

    #[test]
    fn files_whose_names_have_an_equals_sign_are_files() {
        let given = ["odd=name.glb", "folder/a=b.glb", "terrain?environment=sky.hdr"];
        let expected = [
            ("odd-name", "odd=name.glb"),
            ("a-b", "folder/a=b.glb"),
            ("terrain", "terrain?environment=sky.hdr"),
        ];
        assert_eq!(names(&given).unwrap(), pairs(&expected));
    }
}
