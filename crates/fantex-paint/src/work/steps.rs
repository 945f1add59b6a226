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
    /// Parts that are left: forth from the first one, back from the last one.
    left: Range<u32>,
    /// How many there were.
    count: u32,
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
    count: u32,
    afterwards: Afterwards,
}

impl StepWork {
    pub(super) fn new(step: HistoryStep, direction: Direction) -> Self {
        Self::then(step, direction, Afterwards::Move)
    }

    pub(super) fn then(step: HistoryStep, direction: Direction, afterwards: Afterwards) -> Self {
        let count = step.parts();
        Self { step, direction, left: 0..count, count, afterwards }
    }

    pub(super) fn left(kept: Kept) -> Self {
        let Kept { step, direction, left, count, afterwards } = kept;
        Self { step, direction, left, count, afterwards }
    }

    pub(super) fn kept(&self) -> Kept {
        let Self { step, direction, left, count, afterwards } = self;
        Kept {
            step: step.clone(),
            direction: *direction,
            left: left.clone(),
            count: *count,
            afterwards: *afterwards,
        }
    }

    /// The way back to where it started.
    pub(super) fn turned_back(self) -> Self {
        if self.afterwards != Afterwards::Move {
            return self;
        }
        let done = match self.direction {
            Direction::Forth => 0..self.left.start,
            Direction::Back => self.left.end..self.count,
        };
        let (direction, count) = (self.direction.opposite(), done.len() as u32);
        Self { step: self.step, direction, left: done, count, afterwards: Afterwards::Stay }
    }

    pub(super) fn progress(&self) -> WorkProgress {
        WorkProgress {
            label: self.step.label.clone(),
            share: 1.0 - self.left.len() as f32 / self.count.max(1) as f32,
            is_undo: self.direction == Direction::Back,
        }
    }
}

impl Painter {
    /// Applies the next part.
    pub(super) fn step_on(&mut self, mut work: StepWork) -> Result<(), PaintError> {
        let mut left = work.left.clone();
        let next = match work.direction {
            Direction::Forth => left.next(),
            Direction::Back => left.next_back(),
        };
        let Some(part) = next else { return self.end_step(work) };
        let applied = self.history.apply_part(&work.step, part, work.direction, &mut self.editor);
        if applied.is_ok() {
            work.left = left;
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
