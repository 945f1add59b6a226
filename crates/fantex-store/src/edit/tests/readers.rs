//! Readers keep what they opened; space comes back when they are gone.

use std::sync::Arc;

use super::output::recorded_editor;
use super::script::{Dice, State, assert_whole, change, seen_by, small_asset};
use crate::{Asset, AssetEditor, EditOptions};

#[test]
fn a_reader_keeps_its_generation() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, _) = recorded_editor(&path);
    let mut state = State::read(editor.asset());
    let mut dice = Dice(5);
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
    let mut dice = Dice(11);
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

#[test]
fn compacting_keeps_everything_but_the_gaps() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let fresh = std::fs::metadata(&path).unwrap().len();
    let (mut editor, _) = recorded_editor(&path);
    let mut state = State::read(editor.asset());
    let mut dice = Dice(8);
    let reader = Asset::open(&path).unwrap();
    let before = state.clone();
    for _ in 0..10 {
        change(&mut editor, &mut state, &mut dice);
        editor.commit().unwrap();
    }
    for name in state.attachments.keys() {
        editor.detach(name);
    }
    state.attachments.clear();
    change(&mut editor, &mut state, &mut dice);
    let summary = editor.compact().unwrap();
    assert!(summary.bytes_before > 2 * fresh && summary.bytes < fresh + 32768, "{summary:?} {fresh}");
    assert!(State::open(&path).1 == state && State::read(editor.asset()) == state);
    assert!(State::read(&reader) == before, "the old file lives on for its readers");
    change(&mut editor, &mut state, &mut dice);
    assert!(seen_by(&editor).unwrap() == state);
    let generation = editor.commit().unwrap().generation;
    assert_eq!(generation, 14);
    assert_eq!(State::open(&path), (generation, state));
    assert_whole(&path);
}
