//! Pages on their way from the painter to the atlas.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use fantex::cover::{Cover, Frame, Group, GroupKind};
use fantex::glam::{Vec2, Vec3};
use fantex::store::{Asset, PageId};
use fantex::stream::{AtlasFormat, LoadedParcel, Outline, Parcel, ParcelLoader, ParcelTexels};
use fantex_app::paint::{Exchange, Order, PaintLoader};

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
    ParcelTexels { extent: [4, 4], outline: Outline::WHOLE, channels: vec![vec![value; 16].into()] }
}

/// Many tiles of 256x256 texels, whose finest levels stand alone.
fn cover() -> Arc<Cover> {
    let frame = Frame { origin: Vec3::ZERO, direction: Vec3::Z, x_axis: Vec3::X };
    let extent = [256, 256];
    let group =
        Group { kind: GroupKind::Projected, frame, uv_scale: Vec2::ONE, uv_offset: Vec2::ZERO, extent };
    let (corner_groups, unfolded) = (Vec::new(), Vec::new());
    Arc::new(Cover {
        groups: vec![group; 2000],
        corner_groups,
        unfolded: unfolded.into(),
        delta: 0.25,
        density: 1.0,
        is_creased: false,
        hard_edges: None,
        is_paired_by_angle: false,
    })
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
    let asset = crate::painting::small_asset(folder.path());
    loader.request(own(2), 1.0);
    exchange.offer(Box::new(Zeros::default()), Arc::new(Asset::open(&asset).unwrap()), &[]);
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

/// The painter is woken once for all that is wanted of it, and the file is asked for the rest.
#[test]
fn many_parcels_are_asked_for_at_once() {
    let (mut loader, exchange, orders) = loader();
    let pages: Vec<PageId> = (0..1000).map(id).collect();
    exchange.outdate(&pages);
    let all: Vec<(Parcel, f32)> = (0..2000).map(|group| (own(group), group as f32)).collect();
    loader.request_all(&all);
    assert!(matches!(orders.try_recv(), Ok(Order::Pages)) && orders.try_recv().is_err());
    assert_eq!(exchange.wanted(2), [own(999), own(998)]);
    assert_eq!(loader.pending(), 2000);
    loader.cancel_all(&all.iter().map(|(parcel, _)| *parcel).skip(1).collect::<Vec<_>>());
    assert_eq!((loader.pending(), exchange.wanted(9)), (1, vec![own(0)]));
}

/// A mask that is seen alone is in no file.
#[test]
fn what_differs_from_the_newer_file_comes_from_the_painter() {
    let (mut loader, exchange, _orders) = loader();
    let folder = tempfile::tempdir().unwrap();
    let asset = crate::painting::small_asset(folder.path());
    exchange.publish(&[id(1), id(2)], |_| Ok::<_, ()>(texels(7))).unwrap();
    exchange.offer(Box::new(Zeros::default()), Arc::new(Asset::open(&asset).unwrap()), &[id(1)]);
    assert!(loader.poll(1000).is_empty());
    loader.request(own(1), 1.0);
    loader.request(own(2), 1.0);
    assert_eq!(exchange.wanted(9), [own(1)]);
    exchange.answer(own(1), Ok(texels(7)));
    let found = loader.poll(1000);
    assert_eq!(found.iter().map(|p| (p.parcel, value(p))).collect::<Vec<_>>(), [(own(1), 7), (own(2), 0)]);
}

#[test]
fn many_pages_are_asked_for_instead() {
    let (_loader, exchange, _orders) = loader();
    let pages: Vec<PageId> = (0..2000).map(id).collect();
    exchange.publish(&pages, |_| -> Result<_, ()> { panic!("not read at once") }).unwrap();
    let (fresh, stale) = exchange.take_fresh();
    assert_eq!((fresh.len(), stale.len()), (0, 2000));
}

/// Texels for one device are noise on another.
#[test]
fn what_waits_in_other_formats_is_asked_for_anew() {
    let (mut loader, exchange, orders) = loader();
    exchange.set_formats(&[AtlasFormat::Bc7]);
    exchange.publish(&[id(1), id(2)], |_| Ok::<_, ()>(texels(7))).unwrap();
    loader.request(own(1), 1.0);
    exchange.answer(own(1), Ok(texels(7)));
    let folder = tempfile::tempdir().unwrap();
    let asset = crate::painting::small_asset(folder.path());
    exchange.offer(Box::new(Zeros::default()), Arc::new(Asset::open(&asset).unwrap()), &[]);
    exchange.set_formats(&[AtlasFormat::Bc7]);
    assert!(!exchange.is_empty(), "the same formats change nothing");
    exchange.set_formats(&[AtlasFormat::Rgba8]);
    assert_eq!(exchange.formats().as_deref(), Some(&[AtlasFormat::Rgba8][..]));
    let (fresh, mut stale) = exchange.take_fresh();
    stale.sort();
    assert_eq!((fresh.len(), stale), (0, vec![id(1), id(2)]));
    assert!(loader.poll(1000).is_empty());
    assert_eq!(exchange.wanted(9), [own(1)]);
    assert!(orders.try_iter().any(|order| matches!(order, Order::Release(_))));
    assert!(exchange.take_asset().is_none());
}
