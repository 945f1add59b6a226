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
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use fantex_base::{Error, Result};
use fantex_cover::{Cover, level_count};
use fantex_mesh::Mesh;
use rayon::prelude::*;
use tempfile::NamedTempFile;
use xxhash_rust::xxh3::xxh3_64;

use crate::directory::{self, ALIGNMENT, ClusterEntry, Directory, Means};
use crate::error::invalid;
use crate::header::{HEADER_BYTES, SLOT_OFFSETS, SectionRecord, Slot, VERSION};
use crate::layout::{PageSize, TilePlace, page_bytes};
use crate::limits::{MAX_SECTION_RATIO, SECTION_RATIO_FREE};
use crate::reader::pack_cluster;
use crate::{Channel, PageId, TexelFormat, channel, cover_section, mesh_section};

/// A cluster is closed before the page that would make it longer than this, unpacked. Packed it is about two thirds.
pub(crate) const CLUSTER_TARGET_BYTES: u64 = 256 << 10;

/// zstd level of the sections, which are written once.
pub(crate) const SECTION_ZSTD_LEVEL: i32 = 3;

/// Magic number of a zstd frame that decoders skip.
const SKIPPABLE_FRAME: u32 = 0x184d_2a50;

/// How to write an asset.
#[derive(Clone, Debug)]
pub struct CreateOptions {
    /// Overwrite an existing file.
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
    options: CreateOptions,
    file: NamedTempFile,
    extents: Vec<[u32; 2]>,
    formats: Vec<TexelFormat>,
    sections: [SectionRecord; 4],
    /// The level's cluster that still takes pages.
    open: Vec<OpenCluster>,
    /// Full clusters on their way to the file, with their level.
    full: Vec<(usize, OpenCluster)>,
    written: Vec<Vec<ClusterEntry>>,
    due: Option<PageId>,
    /// Where the next cluster goes.
    end: u64,
    summary: WriteSummary,
}

/// Pages of one level and neighbouring groups.
#[derive(Debug)]
struct OpenCluster {
    first: TilePlace,
    /// Per channel, page after page.
    channels: Vec<Vec<u8>>,
}

impl OpenCluster {
    fn empty(channels: usize) -> Self {
        Self { first: TilePlace { group: 0, page: 0 }, channels: vec![Vec::new(); channels] }
    }

    fn length(&self) -> u64 {
        self.channels.iter().map(|c| c.len() as u64).sum()
    }
}

impl AssetWriter {
    /// Checks the contents, creates the temporary file and writes mesh, cover and channels.
    ///
    /// # Errors
    /// The file exists and is not to be overwritten, cannot be written, or the contents break a rule of the format.
    pub fn create(
        path: &Path,
        options: &CreateOptions,
        mesh: &Mesh,
        cover: &Cover,
        channels: &[Channel],
    ) -> Result<Self> {
        let content =
            |error: Error| error.context(format!("cannot write {}", path.display())).with_path(path);
        channel::check_channels(channels).map_err(content)?;
        mesh_section::check(mesh).map_err(content)?;
        cover_section::check(cover, mesh.triangles.len()).map_err(content)?;
        if !options.force && path.symlink_metadata().is_ok() {
            return Err(already_exists(path));
        }
        let file = temporary_file(path).map_err(|source| Error::writing(path, source))?;
        let extents: Vec<_> = cover.groups.iter().map(|group| group.extent).collect();
        let formats: Vec<_> = channels.iter().map(|channel| channel.format).collect();
        let levels = extents.iter().map(|&e| level_count(e)).max().unwrap_or(0) as usize;
        let mut writer = Self {
            path: path.to_owned(),
            options: options.clone(),
            file,
            sections: [SectionRecord::default(); 4],
            open: (0..levels).map(|_| OpenCluster::empty(formats.len())).collect(),
            full: Vec::new(),
            written: vec![Vec::new(); levels],
            due: None,
            end: HEADER_BYTES,
            summary: WriteSummary::default(),
            extents,
            formats,
        };
        writer.due = writer.first_page_from(0);
        writer.write_section(0, &channel::encode_channels(channels))?;
        writer.write_section(1, &cover_section::encode(cover))?;
        writer.write_section(2, &mesh_section::encode(mesh))?;
        writer.keep_room_for_directory();
        Ok(writer)
    }

    /// Adds pages: groups ascending, all pages of a group together as [`group_pages`](crate::group_pages) lists them (a
    /// batch may end within a group). Packs the clusters that this fills on the current rayon pool; the file's bytes depend
    /// neither on the threads nor on how pages are split into batches.
    ///
    /// # Errors
    /// A page came out of turn or with wrong lengths, or the file cannot be written.
    pub fn write_pages(&mut self, batch: Vec<EncodedPage>) -> Result<()> {
        for page in batch {
            self.add_page(page)?;
        }
        self.write_full_clusters()
    }

    /// Writes what is left, makes the file durable and gives it its name. `means`: **linear** RGBA (normals as stored) per
    /// group and channel, `means[group * channels + channel]`.
    ///
    /// # Errors
    /// Pages or means are missing, or the file cannot be written.
    pub fn finish(mut self, means: &[[f32; 4]]) -> Result<WriteSummary> {
        let path = self.path.clone();
        if let Some(missing) = self.due {
            return Err(invalid(
                &path,
                format!("cannot finish {}: page ({missing}) has not been written", path.display()),
            ));
        }
        let expected = self.extents.len() * self.formats.len();
        if means.len() != expected {
            return Err(invalid(
                &path,
                format!(
                    "cannot finish {}: {expected} means are due (one per group and channel), {} were given",
                    path.display(),
                    means.len()
                ),
            ));
        }
        for level in 0..self.open.len() {
            self.close(level);
        }
        self.write_full_clusters()?;
        let file_length = self.end;
        self.write_directory(means)?;
        let slot = Slot {
            version: VERSION,
            flags: 0,
            generation: 1,
            file_length,
            sections: self.sections,
            attachments: SectionRecord::default(),
        };
        for offset in SLOT_OFFSETS {
            self.write_at(offset, &slot.encode())?;
        }
        let io = |source| Error::writing(&path, source);
        // The last cluster's padding is part of the file.
        self.file.as_file().set_len(file_length).map_err(io)?;
        self.file.as_file().sync_all().map_err(io)?;
        persist(self.file, &path, self.options.force)?;
        Ok(WriteSummary { bytes: file_length, ..self.summary })
    }

    fn add_page(&mut self, page: EncodedPage) -> Result<()> {
        let id = page.id;
        let due = self.due.ok_or_else(|| {
            invalid(
                &self.path,
                format!("cannot write {}: page ({id}) is not part of the cover", self.path.display()),
            )
        })?;
        if id != due {
            return Err(invalid(
                &self.path,
                format!("cannot write {}: page ({id}) came where ({due}) was due", self.path.display()),
            ));
        }
        let size = PageSize::new(self.extents[id.group as usize], id.level);
        let number = size.number(id.page).unwrap_or(0);
        let expected = page_bytes(&self.formats, size.page_extent(number));
        let got: Vec<usize> = page.channels.iter().map(Vec::len).collect();
        if got != expected {
            return Err(invalid(
                &self.path,
                format!(
                    "cannot write {}: page ({id}) needs {expected:?} bytes per channel, but has {got:?}",
                    self.path.display()
                ),
            ));
        }
        let level = id.level as usize;
        let page_length = expected.iter().sum::<usize>() as u64;
        let length = self.open[level].length();
        if length > 0 && length + page_length > CLUSTER_TARGET_BYTES {
            self.close(level);
        }
        let cluster = &mut self.open[level];
        if cluster.length() == 0 {
            cluster.first = TilePlace { group: id.group, page: number };
        }
        for (stream, bytes) in cluster.channels.iter_mut().zip(&page.channels) {
            stream.extend_from_slice(bytes);
        }
        self.summary.pages += 1;
        self.summary.unpacked_texel_bytes += page_length;
        self.due = self.page_after(id, size, number);
        Ok(())
    }

    /// Level 0's first page of the first group from `group` on.
    fn first_page_from(&self, group: u32) -> Option<PageId> {
        ((group as usize) < self.extents.len()).then_some(PageId { group, level: 0, page: [0, 0] })
    }

    fn page_after(&self, id: PageId, size: PageSize, number: u32) -> Option<PageId> {
        if number + 1 < size.page_count() {
            return Some(PageId { page: size.page(number + 1), ..id });
        }
        if id.level + 1 < level_count(self.extents[id.group as usize]) {
            return Some(PageId { level: id.level + 1, page: [0, 0], ..id });
        }
        self.first_page_from(id.group + 1)
    }

    /// Moves the open cluster of a level to the full ones, unless it is empty.
    fn close(&mut self, level: usize) {
        if self.open[level].length() > 0 {
            let empty = OpenCluster::empty(self.formats.len());
            self.full.push((level, std::mem::replace(&mut self.open[level], empty)));
        }
    }

    /// Packs all full clusters in parallel and writes them in the order in which they became full.
    fn write_full_clusters(&mut self) -> Result<()> {
        let full = std::mem::take(&mut self.full);
        let (formats, zstd_level) = (&self.formats, self.options.zstd_level);
        let packed: Vec<_> = full
            .into_par_iter()
            .map(|(level, cluster)| {
                pack_cluster(&cluster.channels, formats, zstd_level)
                    .map(|packed| (level, cluster.first, packed.raw_length, packed.stored))
            })
            .collect();
        for cluster in packed {
            let (level, first, raw_length, stored) = cluster.map_err(|e| Error::writing(&self.path, e))?;
            self.write_at(self.end, &stored)?;
            self.written[level].push(ClusterEntry {
                first,
                offset: self.end,
                stored_length: stored.len() as u32,
                raw_length,
                checksum: xxh3_64(&stored),
            });
            self.end = (self.end + stored.len() as u64).next_multiple_of(ALIGNMENT);
            self.summary.cluster_bytes += stored.len() as u64;
            self.summary.clusters += 1;
        }
        Ok(())
    }

    /// Packs and writes a section at the end of those before.
    fn write_section(&mut self, index: usize, raw: &[u8]) -> Result<()> {
        let mut stored =
            zstd::bulk::compress(raw, SECTION_ZSTD_LEVEL).map_err(|e| Error::writing(&self.path, e))?;
        lengthen(&mut stored, raw.len() as u64);
        self.write_at(self.end, &stored)?;
        self.sections[index] = SectionRecord {
            offset: self.end,
            stored_length: stored.len() as u64,
            raw_length: raw.len() as u64,
            checksum: xxh3_64(&stored),
        };
        self.end = (self.end + stored.len() as u64).next_multiple_of(8);
        Ok(())
    }

    /// Puts the start of the clusters behind the longest directory that there can be.
    fn keep_room_for_directory(&mut self) {
        let clusters = clusters_per_level(&self.extents, &self.formats, self.open.len());
        let length = directory::encoded_length(&clusters, self.extents.len(), &self.formats);
        self.sections[3].offset = self.end;
        self.end = (self.end + zstd::zstd_safe::compress_bound(length) as u64).next_multiple_of(ALIGNMENT);
    }

    fn write_directory(&mut self, means: &[[f32; 4]]) -> Result<()> {
        let levels = std::mem::take(&mut self.written);
        let directory = Directory { levels, means: Means::new(means, &self.formats) };
        self.end = self.sections[3].offset;
        self.write_section(3, &directory::encode(&directory))
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> Result<()> {
        let mut file: &File = self.file.as_file();
        file.seek(SeekFrom::Start(offset))
            .and_then(|_| file.write_all(bytes))
            .map_err(|source| Error::writing(&self.path, source))
    }
}

/// Number of clusters that pages will be cut into, per level.
pub(crate) fn clusters_per_level(extents: &[[u32; 2]], formats: &[TexelFormat], levels: usize) -> Vec<usize> {
    let block_bytes: u64 = formats.iter().map(|f| f.block_bytes() as u64).sum();
    let count = |level: usize| {
        let (mut clusters, mut length) = (0, 0);
        for &extent in extents {
            let size = PageSize::new(extent, level as u32);
            for number in 0..size.page_count() {
                let [width, height] = size.page_extent(number).map(u64::from);
                let page_length = width / 4 * (height / 4) * block_bytes;
                if length == 0 || length + page_length > CLUSTER_TARGET_BYTES {
                    clusters += 1;
                    length = 0;
                }
                length += page_length;
            }
        }
        clusters
    };
    (0..levels).into_par_iter().map(count).collect()
}

/// Appends a skippable zstd frame where a section packs so well that readers would refuse it as a bomb.
pub(crate) fn lengthen(stored: &mut Vec<u8>, raw_length: u64) {
    let due = raw_length.saturating_sub(SECTION_RATIO_FREE).div_ceil(MAX_SECTION_RATIO) as usize;
    if stored.len() < due {
        let skipped = due - stored.len();
        stored.extend(SKIPPABLE_FRAME.to_le_bytes());
        stored.extend((skipped as u32).to_le_bytes());
        stored.resize(stored.len() + skipped, 0);
    }
}

/// The folder that holds `path`.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

pub(crate) fn temporary_file(path: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".fantex-").suffix(".tmp");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder_of(path))
}

/// Renames the finished file; without `force` never over another.
fn persist(file: NamedTempFile, path: &Path, force: bool) -> Result<()> {
    let renamed = if force { file.persist(path) } else { file.persist_noclobber(path) };
    renamed.map_err(|e| match e.error.kind() {
        std::io::ErrorKind::AlreadyExists => already_exists(path),
        _ => Error::writing(path, e.error),
    })?;
    // The rename is durable once the folder is.
    #[cfg(unix)]
    File::open(folder_of(path)).and_then(|folder| folder.sync_all()).map_err(|e| Error::writing(path, e))?;
    Ok(())
}

fn already_exists(path: &Path) -> Error {
    let sentence = format!("{} exists already; pass --force to overwrite it", path.display());
    Error::already_exists(sentence).with_path(path)
}
