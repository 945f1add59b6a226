//! Looks that are being worked on, without a window.

use std::time::{Duration, Instant};

use egui_kittest::kittest::{NodeT, Queryable};
use fantex_app::command::{Command, parse_keys};
use fantex_app::live::LiveLook;
use fantex_app::viewer::{KeyPhase, Request, Viewer};

const LOOK: &str = r##"# A ball of marble.
[picture]
samples = 4

[textures.stone]
kind = "marble"
place = { scale = 0.5 }

[materials.ball]
base_color = "stone"
roughness = 0.25

[[object]]
shape = { kind = "sphere" }
material = "ball"
"##;

fn settle(live: &mut LiveLook, seconds: &mut f64) {
    let started = Instant::now();
    loop {
        *seconds += 1.0;
        if let Some(camera) = live.poll(*seconds) {
            live.show(&camera, [120, 80]);
        }
        if let Some(camera) = live.camera {
            live.show(&camera, [120, 80]);
        }
        if live.is_settled() {
            return;
        }
        assert!(started.elapsed() < fantex_test::PATIENCE, "no picture: {:?}", live.error);
        std::thread::sleep(Duration::from_millis(5));
    }
}

pub(crate) fn open(folder: &std::path::Path) -> (LiveLook, f64) {
    let path = folder.join("ball.toml");
    std::fs::write(&path, LOOK).unwrap();
    let mut live = LiveLook::open(&path, None, || {}).unwrap();
    // The look's own camera.
    live.show(&fantex_app::camera::CameraRig::default().camera(), [120, 80]);
    let mut seconds = 0.0;
    settle(&mut live, &mut seconds);
    (live, seconds)
}

#[test]
fn a_look_follows_its_file_and_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let (mut live, mut seconds) = open(folder.path());
    let first = live.picture.clone().unwrap();
    assert_eq!([first.width, first.height], [120, 80]);
    let keys: Vec<String> = live.numbers.iter().map(|number| number.key.to_string()).collect();
    assert_eq!(keys, ["picture.samples", "textures.stone.place.scale", "materials.ball.roughness"]);
    let samples = &live.numbers[0];
    let range = (samples.value, samples.low, samples.high, samples.is_whole);
    assert_eq!(range, (4.0, Some(1.0), Some(64.0), true));

    // A number is changed here: the picture is another one, and the file is as it was until that is saved.
    live.set(1, 0.125);
    assert!(live.is_changed());
    settle(&mut live, &mut seconds);
    assert_ne!(*live.picture.clone().unwrap(), *first);
    let path = folder.path().join("ball.toml");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), LOOK);
    live.save().unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), LOOK.replace("scale = 0.5", "scale = 0.125"));
    assert!(!live.is_changed());
    live.set(2, 0.75);
    live.discard();
    assert_eq!((live.is_changed(), live.numbers[2].value), (false, 0.25));

    // The file is changed elsewhere, with a mistake, and mended.
    let before = live.picture.clone().unwrap();
    std::fs::write(&path, LOOK.replace("roughness = 0.25", "roughnes = 0.25")).unwrap();
    settle(&mut live, &mut seconds);
    let error = live.error.clone().unwrap();
    assert!(error.contains("ball.toml:11: materials.ball"), "{error}");
    assert_eq!(*live.picture.clone().unwrap(), *before);
    std::fs::write(&path, LOOK).unwrap();
    settle(&mut live, &mut seconds);
    settle(&mut live, &mut seconds);
    assert_eq!(live.error, None);
    assert_eq!(*live.picture.clone().unwrap(), *first, "the same look, the same picture");
}

/// Who looks elsewhere and back again before anything is drawn sees it sharp all the same.
#[test]
fn wishes_that_come_back_are_drawn_to_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let (mut live, mut seconds) = open(folder.path());
    let camera = live.camera.unwrap();
    let first = live.picture.clone().unwrap();
    for _ in 0..20 {
        live.show(&camera, [60, 40]);
        live.show(&camera, [120, 80]);
        settle(&mut live, &mut seconds);
    }
    assert_eq!(*live.picture.clone().unwrap(), *first);
}

#[test]
fn what_cannot_be_shown_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none.toml");
    assert!(LiveLook::open(&path, None, || {}).unwrap_err().to_string().contains("none.toml"));
    std::fs::write(&path, "[textures.a]\nkind = \"image\"\nimage = \"none.png\"\n[materials.a]\nbase_color = \"a\"\n[[object]]\nshape = { kind = \"sphere\" }\nmaterial = \"a\"\n").unwrap();
    let mut live = LiveLook::open(&path, None, || {}).unwrap();
    live.show(&fantex_app::camera::CameraRig::default().camera(), [64, 64]);
    let mut seconds = 0.0;
    settle(&mut live, &mut seconds);
    let error = live.error.clone().unwrap();
    assert!(error.contains("none.toml:") && error.contains("none.png"), "{error}");
}

/// Another program writes the file while something is changed here: that stays until it is saved or discarded.
#[test]
fn what_is_changed_here_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (mut live, mut seconds) = open(folder.path());
    live.set(1, 0.125);
    let other = LOOK.replace("roughness = 0.25", "roughness = 0.75");
    std::fs::write(folder.path().join("ball.toml"), &other).unwrap();
    settle(&mut live, &mut seconds);
    assert!(live.is_overtaken && live.is_changed());
    assert_eq!((live.numbers[1].value, live.numbers[2].value), (0.125, 0.25));
    live.discard();
    assert!(!live.is_changed());
    assert_eq!((live.numbers[1].value, live.numbers[2].value), (0.5, 0.75));
}

/// The menus do with a look what their keys do.
#[test]
fn menus_save_pictures_of_looks_and_close_them() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = crate::panels::empty();
    viewer.live = Some(open(folder.path()).0);
    let mut harness = crate::panels::harness(viewer, [1280.0, 800.0]);
    for line in ["Save picture", "Close"] {
        for label in ["File", line] {
            let found = harness.query_all_by_label_contains(label);
            found.min_by(|a, b| a.rect().top().total_cmp(&b.rect().top())).unwrap().click();
            harness.run_steps(3);
        }
    }
    let viewer = harness.state_mut();
    assert!(matches!(viewer.take_requests()[..], [Request::Picture { .. }]));
    assert!(viewer.live.is_none());
}

/// What has no effect on a look cannot be chosen, and is not kept for what is opened next.
#[test]
fn looks_are_drawn_without_shading_and_lines() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = crate::panels::empty();
    viewer.live = Some(open(folder.path()).0);
    assert_eq!(viewer.shown_name().as_deref(), Some("ball.toml"));
    let before = viewer.settings.display.clone();
    for command in [Command::StepShading(1), Command::StepOverlay(1), Command::ToggleWireframe] {
        viewer.command(command);
    }
    assert_eq!(viewer.settings.display, before);
    let harness = crate::panels::harness(viewer, [1600.0, 800.0]);
    assert!(harness.get_by_label("Wireframe").accesskit_node().is_disabled());
}

/// The key that saves writes the look, as in any editor; its picture has another one.
#[test]
fn looks_are_saved_by_the_usual_key() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = crate::panels::empty();
    viewer.live = Some(open(folder.path()).0);
    let press = |viewer: &mut Viewer, keys: &str| {
        let (modifiers, key) = parse_keys(keys).unwrap();
        viewer.key(key, modifiers, KeyPhase::Pressed, true);
    };
    viewer.live.as_mut().unwrap().set(1, 0.125);
    press(&mut viewer, "Ctrl+S");
    press(&mut viewer, "Ctrl+S");
    let text = std::fs::read_to_string(folder.path().join("ball.toml")).unwrap();
    assert_eq!(text, LOOK.replace("scale = 0.5", "scale = 0.125"));
    assert!(viewer.take_requests().is_empty());
    press(&mut viewer, "Ctrl+Shift+P");
    assert!(matches!(viewer.take_requests()[..], [Request::Picture { .. }]));
}
