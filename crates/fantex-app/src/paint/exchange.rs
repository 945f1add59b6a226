//! Mailbox between the render thread and the paint thread.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fantex::base::{Error, Result};
use fantex::cover::Cover;
use fantex::paint::Painter;
use fantex::store::{Asset, PageId, decode_plain, page_extent};
use fantex::stream::{AtlasFormat, LoadedParcel, Outline, Parcel, ParcelLoader, ParcelTexels, assemble};

use crate::paint::Order;

/// Pages that change at once and are handed over with their texels; beyond it they are asked for one after the other.
const MAX_FRESH: usize = 512;

/// What both threads see.
pub struct Exchange {
    state: Mutex<State>,
    /// Tells the parcels of pages.
    cover: Arc<Cover>,
    orders: Sender<Order>,
}

#[derive(Default)]
struct State {
    /// In which formats the atlas takes texels; none until there is one.
    formats: Option<Arc<[AtlasFormat]>>,
    /// Parcels with pages that differ from the file as the loader knows it.
    edited: BTreeSet<Parcel>,
    /// Parcels that the painter is asked for, with their urgency.
    wanted: BTreeMap<Parcel, f32>,
    /// Its answers.
    ready: BTreeMap<Parcel, (f32, Result<ParcelTexels>)>,
    /// Pages that have just changed.
    fresh: BTreeMap<PageId, ParcelTexels>,
    /// The same where there are too many: they have to be asked for.
    stale: Vec<PageId>,
    /// A newer state of the file, for the loader to go over to.
    newer: Option<Newer>,
    /// The state that the loader has gone over to.
    asset: Option<Arc<Asset>>,
}

/// A committed state of the file, newer than the one that pages are loaded from.
struct Newer {
    loader: Box<dyn ParcelLoader>,
    asset: Arc<Asset>,
    /// Parcels that differ from it.
    edited: BTreeSet<Parcel>,
}

impl std::fmt::Debug for Exchange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Exchange").finish_non_exhaustive()
    }
}

impl Exchange {
    /// Nothing has changed. `cover`: of the asset that is painted on.
    pub fn new(orders: Sender<Order>, cover: Arc<Cover>) -> Self {
        Self { state: Mutex::default(), cover, orders }
    }

    fn parcel_of(&self, page: PageId) -> Parcel {
        Parcel::of(&self.cover.groups[page.group as usize], page)
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Says in which formats texels are wanted. Where another device wants others, what waits in the former ones is asked for anew.
    pub fn set_formats(&self, formats: &[AtlasFormat]) {
        let mut state = self.lock();
        if state.formats.as_deref() == Some(formats) {
            return;
        }
        state.formats = Some(formats.into());
        state.forget_texels();
        let ready = std::mem::take(&mut state.ready);
        state.wanted.extend(ready.into_iter().map(|(parcel, (urgency, _))| (parcel, urgency)));
        let newer = state.newer.take();
        drop(state);
        if let Some(newer) = newer {
            // Its threads may be reading: the painter waits for them.
            self.orders.send(Order::Release(newer.loader)).ok();
        }
    }

    /// In which formats texels are wanted, once that is known.
    pub fn formats(&self) -> Option<Arc<[AtlasFormat]>> {
        self.lock().formats.clone()
    }

    /// Lets the painter look once more at what is wanted.
    pub(crate) fn ask_again(&self) {
        // Where the painter is gone nobody answers; pages stay as they are.
        self.orders.send(Order::Pages).ok();
    }

    /// The painter's: these pages are not any more as the file says. `texels` gives them as they are now.
    ///
    /// # Errors
    /// That of `texels`.
    pub fn publish<E>(
        &self,
        pages: &[PageId],
        mut texels: impl FnMut(PageId) -> Result<ParcelTexels, E>,
    ) -> Result<(), E> {
        if pages.len() > MAX_FRESH {
            self.outdate(pages);
            return Ok(());
        }
        for &page in pages {
            let now = texels(page)?;
            self.lock().note(self.parcel_of(page));
            self.publish_preview(page, now);
        }
        Ok(())
    }

    /// The painter's: these pages are not any more as the file says, and have to be asked for.
    pub fn outdate(&self, pages: &[PageId]) {
        let mut state = self.lock();
        for &page in pages {
            state.note(self.parcel_of(page));
            state.fresh.remove(&page);
        }
        state.stale.extend(pages);
    }

    /// The painter's: what it has published may be in formats that are not wanted any more.
    pub(crate) fn forget_texels(&self) {
        self.lock().forget_texels();
    }

    /// The painter's: pages may be loaded from this state of the file from now on, so that the older one need not be kept.
    /// What differs from it is in `differing`, or published later.
    pub fn offer(&self, loader: Box<dyn ParcelLoader>, asset: Arc<Asset>, differing: &[PageId]) {
        let edited = differing.iter().map(|&page| self.parcel_of(page)).collect();
        self.lock().newer = Some(Newer { loader, asset, edited });
    }

    /// The drawer's: the state of the file that pages are loaded from, where it is another one than at the last call.
    pub fn take_asset(&self) -> Option<Arc<Asset>> {
        self.lock().asset.take()
    }

    /// The painter's: these pages look like this while a stroke is open.
    pub fn publish_preview(&self, page: PageId, texels: ParcelTexels) {
        let is_outdated = self.lock().put(page, self.parcel_of(page), texels);
        if is_outdated {
            self.ask_again();
        }
    }

    /// The painter's: some parcels that are wanted, the most urgent first.
    pub fn wanted(&self, most: usize) -> Vec<Parcel> {
        // Frames wait for the lock: it is not held while thousands are sorted.
        let all: Vec<(Parcel, f32)> = self.lock().wanted.iter().map(|(&p, &urgency)| (p, urgency)).collect();
        let mut wanted = by_urgency(all.into_iter());
        wanted.truncate(most);
        wanted
    }

    /// The painter's: an answer. One that nobody waits for any more is dropped.
    pub fn answer(&self, parcel: Parcel, texels: Result<ParcelTexels>) {
        let mut state = self.lock();
        if let Some(urgency) = state.wanted.remove(&parcel) {
            state.ready.insert(parcel, (urgency, texels));
        }
    }

    /// The drawer's: pages that have changed, with their texels, and those that have to be asked for.
    pub fn take_fresh(&self) -> (BTreeMap<PageId, ParcelTexels>, Vec<PageId>) {
        let mut state = self.lock();
        (std::mem::take(&mut state.fresh), std::mem::take(&mut state.stale))
    }

    /// Whether the drawer has nothing to take.
    pub fn is_empty(&self) -> bool {
        let state = self.lock();
        state.fresh.is_empty() && state.stale.is_empty() && state.ready.is_empty()
    }
}

/// Parcels by their urgency, the most urgent first.
fn by_urgency(parcels: impl Iterator<Item = (Parcel, f32)>) -> Vec<Parcel> {
    let mut sorted: Vec<(Parcel, f32)> = parcels.collect();
    sorted.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    sorted.into_iter().map(|(parcel, _)| parcel).collect()
}

impl State {
    /// A parcel is not any more as the file says.
    fn note(&mut self, parcel: Parcel) {
        self.edited.insert(parcel);
        if let Some(newer) = &mut self.newer {
            newer.edited.insert(parcel);
        }
    }

    /// Pages that have changed have to be asked for.
    fn forget_texels(&mut self) {
        let fresh = std::mem::take(&mut self.fresh);
        self.stale.extend(fresh.into_keys());
    }

    /// Takes a page as it is now. An answer that waits is older: true if the painter has to be asked once more.
    fn put(&mut self, page: PageId, parcel: Parcel, texels: ParcelTexels) -> bool {
        let is_outdated = match (self.ready.get_mut(&parcel), parcel) {
            (Some((_, answer)), Parcel::Page(_)) => {
                *answer = Ok(texels.clone());
                false
            }
            (Some(&mut (urgency, _)), Parcel::Bundle { .. }) => {
                self.ready.remove(&parcel);
                self.wanted.insert(parcel, urgency);
                true
            }
            (None, _) => false,
        };
        self.fresh.insert(page, texels);
        is_outdated
    }
}

/// Loads parcels from the file as long as they are as the file says, and from the painter where they have changed.
pub struct PaintLoader {
    file: Box<dyn ParcelLoader>,
    exchange: Arc<Exchange>,
    /// Asked of the file, with the urgency.
    asked: BTreeMap<Parcel, f32>,
}

impl PaintLoader {
    /// `file` loads what was in the file when it was opened. What another loader of the same exchange has asked for is dropped.
    pub fn new(file: Box<dyn ParcelLoader>, exchange: Arc<Exchange>) -> Self {
        let mut state = exchange.lock();
        state.wanted.clear();
        state.ready.clear();
        drop(state);
        Self { file, exchange, asked: BTreeMap::new() }
    }

    /// Goes over to a newer state of the file, if there is one.
    fn go_over(&mut self) {
        let mut state = self.exchange.lock();
        let Some(newer) = state.newer.take() else { return };
        state.edited = newer.edited;
        state.asset = Some(newer.asset);
        drop(state);
        let older = std::mem::replace(&mut self.file, newer.loader);
        let asked: Vec<(Parcel, f32)> = self.asked.iter().map(|(&p, &urgency)| (p, urgency)).collect();
        self.file.request_all(&asked);
        // Its threads may be reading: the painter waits for them.
        self.exchange.orders.send(Order::Release(older)).ok();
    }
}

impl ParcelLoader for PaintLoader {
    fn request(&mut self, parcel: Parcel, urgency: f32) {
        self.request_all(&[(parcel, urgency)]);
    }

    fn request_all(&mut self, parcels: &[(Parcel, f32)]) {
        let (mut of_file, mut is_wanted) = (Vec::new(), false);
        let mut state = self.exchange.lock();
        for &(parcel, urgency) in parcels {
            if !state.edited.contains(&parcel) {
                of_file.push((parcel, urgency));
            } else if let Some((known, _)) = state.ready.get_mut(&parcel) {
                *known = urgency;
            } else {
                state.wanted.insert(parcel, urgency);
                is_wanted = true;
            }
        }
        drop(state);
        self.asked.extend(of_file.iter().copied());
        self.file.request_all(&of_file);
        if is_wanted {
            self.exchange.ask_again();
        }
    }

    fn cancel(&mut self, parcel: Parcel) {
        self.cancel_all(&[parcel]);
    }

    fn cancel_all(&mut self, parcels: &[Parcel]) {
        let mut state = self.exchange.lock();
        for parcel in parcels {
            state.wanted.remove(parcel);
            state.ready.remove(parcel);
        }
        drop(state);
        let is_asked = |parcel: &Parcel| self.asked.remove(parcel).is_some();
        let of_file: Vec<Parcel> = parcels.iter().copied().filter(is_asked).collect();
        self.file.cancel_all(&of_file);
    }

    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedParcel> {
        self.go_over();
        let mut loaded = Vec::new();
        let mut bytes = 0;
        let mut state = self.exchange.lock();
        let ready = by_urgency(state.ready.iter().map(|(&parcel, (urgency, _))| (parcel, *urgency)));
        for parcel in ready {
            if bytes >= max_bytes {
                break;
            }
            if let Some((_, texels)) = state.ready.remove(&parcel) {
                bytes += texels.as_ref().map_or(0, ParcelTexels::bytes);
                loaded.push(LoadedParcel { parcel, texels });
            }
        }
        drop(state);
        if bytes >= max_bytes && !loaded.is_empty() {
            return loaded;
        }
        let arrived = self.file.poll(max_bytes - bytes.min(max_bytes));
        let mut state = self.exchange.lock();
        let mut is_wanted = false;
        for come in arrived {
            let urgency = self.asked.remove(&come.parcel);
            if state.edited.contains(&come.parcel) {
                // It was painted on while it was on its way.
                state.wanted.insert(come.parcel, urgency.unwrap_or(0.0));
                is_wanted = true;
            } else {
                loaded.push(come);
            }
        }
        drop(state);
        if is_wanted {
            self.exchange.ask_again();
        }
        loaded
    }

    fn pending(&self) -> usize {
        let state = self.exchange.lock();
        state.wanted.len() + state.ready.len() + self.file.pending()
    }
}

// Stored bytes of pages to what the atlas takes.

/// The parcel as the painter has it; `shown` has the bytes of pages that look different for the moment, in one channel.
pub(crate) fn parcel_texels(
    painter: &Painter,
    parcel: Parcel,
    formats: &[AtlasFormat],
    shown: &BTreeMap<PageId, (usize, Vec<u8>)>,
) -> Result<ParcelTexels> {
    let asset = painter.editor().asset();
    let layout = parcel.layout(asset.cover());
    let stored_page = |channel, page| painter.editor().read_page_raw(channel, page);
    let outline = Outline::of_stored(&layout, asset.channels(), stored_page)?;
    let texels = assemble(&layout, formats, |channel, page| {
        let shown = shown.get(&page).filter(|(of, _)| *of == channel).map(|(_, bytes)| bytes);
        channel_texels(painter, page, channel, formats[channel], shown).map(Cow::Owned)
    })?;
    Ok(ParcelTexels { outline, ..texels })
}

/// The page as the painter has it; `shown` has the bytes of channels that look different for the moment.
pub(crate) fn page_texels(
    painter: &Painter,
    page: PageId,
    formats: &[AtlasFormat],
    shown: &BTreeMap<usize, Vec<u8>>,
) -> Result<ParcelTexels> {
    let extent = extent(painter, page)?;
    let channels = formats.iter().enumerate().map(|(channel, &format)| {
        Ok(Arc::from(channel_texels(painter, page, channel, format, shown.get(&channel))?))
    });
    Ok(ParcelTexels { extent, outline: Outline::WHOLE, channels: channels.collect::<Result<_>>()? })
}

fn extent(painter: &Painter, page: PageId) -> Result<[u32; 2]> {
    let asset = painter.editor().asset();
    let group =
        asset.cover().groups.get(page.group as usize).ok_or_else(|| no_such_page(painter, 0, page))?;
    Ok(page_extent(group.level_extent(page.level), page.page))
}

/// A page in one channel; `shown`: its stored bytes where it looks different for the moment.
fn channel_texels(
    painter: &Painter,
    page: PageId,
    index: usize,
    format: AtlasFormat,
    shown: Option<&Vec<u8>>,
) -> Result<Vec<u8>> {
    let editor = painter.editor();
    let channel = &editor.asset().channels()[index];
    let stored = match shown {
        Some(bytes) => bytes.clone(),
        None => editor.read_page_raw(index, page)?,
    };
    if format == AtlasFormat::of(channel.format, true) && format != AtlasFormat::Rgba16F {
        return Ok(stored);
    }
    let plain = decode_plain(channel.format, channel.srgb, extent(painter, page)?, &stored);
    plain.map_err(|_| no_such_page(painter, index, page))
}

fn no_such_page(painter: &Painter, channel: usize, page: PageId) -> Error {
    painter.editor().asset().no_such_page(channel, page)
}
