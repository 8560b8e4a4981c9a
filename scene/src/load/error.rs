//! Loading errors.

/// One line with the file, or the scene's name as given by the user, and the reason.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {reason}")]
pub struct LoadError {
    /// The file at fault.
    pub file: String,
    /// What is wrong with it, in one line.
    pub reason: String,
}

impl LoadError {
    /// An error for this file. Line breaks and control characters are replaced, so that the message stays one line.
    pub fn new(file: impl AsRef<str>, reason: impl AsRef<str>) -> Self {
        Self { file: one_line(file.as_ref()), reason: one_line(reason.as_ref()) }
    }
}

/// Makes a file's text fit into one line: at most 300 characters, without control characters.
pub(super) fn one_line(text: &str) -> String {
    text.trim().chars().take(300).map(|c| if c.is_control() { ' ' } else { c }).collect()
}
