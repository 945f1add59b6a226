//! Parts: the texels of a run of groups, and how parts become an asset.
//!
//! ```text
//!  "FANPART1" | plan, groups, shard, counts, checksum | item | item | ... | means, checksum
//!
//!  item: kind, level, first page, lengths, checksum | bytes
//! ```
//!
//! Clusters lie where one process would put them: a part knows how full each level's open cluster is when its groups begin. What it adds
//! to that cluster is a *head*, stored as it is; clusters of its own are packed; those that are open at its end are *tails*. Merging
//! joins tails and heads, packs these, and copies all else.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_base::files::{exists, persist, temporary_file};
use fantex_base::{Error, Result};
use rayon::prelude::*;
use tempfile::NamedTempFile;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::{
    AssetWriter, CreateOptions, Cuts, EncodedPage, OpenCluster, PackedCluster, PageStream, Plan, WriteSummary,
};
use crate::bytes::{ByteReader, ByteWriter};
use crate::error::damaged;
use crate::layout::TilePlace;
use crate::{ByteSource, FileSource};

const SIGNATURE: &[u8; 8] = b"FANPART1";

/// Of the header: signature, plan, first group, end, shard, count, items, means, checksum.
const HEADER: usize = 8 + 16 + 4 * 4 + 8 + 8 + 8;

/// Of an item's header: kind, level, first group and page, bytes unpacked and stored, checksum.
const ITEM: usize = 4 * 6 + 8;

/// A sentence names no more shards.
const MAX_NAMED_SHARDS: usize = 8;

/// No cluster holds more, unpacked: one page of all channels may be longer than the target.
const MAX_ITEM_BYTES: u32 = 1 << 26;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ItemKind {
    /// Ends a cluster that another part began.
    Head,
    /// A cluster.
    Packed,
    /// Begins, or goes on with, a cluster that another part ends.
    Tail,
}

impl ItemKind {
    const ALL: [Self; 3] = [Self::Head, Self::Packed, Self::Tail];
}

/// Writes a part: pages of a run of groups, as [`AssetWriter`] takes them.
#[derive(Debug)]
pub struct PartWriter {
    path: PathBuf,
    force: bool,
    zstd_level: i32,
    identity: u128,
    shard: [u32; 2],
    file: NamedTempFile,
    out: BufWriter<File>,
    items: u64,
    pages: PageStream,
    summary: WriteSummary,
}

impl PartWriter {
    /// Creates the temporary file of shard `number` of `count`.
    ///
    /// # Errors
    /// The file exists and is not to be overwritten, or cannot be written; there is no such shard; the plan was made on a processor whose
    /// block encoders give other bytes.
    pub fn create(
        path: &Path,
        options: &CreateOptions,
        plan: &Plan,
        number: u32,
        count: u32,
    ) -> Result<Self> {
        let groups = plan.shard(number, count)?;
        plan.check_encoders()?;
        if !options.force && path.symlink_metadata().is_ok() {
            return Err(exists(path));
        }
        let io = |source| Error::writing(path, source);
        let mut pages = PageStream::new(path, &plan.cover, &plan.channels, groups.clone());
        for (level, cluster) in pages.open.iter_mut().enumerate() {
            let before = Cuts::new(&pages.extents[..groups.start as usize], &pages.formats, level);
            cluster.before = before.last().map_or(0, |(_, length)| length);
        }
        let file = temporary_file(path, ".tmp").map_err(io)?;
        let mut out = BufWriter::with_capacity(1 << 20, file.as_file().try_clone().map_err(io)?);
        out.write_all(&[0; HEADER]).map_err(io)?;
        Ok(Self {
            path: path.to_owned(),
            force: options.force,
            zstd_level: options.zstd_level,
            identity: plan.identity,
            shard: [number, count],
            file,
            out,
            items: 0,
            pages,
            summary: WriteSummary::default(),
        })
    }

    /// The groups whose pages it takes.
    pub fn groups(&self) -> Range<u32> {
        self.pages.groups.clone()
    }

    /// Adds pages, as [`AssetWriter::write_pages`] does.
    ///
    /// # Errors
    /// As there.
    pub fn write_pages(&mut self, batch: Vec<EncodedPage>) -> Result<()> {
        for page in batch {
            self.pages.add(&page)?;
        }
        self.write_full(ItemKind::Packed)
    }

    /// Writes what is left, makes the file durable and gives it its name. `means`: as in [`AssetWriter::finish`], of these groups.
    ///
    /// # Errors
    /// As there.
    pub fn finish(mut self, means: &[[f32; 4]]) -> Result<WriteSummary> {
        self.pages.check_finished(means.len())?;
        self.pages.close();
        self.write_full(ItemKind::Tail)?;
        let path = self.path.clone();
        let bytes = self.seal(means).map_err(|source| Error::writing(&path, source))?;
        persist(self.file.into_temp_path(), &self.path, self.force)?;
        let (pages, unpacked_texel_bytes) = (self.pages.pages, self.pages.bytes);
        Ok(WriteSummary { bytes, pages, unpacked_texel_bytes, ..self.summary })
    }

    fn write_full(&mut self, kind: ItemKind) -> Result<()> {
        let (formats, zstd_level) = (&self.pages.formats, self.zstd_level);
        let stored: Vec<io::Result<(ItemKind, usize, PackedCluster)>> = std::mem::take(&mut self.pages.full)
            .into_par_iter()
            .map(|(level, cluster)| match (kind, cluster.before) {
                (ItemKind::Packed, 0) => Ok((kind, level, cluster.pack(formats, zstd_level)?)),
                (ItemKind::Packed, _) => Ok((ItemKind::Head, level, cluster.plain())),
                _ => Ok((kind, level, cluster.plain())),
            })
            .collect();
        for item in stored {
            let written = item.and_then(|(kind, level, cluster)| self.write_item(kind, level, &cluster));
            written.map_err(|source| Error::writing(&self.path, source))?;
        }
        Ok(())
    }

    fn write_item(&mut self, kind: ItemKind, level: usize, cluster: &PackedCluster) -> io::Result<()> {
        let PackedCluster { first, raw_length, stored } = cluster;
        let mut header = ByteWriter::default();
        header.u32(ItemKind::ALL.iter().position(|k| *k == kind).unwrap_or(0) as u32);
        [level as u32, first.group, first.page, *raw_length, stored.len() as u32]
            .into_iter()
            .for_each(|n| header.u32(n));
        header.u64(item_checksum(&header.bytes, stored));
        self.out.write_all(&header.bytes)?;
        self.out.write_all(stored)?;
        self.items += 1;
        self.summary.cluster_bytes += stored.len() as u64;
        self.summary.clusters += usize::from(kind == ItemKind::Packed);
        Ok(())
    }

    /// Means and header; returns the length of the file.
    fn seal(&mut self, means: &[[f32; 4]]) -> io::Result<u64> {
        let mut end = ByteWriter::default();
        end.f32s(means.as_flattened());
        end.u64(xxh3_64(&end.bytes));
        self.out.write_all(&end.bytes)?;
        let length = self.out.stream_position()?;
        let mut header = ByteWriter::default();
        header.put(SIGNATURE);
        header.put(&self.identity.to_le_bytes());
        let groups = &self.pages.groups;
        [groups.start, groups.end, self.shard[0], self.shard[1]].into_iter().for_each(|n| header.u32(n));
        header.u64(self.items);
        header.u64(means.len() as u64);
        header.u64(xxh3_64(&header.bytes));
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(&header.bytes)?;
        self.out.flush()?;
        self.out.get_ref().sync_all()?;
        Ok(length)
    }
}

impl OpenCluster {
    /// The bytes as they are, channel after channel.
    fn plain(&self) -> PackedCluster {
        let stored = self.channels.concat();
        PackedCluster { first: self.first, raw_length: stored.len() as u32, stored }
    }
}

/// Of an item's header, but for the checksum, and its bytes.
fn item_checksum(header: &[u8], stored: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(header);
    hash.update(stored);
    hash.digest()
}

// ---- Merging.

/// Bytes of a part that are read at once: enough for several requests to a server. Only one part at a time has them.
const READ_AHEAD: u64 = 24 << 20;

/// A part that is read from front to back.
struct PartReader {
    path: PathBuf,
    source: Arc<dyn ByteSource>,
    /// Read ahead; those before `taken` are done with.
    buffer: Vec<u8>,
    taken: usize,
    /// Where the source is read next.
    offset: u64,
    groups: Range<u32>,
    shard: [u32; 2],
    items: u64,
    means: u64,
    /// Of all its bytes.
    length: u64,
}

struct Item {
    kind: ItemKind,
    level: usize,
    cluster: PackedCluster,
}

impl PartReader {
    fn open(source: &Arc<dyn ByteSource>, plan: &Plan) -> Result<Self> {
        let path = source.location();
        let failed = |error| Error::reading(path, error);
        let mut bytes = [0; HEADER];
        let count = source.read_at(&mut bytes, 0).map_err(failed)?;
        if count < HEADER || !bytes.starts_with(SIGNATURE) {
            let sentence =
                format!("{} is no part of a bake; give files that were baked from shards", path.display());
            return Err(Error::malformed(sentence).with_path(path));
        }
        let (rest, checksum) = bytes.split_at(HEADER - 8);
        if xxh3_64(rest).to_le_bytes() != checksum {
            return Err(damaged(path, "its header has a wrong checksum; bake it anew"));
        }
        if rest[8..24] != plan.identity.to_le_bytes() {
            let sentence = format!("{} belongs to another plan than {}", path.display(), plan.path.display());
            return Err(Error::invalid(sentence).with_path(path));
        }
        let mut header = ByteReader::new(&rest[24..]);
        let mut number = || header.u32("the header");
        let (groups, shard) = (number()?..number()?, [number()?, number()?]);
        let (items, means) = (header.u64("the header")?, header.u64("the header")?);
        let expected = (groups.len() * plan.channels.len()) as u64;
        if groups.end as usize > plan.cover.groups.len() || means != expected {
            return Err(damaged(path, "its header names groups that the plan does not have"));
        }
        Ok(Self {
            path: path.to_owned(),
            length: source.length().map_err(failed)?,
            source: Arc::clone(source),
            buffer: Vec::new(),
            taken: 0,
            offset: HEADER as u64,
            groups,
            shard,
            items,
            means,
        })
    }

    fn damaged(&self) -> Error {
        damaged(&self.path, "a part of it has a wrong length or checksum; bake it anew")
    }

    fn exactly(&mut self, bytes: &mut [u8]) -> Result<()> {
        let mut filled = 0;
        while filled < bytes.len() {
            if self.taken == self.buffer.len() {
                self.read_ahead()?;
            }
            let count = (bytes.len() - filled).min(self.buffer.len() - self.taken);
            bytes[filled..filled + count].copy_from_slice(&self.buffer[self.taken..self.taken + count]);
            filled += count;
            self.taken += count;
        }
        Ok(())
    }

    /// Fills the buffer with the next bytes, at least one.
    fn read_ahead(&mut self) -> Result<()> {
        let left = self.length.saturating_sub(self.offset);
        self.buffer.resize(left.min(READ_AHEAD) as usize, 0);
        self.taken = 0;
        match self.source.read_exact_at(&mut self.buffer, self.offset) {
            Ok(()) if left > 0 => {}
            Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
                return Err(Error::reading(&self.path, error));
            }
            _ => return Err(self.damaged()),
        }
        self.offset += self.buffer.len() as u64;
        Ok(())
    }

    fn item(&mut self, levels: usize) -> Result<Item> {
        let mut bytes = [0; ITEM];
        self.exactly(&mut bytes)?;
        let mut header = ByteReader::new(&bytes);
        let mut number = || header.u32("an item");
        let [kind, level, group, page] = [number()?, number()?, number()?, number()?];
        let [raw_length, stored_length] = [number()?, number()?];
        let checksum = header.u64("an item")?;
        let kind = ItemKind::ALL.get(kind as usize).copied();
        let is_sound =
            raw_length <= MAX_ITEM_BYTES && stored_length <= MAX_ITEM_BYTES && (level as usize) < levels;
        let (Some(kind), true) = (kind, is_sound) else { return Err(self.damaged()) };
        let mut stored = vec![0; stored_length as usize];
        self.exactly(&mut stored)?;
        if item_checksum(&bytes[..ITEM - 8], &stored) != checksum {
            return Err(self.damaged());
        }
        let first = TilePlace { group, page };
        Ok(Item { kind, level: level as usize, cluster: PackedCluster { first, raw_length, stored } })
    }

    /// What follows the items, the end of the part.
    fn means(&mut self) -> Result<Vec<[f32; 4]>> {
        let mut bytes = vec![0; self.means as usize * 16];
        let mut checksum = [0; 8];
        self.exactly(&mut bytes)?;
        self.exactly(&mut checksum)?;
        let is_at_end = self.taken == self.buffer.len() && self.offset == self.length;
        if xxh3_64(&bytes).to_le_bytes() != checksum || !is_at_end {
            return Err(self.damaged());
        }
        self.buffer = Vec::new();
        self.taken = 0;
        Ok(crate::bytes::values_from_bytes(&bytes))
    }
}

/// Merges the parts of a plan, given in any order, into the asset that one process would have baked. Parts are copied one after the other;
/// memory does not grow with them. Nothing is written where `output` is `None`: the parts are checked. `watch` is told often how many bytes of
/// how many have been read, and may end the merge.
///
/// # Errors
/// A part is missing, there twice, of another plan, or damaged; the output exists or cannot be written; the merge was ended.
pub fn merge_parts(
    plan: &Plan,
    parts: &[PathBuf],
    output: Option<(&Path, &CreateOptions)>,
    watch: &dyn Fn(u64, u64) -> ControlFlow<()>,
) -> Result<WriteSummary> {
    let open = |path: &PathBuf| -> Result<Arc<dyn ByteSource>> {
        Ok(Arc::new(FileSource::open(path).map_err(|error| Error::reading(path, error))?))
    };
    merge_sources(plan, &parts.iter().map(open).collect::<Result<Vec<_>>>()?, output, watch)
}

/// As [`merge_parts`], of parts that may lie anywhere.
///
/// # Errors
/// As there; or a source cannot be read.
pub fn merge_sources(
    plan: &Plan,
    parts: &[Arc<dyn ByteSource>],
    output: Option<(&Path, &CreateOptions)>,
    watch: &dyn Fn(u64, u64) -> ControlFlow<()>,
) -> Result<WriteSummary> {
    let mut readers = parts.iter().map(|part| PartReader::open(part, plan)).collect::<Result<Vec<_>>>()?;
    readers.sort_by_key(|reader| (reader.groups.start, reader.groups.end));
    check_complete(plan, &readers)?;
    let (mut done, total) = (0, readers.iter().map(|reader| reader.length).sum());
    let mut writer = match output {
        Some((path, options)) => {
            Some(AssetWriter::create(path, options, &plan.mesh, &plan.cover, &plan.channels)?)
        }
        None => None,
    };
    let stream = PageStream::new(Path::new(""), &plan.cover, &plan.channels, 0..0);
    let (levels, channels) = (stream.open.len(), stream.formats.len());
    let zstd_level = output.map_or(1, |(_, options)| options.zstd_level);
    let mut open: Vec<OpenCluster> = (0..levels).map(|_| OpenCluster::empty(channels)).collect();
    let mut expected: Vec<Cuts<'_>> =
        (0..levels).map(|level| Cuts::new(&stream.extents, &stream.formats, level)).collect();
    let (mut clusters, mut means) = (0, Vec::new());
    let mut put = |writer: &mut Option<AssetWriter>, level: usize, cluster: &PackedCluster, path: &Path| {
        clusters += 1;
        if expected[level].next() != Some((cluster.first, cluster.raw_length as usize)) {
            return Err(damaged(path, "its texels are not those that were planned; bake it anew"));
        }
        writer.as_mut().map_or(Ok(()), |writer| writer.put(level, cluster))
    };
    for reader in &mut readers {
        for _ in 0..reader.items {
            if watch(done, total).is_break() {
                return Err(Error::cancelled("merging was ended; nothing was written"));
            }
            let Item { kind, level, cluster } = reader.item(levels)?;
            done += (ITEM + cluster.stored.len()) as u64;
            if kind == ItemKind::Packed {
                put(&mut writer, level, &cluster, &reader.path)?;
                continue;
            }
            if !open[level].extend(&cluster, &stream.formats) {
                return Err(reader.damaged());
            }
            let full = if kind == ItemKind::Head { open[level].take() } else { None };
            if let Some(full) = full {
                let packed =
                    full.pack(&stream.formats, zstd_level).map_err(|e| Error::reading(&reader.path, e))?;
                put(&mut writer, level, &packed, &reader.path)?;
            }
        }
        means.extend(reader.means()?);
    }
    for (level, cluster) in open.iter_mut().enumerate() {
        if let Some(full) = cluster.take() {
            let packed = full.pack(&stream.formats, zstd_level).map_err(|e| Error::reading(&plan.path, e))?;
            put(&mut writer, level, &packed, &plan.path)?;
        }
    }
    if expected.iter_mut().any(|cuts| cuts.next().is_some()) {
        let sentence = "the parts have fewer texels than were planned; bake them anew";
        return Err(Error::damaged(sentence).with_path(&plan.path));
    }
    match writer {
        Some(writer) => writer.seal(&means),
        None => Ok(WriteSummary { clusters, ..WriteSummary::default() }),
    }
}

/// That each group has one part.
fn check_complete(plan: &Plan, readers: &[PartReader]) -> Result<()> {
    let mut end = 0;
    let mut before: Option<&PartReader> = None;
    let count = readers.first().map_or(1, |reader| reader.shard[1]);
    for reader in readers.iter().filter(|reader| !reader.groups.is_empty()) {
        let Range { start, end: own_end } = reader.groups;
        if let Some(other) = before.filter(|_| start < end) {
            let paths = [&reader.path, &other.path].map(|path| path.display());
            let sentence = format!("{} and {} have the same tiles; give one of them", paths[0], paths[1]);
            return Err(Error::invalid(sentence).with_path(&reader.path));
        }
        if start > end {
            return Err(missing(plan, end..start, count));
        }
        (end, before) = (own_end, Some(reader));
    }
    let groups = plan.cover.groups.len() as u32;
    if end < groups { Err(missing(plan, end..groups, count)) } else { Ok(()) }
}

/// Names the shards that would fill a gap.
fn missing(plan: &Plan, gap: Range<u32>, count: u32) -> Error {
    let mut names: Vec<String> = Vec::new();
    let mut from = gap.start;
    // There may be more shards than tiles.
    while let Some((number, own)) = shard_from(plan, from, count).filter(|(_, own)| own.end <= gap.end) {
        if names.len() == MAX_NAMED_SHARDS {
            names.push("...".into());
            break;
        }
        names.push(format!("{number}/{count}"));
        from = own.end;
    }
    let which = if names.is_empty() { String::new() } else { format!(" (shard {})", names.join(", ")) };
    Error::not_found(format!(
        "the part with tiles {} to {} is missing{which}; bake it from {}",
        gap.start,
        gap.end - 1,
        plan.path.display()
    ))
}

/// The first shard that has groups, all of them from `group` on.
fn shard_from(plan: &Plan, group: u32, count: u32) -> Option<(u32, Range<u32>)> {
    let own = |number| plan.shard(number, count).unwrap_or_default();
    // Where shards end ascends with their numbers.
    let ending_after = |group: u32| {
        let (mut low, mut high) = (1, count);
        while low < high {
            let middle = low + (high - low) / 2;
            (low, high) = if own(middle).end > group { (low, middle) } else { (middle + 1, high) };
        }
        Some((low, own(low))).filter(|(_, own)| own.end > group)
    };
    let (number, own) = ending_after(group)?;
    if own.start >= group { Some((number, own)) } else { ending_after(own.end) }
}

impl OpenCluster {
    /// Adds bytes that are stored as they are; false where they cannot be whole pages of a cluster.
    fn extend(&mut self, cluster: &PackedCluster, formats: &[crate::TexelFormat]) -> bool {
        let per_block: usize = formats.iter().map(|format| format.block_bytes()).sum();
        let blocks = cluster.stored.len() / per_block;
        if blocks * per_block != cluster.stored.len()
            || self.length() + cluster.stored.len() > MAX_ITEM_BYTES as usize
        {
            return false;
        }
        if self.length() == 0 {
            self.first = cluster.first;
        }
        let mut rest = cluster.stored.as_slice();
        for (stream, format) in self.channels.iter_mut().zip(formats) {
            let (own, after) = rest.split_at(blocks * format.block_bytes());
            stream.extend_from_slice(own);
            rest = after;
        }
        true
    }
}
