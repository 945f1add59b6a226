//! Undo and redo, kept in the asset.
//!
//! A step is what a stroke changed: of every page and channel the bytes before, exclusive-or the bytes after, and of every
//! mean and attachment (of the layers) both values. Blocks that did not change are zeros, which pack to nothing, and one record serves both directions, back to
//! the very bytes. Steps are attachments `history/STEP/PART` of the asset (a part has some megabytes, so that a long stroke needs
//! no more memory than a short one); `history/index` names them. They are committed together with the texels, so a
//! restart finds both in agreement.

mod record;

use fantex_store::{AssetEditor, EditError, PageId};
use record::Record;
use serde::{Deserialize, Serialize};

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

#[derive(Clone, Copy)]
enum Direction {
    Back,
    Forth,
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

    pub(crate) fn add_page(
        &mut self,
        id: PageId,
        channel: usize,
        before: &[u8],
        after: &[u8],
        editor: &mut AssetEditor,
    ) -> Result<(), PaintError> {
        let Some(open) = &mut self.open else { return Ok(()) };
        Record::Page { id, channel, change: before.iter().zip(after).map(|(a, b)| a ^ b).collect() }
            .encode(&mut open.bytes);
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

    pub(crate) fn undo(&mut self, editor: &mut AssetEditor, budget_bytes: usize) -> Result<bool, PaintError> {
        let Some(step) = self.index.done.last().cloned() else { return Ok(false) };
        apply(&step, Direction::Back, editor, budget_bytes)?;
        self.index.undone.extend(self.index.done.pop());
        self.save(editor)?;
        Ok(true)
    }

    pub(crate) fn redo(&mut self, editor: &mut AssetEditor, budget_bytes: usize) -> Result<bool, PaintError> {
        let Some(step) = self.index.undone.last().cloned() else { return Ok(false) };
        apply(&step, Direction::Forth, editor, budget_bytes)?;
        self.index.done.extend(self.index.undone.pop());
        self.save(editor)?;
        Ok(true)
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

/// Changes the texels by a step's records. Changes that exceed a budget in memory are written to the file.
fn apply(
    step: &HistoryStep,
    direction: Direction,
    editor: &mut AssetEditor,
    budget_bytes: usize,
) -> Result<(), PaintError> {
    for part in 0..step.parts {
        let bytes = editor.attachment(&part_name(step.id, part))?;
        let bytes = bytes.ok_or_else(|| damaged(editor, "a step is missing"))?;
        let mut rest = bytes.as_slice();
        while !rest.is_empty() {
            let record = Record::decode(&mut rest).ok_or_else(|| damaged(editor, "a step cannot be read"))?;
            match record {
                Record::Page { id, channel, change } => {
                    let mut page = editor.read_page_raw(channel, id)?;
                    page.iter_mut().zip(change).for_each(|(byte, change)| *byte ^= change);
                    editor.replace(id, channel, page)?;
                }
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
        }
        if editor.pending_bytes() > budget_bytes {
            flush_if_possible(editor)?;
        }
    }
    Ok(())
}

/// Takes changes out of memory. Where the disk is full they stay there, and painting goes on: true then.
pub(crate) fn flush_if_possible(editor: &mut AssetEditor) -> Result<bool, PaintError> {
    match editor.flush() {
        Ok(()) => Ok(false),
        Err(EditError::Full { .. }) => Ok(true),
        Err(error) => Err(error.into()),
    }
}

fn part_name(id: u64, part: u32) -> String {
    format!("history/{id:012}/{part:06}")
}

fn damaged(editor: &AssetEditor, reason: &'static str) -> PaintError {
    PaintError::History { path: editor.asset().path().to_owned(), reason }
}
