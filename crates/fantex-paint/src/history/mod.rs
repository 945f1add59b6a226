//! Undo and redo, kept in the asset.
//!
//! A step is what a stroke changed: of every page and channel the bytes before, exclusive-or the bytes after, and of every
//! mean and attachment (of the layers) both values. Blocks that did not change are zeros, which pack to nothing, and one record serves both directions, back to
//! the very bytes. Of a page that is put aside as the base of the layers it is only said that it was: taken back it is dropped, done
//! again it is the page as it is then. Steps are attachments `history/STEP/PART` of the asset (a part has some megabytes, so that a long stroke needs
//! no more memory than a short one); `history/index` names them. They are committed together with the texels, so a
//! restart finds both in agreement.

mod record;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use fantex_store::{AssetEditor, PageId};
use record::Record;
use serde::{Deserialize, Serialize};

use crate::layers::{base_bytes, base_name};
use crate::{PaintError, log};

const INDEX: &str = "history/index";

/// Bytes of a part, unpacked, before the next one begins.
const PART_BYTES: usize = 4 << 20;

/// A step that can be undone or redone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HistoryStep {
    /// Names its attachments; never used twice.
    pub id: u64,
    /// What the user calls it.
    pub label: String,
    /// Number of attachments.
    parts: u32,
}

/// All steps.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Index {
    next_id: u64,
    /// What was done, oldest first.
    done: Vec<HistoryStep>,
    /// What was undone and can be redone, the next one last.
    undone: Vec<HistoryStep>,
}

/// The history of an asset.
#[derive(Debug, Default)]
pub struct History {
    index: Index,
    open: Option<OpenStep>,
}

#[derive(Debug)]
struct OpenStep {
    step: HistoryStep,
    bytes: Vec<u8>,
}

/// What a step changes on a page. It comes into one part of the step, as a whole.
#[derive(Debug)]
pub(crate) struct PageStep {
    pub(crate) id: PageId,
    /// Channels with the bytes before and after.
    pub(crate) channels: Vec<(usize, Vec<u8>, Vec<u8>)>,
    /// The page as it was is put aside as the base of the layers, and not once more in the history.
    pub(crate) is_first_layered: bool,
}

/// Whether a step is taken back or done again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Direction {
    Back,
    Forth,
}

impl Direction {
    pub(crate) fn opposite(self) -> Self {
        match self {
            Self::Back => Self::Forth,
            Self::Forth => Self::Back,
        }
    }
}

impl HistoryStep {
    /// Number of its attachments.
    pub(crate) fn parts(&self) -> u32 {
        self.parts
    }
}

impl History {
    pub(crate) fn load(editor: &AssetEditor) -> Result<Self, PaintError> {
        let Some(bytes) = editor.attachment(INDEX)? else { return Ok(Self::default()) };
        let index =
            serde_json::from_slice(&bytes).map_err(|_| damaged(editor, "its index cannot be read"))?;
        Ok(Self { index, open: None })
    }

    /// Steps that can be undone, oldest first.
    pub fn done(&self) -> &[HistoryStep] {
        &self.index.done
    }

    /// Steps that can be redone, the next one last.
    pub fn undone(&self) -> &[HistoryStep] {
        &self.index.undone
    }

    /// Begins a step; what was undone cannot be redone any more.
    pub(crate) fn begin(&mut self, label: &str, editor: &mut AssetEditor) {
        for step in std::mem::take(&mut self.index.undone) {
            (0..step.parts).for_each(|part| editor.detach(&part_name(step.id, part)));
        }
        let step = HistoryStep { id: self.index.next_id, label: label.to_owned(), parts: 0 };
        self.index.next_id += 1;
        self.open = Some(OpenStep { step, bytes: Vec::new() });
    }

    pub(crate) fn add_page(&mut self, step: PageStep, editor: &mut AssetEditor) -> Result<(), PaintError> {
        let Some(open) = &mut self.open else { return Ok(()) };
        let PageStep { id, channels, is_first_layered } = step;
        if is_first_layered {
            Record::Base(id).encode(&mut open.bytes);
        }
        for (channel, before, after) in channels {
            let change = before.iter().zip(after).map(|(a, b)| a ^ b).collect();
            Record::Page { id, channel, change }.encode(&mut open.bytes);
        }
        if open.bytes.len() >= PART_BYTES { open.write_part(editor) } else { Ok(()) }
    }

    pub(crate) fn add_mean(&mut self, channel: usize, group: u32, before: [f32; 4], after: [f32; 4]) {
        if let Some(open) = &mut self.open {
            Record::Mean { channel, group, values: [before, after] }.encode(&mut open.bytes);
        }
    }

    /// Contents of an attachment; of length 0 where there is none.
    pub(crate) fn add_attachment(
        &mut self,
        name: &str,
        before: Vec<u8>,
        after: Vec<u8>,
        editor: &mut AssetEditor,
    ) -> Result<(), PaintError> {
        let Some(open) = &mut self.open else { return Ok(()) };
        Record::Attachment { name: name.to_owned(), contents: [before, after] }.encode(&mut open.bytes);
        if open.bytes.len() >= PART_BYTES { open.write_part(editor) } else { Ok(()) }
    }

    /// Ends the step; one without changes is dropped.
    pub(crate) fn finish(&mut self, editor: &mut AssetEditor) -> Result<(), PaintError> {
        let Some(mut open) = self.open.take() else { return Ok(()) };
        if !open.bytes.is_empty() {
            open.write_part(editor)?;
        }
        if open.step.parts > 0 {
            self.index.done.push(open.step);
        }
        self.save(editor)
    }

    /// Writes what is recorded of the open step so far; returns the step as it is then.
    pub(crate) fn keep_open(&mut self, editor: &mut AssetEditor) -> Result<Option<HistoryStep>, PaintError> {
        let Some(open) = &mut self.open else { return Ok(None) };
        if !open.bytes.is_empty() {
            open.write_part(editor)?;
        }
        let step = open.step.clone();
        self.save(editor)?;
        Ok(Some(step))
    }

    /// Goes on with a step that was open.
    pub(crate) fn take_up(&mut self, step: HistoryStep) {
        self.open = Some(OpenStep { step, bytes: Vec::new() });
    }

    /// The step that is next in a direction.
    pub(crate) fn next_step(&self, direction: Direction) -> Option<&HistoryStep> {
        match direction {
            Direction::Back => self.index.done.last(),
            Direction::Forth => self.index.undone.last(),
        }
    }

    /// The next step in a direction has been made.
    pub(crate) fn move_step(
        &mut self,
        direction: Direction,
        editor: &mut AssetEditor,
    ) -> Result<(), PaintError> {
        match direction {
            Direction::Back => self.index.undone.extend(self.index.done.pop()),
            Direction::Forth => self.index.done.extend(self.index.undone.pop()),
        }
        self.save(editor)
    }

    /// Forgets the last step, which has been taken back.
    pub(crate) fn forget_last(&mut self, editor: &mut AssetEditor) -> Result<(), PaintError> {
        if let Some(step) = self.index.done.pop() {
            (0..step.parts).for_each(|part| editor.detach(&part_name(step.id, part)));
        }
        self.save(editor)
    }

    /// Changes the asset by a part of a step.
    pub(crate) fn apply_part(
        &self,
        step: &HistoryStep,
        part: u32,
        direction: Direction,
        editor: &mut AssetEditor,
    ) -> Result<(), PaintError> {
        let bytes = editor.attachment(&part_name(step.id, part))?;
        let bytes = bytes.ok_or_else(|| damaged(editor, "a step is missing"))?;
        let mut rest = bytes.as_slice();
        // All is read before anything is changed: a part is applied once or not at all.
        let mut pages: BTreeMap<(PageId, usize), Vec<u8>> = BTreeMap::new();
        let mut bases = Vec::new();
        let mut others = Vec::new();
        while !rest.is_empty() {
            match Record::decode(&mut rest).ok_or_else(|| damaged(editor, "a step cannot be read"))? {
                Record::Page { id, channel, change } => {
                    let page = match pages.entry((id, channel)) {
                        Entry::Occupied(page) => page.into_mut(),
                        Entry::Vacant(place) => place.insert(editor.read_page_raw(channel, id)?),
                    };
                    page.iter_mut().zip(change).for_each(|(byte, change)| *byte ^= change);
                }
                Record::Base(id) => bases.push(match direction {
                    Direction::Back => (id, None),
                    Direction::Forth => (id, Some(base_bytes(editor, id, None)?.concat())),
                }),
                other => others.push(other),
            }
        }
        for (id, base) in bases {
            match base {
                None => editor.detach(&base_name(id)),
                Some(base) => editor.attach(&base_name(id), base)?,
            }
        }
        for ((id, channel), page) in pages {
            editor.replace(id, channel, page)?;
        }
        others.into_iter().try_for_each(|record| apply(record, direction, editor))
    }

    fn save(&self, editor: &mut AssetEditor) -> Result<(), PaintError> {
        let bytes = serde_json::to_vec(&self.index).map_err(std::io::Error::other)?;
        Ok(editor.attach(INDEX, bytes)?)
    }
}

impl OpenStep {
    fn write_part(&mut self, editor: &mut AssetEditor) -> Result<(), PaintError> {
        let name = part_name(self.step.id, self.step.parts);
        editor.attach(&name, std::mem::take(&mut self.bytes))?;
        self.step.parts += 1;
        Ok(())
    }
}

/// Changes the asset by a record that is no page.
fn apply(record: Record, direction: Direction, editor: &mut AssetEditor) -> Result<(), PaintError> {
    match record {
        // They are put together before.
        Record::Page { .. } | Record::Base(_) => {}
        Record::Attachment { name, contents: [before, after] } => {
            let contents = match direction {
                Direction::Back => before,
                Direction::Forth => after,
            };
            if !name.starts_with("layers/") && !name.starts_with(log::PREFIX) {
                return Err(damaged(editor, "a step changes what is neither layer nor log"));
            }
            if contents.is_empty() { editor.detach(&name) } else { editor.attach(&name, contents)? }
        }
        Record::Mean { channel, group, values: [before, after] } => {
            let asset = editor.asset();
            if channel >= asset.channels().len() || group as usize >= asset.cover().groups.len() {
                return Err(damaged(editor, "a step changes a group that does not exist"));
            }
            let value = match direction {
                Direction::Back => before,
                Direction::Forth => after,
            };
            editor.set_mean(channel, group, value);
        }
    }
    Ok(())
}

fn part_name(id: u64, part: u32) -> String {
    format!("history/{id:012}/{part:06}")
}

fn damaged(editor: &AssetEditor, reason: &'static str) -> PaintError {
    PaintError::History { path: editor.asset().path().to_owned(), reason }
}
