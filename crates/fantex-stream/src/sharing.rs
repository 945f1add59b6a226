//! What the streamers of several objects share: memory for texels, and the work of a frame.

use crate::residency::FRAME_NANOSECONDS;

/// Among how many objects memory for texels is divided: a power of two, at least their number. With another one all texels are read anew.
/// So it grows at once, since memory is bounded, and shrinks where fewer have been enough for a while.
#[derive(Clone, Copy, Debug)]
pub struct PoolShares {
    count: u64,
    /// The most that were needed since fewer are enough, and seconds since then.
    enough: Option<(u64, f32)>,
}

/// Seconds for which fewer shares must have been enough.
const SHRINKING_SECONDS: f32 = 5.0;

impl Default for PoolShares {
    /// One.
    fn default() -> Self {
        Self { count: 1, enough: None }
    }
}

impl PoolShares {
    /// Takes account of so many objects, `elapsed_seconds` after the last time.
    pub fn update(&mut self, objects: u64, elapsed_seconds: f32) {
        let needed = objects.max(1).next_power_of_two();
        // Where there is no object, nothing is read anew.
        if needed >= self.count || objects == 0 {
            *self = Self { count: needed, enough: None };
            return;
        }
        let (most, seconds) = self.enough.unwrap_or((needed, 0.0));
        let (most, seconds) = (most.max(needed), seconds + elapsed_seconds);
        *self = match seconds < SHRINKING_SECONDS {
            true => Self { enough: Some((most, seconds)), ..*self },
            false => Self { count: most, enough: None },
        };
    }

    /// How many there are.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Whether their number stays as it is as long as that of the objects does.
    pub fn is_settled(&self) -> bool {
        self.enough.is_none()
    }
}

/// The work of a frame, for streamers that have their turns one after the other: each may use up what is left, but for half of the whole, of
/// which each has its part.
#[derive(Clone, Copy, Debug)]
pub struct SharedWork {
    left: u32,
    /// What is kept for each.
    part: u32,
    /// Streamers that have not had their turn.
    waiting: u32,
}

impl SharedWork {
    /// For so many streamers.
    pub fn new(streamers: usize) -> Self {
        let waiting = u32::try_from(streamers).unwrap_or(u32::MAX).max(1);
        Self { left: FRAME_NANOSECONDS, part: FRAME_NANOSECONDS / 2 / waiting, waiting }
    }

    /// The turn of the next streamer: the [work](crate::Streamer::set_frame_nanoseconds) that it may do.
    pub fn next_turn(&mut self) -> u32 {
        self.waiting = self.waiting.saturating_sub(1);
        self.left.saturating_sub(self.part * self.waiting).max(self.part)
    }

    /// What it has [used](crate::Streamer::used_nanoseconds) of that.
    pub fn spend(&mut self, nanoseconds: u32) {
        self.left = self.left.saturating_sub(nanoseconds);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_do_not_follow_a_number_that_goes_up_and_down() {
        let mut shares = PoolShares::default();
        let mut after = |objects: u64, seconds: f32| {
            shares.update(objects, seconds);
            (shares.count(), shares.is_settled())
        };
        assert_eq!(after(16, 0.1), (16, true));
        assert_eq!(after(17, 0.1), (32, true));
        for _ in 0..20 {
            assert_eq!(after(16, 2.0), (32, false));
            assert_eq!(after(17, 0.1), (32, true));
        }
        // Fewer are enough for five seconds: as many as were needed in that time.
        assert_eq!(after(3, 2.0), (32, false));
        assert_eq!(after(7, 2.0), (32, false));
        assert_eq!(after(1, 2.0), (8, true));
        assert_eq!(after(100, 0.0), (128, true));
        assert_eq!(after(0, 0.0), (1, true));
    }

    #[test]
    fn several_streamers_do_the_work_of_one_and_none_goes_without() {
        for (streamers, need) in
            [(1, u32::MAX), (20, u32::MAX), (20, 100_000), (1000, 50_000), (1000, u32::MAX)]
        {
            let mut work = SharedWork::new(streamers);
            let turn = |_| {
                let given = work.next_turn();
                work.spend(given.min(need));
                given
            };
            let given: Vec<u32> = (0..streamers).map(turn).collect();
            let used: u32 = given.iter().map(|&given| given.min(need)).sum();
            assert!(used <= FRAME_NANOSECONDS, "{used}");
            let part = FRAME_NANOSECONDS / 2 / streamers as u32;
            assert!(given.iter().all(|&given| given >= part), "{given:?}");
            assert!(given[0] >= FRAME_NANOSECONDS / 2);
        }
        // What one does not need is there for the next.
        let mut work = SharedWork::new(2);
        assert_eq!(work.next_turn(), FRAME_NANOSECONDS / 4 * 3);
        work.spend(0);
        assert_eq!(work.next_turn(), FRAME_NANOSECONDS);
    }
}
