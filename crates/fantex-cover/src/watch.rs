//! How far a cover is, and whether it is still wanted.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};

use fantex_base::{Error, Result};

/// Tells how far a cover is, pass by pass, and asks whether it is still wanted.
pub(crate) struct Watch<'a> {
    /// Hears what share is done, 0 to 1, and answers whether to go on.
    goes_on: &'a (dyn Fn(f32) -> bool + Sync),
    /// What was left out cannot be made up for.
    has_ended: AtomicBool,
    /// When all was last [expected](Self::expect) to take so long: the share that was done, the time that had gone, and the whole; see [`time`].
    plan: [Number; 3],
    /// The time before the pass at work, and with it.
    pass: [Number; 2],
    /// How much there is to do in that pass, and how much of it is done.
    work: AtomicU64,
    done: AtomicU64,
}

/// A number that threads read.
#[derive(Default)]
struct Number(AtomicU32);

impl Number {
    fn get(&self) -> f32 {
        f32::from_bits(self.0.load(Relaxed))
    }

    fn set(&self, number: f32) {
        self.0.store(number.to_bits(), Relaxed);
    }
}

/// A pass reports about so many times.
const REPORTS: u64 = 256;

impl<'a> Watch<'a> {
    pub(crate) fn new(goes_on: &'a (dyn Fn(f32) -> bool + Sync)) -> Self {
        let watch = Self {
            goes_on,
            has_ended: AtomicBool::new(false),
            plan: Default::default(),
            pass: Default::default(),
            work: AtomicU64::new(0),
            done: AtomicU64::new(0),
        };
        watch.plan[2].set(f32::INFINITY);
        watch
    }

    /// All passes take so long, about. What is left of the share is for what is left of that.
    pub(crate) fn expect(&self, whole: f32) {
        let share = self.share();
        let [done, begun, all] = &self.plan;
        done.set(share);
        begun.set(self.now());
        all.set(whole);
    }

    /// Begins a pass, at whose end so much of the whole time has gone. What was left out before it counts as done.
    ///
    /// # Errors
    /// The cover is not wanted any more.
    pub(crate) fn begin(&self, until: f32, work: usize) -> Result<()> {
        let [from, to] = &self.pass;
        from.set(to.get());
        to.set(until);
        self.work.store(work as u64, Relaxed);
        self.done.store(0, Relaxed);
        self.check()
    }

    /// Begins the last pass.
    ///
    /// # Errors
    /// The cover is not wanted any more.
    pub(crate) fn begin_last(&self) -> Result<()> {
        self.begin(self.plan[2].get(), REPORTS as usize)
    }

    /// So much of the work of the pass is done. Cheap enough for every set of fans.
    pub(crate) fn add(&self, work: usize) {
        let (work, all) = (work as u64, self.work.load(Relaxed).max(1));
        let before = self.done.fetch_add(work, Relaxed);
        if before * REPORTS / all != (before + work) * REPORTS / all {
            self.has_ended();
        }
    }

    /// Half of what was left of the pass is done.
    pub(crate) fn add_half(&self) {
        let left = self.work.load(Relaxed).saturating_sub(self.done.load(Relaxed));
        self.add(left as usize / 2);
    }

    /// All is done.
    ///
    /// # Errors
    /// The cover is not wanted any more.
    pub(crate) fn end(&self) -> Result<()> {
        self.done.store(self.work.load(Relaxed), Relaxed);
        self.check()
    }

    /// The time that has gone.
    fn now(&self) -> f32 {
        let [from, to] = &self.pass;
        let of_pass = self.done.load(Relaxed) as f32 / self.work.load(Relaxed).max(1) as f32;
        from.get() + (to.get() - from.get()) * of_pass.min(1.0)
    }

    /// The share of the whole that is done.
    fn share(&self) -> f32 {
        let [done, begun, all] = &self.plan;
        let of_rest = (self.now() - begun.get()) / (all.get() - begun.get()).max(f32::MIN_POSITIVE);
        (done.get() + (1.0 - done.get()) * of_rest).clamp(0.0, 1.0)
    }

    pub(crate) fn has_ended(&self) -> bool {
        if !self.has_ended.load(Relaxed) && !(self.goes_on)(self.share()) {
            self.has_ended.store(true, Relaxed);
        }
        self.has_ended.load(Relaxed)
    }

    pub(crate) fn check(&self) -> Result<()> {
        if self.has_ended() { Err(Error::cancelled("covering the mesh was ended")) } else { Ok(()) }
    }
}

/// How long the passes of a cover take, one after the other: milliseconds for a thousand triangles of a rough scan on one core, about.
pub(crate) mod time {
    /// Pairing triangles at their edges.
    pub(crate) const ANGLES: f32 = 0.2;

    /// The same, with the shapes of all fans.
    pub(crate) const SHAPED: f32 = 0.6;

    // One of the ways to group fans: until they are
    /// cut into sets,
    pub(crate) const CUT: f32 = 2.0;
    /// whose connected pieces are found,
    pub(crate) const CONNECTED: f32 = 2.3;
    /// laid flat,
    pub(crate) const FLATTENED: f32 = 3.8;
    /// and joined.
    pub(crate) const JOINED: f32 = 9.0;
    /// All of it.
    const WAY: f32 = 9.3;

    /// All before the next way, after so many.
    pub(crate) fn grouped(ways: usize) -> f32 {
        SHAPED + WAY * ways as f32
    }

    /// Laying groups flat freely, one by one,
    pub(crate) const UNROLLED_ALONE: f32 = 6.0;
    /// and joining them.
    pub(crate) const UNROLLING: f32 = 60.0;

    /// What a round of joining leaves of the time of all rounds.
    pub(crate) const LEFT_PER_ROUND: f32 = 0.5;

    /// Giving every fan a tile of its own.
    pub(crate) const LAYING: f32 = 1.1;

    /// Trying sizes of tiles, and measuring.
    pub(crate) const SIZING: f32 = 2.0;
}
