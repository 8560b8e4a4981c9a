//! The tokens by which clients are known.

use std::fmt;
use std::sync::Arc;

use subtle::{Choice, ConditionallySelectable, ConstantTimeEq};

use super::guard::Rank;

/// Shortest token that is taken: 128 bits in hexadecimal are 32 characters, in base 64 they are 22.
const LEAST_TOKEN: usize = 22;

/// Tokens of clients, each with its role and a name for the log. Kept as hashes, which have one length, so that a
/// comparison takes as long whatever is compared.
#[derive(Clone, PartialEq, Eq, Default)]
pub struct Tokens(Vec<Entry>);

#[derive(Clone, PartialEq, Eq)]
struct Entry {
    hash: [u8; 32],
    rank: Rank,
    name: Arc<str>,
}

impl fmt::Debug for Tokens {
    /// Names alone.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.iter().map(|entry| (&entry.name, entry.rank))).finish()
    }
}

impl Tokens {
    /// Reads tokens, a line each: role (`view` or `admin`), name, token, with spaces between. Empty lines and those that
    /// begin with `#` say nothing.
    ///
    /// # Errors
    /// The line and what is wrong with it, never the token itself.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut tokens: Vec<Entry> = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            let [role, name, token] = words[..] else {
                return Err(format!("line {number}: ROLE NAME TOKEN is wanted, not {} words", words.len()));
            };
            let rank = match role {
                "view" => Rank::View,
                "admin" => Rank::Admin,
                _ => return Err(format!("line {number}: the role must be view or admin")),
            };
            if token.len() < LEAST_TOKEN {
                return Err(format!("line {number}: a token has at least {LEAST_TOKEN} characters"));
            }
            let hash = *blake3::hash(token.as_bytes()).as_bytes();
            if tokens.iter().any(|entry| entry.hash == hash || *entry.name == *name) {
                return Err(format!("line {number}: its name or its token stands above already"));
            }
            tokens.push(Entry { hash, rank, name: name.into() });
        }
        if tokens.is_empty() {
            return Err("it has no token".to_owned());
        }
        Ok(Self(tokens))
    }

    /// Who has that token. Looks at every token, whichever it is.
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
    fn a_token_is_known_by_all_of_it() {
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
    fn a_malformed_line_is_named_and_its_token_is_not() {
        let reason = |text: &str| Tokens::parse(text).unwrap_err();
        assert!(reason("").contains("no token"));
        for (line, word) in [
            (format!("view {VIEW}"), "ROLE NAME TOKEN"),
            (format!("root ops {VIEW}"), "view or admin"),
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
