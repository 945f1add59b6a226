//! Mailbox between the render thread and the paint thread.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use fantex::base::{Error, Result};
use fantex::cover::Cover;
use fantex::paint::Painter;
use fantex::store::{Asset, PageId, decode_plain, page_extent};
use fantex::stream::{AtlasFormat, LoadedParcel, Parcel, ParcelLoader, ParcelTexels, assemble};

use crate::paint::Order;

/// Pages that change at once and are handed over with their texels; beyond it they are asked for one after the other.
const MAX_FRESH: usize = 512;

/// What both threads see.
pub struct Exchange {
    state: Mutex<State>,
    /// Tells the parcels of pages.
    cover: Arc<Cover>,
    orders: Sender<Order>,
    /// In which formats the atlas takes texels; unset until there is one.
    formats: OnceLock<Vec<AtlasFormat>>,
}

#[derive(Default)]
struct State {
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
        Self { state: Mutex::default(), cover, orders, formats: OnceLock::new() }
    }

    fn parcel_of(&self, page: PageId) -> Parcel {
        Parcel::of(&self.cover.groups[page.group as usize], page)
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Says in which formats texels are wanted; what was said first counts.
    pub fn set_formats(&self, formats: &[AtlasFormat]) {
        self.formats.get_or_init(|| formats.to_vec());
    }

    /// In which formats texels are wanted, once that is known.
    pub fn formats(&self) -> Option<&[AtlasFormat]> {
        self.formats.get().map(Vec::as_slice)
    }

    /// Lets the painter look once more at what is wanted.
    pub(crate) fn ask_again(&self) {
        self.kick();
    }

    fn kick(&self) {
        // Where the painter is gone nobody answers; pages stay as they are.
        self.orders.send(Order::Pages).ok();
    }

    /// The painter's: these pages are not any more as the file says. `texels` gives them as they are now.
    ///
    /// # Errors
    ///
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
            let mut state = self.lock();
            state.note(self.parcel_of(page));
            let is_outdated = state.put(page, self.parcel_of(page), now);
            drop(state);
            if is_outdated {
                self.kick();
            }
        }
        Ok(())
    }

    /// The painter's: these pages are not any more as the file says, and have to be asked for.
    pub fn outdate(&self, pages: &[PageId]) {
        let mut state = self.lock();
        pages.iter().for_each(|&page| state.note(self.parcel_of(page)));
        state.stale.extend(pages);
    }

    /// The painter's: pages may be loaded from this state of the file from now on, so that the older one need not be kept.
    /// All that differs from it is published later.
    pub fn offer(&self, loader: Box<dyn ParcelLoader>, asset: Arc<Asset>) {
        self.lock().newer = Some(Newer { loader, asset, edited: BTreeSet::new() });
    }

    /// The drawer's: the state of the file that pages are loaded from, where it is another one than at the last call.
    pub fn take_asset(&self) -> Option<Arc<Asset>> {
        self.lock().asset.take()
    }

    /// The painter's: these pages look like this while a stroke is open.
    pub fn publish_preview(&self, page: PageId, texels: ParcelTexels) {
        let is_outdated = self.lock().put(page, self.parcel_of(page), texels);
        if is_outdated {
            self.kick();
        }
    }

    /// The painter's: some parcels that are wanted, the most urgent first.
    pub fn wanted(&self, most: usize) -> Vec<Parcel> {
        let state = self.lock();
        let mut wanted: Vec<(f32, Parcel)> = state.wanted.iter().map(|(&parcel, &u)| (u, parcel)).collect();
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        wanted.into_iter().take(most).map(|(_, parcel)| parcel).collect()
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

impl State {
    /// A parcel is not any more as the file says.
    fn note(&mut self, parcel: Parcel) {
        self.edited.insert(parcel);
        if let Some(newer) = &mut self.newer {
            newer.edited.insert(parcel);
        }
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
}

impl PaintLoader {
    /// Goes over to a newer state of the file, if there is one.
    fn go_over(&mut self) {
        let mut state = self.exchange.lock();
        let Some(newer) = state.newer.take() else { return };
        state.edited = newer.edited;
        state.asset = Some(newer.asset);
        drop(state);
        let older = std::mem::replace(&mut self.file, newer.loader);
        for (&parcel, &urgency) in &self.asked {
            self.file.request(parcel, urgency);
        }
        // Its threads may be reading: the painter waits for them.
        self.exchange.orders.send(Order::Release(older)).ok();
    }
}

impl ParcelLoader for PaintLoader {
    fn request(&mut self, parcel: Parcel, urgency: f32) {
        let mut state = self.exchange.lock();
        if !state.edited.contains(&parcel) {
            drop(state);
            self.asked.insert(parcel, urgency);
            return self.file.request(parcel, urgency);
        }
        if let Some((known, _)) = state.ready.get_mut(&parcel) {
            *known = urgency;
            return;
        }
        state.wanted.insert(parcel, urgency);
        drop(state);
        self.exchange.kick();
    }

    fn cancel(&mut self, parcel: Parcel) {
        let mut state = self.exchange.lock();
        state.wanted.remove(&parcel);
        state.ready.remove(&parcel);
        drop(state);
        if self.asked.remove(&parcel).is_some() {
            self.file.cancel(parcel);
        }
    }

    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedParcel> {
        self.go_over();
        let mut loaded = Vec::new();
        let mut bytes = 0;
        let mut state = self.exchange.lock();
        let mut by_urgency: Vec<(f32, Parcel)> = state.ready.iter().map(|(&p, (u, _))| (*u, p)).collect();
        by_urgency.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, parcel) in by_urgency {
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
        let mut has_wishes = false;
        for come in arrived {
            let urgency = self.asked.remove(&come.parcel);
            if state.edited.contains(&come.parcel) {
                // It was painted on while it was on its way.
                state.wanted.insert(come.parcel, urgency.unwrap_or(0.0));
                has_wishes = true;
            } else {
                loaded.push(come);
            }
        }
        drop(state);
        if has_wishes {
            self.exchange.kick();
        }
        loaded
    }

    fn pending(&self) -> usize {
        let state = self.exchange.lock();
        state.wanted.len() + state.ready.len() + self.file.pending()
    }
}

// Stored bytes of pages to what the atlas takes.

/// The parcel as the painter has it.
pub(crate) fn parcel_texels(
    painter: &Painter,
    parcel: Parcel,
    formats: &[AtlasFormat],
) -> Result<ParcelTexels> {
    let layout = parcel.layout(painter.editor().asset().cover());
    assemble(&layout, formats, |channel, page| {
        channel_texels(painter, page, channel, formats[channel], None).map(Cow::Owned)
    })
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
    Ok(ParcelTexels { extent, channels: channels.collect::<Result<_>>()? })
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

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, channel};

    use fantex::cover::{Frame, Group, GroupKind};
    use fantex::glam::{Vec2, Vec3};

    use super::*;

    /// Has every parcel at once: zeros.
    #[derive(Default)]
    struct Zeros(Vec<Parcel>);

    impl ParcelLoader for Zeros {
        fn request(&mut self, parcel: Parcel, _: f32) {
            self.0.push(parcel);
        }

        fn cancel(&mut self, parcel: Parcel) {
            self.0.retain(|&p| p != parcel);
        }

        fn poll(&mut self, _: usize) -> Vec<LoadedParcel> {
            self.0.drain(..).map(|parcel| LoadedParcel { parcel, texels: Ok(texels(0)) }).collect()
        }

        fn pending(&self) -> usize {
            self.0.len()
        }
    }

    fn texels(value: u8) -> ParcelTexels {
        ParcelTexels { extent: [4, 4], channels: vec![vec![value; 16].into()] }
    }

    /// Many tiles of 256x256 texels, whose finest levels stand alone.
    fn cover() -> Arc<Cover> {
        let frame = Frame { origin: Vec3::ZERO, direction: Vec3::Z, x_axis: Vec3::X };
        let extent = [256, 256];
        let group =
            Group { kind: GroupKind::Projected, frame, uv_scale: Vec2::ONE, uv_offset: Vec2::ZERO, extent };
        let (corner_groups, unfolded) = (Vec::new(), Vec::new());
        Arc::new(Cover { groups: vec![group; 2000], corner_groups, unfolded, delta: 0.25, density: 1.0 })
    }

    fn id(group: u32) -> PageId {
        PageId { group, level: 0, page: [0, 0] }
    }

    fn own(group: u32) -> Parcel {
        Parcel::Page(id(group))
    }

    fn value(loaded: &LoadedParcel) -> u8 {
        loaded.texels.as_ref().unwrap().channels[0][0]
    }

    fn loader() -> (PaintLoader, Arc<Exchange>, Receiver<Order>) {
        let (sender, receiver) = channel();
        let exchange = Arc::new(Exchange::new(sender, cover()));
        (PaintLoader::new(Box::new(Zeros::default()), exchange.clone()), exchange, receiver)
    }

    #[test]
    fn parcels_come_from_the_file_until_they_are_painted() {
        let (mut loader, exchange, orders) = loader();
        loader.request(own(1), 1.0);
        loader.request(own(2), 1.0);
        // Painted while it is on its way from the file.
        exchange.publish(&[id(2)], |_| Ok::<_, ()>(texels(7))).unwrap();
        let found = loader.poll(1000);
        assert_eq!(found.iter().map(|p| (p.parcel, value(p))).collect::<Vec<_>>(), [(own(1), 0)]);
        assert!(matches!(orders.try_recv(), Ok(Order::Pages)));
        assert_eq!(exchange.wanted(9), [own(2)]);
        assert_eq!(loader.pending(), 1);
        exchange.answer(own(2), Ok(texels(7)));
        // And once more before the answer was taken: the newer texels count.
        exchange.publish(&[id(2)], |_| Ok::<_, ()>(texels(9))).unwrap();
        let found = loader.poll(1000);
        assert_eq!((found[0].parcel, value(&found[0])), (own(2), 9));
        assert_eq!(loader.pending(), 0);
        let (fresh, stale) = exchange.take_fresh();
        assert_eq!((fresh[&id(2)].channels[0][0], stale.len()), (9, 0));
    }

    #[test]
    fn a_bundle_comes_from_the_painter_when_one_of_its_pages_has_changed() {
        let (mut loader, exchange, orders) = loader();
        // The coarsest level of tile 40, which comes with those of 32 to 63.
        let page = PageId { group: 40, level: cover().groups[40].level_count() - 1, page: [0, 0] };
        let bundle = Parcel::Bundle { bundle: 1, step: 0 };
        exchange.publish(&[page], |_| Ok::<_, ()>(texels(7))).unwrap();
        loader.request(bundle, 1.0);
        loader.request(Parcel::Bundle { bundle: 2, step: 0 }, 1.0);
        assert_eq!(exchange.wanted(9), [bundle]);
        assert!(matches!(orders.try_recv(), Ok(Order::Pages)));
        exchange.answer(bundle, Ok(texels(7)));
        // Painted before the answer was taken: it is asked for once more.
        exchange.publish(&[page], |_| Ok::<_, ()>(texels(9))).unwrap();
        assert!(matches!(orders.try_recv(), Ok(Order::Pages)));
        assert_eq!((loader.poll(1000).len(), exchange.wanted(9)), (1, vec![bundle]));
        exchange.answer(bundle, Ok(texels(9)));
        let found = loader.poll(1000);
        assert_eq!((found[0].parcel, value(&found[0]), loader.pending()), (bundle, 9, 0));
    }

    #[test]
    fn cancelled_parcels_do_not_arrive() {
        let (mut loader, exchange, _orders) = loader();
        exchange.publish(&[id(3)], |_| Ok::<_, ()>(texels(1))).unwrap();
        loader.request(own(3), 1.0);
        loader.cancel(own(3));
        exchange.answer(own(3), Ok(texels(1)));
        assert!(loader.poll(1000).is_empty());
    }

    #[test]
    fn what_is_on_its_way_comes_from_the_newer_file() {
        let (mut loader, exchange, orders) = loader();
        exchange.publish(&[id(1)], |_| Ok::<_, ()>(texels(7))).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let asset = crate::paint::tests::small_asset(folder.path());
        loader.request(own(2), 1.0);
        exchange.offer(Box::new(Zeros::default()), Arc::new(Asset::open(&asset).unwrap()));
        exchange.publish(&[id(3)], |_| Ok::<_, ()>(texels(8))).unwrap();
        let found = loader.poll(1000);
        assert_eq!(found.iter().map(|p| p.parcel).collect::<Vec<_>>(), [own(2)]);
        assert!(matches!(orders.try_recv(), Ok(Order::Release(_))));
        assert!(exchange.take_asset().is_some() && exchange.take_asset().is_none());
        // Page 1 is in the newer file, page 3 is not.
        loader.request(own(1), 1.0);
        loader.request(own(3), 1.0);
        assert_eq!(exchange.wanted(9), [own(3)]);
        assert_eq!(loader.poll(1000)[0].parcel, own(1));
    }

    #[test]
    fn many_pages_are_asked_for_instead() {
        let (_loader, exchange, _orders) = loader();
        let pages: Vec<PageId> = (0..2000).map(id).collect();
        exchange.publish(&pages, |_| -> Result<_, ()> { panic!("not read at once") }).unwrap();
        let (fresh, stale) = exchange.take_fresh();
        assert_eq!((fresh.len(), stale.len()), (0, 2000));
    }
}
