//! What bounds residency: the work of a frame, and the bias that makes what is needed fit the atlas.
//!
//! **Work** is counted, not timed, so that the same happens on every machine. The costs are the least squares of the processor time of
//! frames over what was counted in them; they meet a frame's time to within 0.4 ms (root of the mean square, 2600 frames of tours over
//! landscapes of 52 k and 434 k tiles).
//!
//! **The bias** is by how much coarser everything is wanted. For every bias the texels that would be needed are known exactly, from a
//! [`Histogram`] that follows the demand of groups and bundles one by one. The bias rises at once to where the demand fits, and sinks only
//! where the demand of the lower bias fits with room to spare, and not often. So a still camera comes to rest: what made the bias sink
//! cannot make it rise again.

use crate::Parcel;
use crate::demand::{Demand, PageDemand};
use crate::parcel::{BUNDLE_TILES, FAMILY, SHARED_LEVELS};
use crate::shape::{Detail, SparseLists, TileShape, TileShapes};

/// What a frame does, in the order in which it may use up the frame's work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// Giving places to what has come.
    Arrive,
    /// Taking over demand.
    Want,
    /// Asking for what is missing.
    Request,
}

/// Nanoseconds that are meant to be spent in a sixtieth of a second, with what demand takes.
pub(crate) const FRAME_NANOSECONDS: u32 = 6_000_000;

/// Slow frames do this share of what as many quick ones would do: a tenth of their time.
const SLOW_SHARE: f32 = 0.25;
/// Maximum number of quick frames that a slow one counts as.
const MAX_TIMES: f32 = 32.0;

/// After a cut, and while all that is seen lacks something, a frame may do this many times as much: there is little on the screen that
/// could stutter, and with twice [`FRAME_NANOSECONDS`] sixty frames a second are still drawn.
const FILLING_TIMES: f32 = 2.0;
/// Seconds after a cut during which that holds.
const FILLING_SECONDS: f32 = 0.5;

/// Of a frame, eighths that arrivals leave to the rest, at most.
const MAX_RESERVED_EIGHTHS: u32 = 5;
/// And for bounding, at most.
const BOUNDING_EIGHTHS: u32 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Item {
    /// A nanosecond of bounding: see [`Demand::nanoseconds`](crate::demand::Demand::nanoseconds).
    Bounding,
    /// A parcel that comes from the loader.
    Arrival,
    /// A parcel that gets a place, and its entry in the page table.
    Place,
    /// The same for each of its tiles: an entry, and a look whether the tile still lacks something.
    PlaceTile,
    /// A parcel that leaves.
    Evict,
    /// A family whose bundles are looked at.
    Family,
    /// A group of it whose demand has changed.
    Group,
    /// A parcel that becomes needed or unneeded.
    Need,
    /// A parcel that is asked for, with what the loader does of it on the same thread.
    Request,
    /// The same for one that is cancelled.
    Cancel,
    /// A bundle or a group's own pages, looked at for what may be needed soon.
    Expect,
}

/// Kinds of work that are counted.
pub const WORK_KINDS: usize = 11;

/// Names of what is counted, and what each costs, nanoseconds.
pub const WORK_COSTS: [(&str, u32); WORK_KINDS] = [
    ("nanoseconds of bounding", 1),
    ("arrivals", 300),
    ("places", 650),
    ("tiles of places", 20),
    ("evictions", 700),
    ("families", 500),
    ("groups", 12),
    ("needs", 5),
    ("requests", 480),
    ("cancels", 1000),
    ("owners expected", 12),
];

/// What a frame has done: how many of each of [`WORK_COSTS`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameWork {
    /// In that order.
    pub counts: [u32; WORK_KINDS],
}

impl FrameWork {
    /// What it should have taken.
    pub fn nanoseconds(&self) -> u32 {
        self.counts.iter().zip(WORK_COSTS).map(|(count, (_, cost))| count * cost).sum()
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Work {
    /// Nanoseconds for a sixtieth of a second; another number holds from the next frame on.
    pub(crate) regular: u32,
    /// Seconds of filling that are left after a jump of the camera.
    filling_seconds: f32,
    /// Nanoseconds that the frame may spend.
    pub(super) frame: u32,
    /// What of that arrivals leave for the rest.
    reserved: u32,
    spent: u32,
    pub(super) done: FrameWork,
}

impl Work {
    /// `regular`: nanoseconds for a sixtieth of a second.
    pub(super) fn new(regular: u32) -> Self {
        let done = FrameWork::default();
        Self { regular, filling_seconds: 0.0, frame: 0, reserved: 0, spent: 0, done }
    }

    /// Begins a frame `elapsed_seconds` after the last one. Slow frames may do more: a tenth of their time is not noticed. `is_cut`: the
    /// camera has jumped. `lacking`: share of the visible groups that lack something.
    pub(super) fn begin_frame(&mut self, elapsed_seconds: f32, is_cut: bool, lacking: f32) {
        self.filling_seconds = match is_cut {
            true => FILLING_SECONDS,
            false => (self.filling_seconds - elapsed_seconds).max(0.0),
        };
        let lacking = if self.filling_seconds > 0.0 { 1.0 } else { lacking };
        let quick_frames = (elapsed_seconds * 60.0).max(1.0);
        let filling_times = 1.0 + (FILLING_TIMES - 1.0) * lacking;
        let times = filling_times.max(quick_frames.min(1.5)).max(SLOW_SHARE * quick_frames).min(MAX_TIMES);
        self.frame = (self.regular as f32 * times) as u32;
        // The rest takes about as long as it did.
        let [arrivals, places] = [Item::Arrival, Item::Place].map(|item| item as usize);
        let rest: u32 = (0..WORK_KINDS)
            .filter(|kind| !(arrivals..=places + 2).contains(kind))
            .map(|kind| self.done.counts[kind] * WORK_COSTS[kind].1)
            .sum();
        self.reserved = rest.clamp(self.frame / 8, self.frame / 8 * MAX_RESERVED_EIGHTHS);
        (self.spent, self.done) = (0, FrameWork::default());
    }

    /// Whether more may be done of a task. What comes first leaves something for the others.
    pub(super) fn may(&self, task: Task) -> bool {
        let until = match task {
            Task::Arrive => self.frame - self.reserved,
            Task::Want => self.frame / 8 * 7,
            Task::Request => self.frame,
        };
        self.spent < until
    }

    /// How long bounding may take: a part of the frame, less where little is left, never nothing.
    pub(crate) fn bounding_nanoseconds(&self) -> u32 {
        let left = self.frame.saturating_sub(self.spent);
        left.min(self.frame / 8 * BOUNDING_EIGHTHS).max(self.frame / 32)
    }

    /// What the last frame has spent, in nanoseconds for a sixtieth of a second.
    pub(crate) fn used_nanoseconds(&self) -> u32 {
        (f64::from(self.regular) * f64::from(self.spent) / f64::from(self.frame.max(1))) as u32
    }

    pub(super) fn spend(&mut self, item: Item, times: u32) {
        self.done.counts[item as usize] += times;
        self.spent = self.spent.saturating_add(times.saturating_mul(WORK_COSTS[item as usize].1));
    }
}

// The bias.

/// Share of the atlas that needed parcels may take; the rest is lost between them, or keeps what may be needed again.
const MAX_NEEDED_SHARE: f64 = 0.92;
/// Share of that up to which the bias sinks.
const MAX_LOWER_BIAS_SHARE: f64 = 0.88;
/// Share of that to which a rising bias brings the demand.
const TARGET_SHARE: f64 = 0.95;
/// What a parcel that finds no room takes from the share.
const SQUEEZE_FACTOR: f64 = 0.97;
/// What a frame with a moving camera gives back.
const RELAX_STEP: f64 = 0.0005;
/// Frames between two changes of the bias of which the second lowers it.
const MIN_STEADY_FRAMES: u32 = 4;

/// Texels by the bias from which on they are not needed.
#[derive(Clone, Debug)]
struct Histogram {
    texels: Vec<u64>,
}

impl Histogram {
    /// All bundles stand among what no bias needs.
    fn of_nothing_needed(shapes: &TileShapes) -> Self {
        let mut texels = vec![0; 256];
        texels[0] = (0..shapes.bundle_count()).map(|index| shapes.texels(shapes.parcel(index))).sum();
        Self { texels }
    }

    /// Counts the own levels of a tile of one page per level, or (`more` false) does not any more.
    fn count_tile(&mut self, shape: &TileShape, detail: Detail, more: bool) {
        if detail.is_visible() {
            for level in shape.wanted_level(detail)..shape.own_levels() {
                self.count(until(shape, level, detail), shape.texels(level), more);
            }
        }
    }

    /// The same for the own pages of a large tile.
    fn count_pages(&mut self, shape: &TileShape, pages: &[PageDemand], more: bool) {
        for page in pages {
            let id = shape.page(0, page.index);
            let [w, h] = shape.page_extent(id.level, id.page).map(u64::from);
            self.count(until(shape, id.level, page.detail), w * h, more);
        }
    }

    fn count(&mut self, until: u8, texels: u64, more: bool) {
        let bin = &mut self.texels[usize::from(until)];
        *bin = if more { *bin + texels } else { *bin - texels };
    }

    /// The least bias with which at most `limit` texels are needed.
    fn bias_within(&self, limit: f64) -> u8 {
        // Texels in bin k are needed while the bias is below k.
        let mut needed = 0;
        for bias in (1..self.texels.len()).rev() {
            needed += self.texels[bias];
            if needed as f64 > limit {
                return bias as u8;
            }
        }
        0
    }
}

/// The bias from which on a level is not needed.
fn until(shape: &TileShape, level: u32, detail: Detail) -> u8 {
    shape.leaves(level).saturating_sub(detail.0)
}

/// The bias and what it depends on.
#[derive(Clone, Debug)]
pub(super) struct BiasControl {
    /// Steps of [`Detail`] by which everything is wanted coarser.
    pub(super) bias: u8,
    /// Share of the atlas that turned out to be usable.
    usable: f64,
    histogram: Histogram,
    /// Per group the demand that is counted.
    pub(super) counted: Vec<Detail>,
    /// Per large tile that is visible the pages that are counted.
    counted_pages: SparseLists<PageDemand>,
    /// Per bundle the bias from which on it is not needed, as far as the demand of its groups is counted.
    pub(super) untils: Vec<u8>,
    /// Frames since the bias changed.
    steady: u32,
}

impl BiasControl {
    pub(super) fn new(shapes: &TileShapes) -> Self {
        let group_count = shapes.group_count();
        Self {
            untils: vec![0; shapes.bundle_count() as usize],
            bias: 0,
            usable: 1.0,
            histogram: Histogram::of_nothing_needed(shapes),
            counted: vec![Detail::HIDDEN; group_count],
            counted_pages: SparseLists::new(group_count),
            steady: 0,
        }
    }

    /// Begins anew with another atlas and the same demand.
    pub(super) fn reset(&mut self) {
        (self.bias, self.usable, self.steady) = (0, 1.0, 0);
    }

    /// Takes over the demand of a group; its bundle is counted separately.
    pub(super) fn count(&mut self, group: u32, demand: &Demand, shapes: &TileShapes) {
        let shape = shapes.of(group);
        let detail = demand.detail(group);
        let last = std::mem::replace(&mut self.counted[group as usize], detail);
        if !shape.is_paged() {
            if last != detail {
                self.histogram.count_tile(shape, last, false);
                self.histogram.count_tile(shape, detail, true);
            }
            return;
        }
        let pages = demand.pages(group);
        let last = self.counted_pages.set(group, pages.to_vec());
        self.histogram.count_pages(shape, &last, false);
        self.histogram.count_pages(shape, pages, true);
    }

    /// Takes over what bundles need, as far as the demand of their groups is counted.
    pub(super) fn count_family(&mut self, family: u32, shapes: &TileShapes) {
        let groups = shapes.groups(family, 0);
        let first = groups.start;
        let mut untils = [[0; SHARED_LEVELS as usize]; FAMILY as usize];
        for (untils, group) in untils.iter_mut().zip(groups) {
            *untils = self.untils_of(group, shapes);
        }
        for step in 0..SHARED_LEVELS {
            let tiles = BUNDLE_TILES[step as usize];
            for (own, begin) in untils.chunks(tiles as usize).zip((first..).step_by(tiles as usize)) {
                if begin as usize >= shapes.group_count() {
                    break;
                }
                let next = own.iter().map(|untils| untils[step as usize]).max().unwrap_or(0);
                let parcel = Parcel::bundle_of(begin, step);
                let last = std::mem::replace(&mut self.untils[shapes.index(parcel) as usize], next);
                if last != next {
                    let texels = shapes.texels(parcel);
                    self.histogram.count(last, texels, false);
                    self.histogram.count(next, texels, true);
                }
            }
        }
    }

    /// Per step the bias from which on a group does not need its level.
    fn untils_of(&self, group: u32, shapes: &TileShapes) -> [u8; SHARED_LEVELS as usize] {
        let detail = self.counted[group as usize];
        if !detail.is_visible() {
            return [0; SHARED_LEVELS as usize];
        }
        let shape = shapes.of(group);
        // What lies over a page is needed as long as the page is.
        let own = self.counted_pages.get(group).iter();
        let own = own.map(|page| until(shape, shape.page(group, page.index).level, page.detail)).max();
        shape.shared_leaves().map(|leaves| match leaves {
            0 => 0,
            leaves => leaves.saturating_sub(detail.0).max(own.unwrap_or(0)),
        })
    }

    /// A needed parcel found no room: less must be needed.
    pub(super) fn squeeze(&mut self) {
        self.usable = (self.usable * SQUEEZE_FACTOR).max(1e-3);
    }

    /// The camera moves, so what did not fit may fit now.
    pub(super) fn relax(&mut self) {
        self.usable = (self.usable + RELAX_STEP).min(1.0);
    }

    /// Adapts the bias; whether everything should be wanted anew.
    pub(super) fn update(&mut self, needed_texels: u64, atlas_texels: u64) -> bool {
        let limit = atlas_texels as f64 * MAX_NEEDED_SHARE * self.usable;
        if needed_texels as f64 > limit {
            self.bias = self.histogram.bias_within(TARGET_SHARE * limit).max(self.bias);
            self.steady = 0;
            return true;
        }
        self.steady = self.steady.saturating_add(1);
        if self.bias == 0 || self.steady < MIN_STEADY_FRAMES {
            return false;
        }
        let lower = self.histogram.bias_within(MAX_LOWER_BIAS_SHARE * limit);
        if lower >= self.bias {
            return false;
        }
        (self.bias, self.steady) = (lower, 0);
        true
    }
}
