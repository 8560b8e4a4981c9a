//! Parses MTL files. What has no place in a [`crate::Material`] is listed for a warning.

use std::collections::BTreeSet;

use glam::{Vec2, Vec3};

use super::text::{lines, number, numbers, words};
use crate::load::parts::text_of;

/// A material of an MTL file.
#[derive(Debug, Clone, Default)]
pub(super) struct Phong {
    pub(super) name: String,
    pub(super) diffuse: Option<Vec3>,
    pub(super) specular: Option<Vec3>,
    pub(super) emission: Option<Vec3>,
    /// Tf: colour of the light that passes through.
    pub(super) filter: Option<Vec3>,
    pub(super) exponent: Option<f32>,
    pub(super) dissolve: Option<f32>,
    pub(super) transparency: Option<f32>,
    pub(super) ior: Option<f32>,
    pub(super) illumination: Option<i64>,
    pub(super) roughness: Option<f32>,
    pub(super) metallic: Option<f32>,
    pub(super) maps: Vec<(Map, Reference)>,
    /// Statements and options that are not shown, each with what it would do.
    pub(super) unshown: BTreeSet<String>,
}

impl Phong {
    /// The last texture of a use.
    pub(super) fn map(&self, kind: Map) -> Option<&Reference> {
        self.maps.iter().rev().find(|(k, _)| *k == kind).map(|(_, reference)| reference)
    }
}

/// The use of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Map {
    Ambient,
    Diffuse,
    Specular,
    Exponent,
    Emission,
    Dissolve,
    Roughness,
    Metallic,
    /// Roughness in green and metallic in blue.
    Orm,
    /// Roughness in red and metallic in green.
    Rma,
    Normal,
    Bump,
}

impl Map {
    /// The use that a statement, in lower case, names.
    fn parse(keyword: &[u8]) -> Option<Self> {
        Some(match keyword {
            b"map_ka" => Self::Ambient,
            b"map_kd" => Self::Diffuse,
            b"map_ks" => Self::Specular,
            b"map_ns" => Self::Exponent,
            b"map_ke" => Self::Emission,
            b"map_d" | b"map_tr" | b"map_opacity" => Self::Dissolve,
            b"map_pr" => Self::Roughness,
            b"map_pm" => Self::Metallic,
            b"map_orm" => Self::Orm,
            b"map_rma" => Self::Rma,
            b"norm" | b"map_kn" | b"map_norm" => Self::Normal,
            b"bump" | b"map_bump" => Self::Bump,
            _ => return None,
        })
    }
}

/// A texture statement.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reference {
    pub(super) file: String,
    /// OBJ's v points up: `uv · scale + offset`.
    pub(super) scale: Vec2,
    pub(super) offset: Vec2,
    pub(super) clamp: bool,
    /// Both -blendu and -blendv are off.
    pub(super) is_nearest: bool,
    /// -bm: factor on heights.
    pub(super) bump: f32,
    /// -mm: values are `base + gain · texel`.
    pub(super) base: f32,
    pub(super) gain: f32,
    /// -imfchan: the channel of a scalar.
    pub(super) channel: Option<u8>,
}

impl Default for Reference {
    fn default() -> Self {
        Self {
            file: String::new(),
            scale: Vec2::ONE,
            offset: Vec2::ZERO,
            clamp: false,
            is_nearest: false,
            bump: 1.0,
            base: 0.0,
            gain: 1.0,
            channel: None,
        }
    }
}

/// The files that a library names as textures, as they are written.
pub(super) fn textures(bytes: &[u8]) -> BTreeSet<String> {
    parse(bytes).into_iter().flat_map(|material| material.maps).map(|(_, reference)| reference.file).collect()
}

/// Reads the materials of a library.
pub(super) fn parse(bytes: &[u8]) -> Vec<Phong> {
    let mut materials: Vec<Phong> = Vec::new();
    lines(bytes, |keyword, rest| {
        let keyword = keyword.to_ascii_lowercase();
        if keyword == b"newmtl" {
            let name = text_of(rest).trim().to_owned();
            materials.push(Phong { name, ..Phong::default() });
        } else if let Some(material) = materials.last_mut() {
            material.read(&keyword, rest);
        }
    });
    materials
}

impl Phong {
    fn read(&mut self, keyword: &[u8], rest: &[u8]) {
        if let Some(kind) = Map::parse(keyword) {
            let statement = reference(rest, &mut self.unshown);
            self.maps.extend(statement.map(|reference| (kind, reference)));
            return;
        }
        let ([first, ..], count) = numbers::<3>(rest);
        let value = (count > 0).then_some(first as f32);
        let positive = value.is_some_and(|value| value > 0.0);
        match keyword {
            b"kd" => self.diffuse = self.color("Kd", rest),
            b"ks" => self.specular = self.color("Ks", rest),
            b"ke" => self.emission = self.color("Ke", rest),
            b"tf" => self.filter = self.color("Tf", rest),
            b"ns" => self.exponent = value,
            b"ni" => self.ior = value,
            b"d" => match rest.strip_prefix(b"-halo") {
                Some(rest) => {
                    self.dissolve = Some(numbers::<1>(rest).0[0] as f32);
                    self.lacks("d -halo (opacity that depends on the angle)");
                }
                None => self.dissolve = value,
            },
            b"tr" => self.transparency = value,
            b"pr" => self.roughness = value,
            b"pm" => self.metallic = value,
            b"illum" => self.illumination = value.map(|model| model as i64),
            b"ps" if positive => self.lacks("Ps (sheen)"),
            b"pc" if positive => self.lacks("Pc (clearcoat)"),
            b"aniso" if positive => self.lacks("aniso (anisotropy)"),
            b"map_ps" => self.lacks("map_Ps (sheen)"),
            b"map_pc" | b"map_pcr" => self.lacks("map_Pc (clearcoat)"),
            b"map_aniso" | b"map_anisor" => self.lacks("map_aniso (anisotropy)"),
            b"disp" | b"map_disp" => self.lacks("disp (displacement)"),
            b"decal" | b"map_decal" => self.lacks("decal (a texture over the surface)"),
            b"refl" | b"map_refl" => self.lacks("refl (a map that is reflected)"),
            b"map_tf" => self.lacks("map_Tf (the colour of light that passes through)"),
            // The ambient colour stands for light that is computed here; textures are always filtered; the sharpness is
            // that of reflected maps; the others only refine what is absent or listed above.
            b"ka" | b"ps" | b"pc" | b"pcr" | b"aniso" | b"anisor" | b"map_aat" | b"sharpness" | b"map_ao" => {
            }
            _ => {
                let known: String = text_of(keyword).chars().take(32).collect();
                if self.unshown.len() < 32 {
                    self.unshown.insert(format!("{known} (not a statement that is known)"));
                }
            }
        }
    }

    fn lacks(&mut self, what: &str) {
        self.unshown.insert(what.to_owned());
    }

    /// A colour; one number stands for three.
    fn color(&mut self, statement: &str, rest: &[u8]) -> Option<Vec3> {
        if words(rest).next().is_some_and(|word| [&b"spectral"[..], b"xyz"].contains(&word)) {
            self.lacks(&format!("{statement} (a colour as a spectrum or in XYZ)"));
            return None;
        }
        let ([a, b, c], count) = numbers::<3>(rest);
        let color = if count == 1 { Vec3::splat(a as f32) } else { Vec3::new(a as f32, b as f32, c as f32) };
        (count > 0).then_some(color)
    }
}

/// A texture statement: options, then a file name that may contain spaces. `None` without a name.
fn reference(rest: &[u8], unshown: &mut BTreeSet<String>) -> Option<Reference> {
    let mut reference = Reference::default();
    let mut sharp = [false; 2];
    let mut left = rest.trim_ascii();
    while left.starts_with(b"-") {
        let (option, mut after) = split_word(left);
        let (least, most) = match option {
            b"-o" | b"-s" | b"-t" => (1, 3),
            b"-mm" => (2, 2),
            b"-blendu" | b"-blendv" | b"-cc" | b"-clamp" | b"-imfchan" | b"-type" | b"-texres" | b"-bm"
            | b"-boost" | b"-colorspace" => (1, 1),
            // A file name that begins with a dash.
            _ => break,
        };
        let mut values = Vec::new();
        while values.len() < most {
            let (word, more) = split_word(after);
            if word.is_empty() || (values.len() >= least && number(word).is_nan()) {
                break;
            }
            values.push(word);
            after = more;
        }
        let value =
            |i: usize| values.get(i).map(|word| number(word) as f32).filter(|value| value.is_finite());
        let says = |word: &[u8]| values.first().is_some_and(|value| value.eq_ignore_ascii_case(word));
        match option {
            b"-o" => reference.offset = Vec2::new(value(0).unwrap_or(0.0), value(1).unwrap_or(0.0)),
            b"-s" => reference.scale = Vec2::new(value(0).unwrap_or(1.0), value(1).unwrap_or(1.0)),
            b"-clamp" => reference.clamp = says(b"on"),
            b"-bm" => reference.bump = value(0).unwrap_or(1.0),
            b"-mm" => (reference.base, reference.gain) = (value(0).unwrap_or(0.0), value(1).unwrap_or(1.0)),
            b"-imfchan" => {
                reference.channel = values.first().and_then(|word| word.first()).map(u8::to_ascii_lowercase);
            }
            b"-t" if (0..3).any(|i| value(i).is_some_and(|value| value != 0.0)) => {
                unshown.insert("-t (turbulence of a texture)".to_owned());
            }
            b"-boost" if value(0).is_some_and(|value| value > 0.0) => {
                unshown.insert("-boost (sharper distant textures)".to_owned());
            }
            b"-cc" if says(b"on") => {
                unshown.insert("-cc (colour correction of a texture)".to_owned());
            }
            b"-blendu" => sharp[0] = says(b"off"),
            b"-blendv" => sharp[1] = says(b"off"),
            b"-type" => {
                unshown.insert("-type (a sphere or cube that is reflected)".to_owned());
            }
            _ => {}
        }
        left = after;
    }
    reference.is_nearest = sharp == [true; 2];
    if sharp[0] != sharp[1] {
        unshown.insert("-blendu off or -blendv off alone (sharp texels in one direction)".to_owned());
    }
    reference.file = text_of(left).trim().to_owned();
    (!reference.file.is_empty()).then_some(reference)
}

fn split_word(text: &[u8]) -> (&[u8], &[u8]) {
    let word = words(text).next().unwrap_or_default();
    let start = text.len() - text.trim_ascii_start().len();
    (word, text[start + word.len()..].trim_ascii_start())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_options_are_told_from_file_names_with_spaces() {
        let read = |text: &str| reference(text.as_bytes(), &mut BTreeSet::new());
        let odd =
            read("-bm 1.5 -o 0.1 -s 2 3 4 -mm 0.25 2 -imfchan g -clamp on my wood texture.png").unwrap();
        assert_eq!(odd.file, "my wood texture.png");
        assert_eq!((odd.offset, odd.scale, odd.clamp), (Vec2::new(0.1, 0.0), Vec2::new(2.0, 3.0), true));
        assert_eq!((odd.bump, odd.base, odd.gain, odd.channel), (1.5, 0.25, 2.0, Some(b'g')));
        assert_eq!(read("-texres 512 -type sphere a.png").unwrap().file, "a.png");
        assert_eq!(read("-dash.png").unwrap().file, "-dash.png");
        let nan = read("-s nan x 7up.png").unwrap();
        assert_eq!((nan.file.as_str(), nan.scale), ("x 7up.png", Vec2::ONE));
        assert_eq!(read("-o 1 2 3"), None);
        assert_eq!(read(""), None);
        assert_eq!(reference(b"m\xf6bel.png", &mut BTreeSet::new()).unwrap().file, "möbel.png");
    }
}
