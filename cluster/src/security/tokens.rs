//! Tokens that authenticate clients.

use std::fmt;
use std::sync::Arc;

use subtle::{Choice, ConditionallySelectable, ConstantTimeEq};

/// Shortest accepted token: 128 bits are 32 characters in hexadecimal and 22 in base 64.
const LEAST_TOKEN: usize = 22;

/// The rank of a caller. Each includes the ones before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rank {
    /// May check health, and redeem tickets.
    Anybody,
    /// May request views.
    View,
    /// May move nodes of the scene.
    Author,
    /// May read status and metrics.
    Admin,
    /// May act as a process of the cluster.
    Member,
}

/// Tokens of clients, each with a role and a name for the log. They are kept as hashes of one length, so that
/// comparisons take constant time.
#[derive(Clone, PartialEq, Eq, Default)]
pub struct Tokens(Vec<Entry>);

#[derive(Clone, PartialEq, Eq)]
struct Entry {
    hash: [u8; 32],
    rank: Rank,
    name: Arc<str>,
}

impl fmt::Debug for Tokens {
    /// Prints only names and roles.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.iter().map(|entry| (&entry.name, entry.rank))).finish()
    }
}

impl Rank {
    /// The role that a token of this rank has in its file.
    pub(super) fn role(self) -> &'static str {
        match self {
            Self::Anybody => "none",
            Self::View => "view",
            Self::Author => "author",
            Self::Admin => "admin",
            Self::Member => "member",
        }
    }
}

impl Tokens {
    /// Parses tokens, one a line: role (`view`, `author` or `admin`), name and token, separated by spaces. Empty lines and
    /// lines that begin with `#` are ignored.
    ///
    /// # Errors
    /// The number of the line and what is wrong with it, never the token itself.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut tokens: Vec<Entry> = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            let [role, name, token] = words[..] else {
                return Err(format!("line {number}: must be ROLE NAME TOKEN, not {} words", words.len()));
            };
            let rank = match role {
                "view" => Rank::View,
                "author" => Rank::Author,
                "admin" => Rank::Admin,
                _ => return Err(format!("line {number}: the role must be view, author or admin")),
            };
            if token.len() < LEAST_TOKEN {
                return Err(format!("line {number}: a token has at least {LEAST_TOKEN} characters"));
            }
            let hash = *blake3::hash(token.as_bytes()).as_bytes();
            if tokens.iter().any(|entry| entry.hash == hash || *entry.name == *name) {
                return Err(format!("line {number}: its name or its token is a duplicate"));
            }
            tokens.push(Entry { hash, rank, name: name.into() });
        }
        if tokens.is_empty() {
            return Err("the file has no token".to_owned());
        }
        Ok(Self(tokens))
    }

    /// Whether a token has this name.
    pub(crate) fn has_name(&self, name: &str) -> bool {
        self.0.iter().any(|entry| *entry.name == *name)
    }

    /// The role and the name of a token. Compares with all tokens, to take constant time.
    pub(super) fn find(&self, token: &[u8]) -> Option<(Rank, Arc<str>)> {
        let hash = *blake3::hash(token).as_bytes();
        let mut found = u32::MAX;
        for (index, entry) in (0_u32..).zip(&self.0) {
            let same: Choice = entry.hash.ct_eq(&hash);
            found.conditional_assign(&index, same);
        }
        let entry = self.0.get(found as usize)?;
        Some((entry.rank, entry.name.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: &str = "AAAAAAAAAAAAAAAAAAAAAAAAAAAA";
    const ADMIN: &str = "BBBBBBBBBBBBBBBBBBBBBBBBBBBB";

    #[test]
    fn only_a_whole_token_is_found() {
        let tokens =
            Tokens::parse(&format!("# clients\nview shop {VIEW}\n\n admin ops\t{ADMIN} \n")).unwrap();
        assert_eq!(tokens.find(VIEW.as_bytes()), Some((Rank::View, "shop".into())));
        assert_eq!(tokens.find(ADMIN.as_bytes()), Some((Rank::Admin, "ops".into())));
        for wrong in ["", &VIEW[1..], &format!("{VIEW}A"), "shop"] {
            assert_eq!(tokens.find(wrong.as_bytes()), None, "{wrong}");
        }
        assert_eq!(Tokens::default().find(b""), None);
    }

    #[test]
    fn an_error_names_the_line_and_not_the_token() {
        let reason = |text: &str| Tokens::parse(text).unwrap_err();
        assert!(reason("").contains("no token"));
        for (line, word) in [
            (format!("view {VIEW}"), "ROLE NAME TOKEN"),
            (format!("root ops {VIEW}"), "view, author or admin"),
            ("view ops short".to_owned(), "at least"),
            (format!("view a {VIEW}\nview b {VIEW}"), "line 2"),
            (format!("view a {VIEW}\nview a {ADMIN}"), "line 2"),
        ] {
            let said = reason(&line);
            assert!(said.contains(word), "{said}");
            assert!(!said.contains(VIEW) && !said.contains("short"), "{said}");
        }
    }

    #[test]
    fn no_token_is_ever_printed() {
        let tokens = Tokens::parse(&format!("view shop {VIEW}")).unwrap();
        let printed = format!("{tokens:?}");
        assert!(printed.contains("shop") && !printed.contains(VIEW), "{printed}");
    }
}
