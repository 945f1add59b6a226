//! A streamer against a shadow of the atlas, along random paths, with disks that fail and atlases that are too small.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::collections::{BTreeSet, HashMap};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, LazyLock};

use fantex_base::Random;
use fantex_cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{CleanOptions, Mesh, Model, clean, generate};
use fantex_store::{PAGE, PageId, page_extent, page_grid};
use glam::{DVec3, Vec2};
use proptest::prelude::*;

use fantex_bench::simulate::{
    DiskModel, ModelClock, ModelLoader, SimulationOptions, SimulationReport, simulate,
};
use fantex_stream::{
    AtlasPlace, AtlasShape, CameraKeyframe, CameraPath, CoveredMesh, FrameChanges, FrameOptions, Geometry,
    Outline, Parcel, Streamer, StreamerOptions, TableEntry,
};

fn covered(model: Model, texels: u64, tile: u32) -> Arc<CoveredMesh> {
    let (mesh, _) = clean(model, &CleanOptions::default()).unwrap();
    let options = CoverOptions { budget: TexelBudget::Total(texels), tile, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options).unwrap();
    Arc::new(CoveredMesh { mesh, cover })
}

/// The contents of a graphics card's memory, from frame changes only.
struct Shadow {
    /// Per unit of 4x4 texels the page, as its index in `pages`, that was uploaded last.
    units: Vec<u32>,
    indices: HashMap<PageId, u32>,
    table: Vec<TableEntry>,
    pages: Vec<PageId>,
}

impl Shadow {
    fn new(geometry: &CoveredMesh, streamer: &Streamer) -> Self {
        let cover = &geometry.cover;
        let mut pages = Vec::new();
        for group in 0..cover.groups.len() as u32 {
            for level in 0..cover.groups[group as usize].level_count() {
                let [columns, rows] = page_grid(cover.groups[group as usize].level_extent(level));
                for y in 0..rows {
                    for x in 0..columns {
                        let page = PageId { group, level, page: [x, y] };
                        assert_eq!(streamer.table().index(cover, page) as usize, pages.len());
                        pages.push(page);
                    }
                }
            }
        }
        assert_eq!(pages.len(), streamer.table().len());
        let indices = pages.iter().copied().zip(0..).collect();
        Self { units: vec![u32::MAX; 1 << 19], indices, table: vec![TableEntry::ABSENT; pages.len()], pages }
    }

    fn apply(&mut self, cover: &Cover, streamer: &Streamer, changes: &FrameChanges, atlas: AtlasShape) {
        for upload in &changes.uploads {
            let layout = upload.parcel.layout(cover);
            assert_eq!(upload.texels.extent, layout.extent);
            for (slot, signature) in layout.slots.iter().zip(upload.texels.channels[0].chunks(2)) {
                assert_eq!(Parcel::of(&cover.groups[slot.page.group as usize], slot.page), upload.parcel);
                assert_eq!(slot.extent, extent(cover, slot.page));
                assert_eq!(signature, ModelLoader::signature(slot.page));
                let AtlasPlace { layer, x, y } = upload.place;
                let place = AtlasPlace { layer, x: x + slot.at[0] as u16, y: y + slot.at[1] as u16 };
                let outline = outline(upload.parcel, cover);
                assert_eq!(upload.texels.outline, outline);
                let part = outline.part(layout.extent, slot.at, slot.extent);
                for unit in units(place, slot.extent, &part, atlas) {
                    self.units[unit] = self.indices[&slot.page];
                }
            }
        }
        assert!(changes.entries.windows(2).all(|w| w[0].index < w[1].index), "entries come in order, once");
        for change in &changes.entries {
            self.table[change.index as usize] = change.entry;
        }
        if changes.uploads.is_empty() && changes.entries.is_empty() {
            return;
        }
        // Every entry names its page, whole; so no two pages overlap.
        for ((entry, &page), index) in self.table.iter().zip(&self.pages).zip(0..) {
            let Some(place) = entry.place() else { continue };
            let part = streamer.outline(page);
            for unit in units(place, extent(cover, page), &part, atlas) {
                assert_eq!(self.units[unit], index, "an entry names another page's place");
            }
        }
    }
}

fn extent(cover: &Cover, page: PageId) -> [u32; 2] {
    page_extent(cover.groups[page.group as usize].level_extent(page.level), page.page)
}

/// What of a parcel is stored: any spans, for every third all.
fn outline(parcel: Parcel, cover: &Cover) -> Outline {
    let extent = parcel.layout(cover).extent;
    let mut seed = DefaultHasher::new();
    parcel.hash(&mut seed);
    let mut random = Random::new(seed.finish());
    if random.below(3) == 0 {
        return Outline::WHOLE;
    }
    let mut span = || {
        let [a, b] = [0; 2].map(|_| random.below(u64::from(extent[0] / 4) + 1) as u8);
        [a.min(b), a.max(b)]
    };
    Outline::new(extent, (0..extent[1] / 4).map(|_| span()).collect())
}

fn units(
    place: AtlasPlace,
    extent: [u32; 2],
    outline: &Outline,
    atlas: AtlasShape,
) -> impl Iterator<Item = usize> {
    let [x, y, layer] = [place.x, place.y, place.layer].map(u32::from);
    let units = (0..).zip(outline.spans(extent)).flat_map(move |(j, [first, end])| {
        (first..end).map(move |i| {
            assert!(layer < atlas.layers && x + 4 * i < atlas.side && y + 4 * j < atlas.side);
            ((layer * atlas.side / 4 + y / 4 + j) * (atlas.side / 4) + x / 4 + i) as usize
        })
    });
    units.collect::<Vec<_>>().into_iter()
}

struct Stage {
    geometry: Arc<CoveredMesh>,
    streamer: Streamer,
    shadow: Shadow,
    clock: ModelClock,
    atlas: AtlasShape,
}

/// What [`StreamerOptions`] allow a frame.
const FRAME_NANOSECONDS: u32 = 6_000_000;

const FRAME_SECONDS: f64 = 1.0 / 60.0;

impl Stage {
    fn new(geometry: &Arc<CoveredMesh>, atlas: AtlasShape, disk: DiskModel) -> Self {
        Self::with_work(geometry, atlas, disk, FRAME_NANOSECONDS)
    }

    fn with_work(
        geometry: &Arc<CoveredMesh>,
        atlas: AtlasShape,
        disk: DiskModel,
        frame_nanoseconds: u32,
    ) -> Self {
        let clock = ModelClock::default();
        let covered = geometry.clone();
        let loader = ModelLoader::new(geometry.clone(), disk, clock.clone())
            .with_outlines(Arc::new(move |parcel| outline(parcel, &covered.cover)));
        let options = StreamerOptions { atlas, frame_nanoseconds, ..StreamerOptions::default() };
        let streamer = Streamer::new(geometry.clone(), Box::new(loader), options);
        let shadow = Shadow::new(geometry, &streamer);
        Self { geometry: geometry.clone(), streamer, shadow, clock, atlas }
    }

    /// One frame; whether anything changed.
    fn frame(&mut self, camera: Option<&CameraKeyframe>) -> bool {
        self.clock.set(self.clock.seconds() + FRAME_SECONDS);
        let view = camera.and_then(|c| c.view(&self.geometry.mesh.world_from_mesh, [640, 360]));
        let requests = self.streamer.statistics().requests;
        let frame = FrameOptions { upload_bytes: 1 << 18, elapsed_seconds: FRAME_SECONDS as f32 };
        let changes = self.streamer.update(view.as_ref(), frame);
        self.shadow.apply(&self.geometry.cover, &self.streamer, &changes, self.atlas);
        let bytes: usize = changes.uploads.iter().map(|u| u.texels.bytes()).sum();
        assert!(bytes < frame.upload_bytes + (1 << 16), "{bytes} bytes in a frame");
        let figures = self.streamer.statistics();
        assert!(figures.resident.texels <= self.atlas.texels());
        requests != figures.requests || !changes.uploads.is_empty() || !changes.entries.is_empty()
    }

    /// The camera stands still until nothing happens any more; then nothing happens for long.
    fn settle(&mut self, camera: Option<&CameraKeyframe>) {
        let mut frames = 0;
        let mut quiet = 0;
        while quiet < 5 {
            let bias = self.streamer.statistics().bias_levels;
            let changed = self.frame(camera) || bias != self.streamer.statistics().bias_levels;
            quiet = if self.streamer.is_settled() && !changed { quiet + 1 } else { 0 };
            frames += 1;
            assert!(frames < 1500, "does not come to rest: {:?}", self.streamer.statistics());
        }
        self.streamer.sanity_check();
        let bias = self.streamer.statistics().bias_levels;
        for _ in 0..200 {
            assert!(!self.frame(camera), "stirs though the camera stands still");
            assert_eq!(self.streamer.statistics().bias_levels, bias);
        }
    }
}

fn atlas() -> impl Strategy<Value = AtlasShape> {
    prop::sample::select(vec![
        AtlasShape { side: 256, layers: 1 },
        AtlasShape { side: 512, layers: 1 },
        AtlasShape { side: 256, layers: 7 },
        AtlasShape { side: 1024, layers: 2 },
    ])
}

/// Covers of small, large and single-fan tiles; the last has tiles of many pages.
static GEOMETRIES: LazyLock<[Arc<CoveredMesh>; 3]> = LazyLock::new(|| {
    [
        covered(generate::torus(40, 20), 1 << 20, 64),
        covered(generate::icosphere(3), 1 << 17, 0),
        covered(generate::cube(3), 3 << 20, 1024),
    ]
});

#[derive(Clone, Debug)]
enum Act {
    Walk { seed: u64, seconds: f64 },
    Cut { seed: u64 },
    Minimise,
    Edit { first: usize },
    Resize(AtlasShape),
    Retry,
}

fn act() -> impl Strategy<Value = Act> {
    prop_oneof![
        4 => (any::<u64>(), 0.2f64..1.0).prop_map(|(seed, seconds)| Act::Walk { seed, seconds }),
        3 => any::<u64>().prop_map(|seed| Act::Cut { seed }),
        1 => Just(Act::Minimise),
        2 => (0usize..1000).prop_map(|first| Act::Edit { first }),
        1 => atlas().prop_map(Act::Resize),
        1 => Just(Act::Retry),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn whatever_happens_the_atlas_is_right_and_comes_to_rest(
        which in 0usize..3,
        atlas in atlas(),
        acts in prop::collection::vec(act(), 1..7),
        damaged_share in prop::sample::select(vec![0.0, 0.0, 0.01, 0.2, 1.0]),
        latency_seconds in prop::sample::select(vec![0.0, 0.005, 0.08]),
        bandwidth in prop::sample::select(vec![2e6, 1e8]),
        // The covers are small: with as much work as a frame has for large ones nothing would ever wait for the next frame.
        frame_work in prop::sample::select(vec![FRAME_NANOSECONDS, 120_000]),
    ) {
        let disk = DiskModel { damaged_share, latency_seconds, bandwidth, ..DiskModel::default() };
        let mut stage = Stage::with_work(&GEOMETRIES[which], atlas, disk, frame_work);
        let mut camera = CameraKeyframe::looking(0.0, DVec3::Z * 3.0, DVec3::ZERO);
        for act in acts {
            match act {
                Act::Walk { seed, seconds } => {
                    let mut path = CameraPath::random_walk(DVec3::ZERO, 2.0, seed, seconds);
                    path.keyframes[0] = camera;
                    for frame in 0..(seconds / FRAME_SECONDS) as u32 {
                        camera = path.at(f64::from(frame) * FRAME_SECONDS).unwrap();
                        camera.seconds = 0.0;
                        stage.frame(Some(&camera));
                    }
                }
                Act::Cut { seed } => {
                    camera = CameraPath::random_walk(DVec3::ZERO, 3.0, seed, 0.5).keyframes[0];
                    stage.frame(Some(&camera));
                }
                Act::Minimise => {
                    stage.frame(None);
                }
                Act::Edit { first } => {
                    let count = stage.shadow.pages.len();
                    let pages: Vec<PageId> = (first..first + 50).map(|i| stage.shadow.pages[i * 7 % count]).collect();
                    stage.streamer.invalidate(&pages);
                    stage.frame(Some(&camera));
                }
                Act::Resize(atlas) => {
                    stage.atlas = atlas;
                    stage.streamer.set_atlas(atlas);
                    stage.frame(Some(&camera));
                }
                Act::Retry => {
                    stage.streamer.retry_damaged();
                    stage.frame(Some(&camera));
                }
            }
            stage.streamer.sanity_check();
        }
        stage.settle(Some(&camera));
        let figures = stage.streamer.statistics();
        // What cannot be read keeps nothing else from coming.
        prop_assert_eq!(figures.complete_groups, figures.visible_groups);
        prop_assert_eq!(figures.missing, 0);
        if damaged_share == 0.0 {
            prop_assert_eq!(figures.damaged, 0);
        }
        if damaged_share == 1.0 {
            prop_assert_eq!(figures.resident.parcels, 0);
        }
        stage.settle(None);
        prop_assert_eq!(stage.streamer.statistics().needed.parcels, 0);
    }
}

#[test]
fn a_pool_that_is_far_too_small_is_used_and_does_not_flicker() {
    for geometry in &*GEOMETRIES {
        let mut stage = Stage::new(geometry, AtlasShape { side: 256, layers: 1 }, DiskModel::default());
        let camera = CameraKeyframe::looking(0.0, DVec3::new(0.5, 0.6, 1.5), DVec3::ZERO);
        stage.settle(Some(&camera));
        let figures = stage.streamer.statistics();
        assert!(figures.bias_levels > 0.0 && figures.complete_groups == figures.visible_groups);
        // A whole level at a time may be too much, but not more than that.
        assert!(figures.occupancy() > 0.2, "{}", figures.occupancy());
        println!("bias {:.2}, {:.0} % in use", figures.bias_levels, 100.0 * figures.occupancy());
    }
}

#[test]
fn a_cut_to_many_tiles_is_spread_over_frames() {
    let geometry = covered(generate::torus(300, 150), 45_000 * 100, 0);
    let disk = DiskModel { latency_seconds: 0.0, bandwidth: 1e9, ..DiskModel::default() };
    let camera = CameraKeyframe::looking(0.0, DVec3::new(0.5, 0.6, 2.5), DVec3::ZERO);
    let view = camera.view(&geometry.mesh.world_from_mesh, [1280, 720]);
    let [first, second] = [(); 2].map(|()| {
        let atlas = AtlasShape { side: 2048, layers: 2 };
        let mut stage = Stage::with_work(&geometry, atlas, disk, FRAME_NANOSECONDS / 5);
        let mut uploads = Vec::new();
        let mut waiting_frames = 0;
        while uploads.is_empty() || !stage.streamer.is_settled() {
            stage.clock.set(stage.clock.seconds() + FRAME_SECONDS);
            let changes = stage.streamer.update(view.as_ref(), FrameOptions::default());
            let figures = stage.streamer.statistics();
            let (spent, most) = (figures.frame_work.nanoseconds(), figures.frame_limit);
            assert!(spent <= most + most / 50, "{spent} ns");
            uploads.push(changes.uploads.iter().map(|upload| upload.parcel).collect::<Vec<_>>());
            waiting_frames += u32::from(stage.streamer.has_backlog());
            assert!(uploads.len() < 100);
        }
        stage.streamer.sanity_check();
        let figures = stage.streamer.statistics();
        assert!(figures.complete_groups == figures.visible_groups && figures.visible_groups > 20_000);
        let busy = uploads.iter().filter(|uploads| uploads.len() > 300).count();
        assert!(waiting_frames > 0 && busy > 2, "{waiting_frames} {busy}");
        println!("{} frames, {waiting_frames} with demand that waits", uploads.len());
        uploads
    });
    assert_eq!(first, second, "work is counted, not timed");
}

#[test]
fn frames_do_twice_as_much_after_a_cut_and_no_more_once_half_a_second_has_passed() {
    let geometry = covered(generate::torus(300, 150), 45_000 * 100, 0);
    let disk = DiskModel { latency_seconds: 0.0, bandwidth: 1e9, ..DiskModel::default() };
    let mut stage = Stage::new(&geometry, AtlasShape { side: 2048, layers: 2 }, disk);
    for (eye, most_frames) in [(DVec3::new(0.5, 0.6, 2.5), 8), (DVec3::new(-1.0, 2.0, -1.0), 8)] {
        let camera = CameraKeyframe::looking(0.0, eye, DVec3::ZERO);
        let view = camera.view(&geometry.mesh.world_from_mesh, [1280, 720]);
        let mut frames = 0;
        let mut update = |stage: &mut Stage| {
            stage.clock.set(stage.clock.seconds() + FRAME_SECONDS);
            stage
                .streamer
                .update(view.as_ref(), FrameOptions { upload_bytes: 64 << 20, ..FrameOptions::default() });
            frames += 1;
            (frames, stage.streamer.statistics().frame_limit)
        };
        loop {
            let (frames, most) = update(&mut stage);
            assert_eq!(most, 2 * FRAME_NANOSECONDS);
            assert!(frames <= most_frames, "{:?}", stage.streamer.statistics());
            if stage.streamer.is_settled() {
                break;
            }
        }
        let figures = stage.streamer.statistics();
        assert!(figures.complete_groups == figures.visible_groups && figures.visible_groups > 10_000);
        while update(&mut stage).0 < 32 {}
        assert_eq!(update(&mut stage).1, FRAME_NANOSECONDS);
    }
}

#[test]
fn the_bias_sinks_again() {
    let geometry = covered(generate::torus(40, 20), 1 << 20, 64);
    let mut stage = Stage::new(&geometry, AtlasShape { side: 512, layers: 1 }, DiskModel::default());
    let near = CameraKeyframe::looking(0.0, DVec3::new(0.5, 0.6, 1.5), DVec3::ZERO);
    stage.settle(Some(&near));
    assert!(stage.streamer.statistics().bias_levels > 0.0);
    let far = CameraKeyframe::looking(0.0, DVec3::new(2.0, 3.0, 16.0), DVec3::ZERO);
    stage.settle(Some(&far));
    assert_eq!(stage.streamer.statistics().bias_levels, 0.0);
    assert_eq!(stage.streamer.statistics().complete_share(), 1.0);
}

#[test]
fn edited_pages_are_uploaded_again_where_they_are() {
    let geometry = covered(generate::icosphere(3), 1 << 17, 0);
    let mut stage = Stage::new(&geometry, AtlasShape { side: 1024, layers: 1 }, DiskModel::default());
    let camera = CameraKeyframe::looking(0.0, DVec3::Z * 3.0, DVec3::ZERO);
    stage.settle(Some(&camera));
    let resident = (0..stage.shadow.pages.len()).filter(|&i| stage.shadow.table[i] != TableEntry::ABSENT);
    let edited: Vec<PageId> = resident.step_by(37).take(9).map(|i| stage.shadow.pages[i]).collect();
    stage.streamer.invalidate(&edited);
    let mut uploaded = Vec::new();
    for _ in 0..20 {
        stage.clock.set(stage.clock.seconds() + FRAME_SECONDS);
        let view = camera.view(&geometry.mesh.world_from_mesh, [640, 360]);
        let changes = stage.streamer.update(view.as_ref(), FrameOptions::default());
        assert!(changes.entries.is_empty());
        stage.shadow.apply(&geometry.cover, &stage.streamer, &changes, stage.atlas);
        uploaded.extend(changes.uploads.iter().map(|u| u.parcel));
    }
    uploaded.sort();
    let parcel = |&page: &PageId| Parcel::of(&geometry.cover.groups[page.group as usize], page);
    let expected: BTreeSet<Parcel> = edited.iter().map(parcel).collect();
    assert!(expected.len() > 2 && uploaded.iter().eq(&expected), "{uploaded:?} {expected:?}");
}

#[test]
fn no_mesh_streams_nothing() {
    let geometry = covered(generate::cube(1), 1 << 12, 64);
    let mut cover = geometry.cover.clone();
    (cover.groups, cover.corner_groups, cover.unfolded) = Default::default();
    let nothing = Arc::new(CoveredMesh { mesh: Mesh::default(), cover });
    let mut stage = Stage::new(&nothing, AtlasShape { side: 256, layers: 1 }, DiskModel::default());
    stage.settle(Some(&CameraKeyframe::looking(0.0, DVec3::Z, DVec3::ZERO)));
    assert_eq!(stage.streamer.statistics().complete_share(), 1.0);
}

#[test]
fn what_lies_ahead_is_fetched_before_it_is_needed() {
    let geometry = covered(generate::torus(80, 40), 8 << 20, 64);
    let path = CameraPath::orbit(DVec3::ZERO, 1.3, 0.4, 6.0);
    let mut lacking = Vec::new();
    for look_ahead_seconds in [0.0, 0.25] {
        let options = SimulationOptions {
            streamer: StreamerOptions { look_ahead_seconds, ..StreamerOptions::default() },
            disk: DiskModel { latency_seconds: 0.03, queue_depth: 1024, ..DiskModel::default() },
            ..Default::default()
        };
        let report = simulate(geometry.clone() as Arc<dyn Geometry>, &path, &options);
        println!("{}\n{report}", SimulationReport::HEADING);
        assert!(report.is_settled);
        lacking.push(1.0 - report.complete_frames);
    }
    assert!(lacking[1] < 0.5 * lacking[0], "{lacking:?}");
}

#[test]
fn a_flight_over_a_landscape_is_sharp_in_the_end() {
    let options = generate::LandscapeOptions { triangles: 5000, ..Default::default() };
    let land = generate::landscape(&options).unwrap();
    let geometry = covered(land.into(), 300_000, 128);
    let center = geometry.mesh.world_from_mesh.offset;
    let path = CameraPath::cuts(center, &[900.0, 300.0, 600.0], 1.0);
    let report = simulate(geometry as Arc<dyn Geometry>, &path, &SimulationOptions::default());
    assert!(report.slowest_to_sharp().is_some() && report.is_settled);
    assert!(report.hit_rate > 0.9 && report.peak_occupancy < 1.0, "{report}");
}

/// The level that is told for a place is that of the finest page there that the table has.
#[test]
fn the_level_that_is_drawn_is_that_of_the_finest_page_there() {
    for geometry in GEOMETRIES.iter() {
        let mut stage = Stage::new(geometry, AtlasShape { side: 512, layers: 1 }, DiskModel::default());
        stage.settle(Some(&CameraKeyframe::looking(0.0, DVec3::new(1.0, 0.6, 2.5), DVec3::ZERO)));
        let mut found = 0;
        for (group, shape) in (0u32..).zip(&geometry.cover.groups) {
            for uv in [Vec2::ZERO, Vec2::new(0.3, 0.8), Vec2::ONE] {
                let is_there = |level: u32| {
                    let extent = shape.level_extent(level);
                    let at = |k: usize| ((uv[k] * extent[k] as f32) as u32).min(extent[k] - 1) / PAGE;
                    let page = PageId { group, level, page: [at(0), at(1)] };
                    stage.shadow.table[stage.shadow.indices[&page] as usize].place().is_some()
                };
                for from in 0..shape.level_count().min(2) {
                    let expected = (from..shape.level_count()).find(|&level| is_there(level));
                    assert_eq!(stage.streamer.drawn_level(group, from, uv), expected);
                    found += usize::from(expected.is_some());
                }
            }
        }
        assert!(found > 10, "{found}");
    }
}
