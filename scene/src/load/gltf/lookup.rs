//! Looks up what a document refers to, within a limit of memory.

use base64::Engine;
use bytes::Bytes;
use gltf::json;

use crate::load::scene_files::SceneFiles;

/// Limit of a scene's memory: a factor on the bundle's size, for arrays shared by several meshes, and a number of
/// bytes for small files.
const MOST_GROWTH: (u64, u64) = (256, 16 << 20);

/// Counts memory before it is allocated.
pub(super) struct Budget {
    pub(super) left: u64,
}

impl Budget {
    pub(super) fn for_files(bundle: &SceneFiles) -> Self {
        Self { left: (bundle.len() as u64).saturating_mul(MOST_GROWTH.0).saturating_add(MOST_GROWTH.1) }
    }

    /// Reserves `count` elements of `size` bytes.
    pub(super) fn take(&mut self, count: usize, size: u64) -> Result<(), String> {
        let bytes = (count as u64).saturating_mul(size);
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => Err(format!("it claims more than {} times its own size", MOST_GROWTH.0)),
        }
    }
}

/// The file that a URI names.
pub(super) fn file_of(uri: &str) -> String {
    // Exporters escape names differently: a name with a stray per cent sign is used as it is.
    let decoded = percent_encoding::percent_decode_str(uri).decode_utf8();
    decoded.map_or_else(|_| uri.to_owned(), |name| name.into_owned())
}

/// The content of a URI: a file of the bundle, or inline data.
pub(super) fn fetch(bundle: &SceneFiles, uri: &str) -> Result<Bytes, String> {
    let Some(data) = uri.strip_prefix("data:") else {
        return bundle.get("", &file_of(uri)).map(|(_, bytes)| bytes.clone());
    };
    let (kind, data) = data.split_once(',').ok_or("a data URI without data")?;
    if !kind.ends_with(";base64") {
        return Ok(Bytes::from(percent_encoding::percent_decode_str(data).collect::<Vec<u8>>()));
    }
    let lenient = base64::engine::GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        base64::engine::GeneralPurposeConfig::new()
            .with_decode_padding_mode(base64::engine::DecodePaddingMode::Indifferent),
    );
    let bytes = lenient.decode(data.trim()).map_err(|error| format!("a data URI: {error}"))?;
    Ok(Bytes::from(bytes))
}

/// A name from the document, or an empty one.
pub(super) fn name(name: &Option<String>) -> String {
    name.clone().unwrap_or_default()
}

/// Looks up an index.
pub(super) fn get<'a, T>(list: &'a [T], index: json::Index<T>, what: &str) -> Result<&'a T, String> {
    list.get(index.value()).ok_or_else(|| format!("{what} {} does not exist", index.value()))
}
