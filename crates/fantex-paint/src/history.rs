//! Undo and redo, kept in the asset.
//!
//! A step is what a stroke changed: of every page and channel the bytes before, exclusive-or the bytes after, and of every
//! mean and attachment (of the layers) both values. Blocks that did not change are zeros, which pack to nothing, and one record serves both directions, back to
//! the very bytes. Of a page that is put aside as the base of the layers it is only said that it was: taken back it is dropped, done
//! again it is the page as it is then. Steps are attachments `history/STEP/PART` of the asset (a part has some megabytes, so that a long stroke needs
//! no more memory than a short one); `history/index` names them. They are committed together with the texels, so a
//! restart finds both in agreement.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use fantex_base::Result;
use fantex_store::limits::MAX_ATTACHMENTS;
use fantex_store::{AssetEditor, PageId};
use serde::{Deserialize, Serialize};

use crate::base_levels::with_added_channels;
use crate::error::{damaged, encoded};
use crate::layers::{base_bytes, base_name, prefix};
use crate::{Target, log};

pub(crate) const PREFIX: &str = "history/";

pub(crate) const INDEX: &str = "history/index";

/// Bytes of a part, unpacked, before the next one begins.
const PART_BYTES: usize = 4 << 20;

/// Greatest number of the next step that is read.
const MAX_STEP_ID: u64 = 1 << 48;

/// A step that can be undone or redone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HistoryStep {
    /// Names its attachments; never used twice.
    pub id: u64,
    /// What the user calls it.
    pub label: String,
    /// Number of attachments.
    pub(crate) parts: u32,
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

impl Index {
    /// Whether its steps, and one more, can be: each part is a name that is looked for.
    fn can_be_there(&self, more: Option<&HistoryStep>) -> bool {
        let steps = || self.done.iter().chain(&self.undone).chain(more);
        let parts: u64 = steps().map(|step| u64::from(step.parts)).sum();
        let are_numbered = self.next_id <= MAX_STEP_ID && steps().all(|step| step.id < self.next_id);
        parts <= MAX_ATTACHMENTS as u64 && are_numbered
    }
}

/// The history of an asset.
#[derive(Debug, Default)]
pub struct History {
    index: Index,
    open: Option<OpenStep>,
    /// Steps that are listed already, and to which something is to be added.
    late: Vec<OpenStep>,
}

#[derive(Debug)]
struct OpenStep {
    step: HistoryStep,
    bytes: Vec<u8>,
    /// It is among the steps that were done.
    is_listed: bool,
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

    /// What was there before or comes after.
    fn chosen<T>(self, [before, after]: [T; 2]) -> T {
        match self {
            Self::Back => before,
            Self::Forth => after,
        }
    }
}

impl HistoryStep {
    /// Names of its attachments.
    pub(crate) fn part_names(&self) -> impl Iterator<Item = String> {
        (0..self.parts).map(|part| part_name(self.id, part))
    }

    fn detach(&self, editor: &mut AssetEditor) {
        self.part_names().for_each(|name| editor.detach(&name));
    }
}

impl History {
    pub(crate) fn load(editor: &AssetEditor) -> Result<Self> {
        let Some(bytes) = editor.attachment(INDEX)? else { return Ok(Self::default()) };
        let wrong = |why: &str| damaged(editor.asset(), "history", why);
        let index: Index = serde_json::from_slice(&bytes).map_err(|_| wrong("its index cannot be read"))?;
        if !index.can_be_there(None) {
            return Err(wrong("its index names steps that cannot be there"));
        }
        Ok(Self { index, ..Self::default() })
    }

    /// Whether a step that was kept beside those that are listed, if there is one, can be there.
    pub(crate) fn may_be_beside(&self, step: Option<&HistoryStep>) -> bool {
        self.index.can_be_there(step)
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
        self.forget_undone(editor);
        self.begin_beside(label);
    }

    /// What was undone cannot be redone any more.
    pub(crate) fn forget_undone(&mut self, editor: &mut AssetEditor) {
        for step in std::mem::take(&mut self.index.undone) {
            step.detach(editor);
        }
    }

    /// Gives the open step up.
    pub(crate) fn drop_open(&mut self, editor: &mut AssetEditor) {
        if let Some(open) = self.open.take() {
            open.step.detach(editor);
        }
    }

    /// Begins a step beside those that can be undone and redone.
    pub(crate) fn begin_beside(&mut self, label: &str) {
        let step = HistoryStep { id: self.index.next_id, label: label.to_owned(), parts: 0 };
        self.index.next_id += 1;
        self.take_up(Some(step));
    }

    pub(crate) fn add_page(&mut self, step: PageStep, editor: &mut AssetEditor) -> Result<()> {
        let Some(open) = &mut self.open else { return Ok(()) };
        let PageStep { id, channels, is_first_layered } = step;
        if is_first_layered {
            Record::Base(id).encode(&mut open.bytes);
        }
        for (channel, before, after) in channels {
            let change = before.iter().zip(after).map(|(a, b)| a ^ b).collect();
            Record::Page { id, channel, change }.encode(&mut open.bytes);
        }
        open.write_part_of(PART_BYTES, editor)
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
    ) -> Result<()> {
        let Some(open) = &mut self.open else { return Ok(()) };
        Record::Attachment { name: name.to_owned(), contents: [before, after] }.encode(&mut open.bytes);
        open.write_part_of(PART_BYTES, editor)
    }

    /// Ends the step; one without changes is dropped.
    pub(crate) fn finish(&mut self, editor: &mut AssetEditor) -> Result<()> {
        let Some(mut open) = self.open.take() else { return Ok(()) };
        open.write_part_of(1, editor)?;
        let place = self.index.done.iter().rposition(|step| step.id == open.step.id);
        match place.filter(|_| open.is_listed) {
            Some(place) if open.step.parts == 0 => drop(self.index.done.remove(place)),
            Some(place) => self.index.done[place] = open.step,
            None if open.step.parts > 0 => self.index.done.push(open.step),
            None => {}
        }
        self.save(editor)
    }

    /// Lists the open step as done and lets others begin before it ends; returns its number.
    pub(crate) fn leave_open(&mut self) -> Option<u64> {
        let mut open = self.open.take()?;
        if !std::mem::replace(&mut open.is_listed, true) {
            self.index.done.push(open.step.clone());
        }
        let number = open.step.id;
        self.late.push(open);
        Some(number)
    }

    /// Goes on with a step that was left open.
    pub(crate) fn resume(&mut self, number: Option<u64>) {
        let place = self.late.iter().position(|open| Some(open.step.id) == number);
        self.open = place.map(|place| self.late.remove(place));
    }

    /// Writes what is recorded of the open step so far; returns the step as it is then.
    pub(crate) fn keep_open(&mut self, editor: &mut AssetEditor) -> Result<Option<HistoryStep>> {
        let Some(open) = &mut self.open else { return Ok(None) };
        open.write_part_of(1, editor)?;
        let step = open.step.clone();
        self.save(editor)?;
        Ok(Some(step))
    }

    /// The number of the open step.
    pub(crate) fn open_number(&self) -> Option<u64> {
        self.open.as_ref().map(|open| open.step.id)
    }

    /// Goes on with a step, if there is one.
    pub(crate) fn take_up(&mut self, step: Option<HistoryStep>) {
        self.open = step.map(|step| OpenStep { step, bytes: Vec::new(), is_listed: false });
    }

    pub(crate) fn next_step(&self, direction: Direction) -> Option<&HistoryStep> {
        direction.chosen([&self.index.done, &self.index.undone]).last()
    }

    /// The next step in a direction has been made.
    pub(crate) fn move_step(&mut self, direction: Direction, editor: &mut AssetEditor) -> Result<()> {
        match direction {
            Direction::Back => self.index.undone.extend(self.index.done.pop()),
            Direction::Forth => self.index.done.extend(self.index.undone.pop()),
        }
        self.save(editor)
    }

    /// Forgets the last step, which has been taken back.
    pub(crate) fn forget_last(&mut self, editor: &mut AssetEditor) -> Result<()> {
        if let Some(step) = self.index.done.pop() {
            step.detach(editor);
        }
        self.save(editor)
    }

    /// Forgets all steps: nothing can be undone any more.
    pub(crate) fn forget_all(&mut self, editor: &mut AssetEditor) {
        let Index { next_id, done, undone } = std::mem::take(&mut self.index);
        for step in done.iter().chain(&undone) {
            step.detach(editor);
        }
        editor.detach(INDEX);
        self.index.next_id = next_id;
    }

    pub(crate) fn apply_part(
        &self,
        step: &HistoryStep,
        part: u32,
        direction: Direction,
        editor: &mut AssetEditor,
    ) -> Result<()> {
        let bytes = editor.attachment(&part_name(step.id, part))?;
        let bytes = bytes.ok_or_else(|| damaged(editor.asset(), "history", "a step is missing"))?;
        let mut rest = bytes.as_slice();
        // All is read before anything is changed: a part is applied once or not at all.
        let mut pages: BTreeMap<(PageId, usize), Vec<u8>> = BTreeMap::new();
        let mut bases = Vec::new();
        let mut others = Vec::new();
        while !rest.is_empty() {
            let record = Record::decode(&mut rest);
            match record.ok_or_else(|| damaged(editor.asset(), "history", "a step cannot be read"))? {
                Record::Page { id, channel, change } => {
                    let page = match pages.entry((id, channel)) {
                        Entry::Occupied(page) => page.into_mut(),
                        Entry::Vacant(place) => place.insert(editor.read_page_raw(channel, id)?),
                    };
                    if page.len() != change.len() {
                        return Err(damaged(editor.asset(), "history", "a step is of pages of another size"));
                    }
                    page.iter_mut().zip(change).for_each(|(byte, change)| *byte ^= change);
                }
                Record::Base(id) => bases.push(match direction {
                    Direction::Back => (id, None),
                    Direction::Forth => (id, Some(base_bytes(editor, id, None)?.concat())),
                }),
                Record::Attachment { name, contents } => {
                    let contents = attachment_after(&name, direction.chosen(contents), editor)?;
                    others.push(Change::Attachment { name, contents });
                }
                Record::Mean { channel, group, values } => {
                    let asset = editor.asset();
                    if channel >= asset.channels().len() || group as usize >= asset.cover().groups.len() {
                        return Err(damaged(asset, "history", "a step changes a group that does not exist"));
                    }
                    others.push(Change::Mean { channel, group, value: direction.chosen(values) });
                }
            }
        }
        // What a step has changed more than once was at first as its first record says.
        if direction == Direction::Back {
            others.reverse();
        }
        for (id, base) in &mut bases {
            if let Some(base) = base.take() {
                editor.attach(&base_name(*id), base)?;
            }
        }
        for ((id, channel), page) in pages {
            editor.replace(id, channel, page)?;
        }
        for change in others {
            match change {
                Change::Attachment { name, contents } if contents.is_empty() => editor.detach(&name),
                Change::Attachment { name, contents } => editor.attach(&name, contents)?,
                Change::Mean { channel, group, value } => editor.set_mean(channel, group, value),
            }
        }
        if direction == Direction::Back {
            bases.iter().for_each(|(id, _)| editor.detach(&base_name(*id)));
        }
        Ok(())
    }

    fn save(&self, editor: &mut AssetEditor) -> Result<()> {
        let bytes = encoded(&self.index)?;
        editor.attach(INDEX, bytes)
    }
}

impl OpenStep {
    /// Writes what is recorded as a part, where it has so many bytes.
    fn write_part_of(&mut self, bytes: usize, editor: &mut AssetEditor) -> Result<()> {
        if self.bytes.len() < bytes {
            return Ok(());
        }
        let name = part_name(self.step.id, self.step.parts);
        editor.attach(&name, std::mem::take(&mut self.bytes))?;
        self.step.parts += 1;
        Ok(())
    }
}

/// What a step makes of what is no page.
enum Change {
    /// Without contents there is none any more.
    Attachment {
        name: String,
        contents: Vec<u8>,
    },
    Mean {
        channel: usize,
        group: u32,
        value: [f32; 4],
    },
}

/// Contents of an attachment after a step.
fn attachment_after(name: &str, contents: Vec<u8>, editor: &AssetEditor) -> Result<Vec<u8>> {
    if !name.starts_with("layers/") && !name.starts_with(log::PREFIX) {
        return Err(damaged(editor.asset(), "history", "a step changes what is neither layer nor log"));
    }
    // A step from before channels were added knows nothing of them.
    with_added_channels(editor, name, contents)
}

fn part_name(id: u64, part: u32) -> String {
    format!("{PREFIX}{id:012}/{part:06}")
}

// Steps of an asset that loses channels.

/// The step that an attachment is a part of, and which part, by its name.
pub(crate) fn step_of_part(name: &str) -> Option<(u64, u32)> {
    let (step, part) = name.strip_prefix(PREFIX)?.split_once('/')?;
    Some((step.parse().ok()?, part.parse().ok()?))
}

/// The index without some steps.
pub(crate) fn index_without(contents: Vec<u8>, steps: &BTreeSet<u64>) -> Result<Vec<u8>> {
    // One that is damaged is reported by whoever reads it.
    let Ok(mut index) = serde_json::from_slice::<Index>(&contents) else { return Ok(contents) };
    index.done.retain(|step| !steps.contains(&step.id));
    index.undone.retain(|step| !steps.contains(&step.id));
    encoded(&index)
}

/// A part of a step with other numbers of channels and other contents of attachments; what is in channels without a number, and what
/// changes nothing any more, is left out. None where the part cannot be read.
pub(crate) fn part_with(
    contents: &[u8],
    number: impl Fn(usize) -> Option<usize>,
    change: impl Fn(&str, Vec<u8>) -> Result<Vec<u8>>,
) -> Result<Option<Vec<u8>>> {
    let (mut rest, mut out) = (contents, Vec::with_capacity(contents.len()));
    while !rest.is_empty() {
        let Some(record) = Record::decode(&mut rest) else { return Ok(None) };
        let record = match record {
            Record::Page { id, channel, change } => {
                number(channel).map(|channel| Record::Page { id, channel, change })
            }
            Record::Mean { channel, group, values } => {
                number(channel).map(|channel| Record::Mean { channel, group, values })
            }
            Record::Attachment { name, contents: [before, after] } => {
                let contents = [change(&name, before)?, change(&name, after)?];
                (contents[0] != contents[1]).then_some(Record::Attachment { name, contents })
            }
            Record::Base(id) => Some(Record::Base(id)),
        };
        if let Some(record) = record {
            record.encode(&mut out);
        }
    }
    Ok(Some(out))
}

/// The attachments that a part puts aside as the base of the layers, where it does nothing else: nothing that is seen depends on it.
pub(crate) fn put_aside(part: &[u8]) -> Option<Vec<String>> {
    let (mut rest, mut names) = (part, Vec::new());
    while !rest.is_empty() {
        names.push(match Record::decode(&mut rest)? {
            Record::Base(id) => base_name(id),
            Record::Attachment { name, contents: [before, _] }
                if before.is_empty() && name.starts_with(&prefix(Target::Base)) =>
            {
                name
            }
            Record::Attachment { .. } | Record::Page { .. } | Record::Mean { .. } => return None,
        });
    }
    Some(names)
}

// The records of a step, little-endian:
//
// | record | fields |
// |---|---|
// | page | u32 0; u32 group, level, column, row, channel, length; bytes before xor bytes after |
// | attachment | u32 2; u32 lengths of name, contents before, contents after; these (of length 0: none) |
// | mean | u32 1; u32 group, channel; f32[4] before; f32[4] after |
// | base | u32 3; u32 group, level, column, row: of a page that is put aside as the base of the layers |

/// One change.
#[derive(Clone, Debug, PartialEq)]
enum Record {
    Page { id: PageId, channel: usize, change: Vec<u8> },
    Mean { channel: usize, group: u32, values: [[f32; 4]; 2] },
    Attachment { name: String, contents: [Vec<u8>; 2] },
    Base(PageId),
}

const PAGE: u32 = 0;
const MEAN: u32 = 1;
const ATTACHMENT: u32 = 2;
const BASE: u32 = 3;

impl Record {
    pub(crate) fn encode(&self, out: &mut Vec<u8>) {
        match self {
            Self::Page { id, channel, change } => {
                let [column, row] = id.page;
                let words = [PAGE, id.group, id.level, column, row, *channel as u32, change.len() as u32];
                out.extend(words.into_iter().flat_map(u32::to_le_bytes));
                out.extend(change);
            }
            Self::Mean { channel, group, values } => {
                out.extend([MEAN, *group, *channel as u32].into_iter().flat_map(u32::to_le_bytes));
                out.extend(values.iter().flatten().flat_map(|x| x.to_le_bytes()));
            }
            Self::Attachment { name, contents: [before, after] } => {
                let lengths = [name.len(), before.len(), after.len()].map(|n| n as u32);
                out.extend([ATTACHMENT].into_iter().chain(lengths).flat_map(u32::to_le_bytes));
                [name.as_bytes(), before, after].into_iter().for_each(|part| out.extend(part));
            }
            Self::Base(PageId { group, level, page: [column, row] }) => {
                out.extend([BASE, *group, *level, *column, *row].into_iter().flat_map(u32::to_le_bytes));
            }
        }
    }

    /// The next record; none where the bytes are none.
    pub(crate) fn decode(rest: &mut &[u8]) -> Option<Self> {
        match word(rest)? {
            PAGE => {
                let [group, level, column, row, channel, length] = words(rest)?;
                let change = rest.split_off(..length as usize)?.to_vec();
                let id = PageId { group, level, page: [column, row] };
                Some(Self::Page { id, channel: channel as usize, change })
            }
            MEAN => {
                let [group, channel] = words(rest)?;
                let values = [words::<4>(rest)?, words::<4>(rest)?].map(|v| v.map(f32::from_bits));
                Some(Self::Mean { channel: channel as usize, group, values })
            }
            ATTACHMENT => {
                let [name, before, after] = words(rest)?;
                let name = std::str::from_utf8(rest.split_off(..name as usize)?).ok()?.to_owned();
                let before = rest.split_off(..before as usize)?.to_vec();
                let after = rest.split_off(..after as usize)?.to_vec();
                Some(Self::Attachment { name, contents: [before, after] })
            }
            BASE => {
                let [group, level, column, row] = words(rest)?;
                Some(Self::Base(PageId { group, level, page: [column, row] }))
            }
            _ => None,
        }
    }
}

fn word(rest: &mut &[u8]) -> Option<u32> {
    let bytes = rest.split_off(..4)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

fn words<const N: usize>(rest: &mut &[u8]) -> Option<[u32; N]> {
    let mut words = [0; N];
    for slot in &mut words {
        *slot = word(rest)?;
    }
    Some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_and_short_ones_are_refused() {
        let id = PageId { group: 7, level: 2, page: [1, 3] };
        let records = [
            Record::Page { id, channel: 1, change: vec![1, 2, 3] },
            Record::Mean { channel: 0, group: 9, values: [[0.5; 4], [1.5; 4]] },
            Record::Attachment { name: "a/b".into(), contents: [vec![], vec![4, 5]] },
            Record::Base(PageId { level: 0, ..id }),
        ];
        let mut bytes = Vec::new();
        records.iter().for_each(|record| record.encode(&mut bytes));
        let mut rest = bytes.as_slice();
        assert_eq!(records.each_ref().map(|_| Record::decode(&mut rest).unwrap()), records);
        assert!(rest.is_empty());
        for end in 1..30 {
            assert_eq!(Record::decode(&mut &bytes[..end]), None);
        }
    }
}
