//! Writes that fail: nothing is lost, and the next attempt succeeds.

use std::io::ErrorKind;

use super::output::recorded_editor;
use super::script::{Dice, State, assert_whole, change, seen_by, small_asset};
use crate::{Asset, EditError};

/// Runs two good commits, one that fails at the given call, and its repetition. Returns false where nothing failed.
fn session(fail_at: usize, once: bool, kind: ErrorKind) -> bool {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, plan) = recorded_editor(&path);
    let mut state = State::read(editor.asset());
    let mut dice = Dice(99);
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
    }
    let Err(error) = editor.commit() else {
        return false;
    };
    match kind {
        ErrorKind::StorageFull => assert!(matches!(error, EditError::Full { .. }), "{error}"),
        _ => assert!(matches!(error, EditError::Io { .. }), "{error}"),
    }
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

#[test]
fn discarding_returns_to_the_committed_state() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, _) = recorded_editor(&path);
    let committed = State::read(editor.asset());
    let mut dice = Dice(3);
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

#[test]
fn mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let (mut editor, _) = recorded_editor(&path);
    let page = crate::PageId { group: 0, level: 0, page: [0, 0] };
    assert!(matches!(editor.replace(page, 0, vec![0; 3]), Err(EditError::PageBytes { got: 3, .. })));
    let missing = crate::PageId { group: 99, ..page };
    assert!(matches!(editor.replace(missing, 0, vec![]), Err(EditError::Page(_))));
    assert!(matches!(editor.attach(&"x".repeat(256), vec![]), Err(EditError::AttachmentSize { .. })));
    let second = crate::AssetEditor::open(&path, &crate::EditOptions::default());
    assert!(matches!(second, Err(EditError::Locked { .. })));
    // Replaced under the editor's feet.
    std::fs::copy(&path, folder.path().join("other.fan")).unwrap();
    std::fs::rename(folder.path().join("other.fan"), &path).unwrap();
    editor.attach("a", vec![1]).unwrap();
    assert!(matches!(editor.commit(), Err(EditError::Replaced { .. })));
    drop(editor);
    assert!(crate::AssetEditor::open(&path, &crate::EditOptions::default()).is_ok());
    assert_eq!(Asset::open(&path).unwrap().generation(), 1);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "the lock's file is gone");
}
