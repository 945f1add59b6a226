//! Pages of photographs: in memory as far as that is allowed, the others in a scratch file behind a cache.
//!
//! Photographs are decoded once, cut into square pages, and dropped. The first pages stay in memory; once these fill their share,
//! later ones go to an unnamed file, and what is looked up of them is cached. So memory is bounded whatever the number of
//! photographs, none is decoded twice, and it does not matter in which order tiles ask for them. Shared by all threads.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io;
use std::ops::Deref;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use fantex_store::{read_exact_at, write_all_at};

/// Side of a page in texels.
pub(crate) const PAGE: u32 = 64;

/// Where a page is.
#[derive(Clone, Debug)]
pub(crate) enum Stored {
    Memory(Arc<[u8]>),
    File { offset: u64, bytes: u32 },
}

/// A page while it is read.
pub(crate) enum PageBytes<'a> {
    Lent(&'a [u8]),
    Shared(Arc<[u8]>),
}

impl Deref for PageBytes<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Lent(bytes) => bytes,
            Self::Shared(bytes) => bytes,
        }
    }
}

/// Locks of the cache, so that threads seldom wait for each other.
const SHARDS: usize = 32;

/// All pages of a set of photographs.
#[derive(Debug)]
pub(crate) struct PageStore {
    folder: PathBuf,
    /// Bytes of pages that may stay in memory for good, and how many do.
    pinned_limit: u64,
    pinned: AtomicU64,
    /// Made when it is needed.
    scratch: Mutex<Option<Arc<File>>>,
    /// The same, for readers.
    readable: OnceLock<Arc<File>>,
    end: AtomicU64,
    shards: Vec<Mutex<Shard>>,
    shard_limit: u64,
    failure: OnceLock<io::Error>,
}

/// A part of the cache: pages by offset, and their order of arrival for the clock that evicts them.
#[derive(Debug, Default)]
struct Shard {
    pages: BTreeMap<u64, CachedPage>,
    order: VecDeque<u64>,
    bytes: u64,
}

#[derive(Debug)]
struct CachedPage {
    bytes: Arc<[u8]>,
    /// Looked up since the clock's hand passed.
    is_used: bool,
}

impl PageStore {
    /// A store whose pages take `memory_bytes` at most; what does not fit goes to a file in `folder`.
    pub(crate) fn new(memory_bytes: u64, folder: PathBuf) -> Self {
        Self {
            folder,
            pinned_limit: memory_bytes / 4 * 3,
            pinned: AtomicU64::new(0),
            scratch: Mutex::new(None),
            readable: OnceLock::new(),
            end: AtomicU64::new(0),
            shards: (0..SHARDS).map(|_| Mutex::default()).collect(),
            shard_limit: memory_bytes / 4 / SHARDS as u64,
            failure: OnceLock::new(),
        }
    }

    /// Keeps a page.
    pub(crate) fn append(&self, page: Vec<u8>) -> io::Result<Stored> {
        let length = page.len() as u64;
        if self.pinned.fetch_add(length, Relaxed) + length <= self.pinned_limit {
            return Ok(Stored::Memory(page.into()));
        }
        self.pinned.fetch_sub(length, Relaxed);
        let file = self.scratch_file()?;
        let offset = self.end.fetch_add(length, Relaxed);
        write_all_at(&file, &page, offset)?;
        Ok(Stored::File { offset, bytes: page.len() as u32 })
    }

    fn scratch_file(&self) -> io::Result<Arc<File>> {
        let mut scratch = locked(&self.scratch);
        if let Some(file) = &*scratch {
            return Ok(file.clone());
        }
        let file = Arc::new(tempfile::tempfile_in(&self.folder)?);
        self.readable.get_or_init(|| file.clone());
        *scratch = Some(file.clone());
        Ok(file)
    }

    /// Bytes of pages in memory for good, and in the scratch file.
    pub(crate) fn bytes(&self) -> [u64; 2] {
        [self.pinned.load(Relaxed), self.end.load(Relaxed)]
    }

    /// The first page that could not be read. What was asked for then saw nothing.
    pub(crate) fn failure(&self) -> Option<&io::Error> {
        self.failure.get()
    }

    fn cached(&self, offset: u64, bytes: u32) -> Option<Arc<[u8]>> {
        let shard = &self.shards[(offset / u64::from(bytes.max(1)) % SHARDS as u64) as usize];
        if let Some(page) = locked(shard).pages.get_mut(&offset) {
            page.is_used = true;
            return Some(page.bytes.clone());
        }
        // Read without the lock; if two threads read the same page, the second one finds it there.
        let mut page = vec![0; bytes as usize];
        let read = match self.readable.get() {
            Some(file) => read_exact_at(file, &mut page, offset),
            None => Err(io::ErrorKind::NotFound.into()),
        };
        match read {
            Ok(()) => Some(locked(shard).insert(offset, page.into(), self.shard_limit)),
            Err(error) => {
                self.failure.get_or_init(|| error);
                None
            }
        }
    }
}

impl Shard {
    /// Keeps a page, at the price of others that were not looked up for longer.
    fn insert(&mut self, offset: u64, bytes: Arc<[u8]>, limit: u64) -> Arc<[u8]> {
        if let Some(page) = self.pages.get(&offset) {
            return page.bytes.clone();
        }
        self.bytes += bytes.len() as u64;
        while self.bytes > limit {
            let Some(oldest) = self.order.pop_front() else { break };
            match self.pages.get_mut(&oldest) {
                Some(page) if page.is_used => {
                    page.is_used = false;
                    self.order.push_back(oldest);
                }
                Some(page) => {
                    self.bytes -= page.bytes.len() as u64;
                    self.pages.remove(&oldest);
                }
                None => {}
            }
        }
        self.order.push_back(offset);
        self.pages.insert(offset, CachedPage { bytes: bytes.clone(), is_used: false });
        bytes
    }
}

/// Pages that a reader has at hand without a lock.
const AT_HAND: usize = 64;

/// A page with its offset.
type AtHand = (u64, Arc<[u8]>);

/// Reads pages on one thread, and keeps the last ones at hand.
pub(crate) struct PageReader<'a> {
    store: &'a PageStore,
    at_hand: RefCell<Vec<Option<AtHand>>>,
}

impl<'a> PageReader<'a> {
    pub(crate) fn new(store: &'a PageStore) -> Self {
        Self { store, at_hand: RefCell::new(Vec::new()) }
    }

    /// The bytes of a page; nothing where it cannot be read ([`PageStore::failure`]).
    pub(crate) fn page<'p>(&self, stored: &'p Stored) -> Option<PageBytes<'p>> {
        let (offset, bytes) = match stored {
            Stored::Memory(bytes) => return Some(PageBytes::Lent(bytes)),
            Stored::File { offset, bytes } => (*offset, *bytes),
        };
        let mut at_hand = self.at_hand.borrow_mut();
        if at_hand.is_empty() {
            at_hand.resize(AT_HAND, None);
        }
        let place = &mut at_hand[(offset / u64::from(bytes.max(1)) % AT_HAND as u64) as usize];
        match place {
            Some((at, page)) if *at == offset => Some(PageBytes::Shared(page.clone())),
            place => {
                let page = self.store.cached(offset, bytes)?;
                *place = Some((offset, page.clone()));
                Some(PageBytes::Shared(page))
            }
        }
    }
}

/// What a panicking thread leaves behind is whole: nothing in between can fail.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_come_back_from_memory_and_from_the_file() {
        let store = PageStore::new(64 << 10, std::env::temp_dir());
        let page = |i: u32| vec![(i % 251) as u8; 1024];
        let stored: Vec<Stored> = (0..300).map(|i| store.append(page(i)).unwrap()).collect();
        let [in_memory, in_file] = store.bytes();
        assert!(in_memory <= 48 << 10 && in_memory > 40 << 10);
        assert_eq!(in_memory + in_file, 300 * 1024);
        let reader = PageReader::new(&store);
        for step in [1, 7, 101] {
            for i in 0..300 {
                let i = i * step % 300;
                assert_eq!(*reader.page(&stored[i]).unwrap(), *page(i as u32), "{i}");
            }
        }
        let cached: u64 = store.shards.iter().map(|s| locked(s).bytes).sum();
        assert!(cached <= 32 << 10, "the cache holds {cached} bytes");
        assert!(store.failure().is_none());
    }

    #[test]
    fn an_unreadable_page_is_a_failure_and_no_panic() {
        let store = PageStore::new(0, std::env::temp_dir());
        assert!(store.append(vec![1; 8]).is_ok());
        let beyond = Stored::File { offset: 1 << 20, bytes: 8 };
        assert!(PageReader::new(&store).page(&beyond).is_none());
        assert!(store.failure().is_some());
        let nowhere = PageStore::new(0, PathBuf::from("/nonexistent/folder"));
        assert!(nowhere.append(vec![1; 8]).is_err());
    }
}
