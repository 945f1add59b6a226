//! Taking a step back, or doing it again: part by part.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::{Work, WorkProgress};
use crate::history::{Direction, HistoryStep};
use crate::{PaintError, Painter};

/// A step whose parts are being applied.
#[derive(Debug)]
pub(crate) struct StepWork {
    step: HistoryStep,
    direction: Direction,
    /// Parts that are left, and how many there were.
    left: Range<u32>,
    parts: u32,
    afterwards: Afterwards,
}

/// What becomes of the step in the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Afterwards {
    /// It goes over to the steps that can be done again, or back to those that are done.
    Move,
    /// It stays where it is: moving it was given up.
    Stay,
    /// It is forgotten: what it did was given up.
    Forget,
}

/// The same in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Kept {
    step: HistoryStep,
    direction: Direction,
    left: Range<u32>,
    afterwards: Afterwards,
}

impl StepWork {
    pub(super) fn new(step: HistoryStep, direction: Direction) -> Self {
        Self::then(step, direction, Afterwards::Move)
    }

    pub(super) fn then(step: HistoryStep, direction: Direction, afterwards: Afterwards) -> Self {
        let parts = step.parts();
        Self { step, direction, left: 0..parts, parts, afterwards }
    }

    pub(super) fn left(kept: Kept) -> Self {
        let Kept { step, direction, left, afterwards } = kept;
        Self { parts: left.end, step, direction, left, afterwards }
    }

    pub(super) fn kept(&self) -> Kept {
        let Self { step, direction, left, afterwards, .. } = self;
        Kept { step: step.clone(), direction: *direction, left: left.clone(), afterwards: *afterwards }
    }

    /// The way back to where it started. (Each part changes other pages and attachments, so their order does not matter.)
    pub(super) fn turned_back(self) -> Self {
        if self.afterwards != Afterwards::Move {
            return self;
        }
        let parts = self.left.start;
        let direction = self.direction.opposite();
        Self { step: self.step, direction, left: 0..parts, parts, afterwards: Afterwards::Stay }
    }

    pub(super) fn progress(&self) -> WorkProgress {
        WorkProgress {
            label: self.step.label.clone(),
            share: self.left.start as f32 / self.parts.max(1) as f32,
            is_undo: self.direction == Direction::Back,
        }
    }
}

impl Painter {
    /// Applies the next part.
    pub(super) fn step_on(&mut self, mut work: StepWork) -> Result<(), PaintError> {
        let Some(part) = work.left.clone().next() else { return self.end_step(work) };
        let applied = self.history.apply_part(&work.step, part, work.direction, &mut self.editor);
        if applied.is_ok() {
            work.left.start += 1;
        }
        self.work = Some(Work::Step(work));
        applied?;
        self.relieve()
    }

    fn end_step(&mut self, work: StepWork) -> Result<(), PaintError> {
        match work.afterwards {
            Afterwards::Move => self.history.move_step(work.direction, &mut self.editor)?,
            Afterwards::Stay => {}
            Afterwards::Forget => self.history.forget_last(&mut self.editor)?,
        }
        self.reload_layers()
    }
}
