//! How much is done in a frame: counted, not timed, so that the same happens on every machine.
//!
//! The costs are the least squares of the processor time of frames over what was counted in them (`examples/frame_costs.rs`): 2600 frames of
//! tours in real time, first views, orbit, flight and cuts, over a landscape of 960 k triangles with 512 M texels in 52 k tiles and
//! with 4 G in 434 k, in an optimised build, on two cores that did three times as much besides. They meet a frame's time to within 0.4 ms
//! (root of the mean square); a frame takes 0.04 ms beside. Milliseconds taken and counted, median, 99 of 100, longest, with costs close
//! to these:
//!
//! | | taken | counted |
//! |---|---|---|
//! | a second from the first view on | 5.5, 12.2, 12.7 | 5.4, 12.0, 12.0 |
//! | orbit in 3 s | 4.3, 6.9, 8.7 | 4.1, 7.5, 9.0 |
//! | flight, with a cut at its beginning | 1.0, 11.3, 12.9 | 0.8, 12.0, 12.0 |
//! | cuts | 0.0, 9.4, 11.7 | 0.0, 11.9, 12.0 |
//!
//! The costs before, with twice as much for a parcel and half as much for bounding, made a frame of arrivals stop at two thirds of its
//! time, and one of bounding go beyond it.

/// What a frame does, in the order in which it may use up the frame's work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// Giving places to what has come.
    Arrive,
    /// Taking over demand.
    Want,
    /// Asking for what is missing.
    Ask,
}

/// Nanoseconds that are meant to be spent in a sixtieth of a second, with what demand takes.
pub(super) const FRAME: u32 = 6_000_000;

/// Slow frames do this share of what as many quick ones would do: a tenth of their time.
const SLOW_SHARE: f32 = 0.25;
/// And no more than so many quick ones.
const MOST_TIMES: f32 = 32.0;

/// After a cut, and while all that is seen lacks something, a frame may do so many times as much: there is little on the screen that
/// could stutter, and with twice [`FRAME`] sixty frames a second are still drawn.
const FILLING_TIMES: f32 = 2.0;
/// So long after a cut, seconds, which is how long a view may take to be sharp.
pub(super) const FILLING_SECONDS: f32 = 0.5;

/// Of a frame, eighths that arrivals leave to the rest, at most. (With a half for arrivals, whatever there was to do else, a
/// first view of 400 k tiles took the demand of a few families per frame: arrivals and bounding used up the rest.)
const MOST_RESERVED_EIGHTHS: u32 = 5;
/// And for bounding, at most.
const BOUNDING_EIGHTHS: u32 = 2;

/// What is counted.
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
    Ask,
    /// The same for one that is cancelled.
    Cancel,
    /// A bundle or a group's own pages, looked at for what may be needed soon.
    Foresee,
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
    ("owners foreseen", 12),
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

/// What may still be done in a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Work {
    frame: u32,
    /// What of that arrivals leave for the rest.
    reserved: u32,
    spent: u32,
    done: FrameWork,
}

impl Work {
    /// That of the next frame, which comes so long after this one: slow frames, of which there are few, may take longer, and where
    /// drawing takes seconds, as software adapters do, nobody notices a tenth more. `nanoseconds`: as [`FRAME`]. `lacking`: share
    /// of what is seen that lacks something; 1 after a cut.
    pub(super) fn next_frame(&self, nanoseconds: u32, elapsed_seconds: f32, lacking: f32) -> Self {
        let quick_frames = (elapsed_seconds * 60.0).max(1.0);
        let filling_times = 1.0 + (FILLING_TIMES - 1.0) * lacking;
        let times = filling_times.max(quick_frames.min(1.5)).max(SLOW_SHARE * quick_frames).min(MOST_TIMES);
        let frame = (nanoseconds as f32 * times) as u32;
        // The rest takes about as long as it did.
        let [arrivals, places] = [Item::Arrival, Item::Place].map(|item| item as usize);
        let rest: u32 = (0..WORK_KINDS)
            .filter(|kind| !(arrivals..=places + 2).contains(kind))
            .map(|kind| self.done.counts[kind] * WORK_COSTS[kind].1)
            .sum();
        let reserved = rest.clamp(frame / 8, frame / 8 * MOST_RESERVED_EIGHTHS);
        Self { frame, reserved, spent: 0, done: FrameWork::default() }
    }

    /// What has been done.
    pub(super) fn done(&self) -> &FrameWork {
        &self.done
    }

    /// Nanoseconds that have been spent, and may be.
    #[cfg(test)]
    pub(super) fn spent_of(&self) -> (u32, u32) {
        (self.spent, self.frame)
    }

    /// Whether more may be done of a task. What comes first leaves something for the others.
    pub(super) fn may(&self, task: Task) -> bool {
        let until = match task {
            Task::Arrive => self.frame - self.reserved,
            Task::Want => self.frame / 8 * 7,
            Task::Ask => self.frame,
        };
        self.spent < until
    }

    /// How long bounding may take: a part of the frame, less where little is left, never nothing.
    pub(super) fn bounding_nanoseconds(&self) -> u32 {
        let left = self.frame.saturating_sub(self.spent);
        left.min(self.frame / 8 * BOUNDING_EIGHTHS).max(self.frame / 32)
    }

    /// Something has been done so many times.
    pub(super) fn spend(&mut self, item: Item, times: u32) {
        self.done.counts[item as usize] += times;
        self.spent = self.spent.saturating_add(times.saturating_mul(WORK_COSTS[item as usize].1));
    }
}
