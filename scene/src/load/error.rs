//! Why a scene could not be had.

/// One line that names the file, or the scene's name as the user wrote it, and the reason.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {reason}")]
pub struct LoadError {
    /// The file at fault.
    pub file: String,
    /// What is wrong with it, in one line.
    pub reason: String,
}

impl LoadError {
    /// Names the file and the reason; what a file smuggles into either (line breaks, control characters) is
    /// replaced, so that the message stays one line.
    pub fn new(file: impl AsRef<str>, reason: impl AsRef<str>) -> Self {
        Self { file: one_line(file.as_ref()), reason: one_line(reason.as_ref()) }
    }
}

/// Text from a file, made fit for one line of a message: at most 300 characters, none of them control.
pub(super) fn one_line(text: &str) -> String {
    text.trim().chars().take(300).map(|c| if c.is_control() { ' ' } else { c }).collect()
}
