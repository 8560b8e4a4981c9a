//! What the loader of a format is given, and what it returns.

use super::error::one_line;
use crate::animation::{Animation, Node};
use crate::scene::{Instance, NamedCamera};
use crate::{Light, Material, Mesh, Texture};

/// Some editors begin text with this mark.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// A file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Gltf,
    Obj,
    Ply,
}

impl Format {
    /// Detects the format by the first bytes, or else by the extension.
    pub(super) fn detect(name: &str, bytes: &[u8]) -> Result<Self, String> {
        if bytes.is_empty() {
            return Err("the file is empty".to_owned());
        }
        if bytes.starts_with(b"glTF") {
            return Ok(Self::Gltf);
        }
        let text = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
        if text.starts_with(b"ply\n") || text.starts_with(b"ply\r") {
            return Ok(Self::Ply);
        }
        let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension);
        match extension.to_ascii_lowercase().as_str() {
            "gltf" | "glb" => Ok(Self::Gltf),
            "obj" => Ok(Self::Obj),
            "ply" => Ok(Self::Ply),
            _ => Err("is no scene format known here (.glb, .gltf, .obj, .ply)".to_owned()),
        }
    }
}

/// The content of a file, as read by a format's loader.
#[derive(Default)]
pub(super) struct Parts {
    pub(super) meshes: Vec<Mesh>,
    pub(super) instances: Vec<Instance>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    pub(super) nodes: Vec<Node>,
    pub(super) animations: Vec<Animation>,
    pub(super) lights: Vec<Light>,
    pub(super) cameras: Vec<NamedCamera>,
}

/// Warnings, bounded in number since a hostile file could cause any number.
#[derive(Default)]
pub(super) struct Warnings {
    lines: Vec<String>,
    more: usize,
}

impl Warnings {
    const MOST: usize = 64;

    pub(super) fn add(&mut self, line: impl AsRef<str>) {
        if self.lines.len() < Self::MOST {
            self.lines.push(one_line(line.as_ref()));
        } else {
            self.more += 1;
        }
    }

    pub(super) fn into_lines(mut self) -> Vec<String> {
        if self.more > 0 {
            self.lines.push(format!("and {} more warnings", self.more));
        }
        self.lines
    }
}

/// Text of a file as UTF-8, or else as Latin-1.
pub(super) fn text_of(bytes: &[u8]) -> String {
    let latin = || bytes.iter().map(|&byte| char::from(byte)).collect();
    std::str::from_utf8(bytes).map_or_else(|_| latin(), str::to_owned)
}
