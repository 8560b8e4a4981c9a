//! Lines, words and numbers of OBJ and MTL files.

use std::borrow::Cow;

use crate::load::parts::BYTE_ORDER_MARK;

/// Calls `line` with the keyword and the rest of every non-empty line. Comments are removed; a line that ends in a
/// backslash continues in the next one.
pub(super) fn lines(bytes: &[u8], mut line: impl FnMut(&[u8], &[u8])) {
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    let mut rows = bytes.split(|&b| b == b'\n' || b == b'\r');
    while let Some(first) = rows.next() {
        let mut whole = Cow::Borrowed(first);
        while whole.trim_ascii_end().ends_with(b"\\") && !is_comment(&whole) {
            let mut joined = whole.trim_ascii_end().to_vec();
            joined.pop();
            joined.push(b' ');
            let Some(more) = rows.next() else {
                whole = Cow::Owned(joined);
                break;
            };
            // In a two-character line end, the second character makes an empty row.
            let more = if more.is_empty() { rows.next().unwrap_or_default() } else { more };
            joined.extend_from_slice(more);
            whole = Cow::Owned(joined);
        }
        let text = whole.trim_ascii();
        if text.is_empty() || is_comment(text) {
            continue;
        }
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        line(&text[..end], text[end..].trim_ascii());
    }
}

fn is_comment(line: &[u8]) -> bool {
    line.trim_ascii_start().starts_with(b"#")
}

/// The words of a line.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// Parses a number; NaN if the word is not one.
pub(super) fn number(word: &[u8]) -> f64 {
    std::str::from_utf8(word).ok().and_then(|word| word.parse().ok()).unwrap_or(f64::NAN)
}

/// The first `N` numbers of a line, and their count up to `N`; missing ones are zero. Stops at a comment.
pub(super) fn numbers<const N: usize>(line: &[u8]) -> ([f64; N], usize) {
    let mut values = [0.0; N];
    let mut count = 0;
    for word in words(line).take_while(|word| !word.starts_with(b"#")).take(N) {
        values[count] = number(word);
        count += 1;
    }
    (values, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &[u8]) -> Vec<(String, String)> {
        let mut found = Vec::new();
        let owned = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        lines(text, |keyword, rest| found.push((owned(keyword), owned(rest))));
        found
    }

    #[test]
    fn comments_continuations_and_line_ends_of_all_systems() {
        let text = b"\xef\xbb\xbfv 1 2 \\\r\n 3\r\n# v \\\nvt 1\r\n\tusemtl  a b \n\nf 1 \\";
        let expected = [("v", "1 2   3"), ("vt", "1"), ("usemtl", "a b"), ("f", "1")];
        assert_eq!(all(text), expected.map(|(k, r)| (k.to_owned(), r.to_owned())));
    }

    #[test]
    fn numbers_in_common_notations_are_parsed() {
        let (values, count) = numbers::<6>(b".5 -5. +1e-03 1.e010 NaN x7");
        assert_eq!(count, 6);
        assert_eq!(values[..4], [0.5, -5.0, 1e-3, 1e10]);
        assert!(values[4].is_nan() && values[5].is_nan());
        assert_eq!(numbers::<3>(b"1 2 # 3"), ([1.0, 2.0, 0.0], 2));
    }
}
