//! Work that takes long on a large asset: filling, evaluating layers on all pages, taking back steps that changed them.
//!
//! ```text
//!  start --> Work --work_on(until)--> ... --> done, one step of the history
//!              |                       |
//!              |                 cancel_work: takes back what is done so far
//!            commit keeps it in the asset: whoever opens that next goes on
//! ```
//!
//! It is done in slices, group by group with all levels, so that a window can answer between them, show what is finished and
//! commit. Doing it at once (as [`Painter::edit_layers`] and [`Painter::undo`] do) takes the same slices to the end. Memory is bounded
//! by a slice. A commit in the middle holds texels, the records that undo them, and an attachment that says what is left.

mod fill;
mod flatten;
mod slices;
mod steps;

use std::time::Instant;

use fantex_store::AssetEditor;
use serde::{Deserialize, Serialize};

pub(crate) use fill::FillWork;
pub(crate) use flatten::FlattenWork;
pub(crate) use steps::{Afterwards, StepWork};

use crate::history::Direction;
use crate::layers::Layers;
use crate::{PaintError, Painter};

/// The attachment that keeps unfinished work.
const KEPT: &str = "history/unfinished";

/// Work under way.
#[derive(Debug)]
pub(crate) enum Work {
    /// A stroke fills.
    Fill(Box<FillWork>),
    /// Layers have changed.
    Flatten(FlattenWork),
    /// A step is taken back or done again.
    Step(StepWork),
}

/// How far work is.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkProgress {
    /// Its name in the history.
    pub label: String,
    /// 0..1.
    pub share: f32,
    /// Whether it takes something back.
    pub is_undo: bool,
}

/// The same in an asset.
#[derive(Debug, Serialize, Deserialize)]
enum Kept {
    Fill(fill::Kept),
    Flatten(flatten::Kept),
    Step(steps::Kept),
}

impl Painter {
    /// Whether there is unfinished work. Strokes, steps and changes of layers finish it first.
    pub fn has_work(&self) -> bool {
        self.work.is_some()
    }

    /// How far it is; none where there is none.
    pub fn work_progress(&self) -> Option<WorkProgress> {
        Some(match self.work.as_ref()? {
            Work::Fill(work) => work.progress(),
            Work::Flatten(work) => work.progress(),
            Work::Step(work) => work.progress(),
        })
    }

    /// Goes on until a moment (a slice more, at least one); true where nothing is left to do.
    ///
    /// # Errors
    ///
    /// A page cannot be read, evaluated or kept. What is left stays to be done.
    pub fn work_on(&mut self, until: Instant) -> Result<bool, PaintError> {
        while let Some(work) = self.work.take() {
            match work {
                Work::Fill(work) => drop(self.fill_on(work)?),
                Work::Flatten(work) => self.flatten_on(work)?,
                Work::Step(work) => self.step_on(work)?,
            }
            if Instant::now() >= until {
                break;
            }
        }
        Ok(self.work.is_none())
    }

    /// Does all that is left.
    ///
    /// # Errors
    ///
    /// As [`work_on`](Self::work_on).
    pub fn finish_work(&mut self) -> Result<(), PaintError> {
        while !self.work_on(Instant::now())? {}
        Ok(())
    }

    /// Gives the work up: what it has done so far is taken back, which is work, too.
    ///
    /// # Errors
    ///
    /// The history cannot be written.
    pub fn cancel_work(&mut self) -> Result<(), PaintError> {
        match self.work.take() {
            Some(Work::Step(work)) => self.work = Some(Work::Step(work.turned_back())),
            // There is no way back but to the end and from there.
            work if !self.options.history => self.work = work,
            Some(Work::Fill(_) | Work::Flatten(_)) => self.take_back()?,
            None => {}
        }
        Ok(())
    }

    /// Ends the open step, which has something in it, and begins to take it back.
    fn take_back(&mut self) -> Result<(), PaintError> {
        self.room.let_go();
        self.finish_history()?;
        if let Some(step) = self.history.next_step(Direction::Back).cloned() {
            self.work = Some(Work::Step(StepWork::then(step, Direction::Back, Afterwards::Forget)));
        }
        Ok(())
    }

    /// Does what is seen first: groups of less urgency come later.
    pub fn prefer_groups(&mut self, urgency: impl Fn(u32) -> f32) {
        match &mut self.work {
            Some(Work::Fill(work)) => work.prefer(urgency),
            Some(Work::Flatten(work)) => work.slices.prefer(urgency),
            Some(Work::Step(_)) | None => {}
        }
    }

    /// Writes down what is left, for a commit.
    pub(crate) fn keep_work(&mut self) -> Result<(), PaintError> {
        let kept = match &self.work {
            None if self.editor.has_attachment(KEPT) => {
                self.editor.detach(KEPT);
                return Ok(());
            }
            None => return Ok(()),
            Some(Work::Fill(work)) => Kept::Fill(work.kept(self.history.keep_open(&mut self.editor)?)),
            Some(Work::Flatten(work)) => {
                let step = self.history.keep_open(&mut self.editor)?;
                Kept::Flatten(work.kept(step, self.editor.asset().path()))
            }
            Some(Work::Step(work)) => Kept::Step(work.kept()),
        };
        let bytes = serde_json::to_vec(&kept).map_err(std::io::Error::other)?;
        Ok(self.editor.attach(KEPT, bytes)?)
    }

    /// Takes up what was left when the asset was last committed.
    pub(crate) fn take_up_work(&mut self) -> Result<(), PaintError> {
        let Some(bytes) = self.editor.attachment(KEPT)? else { return Ok(()) };
        let kept = serde_json::from_slice(&bytes).map_err(|_| damaged(&self.editor))?;
        self.work = Some(match kept {
            Kept::Fill(kept) => {
                if let Some(step) = &kept.step {
                    self.history.take_up(step.clone());
                }
                match self.fill_left(&kept)? {
                    Some(work) => Work::Fill(Box::new(work)),
                    None => return self.take_back(),
                }
            }
            Kept::Flatten(kept) => {
                self.fills.update(&self.surface, &self.layers)?;
                if let Some(step) = &kept.step {
                    self.history.take_up(step.clone());
                }
                Work::Flatten(self.flatten_left(kept))
            }
            Kept::Step(kept) => Work::Step(StepWork::left(kept)),
        });
        Ok(())
    }

    /// Takes back the last step, or does the next one again; false where there is none.
    fn start_step(&mut self, direction: Direction) -> Result<bool, PaintError> {
        self.finish_work()?;
        self.end()?;
        let Some(step) = self.history.next_step(direction).cloned() else { return Ok(false) };
        self.work = Some(Work::Step(StepWork::new(step, direction)));
        Ok(true)
    }

    /// Begins to take the last step back; false where there is none. The work is to be done by [`work_on`](Self::work_on).
    ///
    /// # Errors
    ///
    /// What is open cannot be ended.
    pub fn start_undo(&mut self) -> Result<bool, PaintError> {
        self.start_step(Direction::Back)
    }

    /// Begins to do again what was taken back last; false where there is nothing. The work is to be done by
    /// [`work_on`](Self::work_on).
    ///
    /// # Errors
    ///
    /// What is open cannot be ended.
    pub fn start_redo(&mut self) -> Result<bool, PaintError> {
        self.start_step(Direction::Forth)
    }

    /// After steps: the layers as they are in the asset.
    fn reload_layers(&mut self) -> Result<(), PaintError> {
        self.layers = Layers::load(&self.editor)?;
        Ok(())
    }
}

fn damaged(editor: &AssetEditor) -> PaintError {
    let reason = "what was left to be done cannot be read";
    PaintError::History { path: editor.asset().path().to_owned(), reason }
}
