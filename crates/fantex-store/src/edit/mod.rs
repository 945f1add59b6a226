//! Changing assets in place, safely.
//!
//! ```text
//!  replace, set_mean, attach      commit
//!  ------------------------>  1. changed clusters, attachments, directory -> free space or the file's end
//!      kept in memory         2. made durable
//!      (flush: step 1 early)  3. the header slot that does not count <- generation + 1
//!                             4. made durable
//! ```
//!
//! - *Nothing that a header slot names is ever overwritten*, so a crash at any moment leaves a committed state: the old
//!   one up to step 3, the new one after it. A torn slot fails its checksum and leaves the other one.
//! - *A reader keeps its generation.* Space that a commit supersedes is reused only when neither slot names it (after the
//!   second next commit), no [`Asset`] that this editor handed out is older, and no other reader has the file open (see
//!   `lock.rs`). Until then the file grows.
//! - *A failed commit loses nothing.* Changes stay with the editor, the space taken is given back, and the commit can be
//!   tried again; after a failed sync it writes everything again that no sync has covered. If it fails at step 3 or 4 the new
//!   generation may or may not be on the disk; both are whole, and the next attempt takes another number.
//!
//! Here are the changes and reading through them; in `commit.rs` the steps above, in `space.rs` where changed clusters go, in
//! `lock.rs` who may write, in `compact.rs` the copy without gaps, in `added.rs` further or fewer channels.

mod added;
mod commit;
mod compact;
pub(crate) mod lock;
mod space;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::{File, OpenOptions};
use std::ops::{Bound, Range};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use fantex_base::{Error, Result};

use self::commit::{DurableOutput, FileOutput, LevelChanges};
use self::space::{Space, padded_in_order, without_fixed};
use crate::directory::{self, Attachments, ClusterEntry, Directory};
use crate::header::{SECTION_NAMES, SectionRecord, Slot, read_other_slot, read_section};
use crate::layout::ClusterPages;
use crate::limits::{MAX_ATTACHMENT_BYTES, MAX_ATTACHMENT_NAME_BYTES};
use crate::reader::read_attachments;
use crate::{Asset, FileSource, PageId, Texels};

pub use self::added::MIDDLE_HEIGHT;
pub use self::commit::{CommitSummary, EditOutput};
pub use self::compact::{CompactSummary, MAX_GAPS, MAX_GAPS_COPIED};
pub use self::lock::{Replacement, WriterLock};

/// How to edit an asset.
#[derive(Clone, Copy, Debug)]
pub struct EditOptions {
    /// zstd level of rewritten clusters, 1..=19.
    pub zstd_level: i32,
    /// Bytes before packing of a cluster that an edit makes, or one page. A cluster is packed as a whole, so that one changed page
    /// costs all of its pages. A baked cluster holds 256 KiB; where an edit touches one, it is cut into runs of this length, so that
    /// the next edit nearby rewrites less.
    pub run_bytes: usize,
}

impl Default for EditOptions {
    /// zstd level 1; one page of 256x256 texels in BC7.
    fn default() -> Self {
        Self { zstd_level: 1, run_bytes: 64 << 10 }
    }
}

/// The one writer of an asset. Dropping it drops what is not committed.
#[derive(Debug)]
pub struct AssetEditor {
    options: EditOptions,
    lock: Arc<WriterLock>,
    /// The asset's, open for reading and writing.
    file: Arc<File>,
    output: DurableOutput,
    /// The newest committed generation.
    asset: Arc<Asset>,
    /// All generations that were handed out.
    snapshots: Vec<(u64, Weak<Asset>)>,
    pending: Pending,
    flushed: Flushed,
    space: Space,
    header: HeaderState,
    /// The file grows to so many bytes at most.
    limit: Option<u64>,
    /// Whether it is written to wherever it is.
    is_detached: bool,
    recent: Mutex<RecentClusters>,
    /// Pages that were replaced since they were last taken, if that is asked for.
    replaced: Option<BTreeSet<PageId>>,
}

#[derive(Debug, Default)]
struct Pending {
    /// Per level.
    pages: Vec<LevelChanges>,
    page_bytes: usize,
    /// None removes.
    attachments: BTreeMap<String, Option<Vec<u8>>>,
    attachment_bytes: usize,
}

impl Pending {
    fn insert_attachment(&mut self, name: String, contents: Option<Vec<u8>>) {
        self.attachment_bytes += contents.as_ref().map_or(0, Vec::len);
        let old = self.attachments.insert(name, contents);
        self.attachment_bytes -= old.flatten().map_or(0, |old| old.len());
    }

    fn remove_attachment(&mut self, name: &str) {
        let old = self.attachments.remove(name);
        self.attachment_bytes -= old.flatten().map_or(0, |old| old.len());
    }

    fn pop_first_attachment(&mut self) -> Option<(String, Option<Vec<u8>>)> {
        let (name, contents) = self.attachments.pop_first()?;
        self.attachment_bytes -= contents.as_ref().map_or(0, Vec::len);
        Some((name, contents))
    }
}

/// Changes that are in the file already, though nothing committed names them.
#[derive(Debug)]
struct Flushed {
    /// The directory that the next commit will write, where it differs.
    directory: Arc<Directory>,
    attachments: Attachments,
    changed: bool,
    /// Where flushed clusters and attachments start that no slot can name.
    uncommitted: BTreeSet<u64>,
    /// What the next commit supersedes.
    superseded: Vec<Range<u64>>,
}

impl Flushed {
    fn none(asset: &Asset) -> Result<Self> {
        Ok(Self {
            directory: Arc::clone(asset.directory()),
            attachments: asset.attachments()?.clone(),
            changed: false,
            uncommitted: BTreeSet::new(),
            superseded: Vec::new(),
        })
    }
}

/// What the two slots hold.
#[derive(Debug)]
struct HeaderState {
    /// Index of the slot that the next commit overwrites.
    target: usize,
    /// The oldest generation that a slot names.
    oldest: u64,
    /// The newest one that was ever written, whether or not that succeeded.
    newest: u64,
    /// False for a file in which parts of the two generations overlap: nothing in it is overwritten.
    may_reuse: bool,
}

impl AssetEditor {
    /// Opens an asset for changing. Takes the lock that keeps other writers out; readers are welcome.
    ///
    /// # Errors
    /// Another writer is at work, or the asset cannot be opened.
    pub fn open(path: &Path, options: &EditOptions) -> Result<Self> {
        Self::open_with_output(path, options, |file| Box::new(FileOutput(file)))
    }

    /// The same where changes reach the file through another output: to count, delay or spoil writes.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with_output(
        path: &Path,
        options: &EditOptions,
        output: impl FnOnce(Arc<File>) -> Box<dyn EditOutput>,
    ) -> Result<Self> {
        path.metadata().map_err(|source| Error::reading(path, source))?;
        let lock = Arc::new(WriterLock::acquire(path)?);
        let file = OpenOptions::new().read(true).write(true).open(path);
        let file = Arc::new(file.map_err(|source| Error::writing(path, source))?);
        let output = output(Arc::clone(&file));
        Self::locked(path, *options, lock, file, output)
    }

    fn locked(
        path: &Path,
        options: EditOptions,
        lock: Arc<WriterLock>,
        file: Arc<File>,
        output: Box<dyn EditOutput>,
    ) -> Result<Self> {
        let source = FileSource::from_file(path, Arc::clone(&file));
        let asset = Arc::new(Asset::open_source(Arc::new(source))?);
        if asset.generation() == u64::MAX {
            // A commit after it would count as older.
            let sentence =
                format!("{} has the last number of a generation: it cannot be changed", path.display());
            return Err(Error::malformed(sentence).with_path(path));
        }
        let flushed = Flushed::none(&asset)?;
        let (space, header) = space_and_header(&asset);
        let levels = asset.level_count() as usize;
        Ok(Self {
            options,
            lock,
            file,
            output: DurableOutput::new(output),
            snapshots: vec![(asset.generation(), Arc::downgrade(&asset))],
            pending: Pending { pages: vec![LevelChanges::new(); levels], ..Pending::default() },
            flushed,
            space,
            header,
            asset,
            limit: None,
            is_detached: false,
            recent: Mutex::default(),
            replaced: None,
        })
    }

    /// The newest committed state. It stays readable as it is, also through later commits and after the editor is gone.
    pub fn asset(&self) -> &Arc<Asset> {
        &self.asset
    }

    /// Replaces a page's bytes in one channel, by [`encode`](crate::encode)'s. In memory until [`flush`](Self::flush) or
    /// [`commit`](Self::commit).
    ///
    /// # Errors
    /// There is no such page or channel, or the bytes are not as many as it takes.
    pub fn replace(&mut self, page: PageId, channel: usize, bytes: Vec<u8>) -> Result<()> {
        let extent = self.asset.page_extent(channel, page)?;
        let expected = self.asset.formats()[channel].bytes(extent);
        if bytes.len() != expected {
            let (path, got) = (self.asset.path(), bytes.len());
            let sentence = format!(
                "cannot change {}: page ({page}) takes {expected} bytes in channel {channel}, but {got} were given",
                path.display()
            );
            return Err(Error::invalid(sentence).with_path(path));
        }
        let place = self.asset.place_of(page)?;
        let channels = self.asset.formats().len();
        let change = self.pending.pages[page.level as usize].entry(place);
        let slot = &mut change.or_insert_with(|| vec![None; channels])[channel];
        self.pending.page_bytes += bytes.len();
        self.pending.page_bytes -= slot.replace(Arc::new(bytes)).map_or(0, |old| old.len());
        if let Some(replaced) = &mut self.replaced {
            replaced.insert(page);
        }
        Ok(())
    }

    /// The pages that were replaced since the last call, ascending; from the first call on they are remembered. For
    /// whoever shows the asset while it changes.
    pub fn take_replaced(&mut self) -> Vec<PageId> {
        self.replaced.replace(BTreeSet::new()).unwrap_or_default().into_iter().collect()
    }

    /// Replaces the mean of a group: **linear** RGBA (normals as stored). Panics where `channel` or `group` is out of range.
    pub fn set_mean(&mut self, channel: usize, group: u32, mean: [f32; 4]) {
        Arc::make_mut(&mut self.flushed.directory).means.set(channel, group, mean);
        self.flushed.changed = true;
    }

    /// Adds or replaces an attachment, up to 1 GiB under a name of up to 255 bytes.
    ///
    /// # Errors
    /// Name or contents are too long.
    pub fn attach(&mut self, name: &str, contents: Vec<u8>) -> Result<()> {
        let bytes = contents.len() as u64;
        if name.len() > MAX_ATTACHMENT_NAME_BYTES || bytes > MAX_ATTACHMENT_BYTES {
            let (name, limit) = (name.to_owned(), MAX_ATTACHMENT_BYTES);
            return Err(Error::too_large(format!(
                "attachment {name:?} has {bytes} bytes; names may have up to 255 and contents up to {limit} bytes"
            )));
        }
        self.pending.insert_attachment(name.to_owned(), Some(contents));
        Ok(())
    }

    /// Removes an attachment, if there is one of that name.
    pub fn detach(&mut self, name: &str) {
        if self.flushed.attachments.contains_key(name) {
            self.pending.insert_attachment(name.to_owned(), None);
        } else {
            self.pending.remove_attachment(name);
        }
    }

    /// Bytes of changed pages and attachments in memory.
    pub fn pending_bytes(&self) -> usize {
        self.pending.page_bytes + self.pending.attachment_bytes
    }

    /// True where a commit would change something.
    pub fn has_changes(&self) -> bool {
        self.flushed.changed || self.has_pending()
    }

    fn has_pending(&self) -> bool {
        !self.pending.attachments.is_empty() || self.pending.pages.iter().any(|pages| !pages.is_empty())
    }

    /// Reads a page's bytes with all changes, committed or not. Keeps the last few clusters.
    ///
    /// # Errors
    /// There is no such page, or it cannot be read.
    pub fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>> {
        let (asset, directory) = (&*self.asset, &*self.flushed.directory);
        View { asset, directory, pages: &self.pending.pages, recent: &self.recent }
            .read_page_raw(channel, page)
    }

    /// All pages as they are now, for other threads.
    pub fn snapshot(&self) -> EditorSnapshot {
        let recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner).clone();
        EditorSnapshot {
            asset: Arc::clone(&self.asset),
            directory: Arc::clone(&self.flushed.directory),
            pages: self.pending.pages.clone(),
            recent: Mutex::new(recent),
        }
    }

    /// Lets the file grow to so many bytes at most, as if the disk had no room beyond; none lifts the limit. (A quota.)
    pub fn limit_file(&mut self, bytes: Option<u64>) {
        self.limit = bytes;
    }

    /// Reads and decodes a page with all changes, committed or not. Not cached.
    ///
    /// # Errors
    /// As [`read_page_raw`](Self::read_page_raw).
    pub fn read_page(&self, channel: usize, page: PageId) -> Result<Texels> {
        let bytes = self.read_page_raw(channel, page)?;
        self.asset.decode_page_raw(channel, page, &bytes)
    }

    /// The mean of a group with all changes. Panics where `channel` or `group` is out of range.
    pub fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.flushed.directory.means.get(channel, group)
    }

    /// Reads an attachment with all changes, committed or not.
    ///
    /// # Errors
    /// It cannot be read, or is damaged.
    pub fn attachment(&self, name: &str) -> Result<Option<Vec<u8>>> {
        if let Some(change) = self.pending.attachments.get(name) {
            return Ok(change.clone());
        }
        let record = self.flushed.attachments.get(name);
        record.map(|record| self.asset.read_attachment(name, record)).transpose()
    }

    /// Whether there is an attachment of that name, with all changes.
    pub fn has_attachment(&self, name: &str) -> bool {
        let change = self.pending.attachments.get(name).map(Option::is_some);
        change.unwrap_or_else(|| self.flushed.attachments.contains_key(name))
    }

    /// Names of all attachments with all changes, ascending.
    pub fn attachment_names(&self) -> Vec<String> {
        self.attachment_names_with("")
    }

    /// The same of those whose names begin with `start`, however many others there are.
    pub fn attachment_names_with(&self, start: &str) -> Vec<String> {
        let from = (Bound::Included(start), Bound::Unbounded);
        let flushed = self.flushed.attachments.range::<str, _>(from).map(|(name, _)| name);
        let mut names: BTreeSet<&String> = flushed.take_while(|name| name.starts_with(start)).collect();
        let pending = self.pending.attachments.range::<str, _>(from);
        for (name, change) in pending.take_while(|(name, _)| name.starts_with(start)) {
            if change.is_some() {
                names.insert(name)
            } else {
                names.remove(name)
            };
        }
        names.into_iter().cloned().collect()
    }

    /// Forgets all changes that are not committed.
    ///
    /// # Errors
    /// The committed attachments are damaged.
    pub fn discard(&mut self) -> Result<()> {
        let flushed = Flushed::none(&self.asset)?;
        self.release_uncommitted();
        self.flushed = flushed;
        let levels = self.pending.pages.len();
        self.pending = Pending { pages: vec![LevelChanges::new(); levels], ..Pending::default() };
        Ok(())
    }

    /// Frees the room of changes that no commit will name; at the file's end, for others, too.
    fn release_uncommitted(&mut self) {
        let Flushed { directory, attachments, uncommitted, .. } = &self.flushed;
        let clusters = directory.levels.iter().flatten().map(ClusterEntry::range);
        let ranges = clusters.chain(attachments.values().map(SectionRecord::range));
        ranges
            .filter(|range| uncommitted.contains(&range.start))
            .for_each(|range| self.space.release(&range));
        let length = self.space.end().max(self.asset.file_bytes());
        if self.asset.source().length().is_ok_and(|actual| actual > length) {
            // Where that fails, the next commit sets the length.
            self.output.set_len(length).unwrap_or_default();
        }
    }
}

impl Drop for AssetEditor {
    fn drop(&mut self) {
        self.release_uncommitted();
    }
}

/// True where parts of a file share no block with each other, but with the fixed ones at most.
fn are_apart(fixed: &[Range<u64>], changing: &[Range<u64>]) -> bool {
    let fixed = padded_in_order(fixed);
    let mut parts: Vec<_> = changing.iter().flat_map(|range| without_fixed(range, &fixed)).collect();
    parts.sort_unstable_by_key(|range| range.start);
    parts.windows(2).all(|pair| pair[0].end <= pair[1].start)
}

/// All bytes that a generation names: the fixed sections first. Without `attachments`, whose list is damaged then, not that list either: it may
/// claim to lie anywhere.
fn used_ranges(
    slot: &Slot,
    directory: &Directory,
    attachments: Option<&Attachments>,
) -> impl Iterator<Item = Range<u64>> {
    let list = attachments.map(|_| &slot.attachments);
    let attached = attachments.into_iter().flat_map(Attachments::values);
    let sections = slot.sections.iter().chain(list).chain(attached);
    let ranges: Vec<_> = sections.map(SectionRecord::range).collect();
    let clusters: Vec<_> = directory.levels.iter().flatten().map(ClusterEntry::range).collect();
    ranges.into_iter().chain(clusters)
}

/// Finds out what is free in a file. What cannot be read of the other generation is not worth keeping.
fn space_and_header(asset: &Asset) -> (Space, HeaderState) {
    let slot = *asset.slot();
    let current: Vec<Range<u64>> = used_ranges(&slot, asset.directory(), asset.attachments().ok()).collect();
    let fixed: Vec<Range<u64>> = slot.sections[..3].iter().map(SectionRecord::range).collect();
    let (target, other_slot) = read_other_slot(&**asset.source(), &slot);
    // A file never gets shorter, so a slot that says so is wrong, and what it names beyond the end is no place to write to.
    let is_possible = |other: &Slot| other.file_length <= slot.file_length && other.names_the_file_only();
    let other_slot = other_slot.filter(is_possible);
    let mut older: Vec<Range<u64>> =
        other_slot.as_ref().and_then(|o| ranges_of(asset, o)).unwrap_or_default();
    let known: BTreeSet<[u64; 2]> = current.iter().map(|range| [range.start, range.end]).collect();
    older.retain(|range| !known.contains(&[range.start, range.end]));
    // What only the other generation names becomes free after the next commit: nothing of this one may lie in it.
    let changing: Vec<Range<u64>> = current[3..].iter().chain(&older).cloned().collect();
    let may_reuse = are_apart(&fixed, &changing);
    let oldest = other_slot.map_or(slot.generation, |other| other.generation.min(slot.generation));
    let mut space = Space::new(slot.file_length, &fixed, current.iter().chain(&older).cloned(), oldest);
    older.into_iter().for_each(|range| space.retire(range, slot.generation));
    let newest = slot.generation;
    (space, HeaderState { target, oldest, newest, may_reuse })
}

/// What the other slot names; none where it cannot be read.
fn ranges_of(asset: &Asset, slot: &Slot) -> Option<Vec<Range<u64>>> {
    let source = &**asset.source();
    let raw = read_section(source, SECTION_NAMES[3], &slot.sections[3], slot.file_length).ok()?;
    let (cover, formats) = (asset.cover(), asset.formats());
    let expected = directory::Expected { cover, formats, places: slot.places() };
    let directory = directory::decode(&raw, &expected).ok()?;
    Some(used_ranges(slot, &directory, Some(&read_attachments(source, slot).ok()?)).collect())
}

/// Clusters that were unpacked last, by offset and checksum: neighbouring pages are mostly read together.
type RecentClusters = VecDeque<([u64; 2], Arc<ClusterPages>)>;

/// Clusters that are kept unpacked, of 64 to 256 KiB mostly.
const RECENT_CLUSTERS: usize = 32;

struct View<'a> {
    asset: &'a Asset,
    directory: &'a Directory,
    /// In memory, per level.
    pages: &'a [LevelChanges],
    recent: &'a Mutex<RecentClusters>,
}

impl View<'_> {
    fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>> {
        self.asset.page_extent(channel, page)?;
        let place = self.asset.place_of(page)?;
        let change = self.pages[page.level as usize].get(&place);
        if let Some(bytes) = change.and_then(|change| change[channel].as_ref()) {
            return Ok(bytes.to_vec());
        }
        let index = self.directory.cluster_of(page.level, place);
        let cluster = self.cluster(page.level, &self.directory.levels[page.level as usize][index])?;
        self.asset.page_in(&cluster, channel, page).map(<[u8]>::to_vec)
    }

    fn cluster(&self, level: u32, entry: &ClusterEntry) -> Result<Arc<ClusterPages>> {
        let key = [entry.offset, entry.checksum];
        let lock = || self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, cluster)) = lock().iter().find(|(known, _)| *known == key) {
            return Ok(Arc::clone(cluster));
        }
        let cluster = Arc::new(self.asset.read_entry(level, entry)?);
        let mut recent = lock();
        if recent.len() >= RECENT_CLUSTERS {
            recent.pop_front();
        }
        recent.push_back((key, Arc::clone(&cluster)));
        Ok(cluster)
    }
}

/// All pages of an asset as an editor had them at a moment, for other threads. Later changes do not show in it. It can be read
/// until the editor next flushes or commits; after that, reading what was flushed before may fail.
#[derive(Debug)]
pub struct EditorSnapshot {
    asset: Arc<Asset>,
    directory: Arc<Directory>,
    pages: Vec<LevelChanges>,
    recent: Mutex<RecentClusters>,
}

impl EditorSnapshot {
    /// The committed state below the changes.
    pub fn asset(&self) -> &Arc<Asset> {
        &self.asset
    }

    /// A page's bytes.
    ///
    /// # Errors
    /// There is no such page, or it cannot be read.
    pub fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>> {
        let Self { asset, directory, pages, recent } = self;
        View { asset, directory, pages, recent }.read_page_raw(channel, page)
    }

    /// A page, decoded.
    ///
    /// # Errors
    /// As [`read_page_raw`](Self::read_page_raw).
    pub fn read_page(&self, channel: usize, page: PageId) -> Result<Texels> {
        let bytes = self.read_page_raw(channel, page)?;
        self.asset.decode_page_raw(channel, page, &bytes)
    }
}
