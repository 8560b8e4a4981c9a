//! The header of a PLY file, and the values after it.

use crate::load::error::one_line;
use crate::load::parts::{BYTE_ORDER_MARK, text_of};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(word: &str) -> Result<Self, String> {
        Ok(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(format!("unknown type {word:?} in its header")),
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(super) fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// The type of the list's count, if the property is a list.
    pub(super) list: Option<Scalar>,
}

#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The number of the scalar property with one of these names.
    pub(super) fn find(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| p.list.is_none() && names.contains(&p.name.as_str()))
    }

    /// The number of the list with one of these names.
    pub(super) fn find_list(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| p.list.is_some() && names.contains(&p.name.as_str()))
    }

    /// The numbers of three scalar properties, each with one of its names.
    pub(super) fn find_three(&self, names: [&[&str]; 3]) -> Option<[usize; 3]> {
        match names.map(|names| self.find(names)) {
            [Some(a), Some(b), Some(c)] => Some([a, b, c]),
            _ => None,
        }
    }
}

/// What a header says.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Images named by comments, in the order that faces count them.
    pub(super) textures: Vec<String>,
    /// Where the data starts.
    pub(super) start: usize,
}

/// Parses the header. Its text may be UTF-8 or Latin-1, and its lines may end as on any system.
pub(super) fn header(bytes: &[u8]) -> Result<Header, String> {
    let mut at = if bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
    let first_end = bytes.iter().position(|&b| b == b'\n' || b == b'\r');
    // Where lines end in a carriage return alone, a line feed after the header is data.
    let line_end = match first_end.map(|end| &bytes[end..]) {
        Some([b'\r', b'\n', ..]) | Some([b'\n', ..]) | None => b'\n',
        _ => b'\r',
    };
    let mut encoding = None;
    let (mut elements, mut textures) = (Vec::<Element>::new(), Vec::new());
    loop {
        let rest = bytes.get(at..).unwrap_or_default();
        let end = rest.iter().position(|&b| b == line_end).ok_or("its header does not end")?;
        let line = text_of(&rest[..end]);
        at += end + 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["end_header"] => break,
            ["comment", what, ..] if what.eq_ignore_ascii_case("TextureFile") => {
                let name = line.split_once(*what).map_or("", |(_, name)| name.trim());
                textures.extend((!name.is_empty()).then(|| name.to_owned()));
            }
            ["ply"] | ["comment" | "obj_info", ..] | [] => {}
            ["format", kind, ..] => {
                encoding = Some(match *kind {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    other => return Err(format!("unknown format {other:?}")),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| format!("element {name:?} has no count"))?;
                elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
            }
            ["property", "list", count, scalar, name] => {
                let (list, scalar) = (Some(Scalar::parse(count)?), Scalar::parse(scalar)?);
                let element = elements.last_mut().ok_or("a property before any element")?;
                element.properties.push(Property { name: (*name).to_owned(), scalar, list });
            }
            ["property", scalar, name] => {
                let scalar = Scalar::parse(scalar)?;
                let element = elements.last_mut().ok_or("a property before any element")?;
                element.properties.push(Property { name: (*name).to_owned(), scalar, list: None });
            }
            _ => return Err(format!("{:?} in its header", one_line(&line))),
        }
    }
    let encoding = encoding.ok_or("its header names no format")?;
    // Some editors put their mark before the data.
    if encoding == Encoding::Ascii && bytes[at..].starts_with(BYTE_ORDER_MARK) {
        at += BYTE_ORDER_MARK.len();
    }
    Ok(Header { encoding, elements, textures, start: at })
}

/// Reads the values of a file's data one after another.
pub(super) struct Values<'a> {
    pub(super) rest: &'a [u8],
    pub(super) encoding: Encoding,
}

impl Values<'_> {
    pub(super) fn next(&mut self, scalar: Scalar) -> Result<f64, String> {
        let cut_short = || "the file is cut short".to_owned();
        if self.encoding == Encoding::Ascii {
            let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or_else(cut_short)?;
            let rest = &self.rest[start..];
            let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
            self.rest = &rest[end..];
            let word = text_of(&rest[..end]);
            let number = word.parse().ok();
            // C libraries write `-nan(ind)` and `1.#QNAN`.
            let number = number.or_else(|| (word.contains("nan") || word.contains('#')).then_some(f64::NAN));
            return number.ok_or_else(|| format!("{:?} is no number", one_line(&word)));
        }
        let size = scalar.size();
        if self.rest.len() < size {
            return Err(cut_short());
        }
        let (value, rest) = self.rest.split_at(size);
        self.rest = rest;
        let mut bytes = [0; 8];
        bytes[..size].copy_from_slice(value);
        if self.encoding == Encoding::Big {
            bytes[..size].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        Ok(match scalar {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(bytes),
        })
    }

    /// Reads a whole property: returns its value, or the last value of a list, whose values go to `list`.
    pub(super) fn property(&mut self, property: &Property, list: &mut Vec<f64>) -> Result<f64, String> {
        let Some(count_type) = property.list else { return self.next(property.scalar) };
        let count = self.next(count_type)?;
        if !(count >= 0.0) || count.fract() != 0.0 {
            return Err(format!("a list of {count} values"));
        }
        list.clear();
        let mut left = count as u64;
        while left > 0 {
            list.push(self.next(property.scalar)?);
            left -= 1;
        }
        Ok(count)
    }
}
