//! A scene by the name that a user gives it.

use std::path::Path;

use crate::Scene;
use crate::load::{LoadError, load_path};
use crate::procedural::{DEFAULT_TERRAIN_TRIANGLES, TERRAIN_TRIANGLES, terrain};

/// `terrain`, `terrain:TRIANGLES`, or the path of a scene file.
///
/// # Errors
/// One line that names the scene and the reason: a number of triangles that is none or outside
/// [`TERRAIN_TRIANGLES`], or what [`load_path`] says of the file.
pub fn open(spec: &str) -> Result<Scene, LoadError> {
    if spec == "terrain" {
        return Ok(terrain(DEFAULT_TERRAIN_TRIANGLES));
    }
    let Some(count) = spec.strip_prefix("terrain:") else {
        if !Path::new(spec).exists() {
            let reason = "no such file, nor the built-in scene terrain[:TRIANGLES]";
            return Err(LoadError::new(spec, reason));
        }
        return load_path(spec);
    };
    match count.parse::<u64>() {
        Ok(triangles) if TERRAIN_TRIANGLES.contains(&triangles) => Ok(terrain(triangles)),
        _ => {
            let (least, most) = (TERRAIN_TRIANGLES.start(), TERRAIN_TRIANGLES.end());
            Err(LoadError::new(spec, format!("the number of triangles must be {least} to {most}")))
        }
    }
}

/// Whether `spec` names a built-in scene, which every process makes for itself, rather than a file.
pub fn is_procedural(spec: &str) -> bool {
    spec == "terrain" || spec.starts_with("terrain:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terrains_are_opened_by_name_and_number() {
        assert_eq!(open("terrain:2000").unwrap().name, "terrain:2000");
        for spec in
            ["terrain:", "terrain:1999", "terrain:20000001", "terrain:-5", "terrain:1e5", "terrain:many"]
        {
            let error = open(spec).expect_err(spec).to_string();
            assert!(error.starts_with(spec) && error.contains("2000 to 20000000"), "{error}");
        }
    }

    #[test]
    fn a_file_that_is_not_there_is_told_from_a_built_in_scene() {
        assert!(open("no/such.glb").unwrap_err().reason.contains("no such file"));
        assert!(open("terrains").unwrap_err().reason.contains("no such file"));
    }
}
