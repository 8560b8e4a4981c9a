//! Names by which requests choose one of a service's scenes.

use argus_scene::InvalidField;

/// The metadata of a request that names its scene.
pub const SCENE_METADATA: &str = "argus-scene";

/// Longest name, bytes.
pub const MAX_SCENE_NAME: usize = 64;

/// Whether names may have this character. All of them may stand in metadata, in labels of metrics and in addresses of pages.
fn is_allowed(c: char) -> bool {
    c.is_ascii_alphanumeric() || ['-', '_', '.'].contains(&c)
}

/// Checks a scene's name.
///
/// # Errors
/// The invalid field, `scene`.
pub fn check_scene_name(name: &str) -> Result<(), InvalidField> {
    let invalid = |reason: String| Err(InvalidField::new("scene", reason));
    match name.len() {
        0 => invalid("a scene's name must not be empty".to_owned()),
        bytes if bytes > MAX_SCENE_NAME => {
            invalid(format!("a scene's name has at most {MAX_SCENE_NAME} characters, not {bytes}"))
        }
        _ if !name.chars().all(is_allowed) => {
            invalid(format!("{name:?} is no name of a scene: use letters without accents, digits, - _ and ."))
        }
        _ => Ok(()),
    }
}

/// A valid name like `wish`: with `-` in place of each character that names cannot have.
pub fn scene_name_like(wish: &str) -> String {
    let name: String =
        wish.chars().map(|c| if is_allowed(c) { c } else { '-' }).take(MAX_SCENE_NAME).collect();
    if name.is_empty() { "scene".to_owned() } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_short_words_of_plain_characters() {
        for name in ["sponza", "sponza-2", "a_b.c", &"x".repeat(MAX_SCENE_NAME)] {
            assert_eq!(check_scene_name(name), Ok(()), "{name}");
        }
        for wrong in ["", "two words", "häuser", "a/b", "a=b", "line\n", &"x".repeat(MAX_SCENE_NAME + 1)] {
            let at = check_scene_name(wrong).unwrap_err();
            assert_eq!(at.field, "scene", "{wrong:?}");
        }
    }

    #[test]
    fn any_wish_becomes_a_valid_name() {
        assert_eq!(scene_name_like("Häuser am See"), "H-user-am-See");
        for wish in ["", "ä", "room", &"é".repeat(500)] {
            assert_eq!(check_scene_name(&scene_name_like(wish)), Ok(()), "{wish}");
        }
    }
}
