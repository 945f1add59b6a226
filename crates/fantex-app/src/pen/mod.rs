//! Pressure of graphics tablets, where the window library does not hand it on.
//!
//! ```text
//!  window system --its own events--> window library --places--.
//!        |                                                     >-- pen events (panels/scene.rs)
//!        `--raw events--> a thread (x11.rs) --PenReadings------'
//! ```
//!
//! Both tell of the same moves in the same order, but a frame need not have as many of one as of the other.

#[cfg(target_os = "linux")]
pub mod x11;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Readings kept for a frame.
const MAX_READINGS: usize = 1024;

/// Pressures since they were last asked for.
#[derive(Clone, Debug, Default)]
pub struct PenReadings(Arc<Mutex<Readings>>);

#[derive(Debug, Default)]
struct Readings {
    /// 0..1; none from what measures no pressure.
    new: Vec<Option<f32>>,
    last: Option<f32>,
}

impl PenReadings {
    /// Adds a move or a touch with its pressure, 0..1; none from a mouse.
    pub fn put(&self, pressure: Option<f32>) {
        let mut readings = self.lock();
        if readings.new.len() == MAX_READINGS {
            readings.new.drain(..MAX_READINGS / 2);
        }
        readings.new.push(pressure);
    }

    /// The pressures of the next `moves` moves: what came since the last call, spread over them.
    pub fn take(&self, moves: usize) -> Vec<Option<f32>> {
        let mut readings = self.lock();
        let new = std::mem::take(&mut readings.new);
        let before = readings.last;
        readings.last = new.last().copied().unwrap_or(before);
        // The last move has the last reading; moves before the first one have that of the call before.
        let reading = |k: usize| (k * new.len() / moves).checked_sub(1).map_or(before, |index| new[index]);
        (1..=moves).map(reading).collect()
    }

    /// How many came since the last [`PenReadings::take`].
    pub fn waiting(&self) -> usize {
        self.lock().new.len()
    }

    fn lock(&self) -> MutexGuard<'_, Readings> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a pressure of 0..1 does, 0..1: its power `2^-softness`. At a softness of 1 a quarter of the force gives half the effect, at -1 seven
/// tenths of it are needed.
pub fn felt(pressure: f32, softness: f32) -> f32 {
    pressure.clamp(0.0, 1.0).powf((-softness.clamp(-1.0, 1.0)).exp2())
}
