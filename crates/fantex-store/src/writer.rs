//! Writing assets.
//!
//! ```text
//!  0      8192                                      4096-aligned
//!  slots | channels | cover | mesh | directory ... | cluster | cluster | ...
//!  `--- written by finish ---'     `- space kept -'  `- written as pages come -'
//! ```
//!
//! How many clusters there will be follows from cover and channels, so the directory's room is known beforehand and it can
//! stand in front of them: a reader far away gets everything but texels in two requests.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use fantex_base::files::{exists, temporary_file};
use fantex_base::{Error, Result};
use fantex_cover::{Cover, level_count};
use fantex_mesh::Mesh;
use rayon::prelude::*;
use tempfile::NamedTempFile;
use xxhash_rust::xxh3::xxh3_64;
use zstd::stream::write::Encoder;
use zstd::zstd_safe::{CParameter, compress_bound};

use crate::directory::{self, ALIGNMENT, Attachments, ClusterEntry, Directory, Means};
use crate::error::invalid;
use crate::header::{HEADER_BYTES, SLOT_OFFSETS, SectionRecord, Slot};
use crate::layout::{PageSize, TilePlace, page_bytes};
use crate::limits::{MAX_SECTION_RATIO, SECTION_RATIO_FREE};
use crate::{Channel, PageId, Replacement, TexelFormat, channel, cover_section, mesh_section, packing};

pub use self::copy::*;
pub use self::merge::*;
pub use self::part::*;
pub use self::plan::*;
pub use self::recipe::*;

mod copy;
mod merge;
mod part;
mod plan;
mod recipe;

/// A cluster is closed before the page that would make it longer than this, unpacked. Packed it is about two thirds.
pub(crate) const CLUSTER_TARGET_BYTES: usize = 256 << 10;

/// zstd level of the sections, which are written once.
const SECTION_ZSTD_LEVEL: i32 = 3;

/// The shortest run that zstd may store as a repetition. Blocks of texels repeat in whole or hardly at all: with short runs a
/// cluster is as large, and takes a tenth longer to unpack.
const MIN_MATCH: u32 = 7;

/// A zstd block has a table of code lengths of its own, which pays from about this many bytes on.
const MIN_ZSTD_BLOCK_BYTES: usize = 2 << 10;

/// Magic number of a zstd frame that decoders skip.
const SKIPPABLE_FRAME: u32 = 0x184d_2a50;

/// How to write an asset.
#[derive(Clone, Debug)]
pub struct CreateOptions {
    /// Overwrite an existing file, unless somebody edits it.
    pub force: bool,
    /// zstd level of the clusters, 1..=19.
    pub zstd_level: i32,
}

impl Default for CreateOptions {
    /// No overwriting, zstd level 1.
    fn default() -> Self {
        Self { force: false, zstd_level: 1 }
    }
}

/// One page of all channels, encoded.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedPage {
    /// Which.
    pub id: PageId,
    /// Bytes of [`encode`](crate::encode) per channel, in the asset's channel order.
    pub channels: Vec<Vec<u8>>,
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteSummary {
    /// Length of the file.
    pub bytes: u64,
    /// Of that, clusters (texels of all levels, packed, without alignment).
    pub cluster_bytes: u64,
    /// Texel bytes before packing (block format, all levels and channels).
    pub unpacked_texel_bytes: u64,
    /// Number of clusters.
    pub clusters: usize,
    /// Number of pages.
    pub pages: u64,
}

/// Writes one asset: a temporary file in the target's folder, renamed by [`finish`](Self::finish). Dropping the writer
/// before that removes the temporary file.
#[derive(Debug)]
pub struct AssetWriter {
    path: PathBuf,
    replacement: Replacement,
    zstd_level: i32,
    file: NewFile,
    pages: PageStream,
    summary: WriteSummary,
}

impl AssetWriter {
    /// Checks the contents, creates the temporary file and writes mesh, cover and channels.
    ///
    /// # Errors
    /// The file exists and is not to be overwritten or is being edited, cannot be written, or the contents break a rule of the format.
    pub fn create(
        path: &Path,
        options: &CreateOptions,
        mesh: &Mesh,
        cover: &Cover,
        channels: &[Channel],
    ) -> Result<Self> {
        check_contents(path, options.force, mesh, cover, channels)?;
        let replacement = Replacement::begin(path, options.force)?;
        let io = |source| Error::writing(path, source);
        let pages = PageStream::new(path, cover, channels, 0..cover.groups.len() as u32);
        let mut file = NewFile::create(path, 1, pages.open.len()).map_err(io)?;
        file.contents(mesh, cover, channels).map_err(io)?;
        file.keep_room_for_directory(&pages.extents, &pages.formats);
        let summary = WriteSummary::default();
        Ok(Self { path: path.to_owned(), replacement, zstd_level: options.zstd_level, file, pages, summary })
    }

    /// Adds pages: groups ascending, all pages of a group together as [`group_pages`](crate::group_pages) lists them (a
    /// batch may end within a group). Packs the clusters that this fills on the current rayon pool; the file's bytes depend
    /// neither on the threads nor on how pages are split into batches.
    ///
    /// # Errors
    /// A page came out of turn or with wrong lengths, or the file cannot be written.
    pub fn write_pages(&mut self, batch: Vec<EncodedPage>) -> Result<()> {
        for page in batch {
            self.pages.add(&page)?;
        }
        self.write_full_clusters()
    }

    /// Writes what is left, makes the file durable and gives it its name. `means`: **linear** RGBA (normals as stored) per
    /// group and channel, `means[group * channels + channel]`.
    ///
    /// # Errors
    /// Pages or means are missing, or the file cannot be written.
    pub fn finish(mut self, means: &[[f32; 4]]) -> Result<WriteSummary> {
        self.pages.check_finished(means.len())?;
        self.pages.close();
        self.write_full_clusters()?;
        self.seal(means)
    }

    /// Writes directory and header once all clusters are there.
    fn seal(self, means: &[[f32; 4]]) -> Result<WriteSummary> {
        let summary =
            WriteSummary { pages: self.pages.pages, unpacked_texel_bytes: self.pages.bytes, ..self.summary };
        let means = Means::new(means, &self.pages.formats);
        let finished = self.file.finish(means, &Attachments::new(), None);
        let (file, bytes) = finished.map_err(|source| Error::writing(&self.path, source))?;
        self.replacement.finish(file.into_temp_path())?;
        Ok(WriteSummary { bytes, ..summary })
    }

    /// Packs all full clusters in parallel and writes them in the order in which they became full.
    fn write_full_clusters(&mut self) -> Result<()> {
        let (formats, zstd_level) = (&self.pages.formats, self.zstd_level);
        let packed: Vec<_> = std::mem::take(&mut self.pages.full)
            .into_par_iter()
            .map(|(level, cluster)| Ok((level, cluster.pack(formats, zstd_level)?)))
            .collect();
        for cluster in packed {
            let (level, cluster) = cluster.map_err(|source: io::Error| Error::writing(&self.path, source))?;
            self.put(level, &cluster)?;
        }
        Ok(())
    }

    /// Adds the next cluster of a level.
    fn put(&mut self, level: usize, cluster: &PackedCluster) -> Result<()> {
        let written = self.file.cluster(level, cluster);
        self.summary.cluster_bytes += written.map_err(|source| Error::writing(&self.path, source))?;
        self.summary.clusters += 1;
        Ok(())
    }

    /// Leaves room for the next cluster of a level. Gives where it lies, with what follows until the next one.
    fn leave_room(&mut self, level: usize, cluster: ClusterEntry) -> Range<u64> {
        self.summary.cluster_bytes += u64::from(cluster.stored_length);
        self.summary.clusters += 1;
        self.file.leave_room(level, cluster)
    }
}

/// That contents keep the rules of the format, and that nothing stands in the way of a new file.
fn check_contents(path: &Path, force: bool, mesh: &Mesh, cover: &Cover, channels: &[Channel]) -> Result<()> {
    let content = |error: Error| error.context(format!("cannot write {}", path.display())).with_path(path);
    channel::check_channels(channels).map_err(content)?;
    mesh_section::check(mesh).map_err(content)?;
    cover_section::check(cover, mesh.triangles.len()).map_err(content)?;
    if !force && path.symlink_metadata().is_ok() {
        return Err(exists(path));
    }
    Ok(())
}

/// Cuts pages of a run of groups, which come in order, into clusters.
#[derive(Debug)]
struct PageStream {
    /// Of what is written, for messages.
    path: PathBuf,
    extents: Vec<[u32; 2]>,
    formats: Vec<TexelFormat>,
    groups: Range<u32>,
    open: Vec<OpenCluster>,
    /// Full clusters on their way to the file, with their level.
    full: Vec<(usize, OpenCluster)>,
    due: Option<PageId>,
    pages: u64,
    /// Of all pages.
    bytes: u64,
}

impl PageStream {
    fn new(path: &Path, cover: &Cover, channels: &[Channel], groups: Range<u32>) -> Self {
        let extents: Vec<_> = cover.groups.iter().map(|group| group.extent).collect();
        let formats: Vec<_> = channels.iter().map(|channel| channel.format).collect();
        let levels = extents.iter().map(|&e| level_count(e)).max().unwrap_or(0) as usize;
        let due = first_page(groups.start, &extents, groups.end);
        let open = (0..levels).map(|_| OpenCluster::empty(formats.len())).collect();
        Self { path: path.into(), extents, formats, groups, open, full: Vec::new(), due, pages: 0, bytes: 0 }
    }

    fn refused(&self, verb: &str, what: String) -> Error {
        invalid(&self.path, format!("cannot {verb} {}: {what}", self.path.display()))
    }

    fn add(&mut self, page: &EncodedPage) -> Result<()> {
        let id = page.id;
        match self.due {
            None => return Err(self.refused("write", format!("page ({id}) is not part of the cover"))),
            Some(due) if id != due => {
                return Err(self.refused("write", format!("page ({id}) came where ({due}) was due")));
            }
            _ => {}
        }
        let size = PageSize::new(self.extents[id.group as usize], id.level);
        let number = size.number(id.page).unwrap_or(0);
        let expected = page_bytes(&self.formats, size.page_extent(number));
        let got: Vec<usize> = page.channels.iter().map(Vec::len).collect();
        if got != expected {
            let what = format!("page ({id}) needs {expected:?} bytes per channel, but has {got:?}");
            return Err(self.refused("write", what));
        }
        let level = id.level as usize;
        let place = TilePlace { group: id.group, page: number };
        let full = self.open[level].add(place, &page.channels, CLUSTER_TARGET_BYTES);
        self.full.extend(full.map(|cluster| (level, cluster)));
        self.pages += 1;
        self.bytes += expected.iter().sum::<usize>() as u64;
        self.due = self.page_after(id, size, number);
        Ok(())
    }

    fn page_after(&self, id: PageId, size: PageSize, number: u32) -> Option<PageId> {
        if number + 1 < size.page_count() {
            return Some(PageId { page: size.page(number + 1), ..id });
        }
        if id.level + 1 < level_count(self.extents[id.group as usize]) {
            return Some(PageId { level: id.level + 1, page: [0, 0], ..id });
        }
        first_page(id.group + 1, &self.extents, self.groups.end)
    }

    /// That all pages came, and so many means.
    fn check_finished(&self, means: usize) -> Result<()> {
        if let Some(missing) = self.due {
            return Err(self.refused("finish", format!("page ({missing}) has not been written")));
        }
        let expected = self.groups.len() * self.formats.len();
        if means != expected {
            let what = format!("{expected} means are due (one per group and channel), {means} were given");
            return Err(self.refused("finish", what));
        }
        Ok(())
    }

    /// What is open becomes full.
    fn close(&mut self) {
        let open = self.open.iter_mut().enumerate();
        self.full.extend(open.filter_map(|(level, cluster)| Some((level, cluster.take()?))));
    }
}

/// Level 0's first page of a group, if there is such a group before `end`.
fn first_page(group: u32, extents: &[[u32; 2]], end: u32) -> Option<PageId> {
    (group < end && (group as usize) < extents.len()).then_some(PageId { group, level: 0, page: [0, 0] })
}

/// Pages of one level that follow each other, until they are a cluster.
#[derive(Debug)]
pub(crate) struct OpenCluster {
    first: TilePlace,
    /// Per channel, page after page.
    channels: Vec<Vec<u8>>,
    /// Bytes of pages before these that another part has.
    before: usize,
}

impl OpenCluster {
    pub(crate) fn empty(channels: usize) -> Self {
        Self { first: TilePlace { group: 0, page: 0 }, channels: vec![Vec::new(); channels], before: 0 }
    }

    pub(crate) fn length(&self) -> usize {
        self.before + self.channels.iter().map(Vec::len).sum::<usize>()
    }

    /// Adds the next page; returns those before it where the cluster would become longer than `max_bytes`.
    pub(crate) fn add(
        &mut self,
        place: TilePlace,
        page: &[impl AsRef<[u8]>],
        max_bytes: usize,
    ) -> Option<Self> {
        let page_length: usize = page.iter().map(|bytes| bytes.as_ref().len()).sum();
        let full = if self.length() + page_length > max_bytes { self.take() } else { None };
        if self.length() == 0 {
            self.first = place;
        }
        for (stream, bytes) in self.channels.iter_mut().zip(page) {
            stream.extend_from_slice(bytes.as_ref());
        }
        full
    }

    /// The pages since the last full cluster, if there are any.
    pub(crate) fn take(&mut self) -> Option<Self> {
        let empty = Self::empty(self.channels.len());
        (self.length() > 0).then(|| std::mem::replace(self, empty))
    }

    /// Rearranges each channel to pack well, and packs them one after the other.
    pub(crate) fn pack(&self, formats: &[TexelFormat], zstd_level: i32) -> io::Result<PackedCluster> {
        let mut raw = vec![0; self.length()];
        let mut runs = Vec::new();
        let mut rest = raw.as_mut_slice();
        for (stream, &format) in self.channels.iter().zip(formats) {
            let (packed, after) = rest.split_at_mut(stream.len());
            packing::pack(format, stream, packed);
            rest = after;
            let fields = packing::alike(format);
            let records = stream.len() / fields.iter().sum::<usize>();
            runs.extend(fields.iter().map(|bytes| records * bytes));
        }
        let stored = packed(&raw, &runs, zstd_level)?;
        Ok(PackedCluster { first: self.first, raw_length: raw.len() as u32, stored })
    }
}

/// One zstd frame in which runs of bytes are blocks of their own where they are long enough: zstd codes the bytes of a block by how often
/// each comes, and fields differ in that. A block costs three bytes, so there are never more than [`compress_bound`], which readers allow.
fn packed(raw: &[u8], runs: &[usize], zstd_level: i32) -> io::Result<Vec<u8>> {
    let mut encoder = Encoder::new(Vec::with_capacity(compress_bound(raw.len())), zstd_level)?;
    encoder.set_parameter(CParameter::MinMatch(MIN_MATCH))?;
    encoder.set_pledged_src_size(Some(raw.len() as u64))?;
    let mut rest = raw;
    let mut length = 0;
    for run in runs {
        length += run;
        if length >= MIN_ZSTD_BLOCK_BYTES && length < rest.len() {
            let (block, after) = rest.split_at(length);
            encoder.write_all(block)?;
            encoder.flush()?;
            (rest, length) = (after, 0);
        }
    }
    encoder.write_all(rest)?;
    encoder.finish()
}

pub(crate) struct PackedCluster {
    first: TilePlace,
    raw_length: u32,
    pub(crate) stored: Vec<u8>,
}

impl PackedCluster {
    /// Its entry once it lies at `offset`.
    pub(crate) fn entry(&self, offset: u64) -> ClusterEntry {
        ClusterEntry {
            first: self.first,
            offset,
            stored_length: self.stored.len() as u32,
            raw_length: self.raw_length,
            checksum: xxh3_64(&self.stored),
        }
    }
}

/// The file of one generation while it is written from front to back, under a temporary name.
#[derive(Debug)]
pub(crate) struct NewFile {
    file: NamedTempFile,
    end: u64,
    pub(crate) slot: Slot,
    levels: Vec<Vec<ClusterEntry>>,
}

impl NewFile {
    pub(crate) fn create(path: &Path, generation: u64, levels: usize) -> io::Result<Self> {
        let (file, slot) = (temporary_file(path, ".tmp")?, Slot::new(generation));
        Ok(Self { file, end: HEADER_BYTES, slot, levels: vec![Vec::new(); levels] })
    }

    /// Adds the sections of channels, cover and mesh, and what the header says of the cover.
    fn contents(&mut self, mesh: &Mesh, cover: &Cover, channels: &[Channel]) -> io::Result<()> {
        self.slot.hard_edges = cover.hard_edges;
        let (cover, mesh) = rayon::join(
            || pack_section(&cover_section::encode(cover, &mesh.triangles)),
            || pack_section(&mesh_section::encode(mesh)),
        );
        let sections = [pack_section(&channel::encode_channels(channels)), cover, mesh];
        for (index, packed) in sections.into_iter().enumerate() {
            let (stored, record) = packed?;
            self.section(index, &stored, record)?;
        }
        Ok(())
    }

    /// Adds a packed section: channels, cover, mesh.
    pub(crate) fn section(&mut self, index: usize, stored: &[u8], record: SectionRecord) -> io::Result<()> {
        self.write_at(self.end, stored)?;
        self.slot.sections[index] = SectionRecord { offset: self.end, ..record };
        self.end = (self.end + stored.len() as u64).next_multiple_of(8);
        Ok(())
    }

    /// Puts the start of the clusters behind the longest directory that there can be.
    pub(crate) fn keep_room_for_directory(&mut self, extents: &[[u32; 2]], formats: &[TexelFormat]) {
        let clusters = clusters_per_level(extents, formats, self.levels.len());
        let length = directory::encoded_length(&clusters, extents.len(), formats);
        self.slot.sections[3].offset = self.end;
        self.end = (self.end + compress_bound(length) as u64).next_multiple_of(ALIGNMENT);
    }

    /// Adds a cluster or an attachment; returns where it lies.
    pub(crate) fn append(&mut self, stored: &[u8]) -> io::Result<u64> {
        let offset = self.end;
        self.write_at(offset, stored)?;
        self.end = (offset + stored.len() as u64).next_multiple_of(ALIGNMENT);
        Ok(offset)
    }

    /// Adds the next cluster of a level; returns its length.
    pub(crate) fn cluster(&mut self, level: usize, cluster: &PackedCluster) -> io::Result<u64> {
        let offset = self.append(&cluster.stored)?;
        self.levels[level].push(cluster.entry(offset));
        Ok(cluster.stored.len() as u64)
    }

    /// Adds the next cluster of a level as another file has it, its checksum, too.
    pub(crate) fn copied_cluster(
        &mut self,
        level: usize,
        stored: &[u8],
        entry: ClusterEntry,
    ) -> io::Result<()> {
        let offset = self.append(stored)?;
        self.levels[level].push(ClusterEntry { offset, ..entry });
        Ok(())
    }

    /// Leaves room for the next cluster of a level, which has its place by that. Gives where it lies, with what follows until the next one.
    fn leave_room(&mut self, level: usize, cluster: ClusterEntry) -> Range<u64> {
        let offset = self.end;
        self.end = (offset + u64::from(cluster.stored_length)).next_multiple_of(ALIGNMENT);
        self.levels[level].push(ClusterEntry { offset, ..cluster });
        offset..self.end
    }

    /// Writes directory, list of attachments and header, and makes the file durable. Returns it with its length.
    pub(crate) fn finish(
        mut self,
        means: Means,
        attachments: &Attachments,
        permissions: Option<std::fs::Permissions>,
    ) -> io::Result<(NamedTempFile, u64)> {
        let directory = Directory { levels: std::mem::take(&mut self.levels), means };
        let (stored, record) = pack_section(&directory::encode(&directory))?;
        let offset = self.slot.sections[3].offset;
        self.write_at(offset, &stored)?;
        self.slot.sections[3] = SectionRecord { offset, ..record };
        if !attachments.is_empty() {
            let (stored, record) = pack_section(&directory::encode_attachments(attachments))?;
            self.slot.attachments = SectionRecord { offset: self.append(&stored)?, ..record };
        }
        self.seal(permissions)
    }

    /// Writes the header and makes the file durable. Returns it with its length.
    fn seal(mut self, permissions: Option<std::fs::Permissions>) -> io::Result<(NamedTempFile, u64)> {
        self.slot.file_length = self.end;
        for offset in SLOT_OFFSETS {
            self.write_at(offset, &self.slot.encode())?;
        }
        let file = self.file.as_file();
        // The last part's padding is part of the file.
        file.set_len(self.end)?;
        if let Some(permissions) = permissions {
            file.set_permissions(permissions)?;
        }
        file.sync_all()?;
        Ok((self.file, self.end))
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let mut file: &File = self.file.as_file();
        file.seek(SeekFrom::Start(offset)).and_then(|_| file.write_all(bytes))
    }
}

/// Packs a section. Where it lies is still to be written into the record.
pub(crate) fn pack_section(raw: &[u8]) -> io::Result<(Vec<u8>, SectionRecord)> {
    let mut stored = zstd::bulk::compress(raw, SECTION_ZSTD_LEVEL)?;
    lengthen(&mut stored, raw.len() as u64);
    let (stored_length, raw_length) = (stored.len() as u64, raw.len() as u64);
    let record = SectionRecord { offset: 0, stored_length, raw_length, checksum: xxh3_64(&stored) };
    Ok((stored, record))
}

/// The clusters that the pages of a level are cut into as they come: the first page, and the bytes of all.
#[derive(Clone, Debug)]
struct Cuts<'a> {
    extents: &'a [[u32; 2]],
    formats: &'a [TexelFormat],
    level: usize,
    next: TilePlace,
}

impl<'a> Cuts<'a> {
    fn new(extents: &'a [[u32; 2]], formats: &'a [TexelFormat], level: usize) -> Self {
        Self { extents, formats, level, next: TilePlace { group: 0, page: 0 } }
    }
}

impl Iterator for Cuts<'_> {
    type Item = (TilePlace, usize);

    fn next(&mut self) -> Option<Self::Item> {
        let mut cluster: Option<Self::Item> = None;
        while let Some(&extent) = self.extents.get(self.next.group as usize) {
            let size = PageSize::new(extent, self.level as u32);
            while self.next.page < size.page_count() {
                let page = size.page_extent(self.next.page);
                let added: usize = self.formats.iter().map(|format| format.bytes(page)).sum();
                match &mut cluster {
                    Some((_, length)) if *length + added > CLUSTER_TARGET_BYTES => return cluster,
                    Some((_, length)) => *length += added,
                    None => cluster = Some((self.next, added)),
                }
                self.next.page += 1;
            }
            self.next = TilePlace { group: self.next.group + 1, page: 0 };
        }
        cluster
    }
}

/// Number of clusters that pages will be cut into, per level.
fn clusters_per_level(extents: &[[u32; 2]], formats: &[TexelFormat], levels: usize) -> Vec<usize> {
    (0..levels).into_par_iter().map(|level| Cuts::new(extents, formats, level).count()).collect()
}

/// Appends a skippable zstd frame where a section packs so well that readers would refuse it as a bomb.
fn lengthen(stored: &mut Vec<u8>, raw_length: u64) {
    let due = raw_length.saturating_sub(SECTION_RATIO_FREE).div_ceil(MAX_SECTION_RATIO) as usize;
    if stored.len() < due {
        let skipped = due - stored.len();
        stored.extend(SKIPPABLE_FRAME.to_le_bytes());
        stored.extend((skipped as u32).to_le_bytes());
        stored.resize(stored.len() + skipped, 0);
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::random::nth_random;

    use super::*;

    /// A cluster of one page with `blocks` blocks, and its bytes once packed field by field.
    fn cluster(formats: &[TexelFormat], blocks: usize, bits: u32) -> (OpenCluster, Vec<u8>) {
        let byte = |i: usize| (nth_random(blocks as u64, i as u64) >> (64 - bits)) as u8;
        let channels: Vec<Vec<u8>> = (0..formats.len())
            .map(|c| (0..blocks * formats[c].block_bytes()).map(|i| byte(i * formats.len() + c)).collect())
            .collect();
        let mut rearranged = Vec::new();
        for (&format, stream) in formats.iter().zip(&channels) {
            let mut packed = vec![0; stream.len()];
            packing::pack(format, stream, &mut packed);
            rearranged.extend(packed);
        }
        let mut cluster = OpenCluster::empty(formats.len());
        cluster.add(TilePlace { group: 0, page: 0 }, &channels, usize::MAX);
        (cluster, rearranged)
    }

    /// Readers take clusters of one frame's greatest length; noise in short ones has no room to spare.
    #[test]
    fn clusters_of_any_formats_and_lengths_are_what_every_reader_takes() {
        let [mixed, equal] = [TexelFormat::ALL.to_vec(), vec![TexelFormat::Bc7; 16]];
        for formats in [&mixed, &equal, &mixed[..1].to_vec()] {
            for blocks in [1, 2, 7, 60, 300, 1500, 9000] {
                for bits in [1, 4, 8] {
                    let (cluster, raw) = cluster(formats, blocks, bits);
                    let stored = cluster.pack(formats, 1).unwrap().stored;
                    assert!(stored.len() <= compress_bound(raw.len()), "{blocks} blocks of {bits} bits");
                    assert_eq!(zstd::bulk::decompress(&stored, raw.len()).unwrap(), raw);
                    assert_eq!(zstd::zstd_safe::find_frame_compressed_size(&stored), Ok(stored.len()));
                }
            }
        }
    }

    /// Bytes of few values beside noise: one table of code lengths for both makes the few ones long.
    #[test]
    fn fields_that_differ_take_less_room_than_at_once() {
        let blocks = 4096;
        let few = |i: u64| 1 << (nth_random(1, i) >> 62);
        let noise = |i: u64| nth_random(2, i) as u8;
        let page: Vec<u8> =
            (0..blocks * 16).map(|i| if i % 16 < 8 { few(i as u64) } else { noise(i as u64) }).collect();
        let formats = [TexelFormat::Bc7];
        let mut cluster = OpenCluster::empty(1);
        cluster.add(TilePlace { group: 0, page: 0 }, &[&page], usize::MAX);
        let mut raw = vec![0; page.len()];
        packing::pack(formats[0], &page, &mut raw);
        let [at_once, stored] =
            [packed(&raw, &[raw.len()], 1).unwrap(), cluster.pack(&formats, 1).unwrap().stored];
        assert!(20 * stored.len() < 19 * at_once.len(), "{} {}", stored.len(), at_once.len());
    }
}
