use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use egui_kittest::kittest::Queryable;
use fantex::base::Error;
use fantex::glam::{DVec2, DVec3};
use fantex::scene::Camera;
use fantex::texture::{ColorSpace, Image, Samples};
use fantex_app::camera::{CameraMode, Ground, ViewPreset};
use fantex_app::command::{Command, shortcuts};
use fantex_app::document::{PAINTER_SHARE, Place, Stage};
use fantex_app::light::Surroundings;
use fantex_app::scene_view::PrepareScene;
use fantex_app::settings::{PanelSettings, Settings, Tab};
use fantex_app::viewer::{FileDialog, PathState, Request, SceneInput, Viewer};

fn viewer() -> Viewer {
    let mut viewer = Viewer::new(Settings::default(), None, Arc::new(|| {}));
    viewer.scene_pixels = [800, 600];
    viewer
}

fn save_torus(folder: &Path) -> PathBuf {
    let path = folder.join("torus.ply");
    crate::document::save_torus(&path, 48, false);
    path
}

/// Polls until nothing runs any more.
fn wait(viewer: &mut Viewer) {
    let started = Instant::now();
    loop {
        viewer.poll();
        if !viewer.is_opening() && !viewer.is_preparing_ground() && !viewer.is_making_surroundings() {
            return;
        }
        assert!(started.elapsed() < fantex_test::PATIENCE, "a job does not end");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn opened() -> (tempfile::TempDir, Viewer) {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = viewer();
    viewer.open(&save_torus(folder.path()).to_string_lossy());
    assert!(viewer.opening.is_some());
    wait(&mut viewer);
    (folder, viewer)
}

#[test]
fn opening_shows_the_model_and_remembers_it() {
    let (_folder, viewer) = opened();
    let document = viewer.document.as_ref().unwrap();
    assert!((viewer.rig.pivot() - document.scale.center).length() < document.scale.diagonal);
    assert!(viewer.settings.recent[0].ends_with("torus.ply"));
    assert!(viewer.ground.is_some());
    assert_eq!(crate::errors(&viewer.notices), 0);
}

#[test]
fn another_gpu_is_given_the_document_and_what_is_being_opened() {
    let (folder, mut viewer) = opened();
    let rig = viewer.rig;
    let asked = Arc::new(Mutex::new(Vec::new()));
    let names = asked.clone();
    let prepare: PrepareScene = Arc::new(move |document, _, _| {
        names.lock().unwrap().push(document.place.name());
        Err(Error::unavailable("there are no graphics here"))
    });
    viewer.draw_with(prepare.clone());
    assert!(viewer.is_opening());
    wait(&mut viewer);
    assert_eq!(*asked.lock().unwrap(), ["torus.ply"]);
    assert!(viewer.document.is_some() && viewer.rig == rig && viewer.new_model.is_none());
    assert!(viewer.notices.log().any(|text| text.contains("no graphics")));
    // Lost while another file is being opened: that begins anew.
    let other = folder.path().join("other.ply");
    std::fs::copy(folder.path().join("torus.ply"), &other).unwrap();
    viewer.open(&other.to_string_lossy());
    asked.lock().unwrap().clear();
    viewer.draw_with(prepare);
    wait(&mut viewer);
    let asked = asked.lock().unwrap();
    assert!(
        ["torus.ply", "other.ply"].iter().all(|name| asked.iter().any(|asked| asked == name)),
        "{asked:?}"
    );
}

/// A large model takes its time until it is given up, also while something else is opened.
#[test]
fn what_is_given_up_does_not_hold_up_what_comes_next() {
    let folder = tempfile::tempdir().unwrap();
    let first = save_torus(folder.path());
    let second = folder.path().join("second.ply");
    std::fs::copy(&first, &second).unwrap();
    let (go_on, waits) = std::sync::mpsc::channel();
    let waits = Mutex::new(waits);
    let prepare: PrepareScene = Arc::new(move |document, _, _| {
        if document.place.name() == "torus.ply" {
            waits.lock().unwrap().recv().unwrap();
        }
        Err(Error::unavailable("there are no graphics here"))
    });
    let mut viewer = Viewer::new(Settings::default(), Some(prepare), Arc::new(|| {}));
    viewer.open(&first.to_string_lossy());
    let started = Instant::now();
    while viewer.opening.as_ref().unwrap().stage() != Stage::Preparing {
        assert!(started.elapsed() < fantex_test::PATIENCE, "it is not read");
        std::thread::sleep(Duration::from_millis(2));
    }
    viewer.command(Command::Cancel);
    viewer.open(&second.to_string_lossy());
    wait(&mut viewer);
    assert!(viewer.notices.log().any(|text| text.contains("no graphics")));
    go_on.send(()).unwrap();
}

/// How far the preparation is, is told while it goes on: of what is painted on that of its painter comes first.
#[test]
fn preparing_is_told_in_shares() {
    let folder = tempfile::tempdir().unwrap();
    let path = crate::painting::small_asset(folder.path());
    let (go_on, waits) = std::sync::mpsc::channel();
    let waits = Mutex::new(waits);
    let prepare: PrepareScene = Arc::new(move |_, _, progress| {
        progress(0.5);
        waits.lock().unwrap().recv().unwrap();
        Err(Error::unavailable("there are no graphics here"))
    });
    for (paints, expected) in [(false, 0.5), (true, 0.5 + 0.5 * PAINTER_SHARE)] {
        let mut viewer = Viewer::new(Settings::default(), Some(prepare.clone()), Arc::new(|| {}));
        viewer.paints = paints;
        viewer.open(&path.to_string_lossy());
        let started = Instant::now();
        let is_there = |viewer: &Viewer| {
            let opening = viewer.opening.as_ref().unwrap();
            opening.stage() == Stage::Preparing
                && opening.share().is_some_and(|share| (share - expected).abs() < 0.002)
        };
        while !is_there(&viewer) || viewer.opening.as_ref().unwrap().seconds() < 0.2 {
            assert!(started.elapsed() < fantex_test::PATIENCE, "it is not told");
            std::thread::sleep(Duration::from_millis(2));
        }
        let mut harness = crate::panels::harness(viewer, [1280.0, 800.0]);
        harness.run_steps(2);
        let percent = format!("Preparing textures … {:.0} %", 100.0 * expected);
        harness.get_by_label_contains(&percent);
        let mut viewer = std::mem::take(harness.state_mut());
        go_on.send(()).unwrap();
        wait(&mut viewer);
        assert_eq!(crate::errors(&viewer.notices), 1);
    }
}

#[test]
fn what_cannot_be_opened_is_a_message_and_leaves_the_rest() {
    let (folder, mut viewer) = opened();
    let broken = folder.path().join("broken.fan");
    std::fs::write(&broken, b"\x89FAN and then nothing").unwrap();
    viewer.open(&broken.to_string_lossy());
    wait(&mut viewer);
    assert!(viewer.document.is_some(), "what was shown stays");
    assert!(viewer.notices.log().any(|text| text.contains("broken.fan")));
    assert_eq!(viewer.settings.recent.len(), 1);
}

#[test]
fn opening_can_be_cancelled() {
    let (_folder, mut viewer) = opened();
    let before = viewer.document.as_ref().unwrap().place.clone();
    viewer.open("/no/such/file.glb");
    viewer.command(Command::Cancel);
    assert!(viewer.opening.is_none());
    wait(&mut viewer);
    assert_eq!(viewer.document.as_ref().unwrap().place, before);
    assert_eq!(crate::errors(&viewer.notices), 0);
}

#[test]
fn the_wheel_comes_closer_to_the_model_under_the_cursor() {
    let (_folder, mut viewer) = opened();
    let distance = |viewer: &Viewer| viewer.hit_under(DVec2::new(0.5, 0.7)).unwrap();
    let before = distance(&viewer);
    let input = SceneInput { wheel: 4.0, cursor: Some(DVec2::new(0.5, 0.7)), ..SceneInput::default() };
    viewer.navigate(&input, 0.016);
    assert!((distance(&viewer) / before - 0.85f64.powi(4)).abs() < 1e-3);
}

#[test]
fn a_double_click_makes_the_point_the_pivot() {
    let (_folder, mut viewer) = opened();
    let cursor = DVec2::new(0.5, 0.7);
    let point = viewer.rig.point_under(cursor, viewer.aspect(), viewer.hit_under(cursor));
    let input = SceneInput { is_double_click: true, cursor: Some(cursor), ..SceneInput::default() };
    viewer.navigate(&input, 0.016);
    assert!((viewer.rig.pivot() - point).length() < 1e-6);
}

#[test]
fn changing_the_mode_keeps_the_picture() {
    let (_folder, mut viewer) = opened();
    let before = viewer.rig;
    viewer.command(Command::Mode(CameraMode::Fly));
    viewer.navigate(&SceneInput::default(), 0.016);
    assert_eq!(viewer.rig, before);
}

#[test]
fn walkers_stand_on_the_model() {
    let (_folder, mut viewer) = opened();
    viewer.set_camera(&Camera {
        eye: DVec3::new(1.0, 3.0, 0.0),
        target: DVec3::new(0.0, 3.0, 0.0),
        up: DVec3::Y,
        fov_degrees: 60.0,
    });
    viewer.command(Command::Mode(CameraMode::Walk));
    for frame in 0..400 {
        viewer.notices.now = f64::from(frame) * 0.02;
        viewer.navigate(&SceneInput::default(), 0.02);
    }
    let below = viewer.ground.as_ref().unwrap().first(viewer.rig.eye, DVec3::NEG_Y, 10.0).unwrap();
    assert!((below.distance - viewer.eye_height()).abs() < 0.05 * viewer.eye_height(), "{below:?}");
}

#[test]
fn recorded_paths_play_back() {
    let (folder, mut viewer) = opened();
    viewer.command(Command::ToggleRecording);
    for frame in 0..60 {
        let input = SceneInput { drag: DVec2::new(0.01, 0.0), ..SceneInput::default() };
        viewer.notices.now = f64::from(frame) / 30.0;
        viewer.navigate(&input, 0.033);
    }
    let end = viewer.rig;
    viewer.notices.now = 2.0;
    viewer.command(Command::ToggleRecording);
    let file = folder.path().join("way.json");
    viewer.save_path(&file);
    viewer.path = None;
    viewer.load_path(&file);
    viewer.show(ViewPreset::Back);
    viewer.notices.now = 10.0;
    viewer.command(Command::TogglePlayback);
    viewer.notices.now = 10.5;
    assert!(viewer.navigate(&SceneInput::default(), 0.016));
    viewer.notices.now = 15.0;
    assert!(!viewer.navigate(&SceneInput::default(), 0.016));
    assert!(matches!(viewer.path_state, PathState::Still));
    assert!((viewer.rig.eye - end.eye).length() < 1e-6);
}

#[test]
fn dragging_with_the_modifier_turns_the_sun_alone() {
    let (_folder, mut viewer) = opened();
    let (rig, sun) = (viewer.rig, viewer.settings.light.to_sun());
    let input = SceneInput { drag: DVec2::new(0.2, 0.1), turns_sun: true, ..SceneInput::default() };
    viewer.navigate(&input, 0.016);
    assert_eq!(viewer.rig, rig);
    assert_ne!(viewer.settings.light.to_sun(), sun);
}

#[test]
fn surroundings_come_in_the_background_and_failures_once() {
    let mut viewer = viewer();
    viewer.settings.light.surroundings = Surroundings::Sky;
    wait(&mut viewer);
    assert!(viewer.lights().ambient.environment.is_some());
    viewer.settings.light.surroundings = Surroundings::File("no/such.hdr".into());
    for _ in 0..3 {
        wait(&mut viewer);
    }
    assert_eq!(crate::errors(&viewer.notices), 1);
    assert!(viewer.lights().ambient.environment.is_none());
}

#[test]
fn pictures_are_drawn_where_something_changes() {
    let (_folder, mut viewer) = opened();
    let settle = |viewer: &mut Viewer| {
        viewer.notices.now = 100.0;
        viewer.notice_changes();
        viewer.pacing.next(100.0, true);
        viewer.pacing.drawn(0.01);
    };
    settle(&mut viewer);
    viewer.notices.now = 101.0;
    viewer.notice_changes();
    assert!(viewer.pacing.is_settled());
    viewer.command(Command::StepOverlay(1));
    viewer.notice_changes();
    assert!(!viewer.pacing.is_settled() && !viewer.pacing.is_moving(101.0));
    settle(&mut viewer);
    viewer.rig.orbit(DVec2::new(0.1, 0.0));
    viewer.notices.now = 102.0;
    viewer.notice_changes();
    assert!(viewer.pacing.is_moving(102.0));
}

#[test]
fn all_panels_come_back_as_they_were() {
    let mut viewer = viewer();
    viewer.settings.panels.has_atlas = true;
    let before = viewer.settings.panels;
    viewer.command(Command::ToggleAllPanels);
    assert!(!viewer.settings.panels.has_inspector && !viewer.settings.panels.has_atlas);
    viewer.command(Command::ToggleAllPanels);
    assert_eq!(viewer.settings.panels, before);
}

/// Who quits with hidden panels finds them again.
#[test]
fn panels_that_were_hidden_at_the_end_come_back() {
    let mut viewer = viewer();
    viewer.command(Command::ToggleAllPanels);
    let mut settings = viewer.settings;
    settings.panels.tab = Tab::Light;
    let mut viewer = Viewer::new(settings, None, Arc::new(|| {}));
    viewer.command(Command::ToggleAllPanels);
    let shown = viewer.settings.panels;
    assert_eq!(shown, PanelSettings { tab: Tab::Light, ..PanelSettings::default() });
    viewer.command(Command::ToggleAllPanels);
    assert!(!viewer.settings.panels.has_inspector);
    viewer.command(Command::ToggleAllPanels);
    assert_eq!(viewer.settings.panels, shown);
}

/// A picture that could not be read is read once it is chosen again.
#[test]
fn surroundings_that_are_chosen_again_are_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.png");
    let mut viewer = viewer();
    let light_of = |color: u8| {
        let (space, samples) = (ColorSpace::Srgb, Samples::U8(vec![color; 3 * 64 * 32]));
        Image { width: 64, height: 32, channels: 3, space, samples }.save(&path).unwrap();
    };
    std::fs::write(&path, "no picture").unwrap();
    viewer.take_file(FileDialog::Surroundings, path.clone());
    wait(&mut viewer);
    assert!(crate::errors(&viewer.notices) == 1 && viewer.lights().ambient.environment.is_none());
    light_of(50);
    viewer.take_file(FileDialog::Surroundings, path.clone());
    wait(&mut viewer);
    let first = viewer.lights().ambient.environment.unwrap();
    light_of(200);
    viewer.take_file(FileDialog::Surroundings, path.clone());
    wait(&mut viewer);
    let second = viewer.lights().ambient.environment.unwrap();
    assert!(!Arc::ptr_eq(&first.map, &second.map), "it shows what the file holds");
}

/// What is asked of an asset ends with it.
#[test]
fn nothing_is_asked_of_what_is_closed() {
    let mut viewer = crate::panels::with_asset(Tab::Model);
    viewer.command(Command::Export);
    assert!(viewer.exporting.is_some());
    viewer.command(Command::Close);
    assert!(viewer.document.is_none() && viewer.exporting.is_none());
}

#[test]
fn commands_without_a_document_do_no_harm() {
    let mut viewer = viewer();
    for shortcut in shortcuts() {
        viewer.command(shortcut.command);
        viewer.navigate(&SceneInput::default(), 0.016);
        viewer.notice_changes();
    }
    assert!(viewer.document.is_none());
}

#[test]
fn dropped_pictures_are_surroundings_and_others_are_opened() {
    let mut viewer = Viewer::new(Settings::default(), None, Arc::new(|| {}));
    viewer.take_dropped("sky.HDR".into());
    assert_eq!(viewer.settings.light.surroundings, fantex_app::light::Surroundings::File("sky.HDR".into()));
    assert!(viewer.opening.is_none());
    viewer.take_first_dropped(vec!["none.glb".into()]);
    assert!(viewer.opening.is_some() && !viewer.notices.log().any(|text| text.contains("dropped")));
    viewer.take_first_dropped(vec!["none.glb".into(), "other.glb".into()]);
    assert!(
        viewer.notices.log().any(|text| text.starts_with("Of 2 files that were dropped, none.glb is taken"))
    );
}

/// Pictures of the clipboard go where dropped ones go, texel by texel, and the same one is kept once.
#[test]
fn pasted_pictures_are_taken_as_dropped_ones() {
    use fantex_app::light::Surroundings;
    use fantex_app::paint::{PaintTool, StickerKind};
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = Viewer::new(Settings::default(), None, Arc::new(|| {}));
    viewer.brushes_file = Some(folder.path().join("brushes.json"));
    let texels = vec![255, 0, 0, 255, 0, 255, 0, 128];
    viewer.take_pasted([2, 1], texels.clone());
    let Surroundings::File(path) = viewer.settings.light.surroundings.clone() else { panic!("not taken") };
    assert!(path.starts_with(folder.path().join("pasted")));
    let image = fantex::texture::Image::load(&path).unwrap();
    assert_eq!((image.width, image.height, image.channels), (2, 1, 4));
    assert_eq!(image.samples, fantex::texture::Samples::U8(texels.clone()));
    // While something is painted on: over the view, or with the sticker's tool the sticker.
    let asset = crate::painting::small_asset(folder.path());
    let painter = fantex::paint::Painter::open(&asset, &fantex::paint::PaintOptions::default()).unwrap();
    viewer.painting = Some(fantex_app::paint::Painting::new(painter, None, Arc::new(|| {})).unwrap());
    viewer.take_pasted([2, 1], texels.clone());
    assert_eq!(viewer.settings.paint.stencil.image.as_ref(), Some(&path));
    viewer.settings.paint.tool = PaintTool::Sticker;
    viewer.take_pasted([1, 2], texels.clone());
    let paint = &viewer.settings.paint;
    assert!(paint.sticker == StickerKind::Picture && paint.picture.as_ref().is_some_and(|p| *p != path));
    assert_eq!(std::fs::read_dir(folder.path().join("pasted")).unwrap().count(), 2);
    viewer.take_pasted([3, 1], texels);
    assert!(
        viewer.notices.shown().any(|notice| notice.text.contains("cannot be pasted: its texels do not fit"))
    );
}

/// The first one may still be drawn, or encoded, when the next one is asked for.
#[test]
fn pictures_have_names_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = crate::panels::with_model();
    viewer.picture_folder = folder.path().to_owned();
    viewer.command(Command::LargeScreenshot(4));
    viewer.command(Command::Screenshot);
    viewer.command(Command::WindowScreenshot);
    viewer.command(Command::WindowScreenshot);
    let names = viewer.take_requests().into_iter().map(|request| match request {
        Request::Picture { path, .. } | Request::WindowPicture(path) => {
            path.file_name().unwrap().to_string_lossy().into_owned()
        }
        other => panic!("{other:?}"),
    });
    let expected = ["torus-001.png", "torus-002.png", "torus-window-001.png", "torus-window-002.png"];
    assert_eq!(names.collect::<Vec<_>>(), expected);
    // Closing tells of those that are not in their files yet.
    assert!(!viewer.may_close());
    assert!(viewer.notices.log().any(|text| text.contains("torus-001.png is still being written")));
    expected.iter().for_each(|name| viewer.forget_picture(&folder.path().join(name)));
    assert!(viewer.may_close());
}

/// Names of files are bytes there.
#[cfg(target_os = "linux")]
#[test]
fn files_whose_names_are_no_text_are_opened() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(std::ffi::OsStr::from_bytes(b"caf\xe9.ply"));
    std::fs::rename(save_torus(folder.path()), &path).unwrap();
    let mut viewer = viewer();
    viewer.take_dropped(path.clone());
    wait(&mut viewer);
    assert!(viewer.document.is_some() && viewer.settings.recent.is_empty());
    let mut viewer = Viewer::new(Settings::default(), None, Arc::new(|| {}));
    viewer.open_or_fail(Place::parse(path));
    wait(&mut viewer);
    assert!(viewer.document.is_some() && viewer.failure.is_none());
}
