//! Where triangles are in a list.

use std::sync::atomic::{AtomicU32, Ordering};

use crate::charts::NONE;

/// Of every triangle its index among those that are looked at, or [`NONE`]. Who looks at the triangles of one
/// piece has their entries for himself.
pub(crate) struct Slots(Vec<AtomicU32>);

impl Slots {
    pub(crate) fn new(count: usize) -> Self {
        Self((0..count).map(|_| AtomicU32::new(NONE)).collect())
    }

    pub(crate) fn of(&self, triangle: u32) -> u32 {
        self.0[triangle as usize].load(Ordering::Relaxed)
    }

    pub(crate) fn has(&self, triangle: u32) -> bool {
        self.of(triangle) != NONE
    }

    pub(crate) fn set(&self, triangle: u32, slot: u32) {
        self.0[triangle as usize].store(slot, Ordering::Relaxed);
    }

    /// Numbers triangles from 0.
    pub(crate) fn number(&self, triangles: &[u32]) {
        (0..).zip(triangles).for_each(|(slot, &t)| self.set(t, slot));
    }

    pub(crate) fn clear(&self, triangles: &[u32]) {
        triangles.iter().for_each(|&t| self.set(t, NONE));
    }
}
