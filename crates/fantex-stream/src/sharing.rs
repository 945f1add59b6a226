//! What the streamers of several objects share: memory for texels.

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
}
