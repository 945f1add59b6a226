//! The GLB container: a header, a chunk of JSON and an optional chunk of binary data.

use std::borrow::Cow;
use std::cell::OnceCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine as _, alphabet};
use fantex_base::input::{self, Held};
use fantex_base::{Error, Result, counted};

use super::schema::{Accessor, Buffer, Root, Sparse};
use super::{Document, get, meshopt};
use crate::load::{HeldBytes, SourceFile, locate, read_file};

/// Splits a GLB file into its JSON and its binary data. Chunks of other kinds and bytes after the stated length are ignored, as the format demands.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>)> {
    let version = read_u32(bytes, 4).ok_or_else(|| damaged(4, "the container's version"))?;
    if version != 2 {
        let sentence = format!("it is a GLB container of version {version}, but fantex reads version 2");
        return Err(Error::unsupported(sentence));
    }
    let length = read_u32(bytes, 8).ok_or_else(|| damaged(8, "the container's length"))? as usize;
    let bytes = bytes
        .get(..length)
        .ok_or_else(|| damaged(bytes.len(), "more bytes, as the container's length says"))?;

    let (kind, json, mut offset) = chunk(bytes, 12)?;
    if kind != b"JSON" {
        return Err(damaged(12, "a chunk of JSON"));
    }
    let mut binary = None;
    while offset < bytes.len() && binary.is_none() {
        let (kind, content, end) = chunk(bytes, offset)?;
        binary = (kind == b"BIN\0").then_some(content);
        offset = end;
    }
    Ok((json, binary))
}

fn chunk(bytes: &[u8], offset: usize) -> Result<(&[u8], &[u8], usize)> {
    let broken = |expected| damaged(offset, expected);
    let length = read_u32(bytes, offset).ok_or_else(|| broken("a chunk's length"))? as usize;
    let kind = bytes.get(offset + 4..offset + 8).ok_or_else(|| broken("a chunk's kind"))?;
    let start = offset + 8;
    let end = start.checked_add(length).ok_or_else(|| broken("a chunk within the file"))?;
    let content = bytes.get(start..end).ok_or_else(|| broken("a chunk that ends within the file"))?;
    Ok((kind, content, end))
}

fn damaged(offset: usize, expected: &str) -> Error {
    Error::malformed(format!("at byte {offset}: expected {expected}; the file is truncated or damaged"))
}

fn read_u32(bytes: &[u8], offset: usize) -> Option<u32> {
    let bytes = bytes.get(offset..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*bytes))
}

// Bytes behind URIs: data URIs and relative paths.

pub(super) enum Target {
    Bytes(HeldBytes),
    File(PathBuf),
}

/// Exporters disagree about the padding at the end.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Decodes a data URI, or resolves a path relative to the file that names it.
pub(super) fn resolve(uri: &str, owner: &Path) -> Result<Target> {
    if let Some((scheme, data)) = uri.split_once(':')
        && scheme.eq_ignore_ascii_case("data")
    {
        return decode_data(data).map(Target::Bytes);
    }
    let not_relative = || {
        let uri: String = uri.chars().take(60).collect();
        Error::unsupported(format!(
            "its URI {uri:?} is not relative; put the file beside the model and name it by a relative path"
        ))
    };
    if uri.starts_with('/') || uri.starts_with('\\') || has_scheme(uri) {
        return Err(not_relative());
    }
    let decoded = percent_encoding::percent_decode_str(uri).decode_utf8_lossy();
    // A name that is absolute only once decoded must not get around the check above.
    let path = Path::new(decoded.as_ref());
    if decoded.is_empty() || decoded.starts_with(['/', '\\']) || path.is_absolute() {
        return Err(not_relative());
    }
    locate(owner, path).map(Target::File)
}

/// `[media type][;base64],DATA`
fn decode_data(data: &str) -> Result<HeldBytes> {
    let broken = |why| Error::malformed(format!("its data URI is broken: {why}"));
    let (media_type, content) = data.split_once(',').ok_or_else(|| broken("it has no comma"))?;
    let held = input::reserve("its data URI", content.len() as u64)?;
    // A copy only where something is encoded.
    let content = Cow::from(percent_encoding::percent_decode_str(content));
    let is_base64 = media_type.rsplit_once(';').is_some_and(|(_, last)| last.eq_ignore_ascii_case("base64"));
    let bytes = match is_base64 {
        true => BASE64.decode(content.trim_ascii_end()).map_err(|_| broken("it is not base64"))?,
        false => content.into_owned(),
    };
    Ok(HeldBytes { bytes, _held: held })
}

/// True for `http:`, `file:`, `C:` and the like.
fn has_scheme(uri: &str) -> bool {
    uri.split_once(':').is_some_and(|(scheme, _)| {
        !scheme.is_empty() && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    })
}

// The binary data that accessors and images read.

/// What is wrong with a buffer that names neither a URI nor, being the first of a GLB file, has its binary chunk; for images no
/// buffer view either.
pub(super) const NO_DATA: &str =
    "it names no data (no URI, and no binary chunk or buffer view stands for it)";

pub(super) struct Buffers<'a> {
    root: &'a Root,
    limit: u64,
    /// None where a buffer names no data: an error only where it is read.
    contents: Vec<Option<Content<'a>>>,
    /// Of each buffer view that is compressed, once it was read.
    decompressed: Vec<OnceCell<(Vec<u8>, Held)>>,
}

impl<'a> Buffers<'a> {
    /// Loads external and embedded buffers; `binary` is the binary chunk of a GLB file.
    pub(super) fn load(root: &'a Root, file: &SourceFile<'a>, binary: Option<&'a [u8]>) -> Result<Self> {
        let mut fetched = Fetched { file, total_bytes: 0, files: HashMap::new() };
        let load = |(index, buffer): (usize, &Buffer)| {
            let bytes = match &buffer.uri {
                _ if buffer.extensions.is_fallback() => Ok(None),
                Some(uri) => fetched.fetch(uri).map(|bytes| Some(ContentBytes::Fetched(bytes))),
                None => Ok(binary.filter(|_| index == 0).map(ContentBytes::Binary)),
            };
            bytes
                .and_then(|bytes| bytes.map(|bytes| Content::new(bytes, buffer.byte_length)).transpose())
                .map_err(|error| error.context(format!("buffer {index}")))
        };
        let contents = root.buffers.iter().enumerate().map(load).collect::<Result<_, _>>()?;
        let decompressed = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
        Ok(Self { root, limit: file.limits.max_file_bytes, contents, decompressed })
    }

    /// The bytes of a buffer view; `from` names the referrer.
    pub(super) fn view(&self, index: usize, from: impl FnOnce() -> String) -> Result<&[u8]> {
        let view = get(&self.root.buffer_views, index, "buffer view", from)?;
        let Some(meshopt) = view.extensions.meshopt() else {
            return self.range(index, [view.buffer, view.byte_offset, view.byte_length]);
        };
        let cell = &self.decompressed[index];
        if let Some((bytes, _)) = cell.get() {
            return Ok(bytes);
        }
        let source = self.range(index, [meshopt.buffer, meshopt.byte_offset, meshopt.byte_length])?;
        let failed = |error: Error| error.context(format!("buffer view {index}"));
        let length = meshopt.count.checked_mul(meshopt.byte_stride);
        if length != Some(view.byte_length) {
            let [length, stride] = [view.byte_length, meshopt.byte_stride].map(|n| counted(n, "byte"));
            let elements = counted(meshopt.count, "element");
            return Err(failed(Error::malformed(format!(
                "it has {length}, but {elements} of {stride} in compressed form"
            ))));
        }
        if view.byte_length as u64 > self.limit {
            let bytes = counted(view.byte_length, "byte");
            let sentence = format!("it has {bytes}, more than the limit of {}", self.limit);
            return Err(failed(Error::too_large(sentence)));
        }
        let held = input::reserve(format_args!("buffer view {index}"), view.byte_length as u64)?;
        let bytes = meshopt::decode(meshopt, source).map_err(failed)?;
        Ok(&cell.get_or_init(|| (bytes, held)).0)
    }

    /// So many bytes of a buffer from an offset on, for buffer view `index`.
    fn range(&self, index: usize, [buffer, offset, length]: [usize; 3]) -> Result<&[u8]> {
        let content = get(&self.contents, buffer, "buffer", || format!("buffer view {index}"))?.as_ref();
        let bytes = content.ok_or_else(|| Error::malformed(format!("buffer {buffer}: {NO_DATA}")))?.bytes();
        let end = offset as u128 + length as u128;
        bytes.get(offset..usize::try_from(end).unwrap_or(usize::MAX)).ok_or_else(|| {
            Error::malformed(format!(
                "buffer view {index} covers bytes {offset} to {end} of buffer {buffer}, which has {}",
                bytes.len()
            ))
        })
    }
}

/// The bytes of a buffer.
struct Content<'a> {
    bytes: ContentBytes<'a>,
    /// What of them is the buffer's.
    length: usize,
}

enum ContentBytes<'a> {
    /// The binary chunk of a GLB file.
    Binary(&'a [u8]),
    Fetched(Rc<HeldBytes>),
}

impl<'a> Content<'a> {
    /// Binary chunks are padded, so data may be longer than a buffer says, but never shorter.
    fn new(bytes: ContentBytes<'a>, length: usize) -> Result<Self> {
        let content = Self { bytes, length };
        let found = content.all().len();
        if found < length {
            let expected = counted(length, "byte");
            return Err(Error::malformed(format!("it should have {expected}, but there are {found}")));
        }
        Ok(content)
    }

    fn all(&self) -> &[u8] {
        match &self.bytes {
            ContentBytes::Binary(bytes) => bytes,
            ContentBytes::Fetched(bytes) => bytes,
        }
    }

    fn bytes(&self) -> &[u8] {
        &self.all()[..self.length]
    }
}

/// What was read for buffers so far.
struct Fetched<'a> {
    file: &'a SourceFile<'a>,
    /// Of all buffers, each file counted once.
    total_bytes: u64,
    /// Many buffers may name one large file, which is read once.
    files: HashMap<PathBuf, Rc<HeldBytes>>,
}

impl Fetched<'_> {
    /// The bytes behind a URI.
    fn fetch(&mut self, uri: &str) -> Result<Rc<HeldBytes>> {
        let (bytes, path) = match resolve(uri, self.file.path)? {
            Target::Bytes(bytes) => (bytes, None),
            Target::File(path) => match self.files.get(&path) {
                Some(bytes) => return Ok(Rc::clone(bytes)),
                None => (read_file(&path, &self.file.limits)?, Some(path)),
            },
        };
        self.total_bytes += bytes.len() as u64;
        let limit = self.file.limits.max_file_bytes;
        if self.total_bytes > limit {
            return Err(Error::too_large(format!(
                "the buffers up to this one have more than {}, the limit for one file",
                counted(limit, "byte")
            )));
        }
        let bytes = Rc::new(bytes);
        self.files.extend(path.map(|path| (path, Rc::clone(&bytes))));
        Ok(bytes)
    }
}

// Accessors: typed, strided, possibly sparse views of buffers. Every range is checked before it is read.

/// Elements of an accessor without a buffer view. They take no bytes in the file, so only this limits the memory that a
/// few letters of JSON can claim.
const MAX_ZEROED_ELEMENTS: usize = 1 << 24;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    /// From the number that glTF inherited from OpenGL.
    fn from_code(code: u64) -> Result<Self> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(Error::malformed(format!("unknown component type {code}"))),
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    fn name(self) -> &'static str {
        match self {
            Self::I8 => "signed bytes",
            Self::U8 => "bytes",
            Self::I16 => "16-bit integers",
            Self::U16 => "unsigned 16-bit integers",
            Self::U32 => "unsigned 32-bit integers",
            Self::F32 => "floats",
        }
    }
}

/// Elements at regular distances, in range.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    count: usize,
}

impl<'a> Elements<'a> {
    /// Each element's bytes (at least its own, perhaps up to the next).
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> {
        self.bytes.chunks(self.stride).take(self.count)
    }
}

pub(super) struct Reader<'a> {
    document: &'a Document<'a>,
    index: usize,
    accessor: &'a Accessor,
    component: Component,
    pub(super) width: usize,
}

impl<'a> Reader<'a> {
    /// Looks an accessor up; `used_for` names its use in messages.
    pub(super) fn new(document: &'a Document, index: usize, used_for: &str) -> Result<Self> {
        let accessor = get(&document.root.accessors, index, "accessor", || used_for.to_owned())?;
        let failed = |error: Error| error.context(format!("accessor {index}"));
        if let Some(unpacked) = document.unpacked[index].get() {
            let (component, width) = (unpacked.component, unpacked.width);
            return Ok(Self { document, index, accessor, component, width });
        }
        let component = Component::from_code(accessor.component_type).map_err(failed)?;
        let width = match accessor.shape.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            // Other matrices serve nothing that is read.
            _ => 0,
        };
        let limits = &document.file.limits;
        let limit = match accessor.buffer_view {
            Some(_) => limits.max_positions.max(limits.max_triangles.saturating_mul(3)),
            None => MAX_ZEROED_ELEMENTS,
        };
        if accessor.count > limit {
            let count = accessor.count;
            let sentence = format!("it announces {count} elements, more than the limit of {limit}");
            return Err(failed(Error::too_large(sentence)));
        }
        Ok(Self { document, index, accessor, component, width })
    }

    pub(super) fn count(&self) -> usize {
        match self.document.unpacked[self.index].get() {
            Some(unpacked) => unpacked.bytes.len() / (self.width * self.component.size()).max(1),
            None => self.accessor.count,
        }
    }

    /// Elements of `N` numbers. Integers are divided by their largest value where the accessor says so, or where
    /// `always_normalized` does.
    pub(super) fn read_floats<const N: usize>(
        &self,
        used_for: &str,
        expected: &'static str,
        always_normalized: bool,
    ) -> Result<Vec<[f32; N]>> {
        if self.width != N {
            return Err(self.wrong_shape(used_for, expected));
        }
        let normalized = self.accessor.normalized || always_normalized;
        match self.component {
            Component::F32 => self.read(f32::from_le_bytes),
            Component::I8 if normalized => self.read(|b| (f32::from(i8::from_le_bytes(b)) / 127.0).max(-1.0)),
            Component::U8 if normalized => self.read(|b| f32::from(u8::from_le_bytes(b)) / 255.0),
            Component::I16 if normalized => {
                self.read(|b| (f32::from(i16::from_le_bytes(b)) / 32767.0).max(-1.0))
            }
            Component::U16 if normalized => self.read(|b| f32::from(u16::from_le_bytes(b)) / 65535.0),
            Component::I8 => self.read(|b| f32::from(i8::from_le_bytes(b))),
            Component::U8 => self.read(|b| f32::from(u8::from_le_bytes(b))),
            Component::I16 => self.read(|b| f32::from(i16::from_le_bytes(b))),
            Component::U16 => self.read(|b| f32::from(u16::from_le_bytes(b))),
            Component::U32 => Err(self.wrong_shape(used_for, expected)),
        }
    }

    pub(super) fn read_indices(&self, used_for: &str) -> Result<Vec<u32>> {
        if self.width != 1 || !self.component.is_index() {
            return Err(self.wrong_shape(used_for, "single unsigned integers"));
        }
        let elements: Vec<[u32; 1]> = match self.component {
            Component::U8 => self.read(|b: [u8; 1]| u32::from(b[0]))?,
            Component::U16 => self.read(|b| u32::from(u16::from_le_bytes(b)))?,
            _ => self.read(u32::from_le_bytes)?,
        };
        Ok(elements.into_iter().map(|[index]| index).collect())
    }

    fn wrong_shape(&self, used_for: &str, expected: &str) -> Error {
        let (shape, numbers) = (&self.accessor.shape, self.component.name());
        self.malformed(format!("it holds {shape} {numbers}, but {used_for} needs {expected}"))
    }

    fn malformed(&self, sentence: String) -> Error {
        Error::malformed(sentence).context(self.label())
    }

    /// Decodes all elements; `B` is the number's size in bytes.
    fn read<const N: usize, const B: usize, T: Copy + Default>(
        &self,
        decode: impl Fn([u8; B]) -> T,
    ) -> Result<Vec<[T; N]>> {
        let element = |bytes: &[u8]| -> [T; N] {
            let (numbers, _) = bytes.as_chunks::<B>();
            std::array::from_fn(|k| decode(numbers[k]))
        };
        let accessor = self.accessor;
        if let Some(unpacked) = self.document.unpacked[self.index].get() {
            return Ok(unpacked.bytes.chunks_exact(N * B).map(element).collect());
        }
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let stride =
                    get(&self.document.root.buffer_views, view, "buffer view", || self.label())?.byte_stride;
                self.elements(view, accessor.byte_offset, accessor.count, N * B, stride)?
                    .iter()
                    .map(element)
                    .collect()
            }
            // Without a view all elements are zero, until sparse data replace some.
            None => vec![[T::default(); N]; accessor.count],
        };
        if let Some(sparse) = &accessor.sparse {
            self.replace(sparse, N * B, &mut values, element)?;
        }
        Ok(values)
    }

    fn replace<V>(
        &self,
        sparse: &Sparse,
        element_bytes: usize,
        values: &mut [V],
        decode: impl Fn(&[u8]) -> V,
    ) -> Result<()> {
        let component = Component::from_code(sparse.indices.component_type)
            .map_err(|error| error.context(self.label()))?;
        if !component.is_index() {
            return Err(self.malformed(format!("unknown component type {}", sparse.indices.component_type)));
        }
        let (indices, new) = (&sparse.indices, &sparse.values);
        let indices =
            self.elements(indices.buffer_view, indices.byte_offset, sparse.count, component.size(), None)?;
        let new = self.elements(new.buffer_view, new.byte_offset, sparse.count, element_bytes, None)?;
        for (index, new) in indices.iter().zip(new.iter()) {
            let index = index.iter().rev().fold(0u32, |index, &byte| index << 8 | u32::from(byte));
            let count = values.len();
            let slot = values.get_mut(index as usize);
            let out_of_range =
                || self.malformed(format!("its sparse data replace element {index}, but it has {count}"));
            *slot.ok_or_else(out_of_range)? = decode(new);
        }
        Ok(())
    }

    fn elements(
        &self,
        view: usize,
        offset: usize,
        count: usize,
        element: usize,
        stride: Option<usize>,
    ) -> Result<Elements<'_>> {
        let bytes = self.document.buffers.view(view, || self.label())?;
        let stride = stride.unwrap_or(element);
        if stride < element {
            let stride = counted(stride, "byte");
            return Err(self.malformed(format!(
                "buffer view {view} has a stride of {stride}, shorter than an element of {element}"
            )));
        }
        // The last element may end before the stride does.
        let needed = match count {
            0 => 0,
            _ => (count as u128 - 1) * stride as u128 + element as u128,
        };
        let available = bytes.get(offset..).unwrap_or_default();
        if needed > available.len() as u128 {
            let (elements, available) = (counted(count, "element"), available.len());
            let needed = counted(needed, "byte");
            return Err(self.malformed(format!(
                "it needs {needed} for {elements}, but buffer view {view} has {available} from its offset on"
            )));
        }
        Ok(Elements { bytes: &available[..needed as usize], stride, count })
    }

    fn label(&self) -> String {
        format!("accessor {}", self.index)
    }
}
