//! What is open is left: once it is saved, or asked for again; and what is painted on or not stays what it was where nothing is opened.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::{Key, Modifiers};
use fantex::glam::DVec2;
use fantex::paint::{PaintOptions, Painter};
use fantex::store::{Asset, ChannelKind};
use fantex_app::camera::ViewPreset;
use fantex_app::command::Command;
use fantex_app::document::{Document, Place};
use fantex_app::paint::{Answer, Leave, NewAsset, Painting, PenEvent, PenPhase, Question, SaveState};
use fantex_app::viewer::{KeyPhase, Request, SceneInput, Viewer};

use crate::painting::{Studio, small_asset};
use crate::panels::{empty, wait_painted, with_model, with_painting};

/// Waits until something is so.
fn wait_until(viewer: &mut Viewer, what: &str, mut is_so: impl FnMut(&mut Viewer) -> bool) {
    let started = Instant::now();
    loop {
        viewer.poll();
        if is_so(viewer) {
            return;
        }
        assert!(started.elapsed() < fantex_test::PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn wait_opened(viewer: &mut Viewer) {
    wait_until(viewer, "it does not open", |viewer| !viewer.is_opening());
}

fn said(viewer: &Viewer, words: &str) -> bool {
    viewer.notices.log().any(|text| text.contains(words))
}

fn pen(viewer: &mut Viewer, events: &[(PenPhase, [f64; 2])], turns_sun: bool) {
    let event =
        |&(phase, [x, y]): &(PenPhase, [f64; 2])| PenEvent { phase, at: DVec2::new(x, y), pressure: 1.0 };
    let pen = events.iter().map(event).collect();
    viewer.navigate(&SceneInput { pen, turns_sun, ..SceneInput::default() }, 0.016);
}

fn draw(viewer: &mut Viewer) {
    use PenPhase::{Down, Move, Up};
    pen(viewer, &[(Down, [0.5, 0.85]), (Move, [0.6, 0.84]), (Up, [0.6, 0.84])], false);
    wait_painted(viewer);
}

fn seen(mut viewer: Viewer) -> Viewer {
    (viewer.scene_pixels, viewer.pixels_per_point) = ([500, 500], 1.0);
    viewer.show(ViewPreset::Top);
    wait_painted(&mut viewer);
    viewer
}

/// What is painted there cannot be saved.
fn with_full_disk(folder: &Path) -> Viewer {
    let path = crate::painting::small_asset(folder);
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    painter.limit_file(Some(std::fs::metadata(&path).unwrap().len()));
    let asset = painter.editor().asset().clone();
    let mut viewer = empty();
    viewer.document = Some(Document::of_asset(Place::File(path), asset));
    viewer.painting = Some(Painting::new(painter, None, Arc::new(|| {})).unwrap());
    viewer.paints = true;
    let mut viewer = seen(viewer);
    draw(&mut viewer);
    wait_until(&mut viewer, "it does not say so", |viewer| {
        matches!(viewer.painting.as_ref().unwrap().save, SaveState::Failed(_))
    });
    viewer
}

#[test]
fn what_is_not_saved_is_lost_only_where_that_is_asked_for_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = with_full_disk(folder.path());
    let copy = folder.path().join("copy.fan");
    viewer.copy_to(copy.clone());
    wait_until(&mut viewer, "it waits for ever", |viewer| viewer.exporting.is_none());
    assert!(said(&viewer, "copy.fan was not written. The disk is full") && !copy.exists());
    assert!(!viewer.may_close());
    assert!(said(&viewer, "Close again to lose what is not saved."));
    viewer.command(Command::Close);
    assert!(viewer.painting.is_some(), "closing the file is not closing the window");
    viewer.command(Command::Reload);
    assert!(viewer.painting.is_some() && !viewer.is_opening());
    assert!(said(&viewer, "Do that again to lose what is not saved."));
    viewer.command(Command::TogglePainting);
    assert!(viewer.paints && viewer.painting.is_some() && !viewer.is_opening());
    let other = folder.path().join("other.ply");
    viewer.take_dropped(other.clone());
    assert!(viewer.painting.is_some() && !viewer.is_opening());
    viewer.take_dropped(other);
    assert!(viewer.is_opening());
    wait_opened(&mut viewer);
    assert!(viewer.painting.is_some(), "there is no such file");
    viewer.command(Command::TogglePainting);
    viewer.command(Command::TogglePainting);
    wait_opened(&mut viewer);
    assert!(!viewer.paints && viewer.painting.is_none() && viewer.document.is_some());
    assert!(viewer.may_close());
}

#[test]
fn closing_waits_until_all_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = seen(with_painting(folder.path()));
    draw(&mut viewer);
    while viewer.painting.as_ref().unwrap().save == SaveState::Saved {
        draw(&mut viewer);
    }
    assert!(!viewer.may_close());
    wait_until(&mut viewer, "it does not close", |viewer| viewer.take_requests() == [Request::Quit]);
    assert!(viewer.may_close());
    assert_eq!(viewer.painting.as_ref().unwrap().save, SaveState::Saved);
    assert_eq!(crate::errors(&viewer.notices), 0);
    // Escape lets it stay open.
    draw(&mut viewer);
    while viewer.painting.as_ref().unwrap().save == SaveState::Saved {
        draw(&mut viewer);
    }
    viewer.command(Command::Close);
    assert!(viewer.is_opening() && viewer.painting.is_some());
    viewer.command(Command::Cancel);
    wait_until(&mut viewer, "it does not save", |viewer| {
        viewer.painting.as_ref().unwrap().save == SaveState::Saved
    });
    assert!(viewer.take_requests().is_empty() && viewer.painting.is_some());
}

#[test]
fn a_look_with_changes_is_left_once_that_is_asked_for_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = empty();
    viewer.live = Some(crate::live::open(folder.path()).0);
    viewer.live.as_mut().unwrap().set(1, 0.125);
    viewer.command(Command::Close);
    assert!(viewer.live.is_some() && said(&viewer, "What was changed of ball.toml is not saved."));
    // Hours later it is told again.
    viewer.notices.now += 7200.0;
    viewer.command(Command::Close);
    assert!(viewer.live.is_some());
    viewer.command(Command::Close);
    assert!(viewer.live.is_none());
}

#[test]
fn a_look_that_cannot_be_read_leaves_what_is_open() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = with_painting(folder.path());
    wait_painted(&mut viewer);
    wait_until(&mut viewer, "it does not save", |viewer| viewer.painting.as_ref().unwrap().is_saved());
    viewer.paints = false;
    viewer.open("none.toml");
    assert!(viewer.painting.is_some() && viewer.document.is_some() && viewer.paints);
    assert_eq!(crate::errors(&viewer.notices), 1);
}

#[test]
fn a_look_that_cannot_be_read_ends_the_program() {
    let mut viewer = empty();
    viewer.open_or_fail(Place::parse("none.toml"));
    assert!(viewer.failure.is_some_and(|failure| failure.contains("none.toml")));
}

#[test]
fn where_nothing_can_be_painted_on_the_switch_goes_back() {
    // There is no such file.
    let mut viewer = with_model();
    viewer.command(Command::TogglePainting);
    wait_opened(&mut viewer);
    assert!(!viewer.paints && viewer.document.is_some());
    assert_eq!(crate::errors(&viewer.notices), 1);
    viewer.command(Command::TogglePainting);
    viewer.command(Command::Cancel);
    assert!(!viewer.paints);
}

/// The painter is gone, and the file is still being opened by what was given up: whatever is opened next waits for that.
#[test]
fn opening_again_can_be_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = seen(with_painting(folder.path()));
    let Place::File(path) = viewer.document.as_ref().unwrap().place.clone() else { panic!("not a file") };
    viewer.document.as_mut().unwrap().exchange = viewer.painting.as_ref().map(|p| p.exchange().clone());
    wait_until(&mut viewer, "it does not save", |viewer| {
        viewer.painting.as_mut().unwrap().leave() == fantex_app::paint::Leave::Free
    });
    viewer.removal = Some(ChannelKind::BaseColor);
    viewer.command(Command::Reload);
    assert!(viewer.opening.is_some() && viewer.painting.is_none() && viewer.removal.is_none());
    viewer.command(Command::Cancel);
    assert!(viewer.document.is_none(), "no scene without its painter");
    viewer.paints = true;
    viewer.open(&path.to_string_lossy());
    wait_opened(&mut viewer);
    assert!(viewer.painting.is_some());
    assert_eq!(crate::errors(&viewer.notices), 0);
}

/// Its own lock does not keep the program out.
#[test]
fn an_asset_is_opened_again_under_another_spelling() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = seen(with_painting(folder.path()));
    viewer.document.as_mut().unwrap().exchange = viewer.painting.as_ref().map(|p| p.exchange().clone());
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    let path = folder.path().join("sub/../torus.fan");
    viewer.open(&path.to_string_lossy());
    wait_opened(&mut viewer);
    assert_eq!(viewer.document.as_ref().unwrap().place, Place::File(path));
    assert!(viewer.painting.is_some() && crate::errors(&viewer.notices) == 0);
}

#[test]
fn one_thing_is_written_at_a_time_and_nothing_of_an_address() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = seen(with_painting(folder.path()));
    let [first, second] = ["first.fan", "second.fan"].map(|name| folder.path().join(name));
    viewer.copy_to(first.clone());
    assert!(viewer.exporting.is_some());
    viewer.copy_to(second.clone());
    assert!(said(&viewer, "Something else is being written"));
    wait_until(&mut viewer, "it is not written", |viewer| viewer.exporting.is_none());
    assert!(first.exists() && !second.exists());
    let mut viewer = empty();
    let asset = Arc::new(Asset::open(&first).unwrap());
    viewer.document = Some(Document::of_asset(Place::parse("https://example.org/a.fan"), asset));
    viewer.command(Command::Export);
    viewer.command(Command::SaveCopy);
    assert!(viewer.exporting.is_none() && viewer.take_requests().is_empty());
    assert!(said(&viewer, "download it first"));
}

#[test]
fn closing_does_not_end_a_copy_without_a_word() {
    let folder = tempfile::tempdir().unwrap();
    let path = crate::painting::small_asset(folder.path());
    let mut viewer = empty();
    let asset = Arc::new(Asset::open(&path).unwrap());
    viewer.document = Some(Document::of_asset(Place::File(path), asset));
    let copy = folder.path().join("copy.fan");
    viewer.copy_to(copy.clone());
    assert!(!viewer.may_close());
    assert!(said(&viewer, "copy.fan is still being written. Close again to lose what is not saved."));
    viewer.command(Command::Close);
    assert!(viewer.document.is_none(), "it goes on without");
    wait_until(&mut viewer, "it is not written", |viewer| viewer.exporting.is_none());
    assert!(copy.exists() && viewer.may_close());
}

#[test]
fn keys_of_a_text_leave_strokes_alone() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = seen(with_painting(folder.path()));
    draw(&mut viewer);
    let undo = |viewer: &mut Viewer, is_typing| {
        let control = Modifiers { ctrl: true, command: true, ..Modifiers::NONE };
        viewer.key(Key::Z, control, KeyPhase::Pressed, is_typing);
        wait_painted(viewer);
        viewer.painting.as_ref().unwrap().snapshot.done.len()
    };
    assert_eq!(undo(&mut viewer, true), 1);
    assert_eq!(undo(&mut viewer, false), 0);
}

#[test]
fn a_button_that_is_let_go_with_control_ends_what_it_began() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = seen(with_painting(folder.path()));
    viewer.settings.paint.alt_turns = true;
    // The hole of the torus: a stroke begins where the surface is met.
    pen(&mut viewer, &[(PenPhase::Down, [0.5, 0.5])], false);
    assert!(viewer.painting.as_ref().unwrap().has_hand_down());
    pen(&mut viewer, &[(PenPhase::Up, [0.5, 0.5])], true);
    assert!(!viewer.painting.as_ref().unwrap().has_hand_down());
}

/// What has been painted may be told later than it is done.
#[test]
fn what_is_not_told_yet_is_not_lost_either() {
    let folder = tempfile::tempdir().unwrap();
    let path = crate::painting::small_asset(folder.path());
    let bytes = std::fs::metadata(&path).unwrap().len();
    let mut studio = Studio::open_at(folder, path, Some(bytes));
    for (phase, x) in [(PenPhase::Down, 0.5), (PenPhase::Move, 0.6), (PenPhase::Up, 0.6)] {
        studio.pen(phase, x, 0.85, Modifiers::NONE);
    }
    let started = Instant::now();
    while studio.painting.is_busy() {
        assert!(started.elapsed() < fantex_test::PATIENCE, "the painter does not end");
        std::thread::sleep(Duration::from_millis(1));
    }
    // Nobody has asked for reports.
    assert_eq!(studio.painting.save, SaveState::Saved);
    assert!(!studio.painting.is_saved());
    assert_eq!(studio.painting.leave(), Leave::Waits);
}

/// The asset is in the window again where its strokes cannot be repeated on the model's new mesh.
#[test]
fn an_asset_whose_strokes_cannot_be_repeated_is_opened_again() {
    let folder = tempfile::tempdir().unwrap();
    small_asset(folder.path());
    let model = folder.path().join("torus.ply");
    crate::document::save_torus(&model, 24, false);
    let mut viewer = empty();
    (viewer.asks, viewer.paints) = (true, true);
    viewer.open_file(model);
    wait_opened(&mut viewer);
    assert!(matches!(viewer.asked.as_ref().unwrap().question, Question::Foreign { .. }));
    let impossible = NewAsset { texels: Some(0), ..NewAsset::default() };
    viewer.answer(Some(Answer::Replay(impossible)));
    wait_opened(&mut viewer);
    assert_eq!(crate::errors(&viewer.notices), 1);
    assert!(viewer.painting.is_some());
    assert_eq!(viewer.document.as_ref().unwrap().mesh().triangles.len(), 48 * 24 * 2);
}

/// What was told of a commit that failed is not so any more once another one succeeds.
#[test]
fn errors_of_saving_go_once_all_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = seen(with_painting(folder.path()));
    let path = viewer.asset_path().unwrap();
    let aside = folder.path().join("aside.fan");
    std::fs::rename(&path, &aside).unwrap();
    draw(&mut viewer);
    assert!(!viewer.may_close());
    wait_until(&mut viewer, "it is not told", |viewer| crate::errors(&viewer.notices) == 2);
    assert!(said(&viewer, "Not saved") && said(&viewer, "Close again to lose what is not saved."));
    std::fs::rename(&aside, &path).unwrap();
    // It is saved at once.
    viewer.copy_to(folder.path().join("copy.fan"));
    wait_until(&mut viewer, "it waits for ever", |viewer| viewer.exporting.is_none());
    viewer.poll();
    assert_eq!(crate::errors(&viewer.notices), 0);
}
