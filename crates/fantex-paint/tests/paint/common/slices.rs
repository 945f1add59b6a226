//! Work in slices that is interrupted.

use std::time::Instant;

use fantex_paint::{PaintOptions, Painter};
use fantex_store::{VerifyOptions, verify};
use glam::Vec3;

use super::{Baked, Contents, contents, paint_stroke, red, stroke};

/// With so little memory that changes and steps go to the file in parts.
pub(crate) fn open(baked: &Baked) -> Painter {
    Painter::open(&baked.path, &PaintOptions { memory_bytes: 2 << 20, history: true }).unwrap()
}

/// Slices, of which none is the last.
pub(crate) fn slices(painter: &mut Painter, count: usize) {
    (0..count).for_each(|_| assert!(!painter.work_on(Instant::now()).unwrap(), "there is more to do"));
}

/// As a crash leaves it: what came after the last commit is gone.
pub(crate) fn crash(painter: Painter, baked: &Baked) -> Painter {
    drop(painter);
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    open(baked)
}

/// A stroke on the base, so that there are layers over something painted.
pub(crate) fn start(baked: &Baked) -> (Painter, Contents) {
    let mut painter = open(baked);
    let line = stroke(painter.surface(), 40.0, &[Vec3::X, Vec3::new(0.5, 0.5, 0.7), Vec3::Z]);
    paint_stroke(&mut painter, red(0.9), &line);
    painter.commit().unwrap();
    let before = contents(&painter);
    (painter, before)
}
