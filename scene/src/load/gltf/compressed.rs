//! Compressed geometry: buffer views by meshopt, primitives by Draco.
//!
//! The `gltf` crate knows neither extension, so both are read from the document's JSON. Each decoder gets its size from
//! the document, and a limit.

use std::collections::HashMap;

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex};
use gltf::json::accessor::ComponentType;
use meshoptimizer_rs::{Limits, Workspace, codec};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// Names of the extension by which buffer views are compressed: standard, its predecessor, and that of early files.
const MESHOPT: [&str; 3] = ["KHR_meshopt_compression", "EXT_meshopt_compression", "MESHOPT_compression"];
const DRACO: &str = "KHR_draco_mesh_compression";

/// What is compressed in a document.
#[derive(Default)]
pub(super) struct Compressed {
    /// By buffer view.
    pub(super) views: HashMap<usize, Result<Packed, String>>,
    /// By accessor.
    pub(super) accessors: HashMap<usize, DracoPart>,
}

/// A buffer view compressed by meshopt.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Packed {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    /// Bytes of an element.
    pub(super) byte_stride: usize,
    /// Number of elements.
    pub(super) count: usize,
    mode: String,
    #[serde(default)]
    filter: Option<String>,
}

/// Where Draco keeps an accessor's elements.
#[derive(Debug, Clone, Copy)]
pub(super) struct DracoPart {
    /// The buffer view of the compressed primitive.
    pub(super) view: usize,
    /// The attribute by its id in the compressed data; `None` for the indices.
    pub(super) attribute: Option<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct DracoPrimitive {
    buffer_view: usize,
    attributes: HashMap<String, u32>,
}

impl Compressed {
    /// Takes the extensions out of a document. Draco decodes strips to lists: their primitives become lists, too.
    pub(super) fn take(document: &mut Value) -> Self {
        let mut found = Self::default();
        for (index, view) in list(document, "bufferViews").iter().enumerate() {
            let extension = MESHOPT.iter().find_map(|name| view.get("extensions")?.get(name));
            if let Some(extension) = extension {
                found.views.insert(index, read(extension));
            }
        }
        let meshes = document.get_mut("meshes").and_then(Value::as_array_mut).into_iter().flatten();
        let primitives = meshes.filter_map(|mesh| mesh.get_mut("primitives")?.as_array_mut()).flatten();
        for primitive in primitives {
            let Some(extension) = primitive.get("extensions").and_then(|e| e.get(DRACO)) else { continue };
            // Without the extension, the primitive is read as it stands.
            let Ok(DracoPrimitive { buffer_view: view, attributes }) = read(extension) else { continue };
            let accessor = |value: Option<&Value>| value.and_then(Value::as_u64).map(|index| index as usize);
            for (name, id) in attributes {
                let index = accessor(primitive.get("attributes").and_then(|a| a.get(&name)));
                let part = DracoPart { view, attribute: Some(id) };
                index.map(|index| found.accessors.entry(index).or_insert(part));
            }
            if let Some(index) = accessor(primitive.get("indices")) {
                found.accessors.entry(index).or_insert(DracoPart { view, attribute: None });
            }
            if primitive.get("mode").and_then(Value::as_u64) == Some(5) {
                primitive["mode"] = 4.into();
            }
        }
        found
    }
}

fn list<'a>(document: &'a Value, name: &str) -> &'a [Value] {
    document.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn read<T: DeserializeOwned>(value: &Value) -> Result<T, String> {
    T::deserialize(value).map_err(|error| error.to_string())
}

impl Packed {
    /// Bytes of the elements when unpacked.
    pub(super) fn unpacked(&self) -> u64 {
        (self.count as u64).saturating_mul(self.byte_stride as u64)
    }

    /// Whether elements are of vertices, whose stride is that of the buffer view.
    pub(super) fn is_of_vertices(&self) -> bool {
        self.mode == "ATTRIBUTES"
    }

    /// Unpacks `bytes` and applies the filter. Allocates [`Packed::unpacked`] bytes.
    pub(super) fn unpack(&self, bytes: &[u8]) -> Result<Vec<u8>, String> {
        let &Self { count, byte_stride: stride, .. } = self;
        if count == 0 {
            return Ok(Vec::new());
        }
        let limits = Limits { max_bytes: self.unpacked() as usize, ..Limits::default() };
        let workspace = &mut Workspace::new(limits);
        let wrong = |error: meshoptimizer_rs::Error| format!("meshopt: {error}");
        let mut unpacked = match &*self.mode {
            "ATTRIBUTES" => codec::decode_vertex_buffer(count, stride, bytes, workspace),
            "TRIANGLES" => codec::decode_index_buffer(count, stride, bytes, workspace),
            "INDICES" => codec::decode_index_sequence(count, stride, bytes, workspace),
            mode => return Err(format!("meshopt: the mode {mode:?} is not known")),
        }
        .map_err(wrong)?;
        match self.filter.as_deref() {
            None | Some("NONE") => Ok(()),
            Some(filter) if !self.is_of_vertices() => {
                return Err(format!("meshopt: the filter {filter:?} is for attributes"));
            }
            Some("OCTAHEDRAL") => codec::decode_filter_oct(&mut unpacked, count, stride, workspace),
            Some("QUATERNION") => codec::decode_filter_quat(&mut unpacked, count, stride, workspace),
            Some("EXPONENTIAL") => codec::decode_filter_exp(&mut unpacked, count, stride, workspace),
            Some("COLOR") => codec::decode_filter_color(&mut unpacked, count, stride, workspace),
            Some(filter) => return Err(format!("meshopt: the filter {filter:?} is not known")),
        }
        .map_err(wrong)?;
        Ok(unpacked)
    }
}

/// Decodes a primitive, of at most `most_bytes` in memory.
pub(super) fn draco_mesh(bytes: &[u8], most_bytes: u64) -> Result<Mesh, String> {
    // A face takes three corners, each with its place in a few tables.
    let limits = DecodeLimits::default()
        .with_max_faces(most_bytes / 64)
        .with_max_points(most_bytes / 16)
        .with_max_decoded_bytes(most_bytes);
    let decode = || {
        let mut mesh = Mesh::new();
        let decoded =
            MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh);
        decoded.map(|()| mesh).map_err(|error| format!("Draco: {error}"))
    };
    // A large decoder of files from anywhere: that none of its checks is missing is not ours to prove.
    let caught = std::panic::catch_unwind(decode);
    caught.unwrap_or_else(|_| Err("Draco: the compressed data is broken".to_owned()))
}

/// Bytes that a decoded primitive takes.
pub(super) fn draco_bytes(mesh: &Mesh) -> u64 {
    let points =
        (0..mesh.num_attributes()).map(|id| mesh.attribute(id).byte_stride().max(0) as u64).sum::<u64>();
    points * mesh.num_points() as u64 + mesh.num_faces() as u64 * 12
}

/// Elements of a decoded primitive: bytes, bytes of an element, and type of a component.
pub(super) fn draco_elements(
    mesh: &Mesh,
    attribute: Option<u32>,
) -> Result<(Vec<u8>, usize, ComponentType), String> {
    let Some(id) = attribute else {
        let corners = mesh.faces().iter().flatten();
        return Ok((corners.flat_map(|corner| corner.0.to_le_bytes()).collect(), 4, ComponentType::U32));
    };
    let attribute =
        mesh.attribute_by_unique_id(id).ok_or_else(|| format!("Draco: there is no attribute {id}"))?;
    let component = match attribute.data_type() {
        DataType::Int8 => ComponentType::I8,
        DataType::Uint8 => ComponentType::U8,
        DataType::Int16 => ComponentType::I16,
        DataType::Uint16 => ComponentType::U16,
        DataType::Uint32 => ComponentType::U32,
        DataType::Float32 => ComponentType::F32,
        other => return Err(format!("Draco: elements of type {other:?}")),
    };
    let size = component.size() * usize::from(attribute.num_components());
    let mut bytes = Vec::with_capacity(size * mesh.num_points());
    for point in 0..mesh.num_points() {
        let element = element(attribute, point, size);
        bytes
            .extend_from_slice(element.ok_or_else(|| format!("Draco: point {point} has no attribute {id}"))?);
    }
    Ok((bytes, size, component))
}

fn element(attribute: &PointAttribute, point: usize, size: usize) -> Option<&[u8]> {
    let value = attribute.mapped_index(PointIndex(point as u32)).0 as usize;
    let at = value.checked_mul(usize::try_from(attribute.byte_stride()).ok()?)?;
    attribute.buffer().data().get(at..)?.get(..size)
}
