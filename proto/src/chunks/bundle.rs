//! Scenes in chunks: a bundle of files, or the name of a generated one.

use std::collections::BTreeSet;

use argus_scene::{InvalidField, SceneHash};
use bytes::Bytes;

use super::{Gather, pieces};
use crate::WireError;
use crate::convert::{required, scene_hash, scene_hash_bytes};
use crate::v1::{self, bundle_header::Source};

/// A scene from its coordinator. The receiver must open it and compare its hash.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneFiles {
    /// The name given by the coordinator's user.
    pub name: String,
    /// The expected hash of the opened scene.
    pub hash: SceneHash,
    /// The source of the scene.
    pub source: SceneFilesSource,
}

/// The source of a scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SceneFilesSource {
    /// A generated scene, such as `terrain:500000`.
    Procedural(String),
    /// Files by their names relative to the bundle's root, parts separated by `/`.
    Files {
        /// The root file.
        root: String,
        /// All of them.
        files: Vec<(String, Bytes)>,
    },
}

/// The only chunk of a generated scene.
pub fn procedural_chunk(name: &str, hash: SceneHash, spec: &str) -> v1::SceneChunk {
    header_chunk(name, hash, Source::Procedural(spec.to_owned()))
}

/// Splits a bundle of files into chunks, which are slices of the files, made lazily.
///
/// # Errors
/// [`WireError::Invalid`] if a name leaves the bundle or `root` is not among the files.
pub fn bundle_chunks(
    name: &str,
    hash: SceneHash,
    root: &str,
    files: Vec<(String, Bytes)>,
) -> Result<impl Iterator<Item = v1::SceneChunk> + use<>, WireError> {
    for (name, _) in &files {
        check_name(name)?;
    }
    if !files.iter().any(|(name, _)| name == root) {
        return Err(WireError::field("bundle.root", format!("{root} is not in the bundle")));
    }
    let source = Source::Files(v1::FileBundle {
        root: root.to_owned(),
        files: files.len() as u32,
        total_bytes: files.iter().map(|(_, bytes)| bytes.len() as u64).sum(),
    });
    let header = header_chunk(name, hash, source);
    let rest = files.into_iter().flat_map(|(name, bytes)| {
        let file = v1::FileHeader { name, bytes: bytes.len() as u64 };
        let data: Vec<_> = pieces(0, &bytes).map(|(_, bytes)| v1::scene_chunk::Body::Data(bytes)).collect();
        std::iter::once(v1::scene_chunk::Body::File(file))
            .chain(data)
            .map(|body| v1::SceneChunk { body: Some(body) })
    });
    Ok(std::iter::once(header).chain(rest))
}

fn header_chunk(name: &str, hash: SceneHash, source: Source) -> v1::SceneChunk {
    let scene = v1::SceneRef { name: name.to_owned(), hash: scene_hash_bytes(hash) };
    let header = v1::BundleHeader { scene: Some(scene), source: Some(source) };
    v1::SceneChunk { body: Some(v1::scene_chunk::Body::Header(header)) }
}

/// Reassembles a bundle.
#[derive(Debug)]
pub struct SceneFilesAssembler {
    hash: SceneHash,
    max_bytes: u64,
    partial: Option<Partial>,
}

#[derive(Debug)]
struct Partial {
    name: String,
    root: String,
    files_due: u32,
    /// Bytes left of the announced total.
    bytes_due: u64,
    files: Vec<(String, Bytes)>,
    names: BTreeSet<String>,
    current: Option<(String, Gather)>,
}

impl SceneFilesAssembler {
    /// Accepts the scene with this hash, in files of at most `max_bytes` together.
    pub fn new(hash: SceneHash, max_bytes: u64) -> Self {
        Self { hash, max_bytes, partial: None }
    }

    /// Adds the next chunk; `Some` if it completes the bundle.
    ///
    /// # Errors
    /// A [`WireError`] if the chunk is malformed; the stream is then unusable.
    pub fn push(&mut self, chunk: v1::SceneChunk) -> Result<Option<SceneFiles>, WireError> {
        use v1::scene_chunk::Body;
        match (required(chunk.body, "chunk.body")?, &mut self.partial) {
            (Body::Header(header), None) => return self.begin(header),
            (Body::Header(_), Some(_)) => return Err(WireError::out_of_order("scene", "a second header")),
            (_, None) => return Err(WireError::out_of_order("scene", "a file before the header")),
            (Body::File(file), Some(partial)) => partial.begin_file(file)?,
            (Body::Data(bytes), Some(partial)) => partial.push(bytes)?,
        }
        let complete = |partial: &mut Partial| partial.files_due == 0 && partial.current.is_none();
        match self.partial.take_if(complete) {
            Some(partial) => partial.finish(self.hash).map(Some),
            None => Ok(None),
        }
    }

    fn begin(&mut self, header: v1::BundleHeader) -> Result<Option<SceneFiles>, WireError> {
        let scene = required(header.scene, "bundle.scene")?;
        let hash = scene_hash(&scene.hash, "bundle.scene.hash")?;
        if hash != self.hash {
            return Err(WireError::field("bundle.scene.hash", format!("is {hash}, not {}", self.hash)));
        }
        match required(header.source, "bundle.source")? {
            Source::Procedural(spec) => {
                Ok(Some(SceneFiles { name: scene.name, hash, source: SceneFilesSource::Procedural(spec) }))
            }
            Source::Files(bundle) => {
                if bundle.total_bytes > self.max_bytes {
                    let reason =
                        format!("{} bytes exceed the {} allowed", bundle.total_bytes, self.max_bytes);
                    return Err(WireError::field("bundle.total_bytes", reason));
                }
                if bundle.files == 0 {
                    return Err(WireError::field("bundle.files", "must be at least 1"));
                }
                check_name(&bundle.root)?;
                self.partial = Some(Partial {
                    name: scene.name,
                    root: bundle.root,
                    files_due: bundle.files,
                    bytes_due: bundle.total_bytes,
                    files: Vec::new(),
                    names: BTreeSet::new(),
                    current: None,
                });
                Ok(None)
            }
        }
    }

    /// Whether the stream may end here.
    ///
    /// # Errors
    /// [`WireError::Truncated`] in the middle of a bundle.
    pub fn end(&self) -> Result<(), WireError> {
        let Some(partial) = &self.partial else { return Ok(()) };
        let pending = partial.current.as_ref().map_or(0, |(_, gather)| gather.got());
        let got = partial.files.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>() + pending;
        let current = partial.current.as_ref().map_or(0, |(_, gather)| gather.expected - gather.got());
        Err(WireError::Truncated { what: "scene", got, expected: got + current + partial.bytes_due })
    }
}

impl Partial {
    fn begin_file(&mut self, file: v1::FileHeader) -> Result<(), WireError> {
        if let Some((name, gather)) = &self.current {
            let reason = format!("{} begins before {name} has its {} bytes", file.name, gather.expected);
            return Err(WireError::out_of_order("scene", reason));
        }
        check_name(&file.name)?;
        if !self.names.insert(file.name.clone()) {
            return Err(WireError::field("file.name", format!("{} occurs twice", file.name)));
        }
        if file.bytes > self.bytes_due {
            return Err(WireError::field("file.bytes", "exceeds the bundle's total"));
        }
        self.bytes_due -= file.bytes;
        self.files_due -= 1;
        if file.bytes == 0 {
            self.files.push((file.name, Bytes::new()));
        } else {
            self.current = Some((file.name, Gather::new("scene", file.bytes)));
        }
        Ok(())
    }

    fn push(&mut self, bytes: Bytes) -> Result<(), WireError> {
        let Some((_, gather)) = &mut self.current else {
            return Err(WireError::out_of_order("scene", "bytes that belong to no file"));
        };
        gather.push(gather.got(), bytes)?;
        if let Some((name, gather)) = self.current.take_if(|(_, gather)| gather.is_complete()) {
            self.files.push((name, gather.finish()));
        }
        Ok(())
    }

    fn finish(self, hash: SceneHash) -> Result<SceneFiles, WireError> {
        if self.bytes_due != 0 {
            return Err(WireError::field("bundle.total_bytes", "is more than its files have"));
        }
        if !self.names.contains(&self.root) {
            return Err(WireError::field("bundle.root", format!("{} is not in the bundle", self.root)));
        }
        let source = SceneFilesSource::Files { root: self.root, files: self.files };
        Ok(SceneFiles { name: self.name, hash, source })
    }
}

/// Refuses names that would leave the folder a bundle is unpacked into, on any operating system.
fn check_name(name: &str) -> Result<(), InvalidField> {
    let stays = name.split('/').all(|part| !matches!(part, "" | "." | ".."))
        && !name.contains(['\\', ':', '\0'])
        && name.len() <= 1024;
    if stays {
        Ok(())
    } else {
        let reason = format!("{name:?} must be a relative path without '..', '\\' and ':'");
        Err(InvalidField::new("file.name", reason))
    }
}
