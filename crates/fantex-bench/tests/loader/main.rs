//! Reading and loading of a baked asset: from files, from a server, and when things go wrong.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod clusters;
mod readers;
mod streaming;
mod tasks;

use fantex::{Preview, PreviewOptions};
use fantex_base::Error;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_bake::{BakeFormat, BakeOptions, NoProgress, Prefilter, Source, SourceChannel, TexelPoint, bake};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{CleanOptions, clean, generate};
use fantex_store::{Asset, ChannelKind, ClusterId, PageId, decode_plain, group_pages};
use fantex_stream::{
    AtlasFormat, ClusterLoader, LoadedParcel, Outline, Parcel, ParcelLoader, ParcelTexels, assemble,
};
use glam::{Vec3, Vec4};

// A small baked asset, and ways to load all of it.

/// Waves and noise, so that clusters do not pack to nothing.
struct Rough;

impl Source for Rough {
    fn channels(&self) -> Vec<SourceChannel> {
        let kinds = [ChannelKind::BaseColor, ChannelKind::Normal, ChannelKind::OcclusionRoughnessMetallic];
        kinds.map(|kind| SourceChannel { kind, has_alpha: false, exceeds_one: false }).to_vec()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let p = point.position;
        let noise = (p.dot(Vec3::new(12.9, 78.2, 37.7)) * 43_758.547).sin().abs().fract();
        let wave = (p * 40.0).to_array().map(|x| 0.5 + 0.4 * x.sin());
        values[0] = Vec4::new(wave[0], wave[1], noise, 1.0);
        values[1] = Vec4::new(0.5 + 0.1 * wave[2], 0.5 - 0.1 * noise, 1.0, 1.0);
        values[2] = Vec4::new(1.0, noise, wave[0], 1.0);
    }
}

/// An asset in a folder that lives as long.
pub(crate) struct Baked {
    pub(crate) path: PathBuf,
    pub(crate) asset: Arc<Asset>,
    pub(crate) folder: tempfile::TempDir,
}

/// A torus of about a million texels per channel; some tiles are larger than a page.
pub(crate) fn baked(format: BakeFormat) -> Baked {
    baked_with(format, 1_000_000)
}

/// The same with another number of texels.
pub(crate) fn baked_with(format: BakeFormat, texels: u64) -> Baked {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.fan");
    bake_torus(&path, format, texels);
    let asset = Arc::new(Asset::open(&path).unwrap());
    Baked { path, asset, folder }
}

pub(crate) fn bake_torus(path: &Path, format: BakeFormat, texels: u64) {
    let mesh = clean(generate::torus(40, 20), &CleanOptions::default()).unwrap().0;
    let budget = TexelBudget::Total(texels);
    let cover = build_cover(&mesh, &CoverOptions { tile: 320, budget, ..CoverOptions::default() }).unwrap().0;
    let options = BakeOptions { format, ..BakeOptions::default() };
    bake(&mesh, &cover, &Rough, path, &options, &NoProgress).unwrap();
}

/// A preview in it, of so few triangles and texels that the asset is many times as long.
pub(crate) fn with_preview(baked: &Baked) -> Preview {
    let options = PreviewOptions { triangles: 300, texels: Some(5_000), ..PreviewOptions::default() };
    Preview::add_to(&baked.path, &options).unwrap()
}

pub(crate) fn all_parcels(asset: &Asset) -> Vec<Parcel> {
    let groups = asset.cover().groups.iter().enumerate();
    let pages = groups
        .flat_map(|(index, group)| group_pages(index as u32, group).map(|page| Parcel::of(group, page)));
    let mut seen = BTreeSet::new();
    pages.filter(|&parcel| seen.insert(parcel)).collect()
}

/// The clusters that hold a parcel's pages.
pub(crate) fn clusters(asset: &Asset, parcel: Parcel) -> BTreeSet<ClusterId> {
    let slots = parcel.layout(asset.cover()).slots;
    slots.iter().map(|slot| asset.cluster_of(slot.page).unwrap()).collect()
}

/// A page as the loader should bring it, read in the plain way.
pub(crate) fn expected_page(asset: &Asset, page: PageId, block_compressed: bool) -> ParcelTexels {
    let extent = asset.page_extent(0, page).unwrap();
    let channels = asset.channels().iter().enumerate().map(|(index, channel)| {
        let raw = asset.read_page_raw(index, page).unwrap();
        match AtlasFormat::of(channel.format, block_compressed).is_compressed() {
            true => Arc::from(raw),
            false => Arc::from(decode_plain(channel.format, channel.srgb, extent, &raw).unwrap()),
        }
    });
    ParcelTexels { extent, outline: Outline::WHOLE, channels: channels.collect() }
}

/// The same for a parcel.
pub(crate) fn expected(asset: &Asset, parcel: Parcel, block_compressed: bool) -> ParcelTexels {
    let formats: Vec<AtlasFormat> =
        asset.channels().iter().map(|channel| AtlasFormat::of(channel.format, block_compressed)).collect();
    let page = |channel: usize, page| {
        let texels = expected_page(asset, page, block_compressed);
        Ok::<_, ()>(Cow::Owned(texels.channels[channel].to_vec()))
    };
    let layout = parcel.layout(asset.cover());
    let outline =
        Outline::of_stored(&layout, asset.channels(), |channel, page| asset.read_page_raw(channel, page));
    ParcelTexels { outline: outline.unwrap(), ..assemble(&layout, &formats, page).unwrap() }
}

/// Polls until nothing is pending.
pub(crate) fn wait_for_all(loader: &mut ClusterLoader, max_bytes: usize) -> Vec<LoadedParcel> {
    let deadline = Instant::now() + fantex_test::PATIENCE;
    let mut pages = Vec::new();
    while loader.pending() > 0 {
        let arrived = loader.poll(max_bytes);
        if arrived.is_empty() {
            assert!(
                Instant::now() < deadline,
                "{} pages never came: {:?}",
                loader.pending(),
                loader.statistics()
            );
            std::thread::sleep(Duration::from_micros(200));
        }
        pages.extend(arrived);
    }
    assert!(loader.poll(usize::MAX).is_empty());
    pages
}

/// Asks for parcels and waits for all. Each must arrive once.
pub(crate) fn load(
    loader: &mut ClusterLoader,
    parcels: &[Parcel],
) -> BTreeMap<Parcel, Result<ParcelTexels, Error>> {
    for (i, &parcel) in parcels.iter().enumerate() {
        loader.request(parcel, (i % 17) as f32);
    }
    assert_eq!(loader.pending(), parcels.len());
    let arrived = wait_for_all(loader, 1 << 20);
    assert_eq!(arrived.len(), parcels.len());
    let arrived: BTreeMap<_, _> = arrived.into_iter().map(|loaded| (loaded.parcel, loaded.texels)).collect();
    assert_eq!(arrived.len(), parcels.len(), "a parcel came twice");
    arrived
}

/// Loads all parcels and compares them with those that are read in the plain way.
pub(crate) fn check_all(loader: &mut ClusterLoader, reference: &Asset, block_compressed: bool) {
    let parcels = all_parcels(reference);
    for (parcel, texels) in load(loader, &parcels) {
        assert!(texels.unwrap() == expected(reference, parcel, block_compressed), "{parcel}");
    }
}
