//! How much is done in a frame: counted, not timed, so that the same happens on every machine.
//!
//! The costs were fitted to the processor time of frames of the tour of `fantex bench stream` over a landscape of 440 k tiles, on two busy
//! cores, in an optimised build with assertions.

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

// What things cost, nanoseconds.

/// A parcel that comes from the loader.
pub(super) const ARRIVE: u32 = 600;
/// A parcel that gets a place, the eviction of others for it, and its entry in the page table.
pub(super) const PLACE: u32 = 1300;
/// The same for each of its tiles: an entry, and a look whether the tile still lacks something.
pub(super) const PLACE_TILE: u32 = 120;
/// A family that needs other bundles.
pub(super) const WANT_FAMILY: u32 = 1000;
/// A group of it whose demand has changed.
pub(super) const WANT_GROUP: u32 = 40;
/// A parcel that becomes needed or unneeded.
pub(super) const NEED: u32 = 60;
/// A parcel that is asked for, with what the loader does of it on the same thread.
pub(super) const ASK: u32 = 700;

/// What may still be done in a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Work {
    frame: u32,
    spent: u32,
}

impl Work {
    /// Of a frame that comes so long after the last one: slow frames, of which there are few, may take longer, and where
    /// drawing takes seconds, as software adapters do, nobody notices a tenth more. `nanoseconds`: as [`FRAME`].
    pub(super) fn of_frame(nanoseconds: u32, elapsed_seconds: f32) -> Self {
        let quick_frames = (elapsed_seconds * 60.0).max(1.0);
        let times = quick_frames.min(1.5).max(SLOW_SHARE * quick_frames).min(MOST_TIMES);
        Self { frame: (nanoseconds as f32 * times) as u32, spent: 0 }
    }

    /// Nanoseconds that have been spent, and may be.
    #[cfg(test)]
    pub(super) fn spent_of(self) -> (u32, u32) {
        (self.spent, self.frame)
    }

    /// Whether more may be done of a task. What comes first leaves something for the others.
    pub(super) fn may(self, task: Task) -> bool {
        let eighths = match task {
            Task::Arrive => 4,
            Task::Want => 7,
            Task::Ask => 8,
        };
        self.spent < self.frame / 8 * eighths
    }

    /// Something has been done.
    pub(super) fn spend(&mut self, nanoseconds: u32) {
        self.spent = self.spent.saturating_add(nanoseconds);
    }
}
