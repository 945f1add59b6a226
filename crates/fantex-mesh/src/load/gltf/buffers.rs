//! The binary data that accessors and images read.

use std::borrow::Cow;

use super::schema::{Buffer, Root};
use super::uri::{Target, resolve};
use super::{BufferProblem, GltfProblem, get};
use crate::load::{LoadError, SourceFile, read_companion};

/// All buffers of a file.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    /// None where a buffer names no data: an error only for those who read it.
    bytes: Vec<Option<Cow<'a, [u8]>>>,
}

impl<'a> Buffers<'a> {
    /// Loads external and embedded buffers; `binary` is the binary chunk of a GLB file.
    pub(super) fn load(
        root: &'a Root,
        file: &SourceFile<'a>,
        binary: Option<&'a [u8]>,
    ) -> Result<Self, GltfProblem> {
        let mut total_bytes = 0;
        let load = |(index, buffer): (usize, &Buffer)| {
            let bytes = match &buffer.uri {
                Some(uri) => fetch(uri, file, &mut total_bytes).map(|bytes| Some(Cow::Owned(bytes))),
                None => Ok(binary.filter(|_| index == 0).map(Cow::Borrowed)),
            };
            bytes
                .and_then(|bytes| bytes.map(|bytes| shorten(bytes, buffer.byte_length)).transpose())
                .map_err(|problem| GltfProblem::Buffer { buffer: index, problem })
        };
        let bytes = root.buffers.iter().enumerate().map(load).collect::<Result<_, _>>()?;
        Ok(Self { root, bytes })
    }

    /// The bytes of a buffer view; `from` says who refers to it.
    pub(super) fn view(&self, index: usize, from: impl FnOnce() -> String) -> Result<&[u8], GltfProblem> {
        let view = get(&self.root.buffer_views, index, "buffer view", from)?;
        let bytes = get(&self.bytes, view.buffer, "buffer", || format!("buffer view {index}"))?;
        let bytes = bytes
            .as_deref()
            .ok_or(GltfProblem::Buffer { buffer: view.buffer, problem: BufferProblem::NoData })?;
        let end = view.byte_offset as u128 + view.byte_length as u128;
        let out_of_range = GltfProblem::View {
            view: index,
            buffer: view.buffer,
            offset: view.byte_offset,
            end,
            length: bytes.len(),
        };
        let end = usize::try_from(end).unwrap_or(usize::MAX);
        bytes.get(view.byte_offset..end).ok_or(out_of_range)
    }
}

/// The bytes behind a URI. `total_bytes` adds up over all buffers, because many may name one large file.
fn fetch(uri: &str, file: &SourceFile, total_bytes: &mut u64) -> Result<Vec<u8>, BufferProblem> {
    let bytes = match resolve(uri, file.folder())? {
        Target::Bytes(bytes) => bytes,
        Target::File(path) => read_companion(&path, &file.limits)
            .map_err(|error: LoadError| BufferProblem::File(Box::new(error)))?,
    };
    *total_bytes += bytes.len() as u64;
    let limit = file.limits.max_file_bytes;
    if *total_bytes > limit {
        return Err(BufferProblem::TooLarge { limit });
    }
    Ok(bytes)
}

/// Binary chunks are padded, so data may be longer than a buffer says, but never shorter.
fn shorten(bytes: Cow<'_, [u8]>, length: usize) -> Result<Cow<'_, [u8]>, BufferProblem> {
    if bytes.len() < length {
        return Err(BufferProblem::TooShort { expected: length, found: bytes.len() });
    }
    Ok(match bytes {
        Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[..length]),
        Cow::Owned(mut bytes) => {
            bytes.truncate(length);
            Cow::Owned(bytes)
        }
    })
}
