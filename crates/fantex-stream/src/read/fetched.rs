//! Opening of assets where reading cannot block.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fantex_base::{Error, Result};
use fantex_store::{Asset, AssetHead, ByteSource};

/// Bytes of an asset that have been fetched.
#[derive(Clone, Debug)]
pub struct Fetched {
    /// As many as were asked for, or those up to the end.
    pub bytes: Vec<u8>,
    /// Bytes of the whole file, where that is known.
    pub total: Option<u64>,
}

/// Bytes of a range, or those up to the file's end: fetched in pieces of at most `piece` bytes, of which `fetch` may bring fewer than asked for.
#[cfg(any(test, target_arch = "wasm32"))]
pub(crate) async fn in_pieces(
    range: Range<u64>,
    piece: u64,
    fetch: impl AsyncFn(Range<u64>) -> io::Result<Fetched>,
) -> io::Result<Fetched> {
    let mut all = Fetched { bytes: Vec::new(), total: None };
    let mut next = range.start;
    while next < range.end {
        let Fetched { bytes, total } = fetch(next..range.end.min(next.saturating_add(piece))).await?;
        all.total = all.total.or(total);
        next += bytes.len() as u64;
        let is_end = bytes.is_empty() || all.total.is_some_and(|total| next >= total);
        if all.bytes.is_empty() {
            all.bytes = bytes;
        } else {
            all.bytes.extend(bytes);
        }
        if is_end {
            break;
        }
    }
    Ok(all)
}

/// What is fetched first: the header, and all that small assets have before their texels.
const FIRST_BYTES: u64 = 64 << 10;

/// Ranges that are fetched to open an asset, at most: the first bytes and every section by itself.
const MAX_FETCHES: usize = 8;

/// Opens an asset whose bytes `fetch` brings, range by range: two as a rule, one for small assets. `location` is for messages. The asset's
/// attachments are not fetched.
///
/// # Errors
/// Those of `fetch`; what is there is no asset, or damaged.
pub async fn open_fetched(
    location: &str,
    fetch: impl AsyncFn(Range<u64>) -> io::Result<Fetched>,
) -> Result<Asset> {
    FetchedFile::start(location, fetch).await?.asset().await
}

/// The start of a file that is fetched range by range.
#[derive(Debug)]
pub struct FetchedFile<F> {
    fetch: F,
    source: Arc<FetchedSource>,
}

impl<F: AsyncFn(Range<u64>) -> io::Result<Fetched>> FetchedFile<F> {
    /// Fetches the first bytes. `location` is for messages.
    ///
    /// # Errors
    /// Those of `fetch`.
    pub async fn start(location: &str, fetch: F) -> Result<Self> {
        let path = PathBuf::from(location);
        let first = fetch(0..FIRST_BYTES).await.map_err(|error| Error::reading(&path, error))?;
        Ok(Self { fetch, source: Arc::new(FetchedSource::new(path, first)) })
    }

    /// What the first bytes tell; none where these are not enough or damaged, which opening finds out, too.
    pub fn head(&self) -> Option<AssetHead> {
        let head = AssetHead::read(&*self.source);
        self.source.state().missing = None;
        head.ok()
    }

    /// The asset's [preview](fantex_store::PREVIEW): two further ranges, or none where there is none.
    ///
    /// # Errors
    /// Those of fetching; it is damaged, or the file is no asset.
    pub async fn preview(&self) -> Result<Option<Asset>> {
        self.opened(|source| Asset::open_preview(&**source)).await
    }

    /// The asset.
    ///
    /// # Errors
    /// Those of fetching; the file is no asset, or damaged.
    pub async fn asset(self) -> Result<Asset> {
        let asset = self.opened(|source| Asset::open_source(source.clone())).await?;
        self.source.state().spans = Vec::new();
        Ok(asset)
    }

    /// What `open` opens. Reads that fail because something has not been fetched say what, so that opening is simply tried again.
    async fn opened<T>(&self, open: impl Fn(&Arc<FetchedSource>) -> Result<T>) -> Result<T> {
        let failed = |error| Error::reading(&self.source.location, error);
        for _ in 0..MAX_FETCHES {
            let opened = open(&self.source);
            let missing = self.source.state().missing.take();
            let range = match (opened, missing) {
                (Ok(opened), _) => return Ok(opened),
                (Err(error), None) => return Err(error),
                (Err(_), Some(range)) => range,
            };
            let start = range.start;
            let bytes = (self.fetch)(range).await.map_err(failed)?.bytes;
            self.source.state().spans.push((start, bytes));
        }
        Err(failed(io::Error::other("the server sends less than was asked for")))
    }
}

/// The ranges of an asset that are fetched until there is something to show, in order: those of its [preview](fantex_store::PREVIEW), or all that is
/// needed to open the asset where it has none.
///
/// # Errors
/// The file cannot be read, is no asset, or is damaged.
#[cfg(not(target_arch = "wasm32"))]
pub fn first_ranges(file: &dyn ByteSource) -> Result<Vec<Range<u64>>> {
    let failed = |error| Error::reading(file.location(), error);
    let read = |range: &Range<u64>| {
        let mut bytes = vec![0; (range.end - range.start) as usize];
        let count = file.read_at(&mut bytes, range.start).map_err(failed)?;
        bytes.truncate(count);
        Ok::<_, Error>(bytes)
    };
    let mut ranges: Vec<_> = std::iter::once(0..FIRST_BYTES).collect();
    let first = Fetched { bytes: read(&ranges[0])?, total: Some(file.length().map_err(failed)?) };
    let source = Arc::new(FetchedSource::new(file.location().to_owned(), first));
    let mut has_preview = true;
    while ranges.len() <= MAX_FETCHES {
        let opened = if has_preview {
            Asset::open_preview(&*source).map(|preview| preview.is_some())
        } else {
            Asset::open_source(source.clone()).map(|_| true)
        };
        let missing = source.state().missing.take();
        match (opened, missing) {
            (Ok(true), _) => return Ok(ranges),
            (Ok(false), _) => has_preview = false,
            (Err(error), None) => return Err(error),
            // What comes last need not be unpacked here.
            (Err(_), Some(range)) if !has_preview => {
                ranges.push(range);
                return Ok(ranges);
            }
            (Err(_), Some(range)) => {
                let bytes = read(&range)?;
                source.state().spans.push((range.start, bytes));
                ranges.push(range);
            }
        }
    }
    Ok(ranges)
}

#[derive(Debug)]
struct FetchedSource {
    location: PathBuf,
    length: u64,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// First byte, and the bytes from there on.
    spans: Vec<(u64, Vec<u8>)>,
    /// What the last failed read asked for.
    missing: Option<Range<u64>>,
}

impl FetchedSource {
    fn new(location: PathBuf, first: Fetched) -> Self {
        let length = first.total.unwrap_or(u64::MAX);
        let state = State { spans: vec![(0, first.bytes)], missing: None };
        Self { location, length, state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ByteSource for FetchedSource {
    fn location(&self) -> &Path {
        &self.location
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.length)
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let end = offset.saturating_add(bytes.len() as u64).min(self.length);
        let length = end.saturating_sub(offset) as usize;
        let mut state = self.state();
        let found = state.spans.iter().find_map(|(start, span)| {
            let from = usize::try_from(offset.checked_sub(*start)?).ok()?;
            span.get(from..from.checked_add(length)?)
        });
        if let Some(found) = found {
            bytes[..length].copy_from_slice(found);
            return Ok(length);
        }
        state.missing = Some(offset..end);
        Err(io::Error::new(io::ErrorKind::WouldBlock, "these bytes have not been fetched"))
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::pin::pin;
    use std::task::{Context, Poll, Waker};

    use super::*;

    /// What a future gives that never waits.
    fn ready<T>(future: impl Future<Output = T>) -> T {
        match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(value) => value,
            Poll::Pending => panic!("it waits"),
        }
    }

    #[test]
    fn long_ranges_are_fetched_piece_by_piece_and_short_answers_asked_on() {
        let file: Vec<u8> = (0..100).collect();
        for (told, most) in [(true, 8), (true, 3), (false, 8), (false, 3)] {
            let asked = RefCell::new(Vec::new());
            // Like a server that sends at most so many bytes at once, and tells how long the file is or not.
            let fetch = async |range: Range<u64>| {
                asked.borrow_mut().push(range.clone());
                let end = range.end.min(range.start + most).min(100) as usize;
                let bytes = file[(range.start as usize).min(end)..end].to_vec();
                Ok(Fetched { bytes, total: told.then_some(100) })
            };
            let whole = ready(in_pieces(10..120, 8, fetch)).unwrap();
            assert_eq!(whole.bytes, file[10..]);
            let part = ready(in_pieces(10..30, 8, fetch)).unwrap();
            assert_eq!(part.bytes, file[10..30]);
            assert!(asked.borrow().iter().all(|range| range.end - range.start <= 8));
        }
        let failing = async |_| Err(io::Error::other("no"));
        assert!(ready(in_pieces(0..9, 8, failing)).is_err());
    }
}
