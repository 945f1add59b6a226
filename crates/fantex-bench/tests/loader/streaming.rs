//! A streamer over files that are damaged, change underneath, or are slow: there is always a picture, and it is as good as what
//! can be read.

use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_bake::BakeFormat;
use fantex_bench::faulty::{FaultyReader, ReadFaults};
use fantex_store::{Asset, ClusterId, PageId, group_pages};
use fantex_stream::CameraKeyframe;
use fantex_stream::read::{FileReadOptions, RetryPolicy, open_file_reader};
use fantex_stream::{
    AtlasShape, ClusterLoader, ClusterLoaderOptions, CutWatch, DiskLoad, FrameChanges, FrameOptions, Parcel,
    ParcelTexels, Slot, Streamer, StreamerOptions, TableEntry, loaded_clusters, mean_cluster_bytes,
    plain_reads, queued_reads, unpacked_clusters,
};
use glam::DVec3;

use crate::{Baked, bake_torus, baked, clusters, expected_page};

const ROOMY: AtlasShape = AtlasShape { side: 2048, layers: 1 };
const TINY: AtlasShape = AtlasShape { side: 256, layers: 1 };

/// A streamer, and what a graphics card would hold.
struct Stage {
    streamer: Streamer,
    asset: Arc<Asset>,
    /// Pages by their index in the page table.
    pages: Vec<PageId>,
    table: Vec<TableEntry>,
    /// Bytes of the first channel of what was uploaded last.
    texels: BTreeMap<PageId, Arc<[u8]>>,
}

impl Stage {
    fn new(baked: &Baked, faults: ReadFaults, atlas: AtlasShape) -> Self {
        let reader = open_file_reader(&baked.path, &FileReadOptions::default()).unwrap();
        let reader = Box::new(FaultyReader::new(reader, faults));
        let retry = Some(RetryPolicy { retries: 3, first_pause: Duration::from_micros(100) });
        // Many reads, so that some are hit.
        let options = ClusterLoaderOptions { merge_bytes: 0, retry, ..ClusterLoaderOptions::default() };
        let loader = ClusterLoader::with_reader(baked.asset.clone(), reader, &options).unwrap();
        let options = StreamerOptions { atlas, ..StreamerOptions::default() };
        let streamer = Streamer::new(baked.asset.clone(), Box::new(loader), options);
        let groups = baked.asset.cover().groups.iter().enumerate();
        let mut pages: Vec<PageId> =
            groups.flat_map(|(index, group)| group_pages(index as u32, group)).collect();
        let index = |page: PageId| streamer.table().index(baked.asset.cover(), page);
        pages.sort_by_key(|&page| index(page));
        let table = vec![TableEntry::ABSENT; streamer.table().len()];
        Self { streamer, asset: baked.asset.clone(), pages, table, texels: BTreeMap::new() }
    }

    fn frame(&mut self, eye: DVec3) -> FrameChanges {
        let camera = CameraKeyframe::looking(0.0, eye, DVec3::ZERO);
        let view = camera.view(&self.asset.mesh().world_from_mesh, [1280, 720]);
        let changes = self.streamer.update(view.as_ref(), FrameOptions::default());
        for upload in &changes.uploads {
            for slot in upload.parcel.layout(self.asset.cover()).slots {
                self.texels.insert(slot.page, cut(&upload.texels, &slot));
            }
        }
        for change in &changes.entries {
            self.table[change.index as usize] = change.entry;
        }
        changes
    }

    /// Frames until nothing happens any more.
    fn settle(&mut self, eye: DVec3) {
        let deadline = Instant::now() + fantex_test::PATIENCE;
        let mut quiet = 0;
        while quiet < 5 {
            let changes = self.frame(eye);
            let has_changed = !changes.uploads.is_empty() || !changes.entries.is_empty();
            quiet = if self.streamer.is_settled() && !has_changed { quiet + 1 } else { 0 };
            assert!(Instant::now() < deadline, "does not come to rest: {:?}", self.streamer.statistics());
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn is_resident(&self, page: PageId) -> bool {
        let index = self.streamer.table().index(self.asset.cover(), page);
        self.table[index as usize] != TableEntry::ABSENT
    }

    fn resident(&self) -> Vec<PageId> {
        self.pages.iter().copied().filter(|&page| self.is_resident(page)).collect()
    }

    fn damaged(&self) -> Vec<Parcel> {
        self.streamer.damaged().map(|(&parcel, _)| parcel).collect()
    }

    fn pages_of(&self, parcel: Parcel) -> Vec<PageId> {
        parcel.layout(self.asset.cover()).slots.iter().map(|slot| slot.page).collect()
    }

    /// What a look-up of one level finds at a tile's middle: the level itself, or the next coarser one that is resident, or
    /// (none) the mean.
    fn shown_level(&self, group: u32, level: u32) -> Option<u32> {
        let tile = &self.asset.cover().groups[group as usize];
        (level..tile.level_count()).find(|&level| {
            let page = tile.level_extent(level).map(|n| n / 2 / fantex_store::PAGE);
            self.is_resident(PageId { group, level, page })
        })
    }

    /// All that is wanted is resident or damaged; everything resident is what the asset held.
    fn check(&self, reference: &BTreeMap<PageId, Arc<[u8]>>) {
        let figures = self.streamer.statistics();
        assert_eq!(figures.missing, 0);
        assert_eq!(figures.complete_groups, figures.visible_groups);
        assert_eq!(figures.damaged, self.damaged().len());
        for page in self.resident() {
            assert!(self.texels[&page] == reference[&page], "{page} is not what it should be");
        }
        for page in self.damaged().into_iter().flat_map(|parcel| self.pages_of(parcel)) {
            assert!(!self.is_resident(page), "{page} was damaged from the beginning");
        }
    }
}

/// The first channel of a page (in blocks of 16 bytes) out of a parcel.
fn cut(texels: &ParcelTexels, slot: &Slot) -> Arc<[u8]> {
    let columns = texels.extent[0] as usize / 4;
    let [x, y, width, height] =
        [slot.at[0], slot.at[1], slot.extent[0], slot.extent[1]].map(|n| n as usize / 4);
    let row = |r: usize| &texels.channels[0][16 * ((y + r) * columns + x)..][..16 * width];
    (0..height).flat_map(row).copied().collect()
}

/// All pages of an asset, read in the plain way.
fn reference(asset: &Asset) -> BTreeMap<PageId, Arc<[u8]>> {
    let groups = asset.cover().groups.iter().enumerate();
    let pages = groups.flat_map(|(index, group)| group_pages(index as u32, group));
    pages.map(|page| (page, expected_page(asset, page, true).channels[0].clone())).collect()
}

/// Overwrites some bytes of a cluster.
fn damage(baked: &Baked, cluster: ClusterId) {
    let mut file = std::fs::OpenOptions::new().write(true).open(&baked.path).unwrap();
    file.seek(SeekFrom::Start(baked.asset.cluster_range(cluster).start + 5)).unwrap();
    file.write_all(b"something else").unwrap();
}

const NEAR: DVec3 = DVec3::new(0.3, 1.0, 1.6);
const FAR: DVec3 = DVec3::new(-20.0, 30.0, 60.0);

#[test]
fn a_damaged_middle_level_keeps_nothing_finer_from_coming() {
    let baked = baked(BakeFormat::Bc7);
    let reference = reference(&baked.asset);
    let damaged_level = 2;
    for cluster in baked.asset.clusters().filter(|cluster| cluster.level == damaged_level) {
        damage(&baked, cluster);
    }
    let mut stage = Stage::new(&baked, ReadFaults::default(), ROOMY);
    // From nearer and nearer, and back: levels come one after the other, and leave.
    for eye in [FAR, 0.3 * FAR, 0.1 * FAR, NEAR, FAR, NEAR] {
        stage.settle(eye);
        stage.check(&reference);
    }
    assert!(!stage.damaged().is_empty());
    for parcel in stage.damaged() {
        assert!(stage.pages_of(parcel).iter().any(|page| page.level == damaged_level), "{parcel}");
    }
    let mut sharp = 0;
    for group in 0..baked.asset.cover().groups.len() as u32 {
        let Some(wanted) = stage.streamer.wanted_level(group) else { continue };
        if wanted < damaged_level && stage.shown_level(group, wanted) == Some(wanted) {
            sharp += 1;
            // The hole itself is filled by the next level that can be read.
            let tile = &baked.asset.cover().groups[group as usize];
            let parcel = |level| {
                let page = tile.level_extent(level).map(|n| n / 2 / fantex_store::PAGE);
                Parcel::of(tile, PageId { group, level, page })
            };
            let next = (damaged_level..tile.level_count()).find(|&l| !stage.damaged().contains(&parcel(l)));
            assert!(next.is_some_and(|next| next > damaged_level));
            assert_eq!(stage.shown_level(group, damaged_level), next, "group {group}");
        }
    }
    assert!(sharp > 0, "no tile is finer than its hole");
    // An empty atlas, filled with the holes known: the same again.
    let resident = stage.resident();
    stage.streamer.set_atlas(AtlasShape { layers: 2, ..ROOMY });
    stage.settle(NEAR);
    stage.check(&reference);
    assert!(
        resident.iter().any(|page| page.level == 0) && stage.resident().iter().any(|page| page.level == 0)
    );
}

#[test]
fn what_can_be_read_again_fills_its_hole() {
    let baked = baked(BakeFormat::Bc7);
    let reference = reference(&baked.asset);
    let hit: Vec<ClusterId> = baked.asset.clusters().filter(|cluster| cluster.level == 1).collect();
    let whole = std::fs::read(&baked.path).unwrap();
    hit.iter().for_each(|&cluster| damage(&baked, cluster));
    let mut stage = Stage::new(&baked, ReadFaults::default(), ROOMY);
    stage.settle(NEAR);
    let damaged = stage.damaged();
    assert!(!damaged.is_empty());
    let mut file = std::fs::OpenOptions::new().write(true).open(&baked.path).unwrap();
    file.write_all(&whole).unwrap();
    stage.streamer.retry_damaged();
    assert!(damaged.iter().any(|&parcel| stage.streamer.is_missing(parcel)));
    stage.settle(NEAR);
    stage.check(&reference);
    assert!(stage.damaged().is_empty());
    let mut pages = damaged.iter().flat_map(|&parcel| stage.pages_of(parcel));
    assert!(pages.all(|page| stage.is_resident(page)));
}

#[test]
fn a_file_truncated_underneath_is_streamed_as_far_as_it_goes() {
    let baked = baked(BakeFormat::Bc7);
    let reference = reference(&baked.asset);
    let mut stage = Stage::new(&baked, ReadFaults::default(), ROOMY);
    // The coarse levels come before, the others after.
    stage.settle(FAR);
    let before = stage.resident();
    let finest = baked.asset.clusters().filter(|cluster| cluster.level == 0);
    let mut finest: Vec<_> = finest.map(|cluster| baked.asset.cluster_range(cluster)).collect();
    finest.sort_by_key(|range| range.start);
    let middle = finest[finest.len() / 2].start + 1;
    std::fs::OpenOptions::new().write(true).open(&baked.path).unwrap().set_len(middle).unwrap();
    // All around.
    for eye in [NEAR, DVec3::new(1.6, 1.0, -0.3), DVec3::new(-0.3, 1.0, -1.6), DVec3::new(-1.6, 1.0, 0.3)] {
        stage.settle(eye);
        stage.check(&reference);
    }
    assert!(before.iter().all(|&page| stage.is_resident(page)), "what is there stays");
    assert!(stage.resident().len() > before.len());
    assert!(!stage.damaged().is_empty());
    for (parcel, error) in stage.streamer.damaged() {
        let ranges = clusters(&baked.asset, *parcel).into_iter().map(|id| baked.asset.cluster_range(id));
        let mut gone = ranges.filter(|range| range.end > middle);
        let names = |start: u64| error.to_string().contains(&format!("at byte {start} of"));
        assert!(gone.any(|range| names(range.start)), "{parcel}: {error}");
    }
}

#[test]
fn a_file_changed_underneath_shows_nothing_wrong() {
    let baked = baked(BakeFormat::Bc7);
    let reference = reference(&baked.asset);
    let mut stage = Stage::new(&baked, ReadFaults::default(), ROOMY);
    for _ in 0..3 {
        stage.frame(NEAR);
    }
    let finest: Vec<ClusterId> = baked.asset.clusters().filter(|cluster| cluster.level == 0).collect();
    finest.iter().step_by(2).for_each(|&cluster| damage(&baked, cluster));
    // What was in flight may have come before the change or not; nothing that is shown is of neither.
    for eye in [NEAR, FAR, NEAR, -NEAR] {
        stage.settle(eye);
        stage.check(&reference);
    }
}

#[test]
fn rare_read_errors_leave_no_trace() {
    let baked = baked(BakeFormat::Bc7);
    let reference = reference(&baked.asset);
    for seed in 0..3 {
        let faults = ReadFaults { seed, error_probability: 0.01, ..ReadFaults::default() };
        let mut stage = Stage::new(&baked, faults, ROOMY);
        for eye in [FAR, NEAR, -NEAR] {
            stage.settle(eye);
            stage.check(&reference);
        }
        assert!(stage.damaged().is_empty());
    }
}

#[test]
fn where_nothing_can_be_read_means_are_shown_and_the_camera_flies_on() {
    let baked = baked(BakeFormat::Bc7);
    let faults = ReadFaults { error_probability: 1.0, ..ReadFaults::default() };
    let mut stage = Stage::new(&baked, faults, ROOMY);
    for eye in [FAR, NEAR, -NEAR] {
        stage.settle(eye);
        stage.check(&BTreeMap::new());
        assert!(stage.resident().is_empty());
    }
    let damaged = stage.damaged().len();
    assert_eq!(damaged as u64, stage.streamer.statistics().requests, "nothing is asked for twice");
    let (_, error) = stage.streamer.damaged().next().unwrap();
    assert!(error.to_string().contains("an injected fault"), "{error}");
    // Trying again fails again, and ends.
    stage.streamer.retry_damaged();
    stage.settle(NEAR);
    assert!(stage.streamer.statistics().requests > damaged as u64 && stage.damaged().len() <= damaged);
}

#[test]
fn a_slow_disk_delays_pages_and_no_frame() {
    let baked = baked(BakeFormat::Bc7);
    let reference = reference(&baked.asset);
    let faults = ReadFaults {
        delay: Duration::from_millis(30),
        bytes_per_second: Some(10e6),
        ..ReadFaults::default()
    };
    let mut stage = Stage::new(&baked, faults, ROOMY);
    let (mut watch, mut frames) = (CutWatch::new(), 0);
    let started = Instant::now();
    loop {
        let changes = stage.frame(NEAR);
        frames += 1;
        if frames == 1 {
            assert!(changes.uploads.is_empty() || started.elapsed() > faults.delay, "it waits for the disk");
        }
        if watch.update(&stage.streamer) {
            break;
        }
        assert!(!watch.awaited().is_empty());
        assert!(started.elapsed() < fantex_test::PATIENCE, "{:?}", stage.streamer.statistics());
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(frames > 1 && started.elapsed() > 2 * faults.delay, "{frames} frames");
    stage.settle(NEAR);
    stage.check(&reference);
}

#[test]
fn a_pool_too_small_for_the_view_holds_what_fits_and_comes_to_rest() {
    let baked = baked(BakeFormat::Bc7);
    let reference = reference(&baked.asset);
    let mut stage = Stage::new(&baked, ReadFaults::default(), TINY);
    for eye in [NEAR, -NEAR, NEAR] {
        stage.settle(eye);
        stage.check(&reference);
        let figures = stage.streamer.statistics();
        assert!(figures.bias_levels > 0.0 && figures.resident.texels <= TINY.texels());
        assert!(figures.occupancy() > 0.2, "{}", figures.occupancy());
    }
    // With faults on top: still at rest, still right.
    let faults = ReadFaults { seed: 5, corruption_probability: 0.3, ..ReadFaults::default() };
    let mut stage = Stage::new(&baked, faults, TINY);
    for eye in [NEAR, FAR, -NEAR] {
        stage.settle(eye);
        stage.check(&reference);
    }
}

// What the disk can do, and what of it arrives.

/// Measures and prints all four speeds; returns MB/s of plain, queued, loaded, unpacked.
fn measure(asset: &Arc<Asset>, load: &DiskLoad) -> [f64; 4] {
    let block_bytes = mean_cluster_bytes(asset);
    let plain = plain_reads(asset.path(), block_bytes, load).unwrap();
    let queued = queued_reads(asset, load).unwrap();
    // Each cluster by itself, and none from the cache, as the plain loop reads.
    let options = ClusterLoaderOptions { cache_bytes: 0, merge_bytes: 0, ..ClusterLoaderOptions::default() };
    let (loaded, counts) = loaded_clusters(asset, &options, load).unwrap();
    let unpacked = unpacked_clusters(asset, load).unwrap();
    eprintln!("{}; blocks of {block_bytes} bytes", plain.reader.unwrap());
    for (name, speed) in [("plain", plain), ("queued", queued), ("loaded", loaded), ("unpacked", unpacked)] {
        assert!(speed.reads > 0 && speed.bytes > 0, "{name}");
        let ratio = speed.megabytes_per_second() / plain.megabytes_per_second();
        let (reads, megabytes) = (speed.reads_per_second(), speed.megabytes_per_second());
        eprintln!("{name:>9}: {reads:8.0} reads/s {megabytes:8.1} MB/s, {ratio:.2} of plain");
    }
    eprintln!("{counts:?}");
    [plain, queued, loaded, unpacked].map(|speed| speed.megabytes_per_second())
}

#[test]
fn all_speeds_are_measured() {
    let baked = baked(BakeFormat::Bc7);
    let load = DiskLoad { seconds: 0.05, depth: 8, seed: 1 };
    let [plain, queued, loaded, unpacked] = measure(&baked.asset, &load);
    assert!([plain, queued, loaded, unpacked].iter().all(|speed| speed.is_finite()));
}

/// On an asset that is given in `FANTEX_BENCH_ASSET`, or of some hundred megabytes, baked for it.
#[test]
#[ignore = "takes minutes; run it alone, on an idle machine"]
fn most_of_the_disks_speed_arrives() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let given = std::env::var_os("FANTEX_BENCH_ASSET").map(PathBuf::from);
    let path = given.unwrap_or_else(|| {
        let path = folder.path().join("large.fan");
        bake_torus(&path, BakeFormat::Bc7, 40_000_000);
        path
    });
    let asset = Arc::new(Asset::open(&path).unwrap());
    // Interleaved, so that what else the machine does hits all alike; the best of each counts.
    let mut best = [0.0f64; 4];
    for seed in 0..5 {
        let speeds = measure(&asset, &DiskLoad { seed, ..DiskLoad::default() });
        best.iter_mut().zip(speeds).for_each(|(best, speed)| *best = best.max(speed));
    }
    let [plain, queued, loaded, unpacked] = best;
    eprintln!("best MB/s: plain {plain:.0}, queued {queued:.0}, loaded {loaded:.0}, unpacked {unpacked:.0}");
    // What bounds is either the disk or the processor.
    assert!(loaded >= 0.8 * plain.min(unpacked), "{loaded} MB/s of {plain} and {unpacked}");
}
