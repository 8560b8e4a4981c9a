//! Buffers, views and accessors, every bound checked before anything is allocated.

use std::collections::HashMap;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use bytes::Bytes;
use glam::Vec4;
use gltf::json;
use json::accessor::{ComponentType, Type};
use json::validation::Checked;

use super::compressed::{self, DracoPart};
use super::document::Document;
use super::lookup::{fetch, get};
use crate::load::scene_files::SceneFiles;

/// Bytes that an element takes at most while its primitive is read.
const MOST_ELEMENT: u64 = 2 * 68;

/// Reads numbers out of a document's buffers.
pub(super) struct Reader<'a> {
    pub(super) root: &'a json::Root,
    blob: Option<Bytes>,
    bundle: &'a SceneFiles,
    buffers: Vec<OnceLock<Result<Bytes, String>>>,
    /// Unpacked buffer views and Draco primitives, by buffer view.
    pub(super) document: &'a Document,
    unpacked: HashMap<usize, OnceLock<Result<Bytes, String>>>,
    primitives: HashMap<usize, OnceLock<Result<draco_core::Mesh, String>>>,
    /// Limit in bytes of an accessor without a buffer, which is all zeros.
    most_zeros: u64,
    /// Remaining bytes for unpacked views and primitives.
    left: AtomicU64,
}

/// The position and layout of an accessor's elements.
struct Elements {
    data: Bytes,
    stride: usize,
    count: usize,
    component: ComponentType,
    normalized: bool,
}

impl<'a> Reader<'a> {
    pub(super) fn new(document: &'a Document, bundle: &'a SceneFiles, most_zeros: u64) -> Self {
        let root = &document.root;
        let buffers = root.buffers.iter().map(|_| OnceLock::new()).collect();
        let compressed = &document.compressed;
        let unpacked = compressed.views.keys().map(|&view| (view, OnceLock::new())).collect();
        let primitives = compressed.accessors.values().map(|part| (part.view, OnceLock::new())).collect();
        Self {
            root,
            blob: document.blob.clone(),
            bundle,
            buffers,
            document,
            unpacked,
            primitives,
            most_zeros,
            left: AtomicU64::new(most_zeros),
        }
    }

    /// Reserves memory for decompression.
    fn take(&self, bytes: u64) -> Result<(), String> {
        let left =
            self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(bytes));
        left.map(|_| ()).map_err(|_| "it unpacks to more than its file can hold".to_owned())
    }

    fn buffer(&self, index: json::Index<json::Buffer>) -> Result<Bytes, String> {
        let number = index.value();
        let buffer = get(&self.root.buffers, index, "buffer")?;
        let loaded = self.buffers[number].get_or_init(|| {
            let bytes = match (&buffer.uri, &self.blob) {
                (Some(uri), _) => fetch(self.bundle, uri)?,
                (None, Some(blob)) if number == 0 => blob.clone(),
                (None, _) => return Err("has neither a URI nor a binary chunk".to_owned()),
            };
            let length = usize::try_from(buffer.byte_length.0).unwrap_or(usize::MAX);
            if bytes.len() < length {
                return Err(format!("has {} bytes instead of {length}", bytes.len()));
            }
            Ok(bytes.slice(..length))
        });
        loaded.clone().map_err(|reason| format!("buffer {number}: {reason}"))
    }

    /// The bytes of a view, and its stride if it sets one.
    pub(super) fn view(
        &self,
        index: json::Index<json::buffer::View>,
    ) -> Result<(Bytes, Option<usize>), String> {
        let view = get(&self.root.buffer_views, index, "buffer view")?;
        if let Some(packed) = self.document.compressed.views.get(&index.value()) {
            let stride = packed.as_ref().ok().filter(|packed| packed.is_of_vertices()).map(|p| p.byte_stride);
            let declared = view.byte_stride.map(|stride| stride.0).filter(|&stride| stride > 0);
            return Ok((self.unpacked_view(index.value())?, declared.or(stride)));
        }
        let buffer = self.buffer(view.buffer)?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let slice = slice(&buffer, start, view.byte_length.0)
            .ok_or_else(|| format!("buffer view {} does not fit in its buffer", index.value()))?;
        // A stride of zero is invalid but means none.
        Ok((slice, view.byte_stride.map(|stride| stride.0).filter(|&stride| stride > 0)))
    }

    /// The bytes of a view that meshopt has compressed.
    fn unpacked_view(&self, index: usize) -> Result<Bytes, String> {
        let (Some(packed), Some(place)) =
            (self.document.compressed.views.get(&index), self.unpacked.get(&index))
        else {
            return Err("is not compressed".to_owned());
        };
        let unpack = || {
            let packed = packed.as_ref().map_err(String::clone)?;
            let buffer = self.buffer(json::Index::new(packed.buffer as u32))?;
            let bytes = slice(&buffer, packed.byte_offset, packed.byte_length);
            let bytes = bytes.ok_or("its compressed data does not fit in its buffer")?;
            self.take(packed.unpacked())?;
            packed.unpack(&bytes).map(Bytes::from)
        };
        place.get_or_init(unpack).clone().map_err(|reason| format!("buffer view {index}: {reason}"))
    }

    /// Elements that Draco has compressed.
    fn draco(
        &self,
        part: DracoPart,
        accessor: &json::Accessor,
        components: usize,
    ) -> Result<Elements, String> {
        let place = self.primitives.get(&part.view).ok_or("is not compressed")?;
        let decode = || {
            let (bytes, _) = self.view(json::Index::new(part.view as u32))?;
            let mesh = compressed::draco_mesh(&bytes, self.left.load(Ordering::Relaxed))?;
            self.take(compressed::draco_bytes(&mesh))?;
            Ok(mesh)
        };
        let mesh = place.get_or_init(decode).as_ref().map_err(|reason: &String| reason.clone())?;
        let (data, stride, component) = compressed::draco_elements(mesh, part.attribute)?;
        let count = data.len() / stride;
        // Memory was reserved by what the accessor claims. Draco splits vertices at seams, which exporters may not count.
        self.take((count as u64).saturating_sub(accessor.count.0).saturating_mul(MOST_ELEMENT))?;
        if stride < component.size() * components {
            return Err("Draco: has another type than its use needs".to_owned());
        }
        Ok(Elements { data: data.into(), stride, count, component, normalized: accessor.normalized })
    }

    fn elements(&self, index: json::Index<json::Accessor>, types: &[Type]) -> Result<Elements, String> {
        let wrong = |reason: &str| format!("accessor {}: {reason}", index.value());
        let accessor = get(&self.root.accessors, index, "accessor")?;
        let (Checked::Valid(component), Checked::Valid(kind)) = (accessor.component_type, accessor.type_)
        else {
            return Err(wrong("unknown component or element type"));
        };
        if !types.contains(&kind) {
            return Err(wrong("has another type than its use needs"));
        }
        if let Some(&part) = self.document.compressed.accessors.get(&index.value()) {
            return self.draco(part, accessor, kind.multiplicity()).map_err(|reason| wrong(&reason));
        }
        let component = component.0;
        let size = component.size() * kind.multiplicity();
        let count = usize::try_from(accessor.count.0).unwrap_or(usize::MAX);
        let (data, stride) = match accessor.buffer_view {
            Some(view) => {
                let (bytes, stride) = self.view(view)?;
                let stride = stride.unwrap_or(size);
                if stride < size {
                    return Err(wrong("its elements overlap"));
                }
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let needed = match count {
                    0 => Some(0),
                    _ => (count - 1).checked_mul(stride).and_then(|last| last.checked_add(size)),
                };
                let needed = needed.and_then(|needed| slice(&bytes, offset, needed as u64));
                (needed.ok_or_else(|| wrong("does not fit in its buffer view"))?, stride)
            }
            None => {
                let bytes = (count as u64).saturating_mul(size as u64);
                if bytes > self.most_zeros {
                    return Err(wrong("claims more than its file can hold"));
                }
                (Bytes::from(vec![0; bytes as usize]), size)
            }
        };
        let elements = Elements { data, stride, count, component, normalized: accessor.normalized };
        match &accessor.sparse {
            Some(sparse) => self.displace(elements, sparse, size).map_err(|reason| wrong(&reason)),
            None => Ok(elements),
        }
    }

    /// Replaces the elements that a sparse accessor lists.
    fn displace(
        &self,
        base: Elements,
        sparse: &json::accessor::sparse::Sparse,
        size: usize,
    ) -> Result<Elements, String> {
        let Checked::Valid(index_type) = sparse.indices.component_type else {
            return Err("unknown type of sparse indices".to_owned());
        };
        let count = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
        let part = |view, offset: json::validation::USize64, size: usize| {
            let (bytes, _) = self.view(view)?;
            let length = count.checked_mul(size).ok_or("too many sparse elements")?;
            slice(&bytes, offset.0, length as u64)
                .ok_or_else(|| "its sparse part does not fit in its view".to_owned())
        };
        let indices = part(sparse.indices.buffer_view, sparse.indices.byte_offset, index_type.0.size())?;
        let values = part(sparse.values.buffer_view, sparse.values.byte_offset, size)?;
        let mut dense = Vec::with_capacity(base.count * size);
        for i in 0..base.count {
            dense.extend_from_slice(&base.data[i * base.stride..i * base.stride + size]);
        }
        for i in 0..count {
            let at = integer(&indices, i * index_type.0.size(), index_type.0) as usize;
            if at >= base.count {
                return Err("a sparse index is out of range".to_owned());
            }
            dense[at * size..(at + 1) * size].copy_from_slice(&values[i * size..(i + 1) * size]);
        }
        Ok(Elements { data: Bytes::from(dense), stride: size, ..base })
    }

    /// Elements of `N` numbers: floats unchanged, integers divided by their largest value if normalised. Of the
    /// allowed `types`, shorter ones are filled up with ones.
    pub(super) fn floats<const N: usize>(
        &self,
        index: json::Index<json::Accessor>,
        types: &[Type],
    ) -> Result<Vec<[f32; N]>, String> {
        let elements = self.elements(index, types)?;
        let kind = self.root.accessors[index.value()].type_;
        let width = match kind {
            Checked::Valid(kind) => kind.multiplicity().min(N),
            Checked::Invalid => 0,
        };
        let size = elements.component.size();
        let scale = match (elements.normalized, elements.component) {
            (false, _) | (_, ComponentType::F32) => 1.0,
            (_, ComponentType::I8) => 1.0 / 127.0,
            (_, ComponentType::U8) => 1.0 / 255.0,
            (_, ComponentType::I16) => 1.0 / 32767.0,
            (_, ComponentType::U16) => 1.0 / 65535.0,
            (_, ComponentType::U32) => 1.0 / 4_294_967_295.0,
        };
        // The only signed integer without an opposite also stands for −1.
        let signed = |x: f32| if elements.normalized { (x * scale).max(-1.0) } else { x };
        let number = |at: usize| {
            let bits = integer(&elements.data, at, elements.component);
            match elements.component {
                ComponentType::F32 => f32::from_bits(bits),
                ComponentType::I8 => signed(f32::from(bits as u8 as i8)),
                ComponentType::I16 => signed(f32::from(bits as u16 as i16)),
                _ => bits as f32 * scale,
            }
        };
        Ok((0..elements.count)
            .map(|i| {
                let mut element = [1.0; N];
                for (k, value) in element[..width].iter_mut().enumerate() {
                    *value = number(i * elements.stride + k * size);
                }
                element
            })
            .collect())
    }

    /// Colours, with or without alpha. Integers are fractions of their largest value, even where an exporter forgot to say so.
    pub(super) fn colors(&self, index: json::Index<json::Accessor>) -> Result<Vec<Vec4>, String> {
        let read = self.floats::<4>(index, &[Type::Vec3, Type::Vec4])?;
        let accessor = &self.root.accessors[index.value()];
        let largest = match accessor.component_type {
            Checked::Valid(kind) if !accessor.normalized => match kind.0 {
                ComponentType::U8 => 255.0,
                ComponentType::U16 => 65535.0,
                _ => 1.0,
            },
            _ => 1.0,
        };
        let has_alpha = accessor.type_ == Checked::Valid(Type::Vec4);
        let scale = Vec4::new(largest, largest, largest, if has_alpha { largest } else { 1.0 }).recip();
        Ok(read.into_iter().map(|color| Vec4::from(color) * scale).collect())
    }

    /// Unsigned integers, one per element.
    pub(super) fn integers(&self, index: json::Index<json::Accessor>) -> Result<Vec<u32>, String> {
        let elements = self.elements(index, &[Type::Scalar])?;
        match elements.component {
            ComponentType::U8 | ComponentType::U16 | ComponentType::U32 => {}
            _ => return Err(format!("accessor {}: indices must be unsigned integers", index.value())),
        }
        Ok((0..elements.count)
            .map(|i| integer(&elements.data, i * elements.stride, elements.component))
            .collect())
    }

    /// The number of elements that an accessor claims.
    pub(super) fn count(&self, index: json::Index<json::Accessor>) -> Result<usize, String> {
        let accessor = get(&self.root.accessors, index, "accessor")?;
        Ok(usize::try_from(accessor.count.0).unwrap_or(usize::MAX))
    }
}

/// An unsigned little-endian number; signed types are returned as their bits.
fn integer(data: &[u8], at: usize, component: ComponentType) -> u32 {
    match component.size() {
        1 => u32::from(data[at]),
        2 => u32::from(u16::from_le_bytes([data[at], data[at + 1]])),
        _ => u32::from_le_bytes([data[at], data[at + 1], data[at + 2], data[at + 3]]),
    }
}

fn slice(bytes: &Bytes, start: u64, length: u64) -> Option<Bytes> {
    let end = start.checked_add(length).filter(|&end| end <= bytes.len() as u64)?;
    Some(bytes.slice(start as usize..end as usize))
}
