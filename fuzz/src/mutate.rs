//! Edits of valid inputs.

/// An edit: kind, position and value. Any three numbers are valid.
pub type Edit = (u8, u32, u32);

/// Values at which code often has a boundary.
const EDGES: [u32; 12] =
    [0, 1, 0x7f, 0x80, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_fffe, 0xffff_ffff, 0x7fc0_0000];

/// Texts with a meaning in the tested formats.
const WORDS: [&[u8]; 16] = [
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"99999999999999999999",
    b"0",
    b"..",
    b"/",
    b"\n",
    b" ",
    b"{}",
    b"[]",
    b"null",
    b"\xff",
    b"\0",
    b"-0.0",
];

/// Most edits of an input: with more, it is noise and refused at its first byte.
const MOST_EDITS: usize = 5;

/// The longest input: some edits repeat parts.
const LONGEST: usize = 1 << 20;

/// `seed` with a few of the edits, and `other` as a source of pieces.
pub fn edited(seed: &[u8], other: &[u8], edits: &[Edit]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for &(what, place, with) in &edits[..edits.len() % (MOST_EDITS + 1)] {
        let at = place as usize % (bytes.len() + 1);
        let count = with as usize % 64;
        let end = (at + count).min(bytes.len());
        match what % 19 {
            // Rare, since it undoes edits further on.
            0 => bytes.truncate(at),
            1 | 10 => drop(bytes.drain(at..end)),
            2 | 11 => replace(&mut bytes, at, &with.to_le_bytes()[..1]),
            3 | 12 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << (with % 8);
                }
            }
            4 | 13 => replace(&mut bytes, at, &EDGES[with as usize % EDGES.len()].to_le_bytes()),
            5 | 14 => replace(&mut bytes, at, &EDGES[with as usize % EDGES.len()].to_be_bytes()[2..]),
            6 | 15 => insert(&mut bytes, at, WORDS[with as usize % WORDS.len()]),
            7 | 16 => {
                let piece = bytes[at..end].to_vec();
                insert(&mut bytes, at, &piece);
            }
            8 | 17 => {
                let from = with as usize % (other.len() + 1);
                let piece = &other[from..(from + 64).min(other.len())];
                insert(&mut bytes, at, piece);
            }
            _ => {
                // The next number of a text.
                let at = at + bytes[at..].iter().position(u8::is_ascii_digit).unwrap_or_default();
                let digits = bytes[at..].iter().take_while(|byte| byte.is_ascii_digit()).count();
                let number = EDGES[with as usize % EDGES.len()].to_string();
                bytes.splice(at..at + digits, number.bytes());
            }
        }
    }
    bytes.truncate(LONGEST);
    bytes
}

fn insert(bytes: &mut Vec<u8>, at: usize, piece: &[u8]) {
    bytes.splice(at..at, piece.iter().copied());
}

fn replace(bytes: &mut [u8], at: usize, piece: &[u8]) {
    for (byte, new) in bytes[at..].iter_mut().zip(piece) {
        *byte = *new;
    }
}
