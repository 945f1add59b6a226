//! The GLB container: a header, a chunk of JSON and an optional chunk of binary data.

use super::GltfProblem;

/// The parts of a GLB file.
pub(super) struct Container<'a> {
    pub(super) json: &'a [u8],
    pub(super) binary: Option<&'a [u8]>,
}

/// Splits a GLB file. Chunks of other kinds and bytes after the stated length are ignored, as the format demands.
pub(super) fn split(bytes: &[u8]) -> Result<Container<'_>, GltfProblem> {
    let truncated = |offset, expected| GltfProblem::Container { offset, expected };
    let version = read_u32(bytes, 4).ok_or(truncated(4, "the container's version"))?;
    if version != 2 {
        return Err(GltfProblem::ContainerVersion { version });
    }
    let length = read_u32(bytes, 8).ok_or(truncated(8, "the container's length"))? as usize;
    let bytes =
        bytes.get(..length).ok_or(truncated(bytes.len(), "more bytes, as the container's length says"))?;

    let (kind, json, mut offset) = chunk(bytes, 12)?;
    if kind != b"JSON" {
        return Err(truncated(12, "a chunk of JSON"));
    }
    let mut binary = None;
    while offset < bytes.len() && binary.is_none() {
        let (kind, content, end) = chunk(bytes, offset)?;
        binary = (kind == b"BIN\0").then_some(content);
        offset = end;
    }
    Ok(Container { json, binary })
}

/// Kind, content and end of the chunk at `offset`.
fn chunk(bytes: &[u8], offset: usize) -> Result<(&[u8], &[u8], usize), GltfProblem> {
    let broken = |expected| GltfProblem::Container { offset, expected };
    let length = read_u32(bytes, offset).ok_or(broken("a chunk's length"))? as usize;
    let kind = bytes.get(offset + 4..offset + 8).ok_or(broken("a chunk's kind"))?;
    let start = offset + 8;
    let end = start.checked_add(length).ok_or(broken("a chunk within the file"))?;
    let content = bytes.get(start..end).ok_or(broken("a chunk that ends within the file"))?;
    Ok((kind, content, end))
}

fn read_u32(bytes: &[u8], offset: usize) -> Option<u32> {
    let bytes = bytes.get(offset..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*bytes))
}
