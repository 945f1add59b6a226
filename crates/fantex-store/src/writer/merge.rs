//! Merging: how parts become an asset.
//!
//! Parts are read one after the other: what says where their clusters lie, then heads and tails, then the clusters from the first to the last. Or
//! these are not read: they stand in a part as they will in the asset, so that others may copy them ([`merge_with_gaps`]).

use std::io;
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_base::zstandard::packed_bound;
use fantex_base::{Error, Result};
use xxhash_rust::xxh3::xxh3_64;

use super::part::{HEADER, ITEM, ItemKind};
use super::{
    AssetWriter, CLUSTER_TARGET_BYTES, CreateOptions, Cuts, OpenCluster, PackedCluster, PageStream, Plan,
    WriteSummary,
};
use crate::bytes::{ByteReader, values_from_bytes};
use crate::directory::{ALIGNMENT, ClusterEntry};
use crate::error::damaged;
use crate::header::PART_SIGNATURE;
use crate::layout::{PAGE, TilePlace, page_grid};
use crate::limits::MAX_CLUSTER_BYTES;
use crate::{ByteSource, PathSource, TexelFormat, cover_level_count};

/// Bytes of a part that are read at once: enough for several requests to a server. Only one part at a time has them.
const READ_AHEAD: u64 = 24 << 20;

/// A sentence names no more shards.
const MAX_NAMED_SHARDS: usize = 8;

/// Clusters that an asset has as they lie in a part, with what stands between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartRun {
    /// Which part, as they were given.
    pub part: usize,
    /// Where the first one starts in the part.
    pub offset: u64,
    /// Where they lie in the asset.
    pub range: Range<u64>,
}

/// The head of a part.
struct PartReader {
    /// Which, as they were given.
    part: usize,
    path: PathBuf,
    source: Arc<dyn ByteSource>,
    groups: Range<u32>,
    shard: [u32; 2],
    items: u64,
    /// Where the items stand.
    directory: u64,
    /// Of all its bytes.
    length: u64,
}

/// What a part has, but for its clusters.
struct Contents {
    items: Vec<Item>,
    /// Heads and tails, one after the other.
    loose: Vec<u8>,
    means: Vec<[f32; 4]>,
}

struct Item {
    kind: ItemKind,
    level: usize,
    /// With the place in the part.
    entry: ClusterEntry,
}

impl Item {
    /// Bytes that it takes in the part.
    fn taken(&self) -> u64 {
        let stored = u64::from(self.entry.stored_length);
        if self.kind == ItemKind::Packed { stored.next_multiple_of(ALIGNMENT) } else { stored }
    }
}

impl PartReader {
    fn open(part: usize, source: &Arc<dyn ByteSource>, plan: &Plan) -> Result<Self> {
        let path = source.location();
        let failed = |error| Error::reading(path, error);
        let mut bytes = [0; HEADER];
        let count = source.read_at(&mut bytes, 0).map_err(failed)?;
        if !bytes.starts_with(PART_SIGNATURE) {
            return Err(no_part(path, &bytes[..8]));
        }
        let (rest, checksum) = bytes.split_at(HEADER - 8);
        if count < HEADER || xxh3_64(rest).to_le_bytes() != checksum {
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
        let directory = header.u64("the header")?;
        let expected = (groups.len() * plan.channels.len()) as u64;
        let planned = plan.cover.groups.get(groups.start as usize..groups.end as usize);
        let Some(planned) = planned.filter(|_| means == expected) else {
            return Err(damaged(path, "its header names groups that the plan does not have"));
        };
        // Of a level each item but an empty head and tail has a page.
        let pages = planned.iter().flat_map(|group| {
            (0..group.level_count()).map(move |level| page_grid(group.level_extent(level)).map(u64::from))
        });
        let most = pages.map(|[columns, rows]| columns * rows).sum::<u64>()
            + 2 * u64::from(cover_level_count(&plan.cover));
        let length = source.length().map_err(failed)?;
        let end = items.min(most) * ITEM as u64 + means * 16 + 8;
        if items > most || directory.checked_add(end) != Some(length) {
            return Err(damaged(path, "its length is not what its header says; bake it anew"));
        }
        let source = Arc::clone(source);
        Ok(Self { part, path: path.to_owned(), source, groups, shard, items, directory, length })
    }

    fn damaged(&self) -> Error {
        damaged(&self.path, "a part of it has a wrong length or checksum; bake it anew")
    }

    fn read(&self, range: Range<u64>) -> Result<Vec<u8>> {
        let mut bytes = vec![0; (range.end - range.start) as usize];
        match self.source.read_exact_at(&mut bytes, range.start) {
            Ok(()) => Ok(bytes),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Err(self.damaged()),
            Err(error) => Err(Error::reading(&self.path, error)),
        }
    }

    /// All but the clusters. None of the heads and tails may be longer than `max_loose`.
    fn contents(&self, levels: usize, max_loose: usize) -> Result<Contents> {
        let bytes = self.read(self.directory..self.length)?;
        let (rest, checksum) = bytes.split_at(bytes.len() - 8);
        if xxh3_64(rest).to_le_bytes() != checksum {
            return Err(self.damaged());
        }
        let (entries, means) = rest.split_at(self.items as usize * ITEM);
        let mut items: Vec<Item> = entries
            .chunks_exact(ITEM)
            .map(|entry| parsed_item(entry, levels, max_loose).ok_or_else(|| self.damaged()))
            .collect::<Result<_>>()?;
        let is_packed = |item: &&mut Item| item.kind == ItemKind::Packed;
        let mut end = HEADER as u64;
        for item in items.iter_mut().filter(is_packed) {
            item.entry.offset = end;
            end += item.taken();
        }
        let loose_start = end;
        for item in items.iter_mut().filter(|item| !is_packed(item)) {
            item.entry.offset = end;
            end += item.taken();
        }
        // Each level has one of both.
        let count = items.iter().filter(|item| item.kind != ItemKind::Packed).count();
        if end != self.directory || count > 2 * levels {
            return Err(self.damaged());
        }
        let loose = self.read(loose_start..end)?;
        Ok(Contents { items, loose, means: values_from_bytes(means) })
    }
}

impl Contents {
    /// The bytes of a head or tail.
    fn loose(&self, item: &Item) -> Option<PackedCluster> {
        let ClusterEntry { first, offset, stored_length, raw_length, checksum } = item.entry;
        let start = self.items.iter().find(|item| item.kind != ItemKind::Packed)?.entry.offset;
        let stored = self.loose[(offset - start) as usize..][..stored_length as usize].to_vec();
        (xxh3_64(&stored) == checksum).then_some(PackedCluster { first, raw_length, stored })
    }
}

/// The sentence on what does not begin as a part does.
fn no_part(path: &Path, signature: &[u8]) -> Error {
    let path_text = path.display();
    let error = if signature.starts_with(&PART_SIGNATURE[..7]) {
        Error::unsupported(format!(
            "{path_text} is a part of version {}, and this program reads version {}: bake it anew with the program that merges",
            char::from(signature[7]).escape_default(),
            char::from(PART_SIGNATURE[7])
        ))
    } else {
        Error::malformed(format!("{path_text} is no part of a bake; give files that were baked from shards"))
    };
    error.with_path(path)
}

/// An item whose place is still to be found out; none where it cannot be right.
fn parsed_item(bytes: &[u8], levels: usize, max_loose: usize) -> Option<Item> {
    let mut item = ByteReader::new(bytes);
    let mut number = || item.u32("an item").ok();
    let [kind, level, group, page] = [number()?, number()?, number()?, number()?];
    let [raw_length, stored_length] = [number()?, number()?];
    let checksum = item.u64("an item").ok()?;
    let kind = *ItemKind::ALL.get(kind as usize)?;
    let is_sound = match kind {
        ItemKind::Packed => {
            u64::from(raw_length) <= MAX_CLUSTER_BYTES
                && stored_length as usize <= packed_bound(raw_length as usize)
        }
        _ => raw_length == stored_length && raw_length as usize <= max_loose,
    };
    let first = TilePlace { group, page };
    let entry = ClusterEntry { first, offset: 0, stored_length, raw_length, checksum };
    (is_sound && (level as usize) < levels).then_some(Item { kind, level: level as usize, entry })
}

/// The clusters of a part, read from the first to the last.
struct ClusterReader<'a> {
    part: &'a PartReader,
    /// Read ahead; those before `taken` are done with.
    buffer: Vec<u8>,
    taken: usize,
    /// Where the part is read next.
    offset: u64,
}

impl<'a> ClusterReader<'a> {
    fn new(part: &'a PartReader) -> Self {
        Self { part, buffer: Vec::new(), taken: 0, offset: HEADER as u64 }
    }

    /// The next cluster.
    fn cluster(&mut self, item: &Item) -> Result<PackedCluster> {
        let ClusterEntry { first, stored_length, raw_length, checksum, .. } = item.entry;
        let mut stored = vec![0; item.taken() as usize];
        self.fill(&mut stored)?;
        let is_padded = stored.drain(stored_length as usize..).all(|byte| byte == 0);
        if !is_padded || xxh3_64(&stored) != checksum {
            return Err(self.part.damaged());
        }
        Ok(PackedCluster { first, raw_length, stored })
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<()> {
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
        let left = self.part.directory.saturating_sub(self.offset);
        self.buffer.resize(left.min(READ_AHEAD) as usize, 0);
        self.taken = 0;
        match self.part.source.read_exact_at(&mut self.buffer, self.offset) {
            Ok(()) if left > 0 => {}
            Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
                return Err(Error::reading(&self.part.path, error));
            }
            _ => return Err(self.part.damaged()),
        }
        self.offset += self.buffer.len() as u64;
        Ok(())
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
    let source = |path: &PathBuf| -> Arc<dyn ByteSource> { Arc::new(PathSource::new(path)) };
    merge_sources(plan, &parts.iter().map(source).collect::<Vec<_>>(), output, watch)
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
    merge(plan, parts, output, None, watch)
}

/// As [`merge_sources`], but leaves gaps in the file where the asset has clusters as they lie in a part. Most bytes of parts are not read, nor
/// are their checksums looked at; those that stand in the asset are what its readers go by. The gaps are given by ascending place in the asset;
/// file systems that can keep no room for them.
///
/// # Errors
/// As there.
pub fn merge_with_gaps(
    plan: &Plan,
    parts: &[Arc<dyn ByteSource>],
    path: &Path,
    options: &CreateOptions,
    watch: &dyn Fn(u64, u64) -> ControlFlow<()>,
) -> Result<(WriteSummary, Vec<PartRun>)> {
    let mut gaps = Vec::new();
    let written = merge(plan, parts, Some((path, options)), Some(&mut gaps), watch)?;
    Ok((written, gaps))
}

fn merge(
    plan: &Plan,
    parts: &[Arc<dyn ByteSource>],
    output: Option<(&Path, &CreateOptions)>,
    mut gaps: Option<&mut Vec<PartRun>>,
    watch: &dyn Fn(u64, u64) -> ControlFlow<()>,
) -> Result<WriteSummary> {
    let readers = parts.iter().enumerate().map(|(index, part)| PartReader::open(index, part, plan));
    let mut readers = readers.collect::<Result<Vec<_>>>()?;
    readers.sort_by_key(|reader| (reader.groups.start, reader.groups.end));
    check_complete(plan, &readers)?;
    let (mut done, total) = (0, readers.iter().map(|reader| reader.length).sum());
    let writer = match output {
        Some((path, options)) => {
            Some(AssetWriter::create(path, options, &plan.mesh, &plan.cover, &plan.channels)?)
        }
        None => None,
    };
    let stream = PageStream::new(Path::new(""), &plan.cover, &plan.channels, 0..0);
    let zstd_level = output.map_or(1, |(_, options)| options.zstd_level);
    let mut merger = Merger::new(writer, &stream, zstd_level);
    let (levels, max_loose) = (merger.open.len(), merger.max_loose());
    let mut means = Vec::new();
    for reader in &readers {
        let before = done;
        let contents = reader.contents(levels, max_loose)?;
        let mut clusters = ClusterReader::new(reader);
        for item in &contents.items {
            if watch(done, total).is_break() {
                return Err(Error::cancelled("merging was ended; nothing was written"));
            }
            match (item.kind, &mut gaps) {
                (ItemKind::Packed, None) => {
                    merger.check_due(item.level, item.entry.first, item.entry.raw_length, &reader.path)?;
                    merger.put(item.level, &clusters.cluster(item)?)?;
                }
                (ItemKind::Packed, Some(gaps)) => {
                    merger.check_due(item.level, item.entry.first, item.entry.raw_length, &reader.path)?;
                    add_gap(gaps, reader.part, item.entry.offset, merger.leave_room(item));
                }
                (kind, _) => {
                    let cluster = contents.loose(item).ok_or_else(|| reader.damaged())?;
                    merger.join(item.level, &cluster, kind == ItemKind::Head, reader)?;
                }
            }
            done += item.taken();
        }
        means.extend(contents.means);
        done = before + reader.length;
    }
    if watch(done, total).is_break() {
        return Err(Error::cancelled("merging was ended; nothing was written"));
    }
    merger.finish(plan, &means)
}

/// What lies right behind the last gap makes it longer.
fn add_gap(gaps: &mut Vec<PartRun>, part: usize, offset: u64, range: Range<u64>) {
    match gaps.last_mut() {
        Some(last)
            if last.part == part
                && last.range.end == range.start
                && last.offset + (last.range.end - last.range.start) == offset =>
        {
            last.range.end = range.end;
        }
        _ => gaps.push(PartRun { part, offset, range }),
    }
}

/// The asset that is merged.
struct Merger<'a> {
    /// None where parts are only looked at.
    writer: Option<AssetWriter>,
    formats: &'a [TexelFormat],
    zstd_level: i32,
    /// Of each level what tails and heads have added to a cluster that is not full.
    open: Vec<OpenCluster>,
    /// Of each level the clusters that are still to come.
    due: Vec<Cuts<'a>>,
    clusters: usize,
}

impl<'a> Merger<'a> {
    fn new(writer: Option<AssetWriter>, stream: &'a PageStream, zstd_level: i32) -> Self {
        let (levels, formats) = (stream.open.len(), stream.formats.as_slice());
        Self {
            writer,
            formats,
            zstd_level,
            open: (0..levels).map(|_| OpenCluster::empty(formats.len())).collect(),
            due: (0..levels).map(|level| Cuts::new(&stream.extents, formats, level)).collect(),
            clusters: 0,
        }
    }

    /// Bytes that a cluster has at most: one page of all channels may be longer than the target.
    fn max_loose(&self) -> usize {
        let page: usize = self.formats.iter().map(|format| format.bytes([PAGE, PAGE])).sum();
        page.max(CLUSTER_TARGET_BYTES)
    }

    /// That this is the next cluster of a level.
    fn check_due(&mut self, level: usize, first: TilePlace, raw_length: u32, path: &Path) -> Result<()> {
        self.clusters += 1;
        if self.due[level].next() == Some((first, raw_length as usize)) {
            return Ok(());
        }
        Err(damaged(path, "its texels are not those that were planned; bake it anew"))
    }

    fn put(&mut self, level: usize, cluster: &PackedCluster) -> Result<()> {
        self.writer.as_mut().map_or(Ok(()), |writer| writer.put(level, cluster))
    }

    /// Where a cluster will lie, with what follows until the next one.
    fn leave_room(&mut self, item: &Item) -> Range<u64> {
        self.writer.as_mut().map_or(0..0, |writer| writer.leave_room(item.level, item.entry))
    }

    /// Adds a head, which ends a cluster, or a tail.
    fn join(
        &mut self,
        level: usize,
        cluster: &PackedCluster,
        is_head: bool,
        reader: &PartReader,
    ) -> Result<()> {
        let max_bytes = self.max_loose();
        if !self.open[level].extend(cluster, self.formats, max_bytes) {
            return Err(reader.damaged());
        }
        if is_head { self.close(level, &reader.path) } else { Ok(()) }
    }

    /// Packs what a level has open. `path` is what is to blame.
    fn close(&mut self, level: usize, path: &Path) -> Result<()> {
        let Some(full) = self.open[level].take() else { return Ok(()) };
        let packed = full.pack(self.formats, self.zstd_level).map_err(|e| Error::reading(path, e))?;
        self.check_due(level, packed.first, packed.raw_length, path)?;
        self.put(level, &packed)
    }

    fn finish(mut self, plan: &Plan, means: &[[f32; 4]]) -> Result<WriteSummary> {
        for level in 0..self.open.len() {
            self.close(level, &plan.path)?;
        }
        if self.due.iter_mut().any(|cuts| cuts.next().is_some()) {
            let sentence = "the parts have fewer texels than were planned; bake them anew";
            return Err(Error::damaged(sentence).with_path(&plan.path));
        }
        match self.writer {
            Some(writer) => writer.seal(means),
            None => Ok(WriteSummary { clusters: self.clusters, ..WriteSummary::default() }),
        }
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
    /// Adds bytes that are stored as they are; false where they cannot be whole pages of a cluster of at most `max_bytes`.
    fn extend(&mut self, cluster: &PackedCluster, formats: &[TexelFormat], max_bytes: usize) -> bool {
        let per_block: usize = formats.iter().map(|format| format.block_bytes()).sum();
        let blocks = cluster.stored.len() / per_block;
        if blocks * per_block != cluster.stored.len() || self.length() + cluster.stored.len() > max_bytes {
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
