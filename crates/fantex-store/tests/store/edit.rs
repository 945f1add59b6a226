//! Edits: crashes, failures and readers.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use fantex_base::files::temporary_file;
use fantex_store::{
    Asset, AssetEditor, AssetWriter, Channel, ChannelKind, CreateOptions, EditOptions, EditOutput, PageId,
    PartWriter, Recipe, Replacement, TexelFormat, VerifyOptions, decode, is_disk_full, verify, write_all_at,
};
use fantex_test::fan_file::{seal, set_word};

use crate::common::{Dice, encoded_page, fan_cover, means, pages, plain_channels, sheet, write};

/// All that an asset holds and that commits change.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct State {
    pages: BTreeMap<(PageId, usize), Vec<u8>>,
    means: Vec<[f32; 4]>,
    pub(crate) attachments: BTreeMap<String, Vec<u8>>,
}

impl State {
    /// Reads everything, which checks all checksums.
    pub(crate) fn read(asset: &Asset) -> State {
        let mut state = State::default();
        let channels = asset.channels().len();
        for id in pages(asset.cover()) {
            for channel in 0..channels {
                state.pages.insert((id, channel), asset.read_page_raw(channel, id).unwrap());
            }
        }
        for group in 0..asset.cover().groups.len() as u32 {
            state.means.extend((0..channels).map(|channel| asset.mean(channel, group)));
        }
        for name in asset.attachment_names().unwrap() {
            let contents = asset.attachment(name).unwrap().unwrap();
            state.attachments.insert(name.to_owned(), contents);
        }
        state
    }

    pub(crate) fn open(path: &Path) -> (u64, State) {
        let asset = Asset::open(path).unwrap();
        (asset.generation(), State::read(&asset))
    }
}

/// Tiles of one page and of several.
pub(crate) fn small_asset(folder: &Path) -> PathBuf {
    let path = folder.join("small.fan");
    let mesh = sheet(2);
    let cover = fan_cover(&mesh, |v| [[16, 12], [4, 4], [260, 8], [32, 32]][v % 4]);
    let channels = plain_channels();
    write(&path, &mesh, &cover, &channels, 100).unwrap();
    assert_eq!(State::open(&path).1.means, means(&cover, &channels));
    path
}

/// Makes some changes, in the editor and in the state that is expected of it.
pub(crate) fn change(editor: &mut AssetEditor, state: &mut State, dice: &mut Dice) {
    let cover = editor.asset().cover().clone();
    let channels = plain_channels();
    let all: Vec<PageId> = pages(&cover).collect();
    for _ in 0..1 + dice.below(6) {
        let id = all[dice.below(all.len())];
        let channel = dice.below(channels.len());
        let mut bytes = encoded_page(&cover, &channels, id).channels[channel].clone();
        let shift = dice.below(256) as u8;
        if channels[channel].format.block_bytes() < 256 {
            bytes.iter_mut().for_each(|b| *b = b.wrapping_add(shift));
        } else {
            bytes
                .chunks_exact_mut(4)
                .for_each(|x| x.copy_from_slice(&(f32::from(shift) / 3.0).to_le_bytes()));
        }
        editor.replace(id, channel, bytes.clone()).unwrap();
        state.pages.insert((id, channel), bytes);
        let mean = [dice.below(64) as f32, 0.5, 0.25, 1.0];
        editor.set_mean(channel, id.group, mean);
        state.means[id.group as usize * channels.len() + channel] = mean;
    }
    let name = format!("layer/{}", dice.below(4));
    if dice.below(3) == 0 {
        editor.detach(&name);
        state.attachments.remove(&name);
    } else {
        let contents = vec![dice.below(256) as u8; dice.below(9000)];
        editor.attach(&name, contents.clone()).unwrap();
        state.attachments.insert(name, contents);
    }
}

/// What the editor shows of its uncommitted state.
pub(crate) fn seen_by(editor: &AssetEditor) -> fantex_base::Result<State> {
    let mut state = State::default();
    let asset = editor.asset();
    for id in pages(asset.cover()) {
        for channel in 0..asset.channels().len() {
            state.pages.insert((id, channel), editor.read_page_raw(channel, id)?);
        }
    }
    for group in 0..asset.cover().groups.len() as u32 {
        state.means.extend((0..asset.channels().len()).map(|channel| editor.mean(channel, group)));
    }
    for name in editor.attachment_names() {
        let contents = editor.attachment(&name)?.unwrap();
        state.attachments.insert(name, contents);
    }
    Ok(state)
}

/// Checksums of everything.
pub(crate) fn assert_whole(path: &Path) {
    let report = verify(path, &VerifyOptions::default()).unwrap();
    assert_eq!((report.damaged_tiles, report.damaged_headers, report.damaged_attachments), (0, 0, 0));
}

/// One call.
#[derive(Clone, Debug)]
enum Operation {
    Write(u64, Vec<u8>),
    SetLen(u64),
    Sync,
}

/// What a recorder has seen and what it shall do.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    log: Vec<Operation>,
    /// From this call on everything that needs room fails, half done.
    fail_from: Option<usize>,
    fail_kind: Option<ErrorKind>,
    /// Only this one call fails.
    once: bool,
    /// The file and what it held at the last sync: a sync that fails forgets the writes since.
    durable: Option<(PathBuf, Vec<u8>)>,
}

impl Plan {
    fn fails(&mut self, operation: Operation) -> Option<io::Error> {
        let index = self.log.len();
        self.log.push(operation);
        let from = self.fail_from?;
        let fails = if self.once { index == from } else { index >= from };
        fails.then(|| self.fail_kind.unwrap_or(ErrorKind::StorageFull).into())
    }
}

/// Writes to the file as planned.
#[derive(Debug)]
struct Recorder {
    file: Arc<File>,
    plan: Arc<Mutex<Plan>>,
}

impl EditOutput for Recorder {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        match self.plan.lock().unwrap().fails(Operation::Write(offset, bytes.to_vec())) {
            Some(error) => {
                write_all_at(&self.file, &bytes[..bytes.len() / 2], offset)?;
                Err(error)
            }
            None => write_all_at(&self.file, bytes, offset),
        }
    }

    fn set_len(&mut self, length: u64) -> io::Result<()> {
        self.plan.lock().unwrap().fails(Operation::SetLen(length)).map_or(Ok(()), Err)?;
        self.file.set_len(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        // The tests' crashes are made of the log; nothing needs to reach the disk.
        let mut plan = self.plan.lock().unwrap();
        let failure = plan.fails(Operation::Sync);
        match (&failure, &mut plan.durable) {
            (Some(_), Some((_, bytes))) => {
                self.file.set_len(bytes.len() as u64)?;
                write_all_at(&self.file, bytes, 0)?;
            }
            (None, Some((path, bytes))) => *bytes = std::fs::read(path)?,
            (_, None) => {}
        }
        failure.map_or(Ok(()), Err)
    }
}

/// An editor that writes through a recorder.
pub(crate) fn recorded_editor(path: &Path) -> (AssetEditor, Arc<Mutex<Plan>>) {
    let plan = Arc::new(Mutex::new(Plan::default()));
    // Short runs, so that clusters of a small asset are cut.
    let options = EditOptions { run_bytes: 4096, ..EditOptions::default() };
    let editor = AssetEditor::open_with_output(path, &options, |file| {
        Box::new(Recorder { file, plan: Arc::clone(&plan) })
    });
    (editor.unwrap(), plan)
}

/// The bytes on the disk.
#[derive(Clone)]
struct Disk(Vec<u8>);

impl Disk {
    fn write(&mut self, offset: u64, bytes: &[u8]) {
        let end = offset as usize + bytes.len();
        if self.0.len() < end {
            self.0.resize(end, 0);
        }
        self.0[offset as usize..end].copy_from_slice(bytes);
    }

    /// Does a call as a crash leaves it: `fate` 0 as asked, 1 not at all, 2 torn.
    fn apply(&mut self, operation: &Operation, fate: usize, dice: &mut Dice) {
        match (operation, fate) {
            (_, 1) | (Operation::Sync, _) => {}
            (Operation::Write(offset, bytes), 0) => self.write(*offset, bytes),
            (Operation::Write(offset, bytes), _) => {
                // Sectors of 64 bytes (smaller than any real one), each by itself.
                for (k, sector) in bytes.chunks(64).enumerate() {
                    if dice.below(2) == 0 {
                        self.write(offset + 64 * k as u64, sector);
                    }
                }
            }
            (Operation::SetLen(length), _) => self.0.resize(*length as usize, 0),
        }
    }
}

/// Opens a crashed disk's asset and compares it with what was committed.
fn check(disk: &Disk, path: &Path, states: &BTreeMap<u64, State>, acknowledged: u64) -> u64 {
    std::fs::write(path, &disk.0).unwrap();
    let (generation, state) = State::open(path);
    assert!(generation >= acknowledged, "generation {generation} after {acknowledged} was acknowledged");
    assert!(Some(&state) == states.get(&generation), "generation {generation} is not what was committed");
    generation
}

#[test]
fn after_a_crash_at_any_write_a_committed_state_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mut durable = Disk(std::fs::read(&path).unwrap());
    let (first, mut state) = State::open(&path);
    let mut states = BTreeMap::from([(first, state.clone())]);
    let (mut editor, plan) = recorded_editor(&path);
    let mut dice = Dice::new(7);
    // Calls that belong to commits, and the generation that was acknowledged before each of them.
    let mut acknowledged = Vec::new();
    for round in 0..14 {
        let before = editor.asset().generation();
        change(&mut editor, &mut state, &mut dice);
        if round % 3 == 2 {
            editor.flush().unwrap();
            change(&mut editor, &mut state, &mut dice);
        }
        assert!(seen_by(&editor).unwrap() == state);
        let generation = editor.commit().unwrap().generation;
        states.insert(generation, state.clone());
        acknowledged.resize(plan.lock().unwrap().log.len(), before);
    }
    assert_eq!(State::open(&path), (15, state));
    assert_whole(&path);

    let log = plan.lock().unwrap().log.clone();
    let crashed = folder.path().join("crashed.fan");
    let mut unsynced: Vec<&Operation> = Vec::new();
    let mut newer = 0;
    for (operation, &known) in log.iter().zip(&acknowledged) {
        unsynced.push(operation);
        for variant in 0..6 {
            let mut disk = durable.clone();
            for (k, operation) in unsynced.iter().enumerate() {
                let last = k + 1 == unsynced.len();
                let fate = match variant {
                    0 => 0,
                    1 => usize::from(!last),
                    2 => {
                        if last {
                            2
                        } else {
                            0
                        }
                    }
                    _ => dice.below(3),
                };
                disk.apply(operation, fate, &mut dice);
            }
            newer += u32::from(check(&disk, &crashed, &states, known) > known);
        }
        if matches!(operation, Operation::Sync) {
            unsynced.drain(..).for_each(|operation| durable.apply(operation, 0, &mut dice));
        }
    }
    assert!(log.len() > 100 && newer > 20, "{} calls, {newer} crashes after the switch", log.len());
}

/// Runs two good commits, one that fails at the given call, and its repetition. Returns false where nothing failed.
fn session(fail_at: usize, once: bool, kind: ErrorKind) -> bool {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, plan) = recorded_editor(&path);
    let mut state = State::read(editor.asset());
    let mut dice = Dice::new(99);
    for _ in 0..2 {
        change(&mut editor, &mut state, &mut dice);
        editor.commit().unwrap();
    }
    let committed = state.clone();
    change(&mut editor, &mut state, &mut dice);
    {
        let mut plan = plan.lock().unwrap();
        plan.fail_from = Some(plan.log.len() + fail_at);
        (plan.once, plan.fail_kind) = (once, Some(kind));
        plan.durable = once.then(|| (path.clone(), std::fs::read(&path).unwrap()));
    }
    let Err(error) = editor.commit() else {
        return false;
    };
    assert_eq!(error.kind(), fantex_base::ErrorKind::Io, "{error}");
    assert_eq!(is_disk_full(&error), kind == ErrorKind::StorageFull, "{error}");
    let on_disk = State::open(&path).1;
    assert!(on_disk == committed || on_disk == state, "call {fail_at}");
    assert!(seen_by(&editor).unwrap() == state, "changes are kept");
    // Painting goes on, and there is room again.
    change(&mut editor, &mut state, &mut dice);
    plan.lock().unwrap().fail_from = None;
    editor.commit().unwrap();
    assert!(State::open(&path).1 == state, "call {fail_at}");
    for _ in 0..4 {
        change(&mut editor, &mut state, &mut dice);
        editor.commit().unwrap();
        assert!(State::open(&path).1 == state, "call {fail_at}");
    }
    assert_whole(&path);
    true
}

#[test]
fn whichever_write_fails_nothing_is_lost() {
    for kind in [ErrorKind::StorageFull, ErrorKind::PermissionDenied] {
        for once in [true, false] {
            let failed = (0..).take_while(|&call| session(call, once, kind)).count();
            assert!(failed > 5, "{failed} calls");
        }
    }
}

/// What was flushed and never committed takes no room once the editor has gone.
#[test]
fn room_of_uncommitted_changes_is_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let length = || std::fs::metadata(&path).unwrap().len();
    let before = length();
    for discards in [false, true] {
        let (mut editor, _) = recorded_editor(&path);
        editor.attach("large", (0..1 << 20).map(|i: u32| (i.wrapping_mul(i) >> 7) as u8).collect()).unwrap();
        editor.flush().unwrap();
        assert!(length() > before);
        if discards {
            editor.discard().unwrap();
            assert_eq!(length(), before);
        }
        drop(editor);
        assert_eq!(length(), before);
    }
}

#[test]
fn discarding_returns_to_the_committed_state() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, _) = recorded_editor(&path);
    let committed = State::read(editor.asset());
    let mut dice = Dice::new(3);
    for round in 0..3 {
        change(&mut editor, &mut committed.clone(), &mut dice);
        if round > 0 {
            editor.flush().unwrap();
            assert_eq!(editor.pending_bytes(), 0);
            change(&mut editor, &mut committed.clone(), &mut dice);
        }
        editor.discard().unwrap();
        assert!(!editor.has_changes());
        assert!(seen_by(&editor).unwrap() == committed);
    }
    assert_eq!(editor.commit().unwrap().generation, 1);
}

/// The count of bytes is kept beside the attachments, through whatever happens to them.
#[test]
fn bytes_of_attachments_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, plan) = recorded_editor(&path);
    editor.attach("a", vec![1; 100]).unwrap();
    editor.attach("b", vec![2; 30]).unwrap();
    editor.attach("c", Vec::new()).unwrap();
    assert_eq!(editor.pending_bytes(), 130);
    editor.attach("a", vec![3; 40]).unwrap();
    editor.detach("b");
    editor.detach("none");
    assert_eq!(editor.pending_bytes(), 40);
    editor.attach("b", vec![4; 7]).unwrap();
    let from = plan.lock().unwrap().log.len();
    plan.lock().unwrap().fail_from = Some(from);
    editor.flush().unwrap_err();
    assert_eq!(editor.pending_bytes(), 47);
    plan.lock().unwrap().fail_from = None;
    editor.flush().unwrap();
    assert_eq!(editor.pending_bytes(), 0);
    editor.detach("a");
    assert_eq!(editor.pending_bytes(), 0);
    let names = |editor: &AssetEditor| ["", "a", "ab", "b"].map(|start| editor.attachment_names_with(start));
    assert_eq!(names(&editor), [vec!["b", "c"], vec![], vec![], vec!["b"]]);
    editor.attach("a", vec![5; 9]).unwrap();
    assert_eq!(names(&editor), [vec!["a", "b", "c"], vec!["a"], vec![], vec!["b"]]);
    assert_eq!(editor.pending_bytes(), 9);
    editor.discard().unwrap();
    assert_eq!(editor.pending_bytes(), 0);
}

fn refused<T: std::fmt::Debug>(result: fantex_base::Result<T>, sentence: &str) {
    let error = result.unwrap_err().to_string();
    assert!(error.contains(sentence), "{error}");
}

#[test]
fn mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, _) = recorded_editor(&path);
    let page = PageId { group: 0, level: 0, page: [0, 0] };
    refused(editor.replace(page, 0, vec![0; 3]), "but 3 were given");
    let missing = PageId { group: 99, ..page };
    refused(editor.replace(missing, 0, vec![]), "has no page");
    refused(editor.attach(&"x".repeat(256), vec![]), "names may have up to 255");
    let second = AssetEditor::open(&path, &EditOptions::default());
    refused(second, "is being edited by another program");
    // Replaced under the editor's feet.
    std::fs::copy(&path, folder.path().join("other.fan")).unwrap();
    std::fs::rename(folder.path().join("other.fan"), &path).unwrap();
    editor.attach("a", vec![1]).unwrap();
    refused(editor.commit(), "was replaced or removed");
    // The open file takes it.
    assert!(!editor.is_in_place());
    editor.set_detached(true);
    assert_eq!(editor.commit().unwrap().generation, 2);
    assert_eq!(editor.asset().attachment("a").unwrap(), Some(vec![1]));
    assert!(Asset::open(&path).unwrap().attachment_names().unwrap().is_empty());
    editor.set_detached(false);
    // Nor are those saved that are in the old file already, or a copy of it.
    editor.discard().unwrap();
    editor.set_mean(0, 0, [0.5; 4]);
    refused(editor.commit(), "was replaced or removed");
    editor.discard().unwrap();
    let there = std::fs::read(&path).unwrap();
    refused(editor.compact(), "was replaced or removed");
    assert!(std::fs::read(&path).unwrap() == there);
    drop(editor);
    assert!(AssetEditor::open(&path, &EditOptions::default()).is_ok());
    assert_eq!(Asset::open(&path).unwrap().generation(), 1);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "the lock's file is gone");
}

/// One writer at a time, whatever name it uses.
#[cfg(unix)]
#[test]
fn an_asset_has_one_writer_by_all_its_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let names =
        ["soft.fan", "below/soft.fan", "hard.fan", "below/hard.fan"].map(|name| folder.path().join(name));
    std::fs::create_dir(folder.path().join("below")).unwrap();
    for (index, name) in names.iter().enumerate() {
        match index {
            0 | 1 => std::os::unix::fs::symlink(&path, name).unwrap(),
            _ => std::fs::hard_link(&path, name).unwrap(),
        }
    }
    let open = |path: &std::path::Path| AssetEditor::open(path, &EditOptions::default());
    for first in std::iter::once(&path).chain(&names) {
        let editor = open(first).unwrap();
        for second in std::iter::once(&path).chain(&names) {
            refused(open(second), "is being edited by another program");
        }
        drop(editor);
    }
    // When another file takes its place, that is locked by all its names, and the one that is gone by none.
    let mut editor = open(&path).unwrap();
    editor.compact().unwrap();
    let new = folder.path().join("new.fan");
    std::fs::hard_link(&path, &new).unwrap();
    refused(open(&new), "is being edited by another program");
    drop(open(&names[2]).unwrap());
}

/// Neither does what is painted go with the asset that is replaced, nor is an asset painted on that is about to be.
#[test]
fn an_asset_that_is_edited_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mesh = sheet(2);
    let (cover, channels) = (fan_cover(&mesh, |_| [16, 12]), plain_channels());
    let there = std::fs::read(&path).unwrap();
    let open = |path: &Path| AssetEditor::open(path, &EditOptions::default());
    let editor = open(&path).unwrap();
    refused(write(&path, &mesh, &cover, &channels, 100), "is being edited by another program");
    drop(editor);
    assert!(std::fs::read(&path).unwrap() == there);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left");

    let options = CreateOptions { force: true, ..CreateOptions::default() };
    let writer = AssetWriter::create(&path, &options, &mesh, &cover, &channels).unwrap();
    refused(open(&path), "is being edited by another program");
    drop(writer);
    drop(open(&path).unwrap());
    write(&path, &mesh, &cover, &channels, 100).unwrap();
    drop(open(&path).unwrap());

    // One that was not there in the beginning.
    let other = folder.path().join("other.fan");
    let replacement = Replacement::begin(&other, true).unwrap();
    std::fs::copy(&path, &other).unwrap();
    let editor = open(&other).unwrap();
    let file = temporary_file(&other, "").unwrap().into_temp_path();
    refused(replacement.finish(file), "is being edited by another program");
    drop(editor);
    assert!(std::fs::read(&other).unwrap() == std::fs::read(&path).unwrap());
}

#[test]
fn plans_and_parts_do_not_replace_what_is_edited_either() {
    let folder = tempfile::tempdir().unwrap();
    let (path, at) = (small_asset(folder.path()), folder.path().join("at.plan"));
    let mesh = sheet(2);
    let (cover, channels) = (fan_cover(&mesh, |_| [16, 12]), plain_channels());
    let recipe = Recipe::default();
    let plan = |path: &Path| fantex_store::Plan::write(path, true, &mesh, &cover, &channels, &recipe, b"");
    plan(&at).unwrap();
    let planned = fantex_store::Plan::open(&at).unwrap();
    let options = CreateOptions { force: true, ..CreateOptions::default() };
    let part = || PartWriter::create(&path, &options, &planned, 1, 1);
    let there = std::fs::read(&path).unwrap();
    let open = || AssetEditor::open(&path, &EditOptions::default());
    let editor = open().unwrap();
    refused(plan(&path), "is being edited by another program");
    refused(part(), "is being edited by another program");
    drop(editor);
    let writer = part().unwrap();
    refused(open(), "is being edited by another program");
    drop(writer);
    assert!(std::fs::read(&path).unwrap() == there);
    plan(&path).unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left");
}

/// Where no generation can follow, commits would be lost.
#[test]
fn an_asset_of_the_last_generation_is_read_and_not_changed() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mut bytes = std::fs::read(&path).unwrap();
    [0, 4096].into_iter().for_each(|slot| set_word(&mut bytes, slot + 16, u64::MAX));
    seal(&mut bytes);
    std::fs::write(&path, bytes).unwrap();
    assert_eq!(Asset::open(&path).unwrap().generation(), u64::MAX);
    let error = AssetEditor::open(&path, &EditOptions::default()).unwrap_err();
    assert!(error.to_string().contains("small.fan has the last number of a generation"), "{error}");
}

/// What it names beyond the file's end is no room to write to: the next commit would cut it off. Nor is what the newer one names, too.
#[test]
fn an_older_slot_that_claims_what_it_cannot_have_is_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (whole, asset) = (std::fs::read(&path).unwrap(), Asset::open(&path).unwrap());
    let cluster = asset.cluster_range(asset.clusters().next().unwrap());
    drop(asset);
    let [longer, place, stored] = [24, 96, 104];
    // Words of the slot: the length of the file, where the mesh lies, and its bytes.
    let cases: [&[(usize, u64)]; 4] = [
        &[(longer, 1 << 41), (place, 1 << 40)],
        &[(place, 1 << 40), (stored, 1 << 20)],
        &[(place, u64::MAX - 99), (stored, 99)],
        &[(place, cluster.start + 1), (stored, cluster.end - cluster.start)],
    ];
    for claims in cases {
        let mut bytes = whole.clone();
        for &(at, value) in claims.iter().chain(&[(16, 0)]) {
            set_word(&mut bytes, 4096 + at, value);
        }
        seal(&mut bytes);
        std::fs::write(&path, bytes).unwrap();
        let mut expected = State::open(&path).1;
        let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
        for number in 0..3_u32 {
            let name = format!("note {number}");
            let note: Vec<u8> = (number..30_000).map(|i| (i.wrapping_mul(i) >> 7) as u8).collect();
            editor.attach(&name, note.clone()).unwrap();
            editor.commit().unwrap();
            expected.attachments.insert(name, note);
        }
        drop(editor);
        assert!(State::open(&path) == (4, expected), "{claims:?}");
    }
}

#[test]
fn a_reader_keeps_its_generation() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, _) = recorded_editor(&path);
    let mut state = State::read(editor.asset());
    let mut dice = Dice::new(5);
    let mut readers: Vec<(Arc<Asset>, State)> = Vec::new();
    for round in 0..12 {
        // One from the editor, one of its own.
        match round {
            3 => readers.push((Arc::clone(editor.asset()), state.clone())),
            6 => readers.push((Arc::new(Asset::open(&path).unwrap()), state.clone())),
            _ => {}
        }
        change(&mut editor, &mut state, &mut dice);
        editor.commit().unwrap();
        for (asset, seen) in &readers {
            assert!(State::read(asset) == *seen, "round {round}");
        }
    }
    drop(editor);
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    assert!(State::read(editor.asset()) == state);
    for _ in 0..4 {
        change(&mut editor, &mut state, &mut dice);
        editor.commit().unwrap();
        for (asset, seen) in &readers {
            assert!(State::read(asset) == *seen);
        }
    }
    assert_whole(&path);
}

#[cfg(unix)]
#[test]
fn without_readers_the_file_stops_growing() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mut state = State::open(&path).1;
    let mut dice = Dice::new(11);
    let mut lengths = Vec::new();
    for round in 0..60 {
        let (mut editor, _) = recorded_editor(&path);
        for _ in 0..=round % 3 {
            change(&mut editor, &mut state, &mut dice);
            editor.commit().unwrap();
        }
        lengths.push(editor.asset().file_bytes());
    }
    assert!(State::open(&path).1 == state);
    assert!(lengths[59] <= lengths[20] + lengths[20] / 2, "{lengths:?}");
}

/// What was there stays, byte for byte; the new channel holds what the materials say.
#[test]
fn channels_are_added_behind_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mut dice = Dice::new(9);
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    let mut state = State::read(editor.asset());
    change(&mut editor, &mut state, &mut dice);
    let known = editor.asset().channels().to_vec();
    let kind = ChannelKind::OcclusionRoughnessMetallic;
    refused(editor.add_channels(&[kind, kind]), "it has one of occlusion");
    refused(editor.add_channels(&[ChannelKind::Light]), "only a bake makes one of light");
    editor.add_channels(&[kind]).unwrap();
    let asset = Asset::open(&path).unwrap();
    let number = known.len();
    assert_eq!(asset.channels()[..number], known);
    assert_eq!(asset.channels()[number], Channel { kind, format: TexelFormat::Rgba8, srgb: false });
    let is_material = |group: u32, value: [f32; 4]| {
        let mesh = asset.mesh();
        let of_group = (0..mesh.triangles.len()).filter(|&t| asset.cover().corner_groups[t].contains(&group));
        of_group.map(|t| &mesh.materials[mesh.material_of(t)]).any(|material| {
            let expected = [1.0, material.roughness, material.metallic];
            expected.iter().zip(value).all(|(a, b)| (a - b).abs() < 0.003)
        })
    };
    for id in pages(asset.cover()) {
        for channel in 0..number {
            assert_eq!(asset.read_page_raw(channel, id).unwrap(), state.pages[&(id, channel)]);
        }
        let texels = asset.read_page(number, id).unwrap();
        assert!(texels.rgba.iter().all(|value| is_material(id.group, *value)), "{id}");
    }
    for group in 0..asset.cover().groups.len() as u32 {
        let means: Vec<_> = (0..number).map(|channel| asset.mean(channel, group)).collect();
        assert_eq!(means, state.means[group as usize * number..][..number]);
        assert!(is_material(group, asset.mean(number, group)));
    }
    let attachments = |asset: &Asset| State::read(asset).attachments;
    assert_eq!(attachments(&asset), state.attachments);
    assert_whole(&path);
    // It goes on as before.
    let id = pages(asset.cover()).next().unwrap();
    let bytes = vec![7; asset.read_page_raw(number, id).unwrap().len()];
    editor.replace(id, number, bytes.clone()).unwrap();
    editor.commit().unwrap();
    assert_eq!(Asset::open(&path).unwrap().read_page_raw(number, id).unwrap(), bytes);
}

/// What stays is what it was, byte for byte; attachments are changed with it.
#[test]
fn channels_are_removed_and_the_others_move_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mut dice = Dice::new(10);
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    let mut state = State::read(editor.asset());
    change(&mut editor, &mut state, &mut dice);
    editor.attach("kept", vec![1; 5000]).unwrap();
    editor.attach("counts/channels", vec![2, 0]).unwrap();
    editor.attach("counts/gone", vec![3]).unwrap();
    let known = editor.asset().channels().to_vec();
    let all: Vec<ChannelKind> = known.iter().map(|channel| channel.kind).collect();
    assert!(all.len() > 1);
    let keep = |_: &str, contents| Ok(Some(contents));
    refused(editor.remove_channels(&all, |_| true, keep), "it has no other channel");
    refused(editor.remove_channels(&[ChannelKind::Light], |_| true, keep), "it has none");
    editor.commit().unwrap();
    state.attachments = State::read(editor.asset()).attachments;
    let before = std::fs::read(&path).unwrap();
    let failing = |_: &str, _: Vec<u8>| Err(fantex_base::Error::invalid("not so"));
    refused(editor.remove_channels(&all[..1], |name| name == "kept", failing), "not so");
    assert!(std::fs::read(&path).unwrap() == before, "what fails changes nothing");
    let reader = Asset::open(&path).unwrap();
    let change_counts = |name: &str, contents: Vec<u8>| match name {
        "counts/gone" => Ok(None),
        _ => Ok(Some([contents.as_slice(), &[7]].concat())),
    };
    editor.remove_channels(&all[..1], |name| name.starts_with("counts/"), change_counts).unwrap();
    let asset = Asset::open(&path).unwrap();
    assert_eq!(asset.channels(), &known[1..]);
    let count = known.len();
    for id in pages(asset.cover()) {
        for channel in 1..count {
            assert_eq!(asset.read_page_raw(channel - 1, id).unwrap(), state.pages[&(id, channel)]);
        }
    }
    for group in 0..asset.cover().groups.len() as u32 {
        let means: Vec<_> = (1..count).map(|channel| asset.mean(channel - 1, group)).collect();
        assert_eq!(means, state.means[group as usize * count + 1..][..count - 1]);
    }
    state.attachments.remove("counts/gone");
    state.attachments.insert("counts/channels".into(), vec![2, 0, 7]);
    assert_eq!(State::read(&asset).attachments, state.attachments);
    assert_eq!(reader.channels(), known, "the old file lives on for its readers");
    assert_whole(&path);
    // It goes on as before.
    let id = pages(asset.cover()).next().unwrap();
    let bytes = vec![7; asset.read_page_raw(0, id).unwrap().len()];
    editor.replace(id, 0, bytes.clone()).unwrap();
    editor.commit().unwrap();
    assert_eq!(Asset::open(&path).unwrap().read_page_raw(0, id).unwrap(), bytes);
}

#[test]
fn added_pages_are_empty_where_nothing_is_read() {
    let channel = |kind, format| Channel { kind, format, srgb: false };
    let color = channel(ChannelKind::BaseColor, TexelFormat::Bc7);
    let mut seen = vec![0x40_u8; 32];
    seen[16..].fill(0);
    for (kind, format) in [(ChannelKind::Normal, TexelFormat::Bc5), (ChannelKind::Emission, TexelFormat::Bc7)]
    {
        let added = Channel::beside(kind, std::slice::from_ref(&color)).unwrap();
        assert_eq!(added.format, format);
        let page = added.plain_page([8, 4], [0.5, 0.5, 0.0, 1.0], &[(&color, &seen)]).unwrap();
        let values = decode(format, [8, 4], &page).unwrap();
        assert!(page[16..].iter().all(|byte| *byte == 0));
        assert!((values[0][1] - if added.srgb { 0.735 } else { 0.5 }).abs() < 0.006, "{:?}", values[0]);
        assert_eq!(
            added.plain_page([8, 4], [0.5; 4], &[]).unwrap()[..16],
            added.plain_page([8, 4], [0.5; 4], &[]).unwrap()[16..]
        );
    }
}
