//! Copies without gaps.

use std::path::Path;

use fantex_base::Error;
use fantex_store::{Asset, AssetEditor, EditOptions, PageId, is_disk_full};

use crate::common::Dice;
use crate::edit::{State, assert_whole, change, recorded_editor, seen_by, small_asset};

#[test]
fn compacting_keeps_everything_but_the_gaps() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let fresh = std::fs::metadata(&path).unwrap().len();
    let (mut editor, _) = recorded_editor(&path);
    let mut state = State::read(editor.asset());
    let mut dice = Dice::new(8);
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

/// Any open asset can be copied so, into a file of another name; what no edit has cut is copied as it is stored.
#[test]
fn a_copy_has_no_gaps() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let copied = |asset: &Asset, name: &str| {
        let mut told = Vec::new();
        let to = folder.path().join(name);
        let copy = asset.copy_without_gaps(&to, &mut |done, total| {
            told.push(done);
            assert!(done <= total);
            Ok(())
        });
        copy.unwrap().persist(&to).unwrap();
        assert!(told.is_sorted() && told.len() > 2, "{told:?}");
        (to.clone(), State::open(&to).1)
    };
    let clusters = |path: &Path| {
        let asset = Asset::open(path).unwrap();
        let stored = |cluster| {
            let range = asset.cluster_range(cluster);
            let mut bytes = vec![0; (range.end - range.start) as usize];
            asset.source().read_exact_at(&mut bytes, range.start).unwrap();
            bytes
        };
        asset.clusters().map(stored).collect::<Vec<_>>()
    };
    let fresh = Asset::open(&path).unwrap();
    let (copy, state) = copied(&fresh, "fresh.fan");
    assert!(state == State::read(&fresh) && clusters(&copy) == clusters(&path));
    assert!(fresh.gap_share() < 0.2, "{}", fresh.gap_share());

    let (mut editor, _) = recorded_editor(&path);
    let mut dice = Dice::new(8);
    let mut state = State::read(editor.asset());
    for _ in 0..10 {
        change(&mut editor, &mut state, &mut dice);
        editor.commit().unwrap();
    }
    let there = std::fs::read(&path).unwrap();
    assert!(editor.asset().gap_share() > 0.5, "{}", editor.asset().gap_share());
    let (copy, copied_state) = copied(editor.asset(), "edited.fan");
    assert!(copied_state == state && std::fs::read(&path).unwrap() == there);
    assert_whole(&copy);
    let asset = Asset::open(&copy).unwrap();
    assert!(asset.gap_share() < 0.2 && asset.file_bytes() < editor.asset().file_bytes() / 2);

    // It can be ended, and leaves nothing then.
    let files = std::fs::read_dir(folder.path()).unwrap().count();
    let end = &mut |_, _| Err(Error::cancelled("enough"));
    assert!(editor.asset().copy_without_gaps(&copy, end).unwrap_err().is_cancelled());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), files);
}

#[test]
fn the_file_may_not_grow_further_after_compacting_either() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, _) = recorded_editor(&path);
    let bytes = editor.compact().unwrap().bytes;
    editor.limit_file(Some(2 * bytes));
    editor.take_replaced();
    let page = PageId { group: 0, level: 0, page: [0, 0] };
    let texels = editor.read_page_raw(0, page).unwrap();
    editor.replace(page, 0, texels).unwrap();
    editor.compact().unwrap();
    assert_eq!(editor.take_replaced(), [page]);
    let large: Vec<u8> =
        (0..4 * bytes as u32).flat_map(|n| n.wrapping_mul(0x9e37_79b9).to_le_bytes()).collect();
    editor.attach("large", large).unwrap();
    let error = editor.commit().unwrap_err();
    assert!(is_disk_full(&error), "{error}");
    editor.limit_file(None);
    editor.commit().unwrap();
}

/// A link stays one, and leads to the copy.
#[cfg(unix)]
#[test]
fn compacting_replaces_the_file_that_a_link_leads_to() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let link = folder.path().join("below/link.fan");
    std::fs::create_dir(link.parent().unwrap()).unwrap();
    std::os::unix::fs::symlink(&path, &link).unwrap();
    let mut editor = AssetEditor::open(&link, &EditOptions::default()).unwrap();
    let (mut state, mut dice) = (State::read(editor.asset()), Dice::new(9));
    for _ in 0..3 {
        change(&mut editor, &mut state, &mut dice);
        editor.compact().unwrap();
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert!(State::open(&path).1 == state && State::open(&link).1 == state);
    }
    drop(editor);
    let names = |folder: &Path| std::fs::read_dir(folder).unwrap().count();
    assert_eq!((names(folder.path()), names(link.parent().unwrap())), (2, 1), "nothing else is left");
}
