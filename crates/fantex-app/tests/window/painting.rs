//! Painting in the window: strokes are seen at once, undone, saved and there again.

use fantex_store::{VerifyOptions, verify};

use super::display::Display;
use super::{check_success, difference, save_asset, save_model};

#[test]
fn strokes_show_in_the_next_frame_are_undone_and_come_back() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    // The panels of the painter take room from the scene: the view is framed once they are there.
    // The button is still down when the picture is taken, and nothing has waited for streaming.
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"screenshot":{"path":"before.png"}},
        {"color":"#ff2000"},{"brush":{"size":60,"hardness":0.9,"flow":1.0,"smoothing":0.0}},
        {"stroke":{"points":[[0.5,0.75],[0.6,0.78]],"holds":true}},{"wait_painted":60},
        {"screenshot":{"path":"open.png"}},
        {"stroke":{"points":[[0.6,0.78]]}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"done.png"}},
        {"key":"Ctrl+Z"},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"undone.png"}},
        {"key":"Ctrl+Shift+Z"},{"wait_painted":60},{"wait_saved":30},
        {"wait_sharp":60},{"screenshot":{"path":"again.png"}},"quit""##;
    let path = asset.to_string_lossy().into_owned();
    check_success(&display.run(folder.path(), &[&path, "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "before.png", "open.png") > 0.003, "the stroke is seen while it is drawn");
    assert!(difference(at, "open.png", "done.png") < 0.001, "its end changes nothing");
    assert_eq!(difference(at, "before.png", "undone.png"), 0.0);
    assert_eq!(difference(at, "done.png", "again.png"), 0.0);
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
    let steps = r#"{"wait_loaded":120},{"wait_frames":3},{"expect_painting":{"layers":0,"steps":1}},{"view":"top"},{"wait_sharp":120},
        {"screenshot":{"path":"reopened.png"}},"quit""#;
    check_success(&display.run(folder.path(), &[&path, "--paint"], steps));
    assert!(difference(at, "done.png", "reopened.png") < 0.001);
}

#[test]
fn models_become_assets_with_layers_and_panels() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let model = save_model(folder.path());
    let settings = folder.path().join("settings.json");
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},
        {"layer":"add"},{"wait_painted":60},{"layer":{"rename":"Dirt"}},{"wait_painted":60},
        {"symmetry":{"kind":"mirror"}},{"color":"#102080"},{"channels":{"color":true,"material":true}},
        {"stroke":{"points":[[0.6,0.7],[0.7,0.6]]}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"normal.png"}},
        {"layer":{"show":false}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"hidden.png"}},
        {"layer":{"show":true}},{"wait_painted":60},{"paint_tool":"erase"},
        {"stroke":{"points":[[0.6,0.7],[0.7,0.6]]}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"erased.png"}},
        {"hover":[0.65,0.65]},{"wait_frames":3},{"window_screenshot":{"path":"window.png"}},
        {"key":"F1"},{"wait_frames":3},{"window_screenshot":{"path":"help.png"}},{"key":"Escape"},
        {"key":"Tab"},{"wait_frames":3},{"wait_sharp":60},{"window_screenshot":{"path":"wide.png"}},
        {"wait_saved":30},{"expect_painting":{"layers":1}},"quit""##;
    let arguments =
        [model.to_string_lossy(), "--paint".into(), "--settings".into(), settings.to_string_lossy()];
    check_success(&display.run(folder.path(), &arguments.each_ref().map(|a| a.as_ref()), steps));
    let at = folder.path();
    assert!(difference(at, "normal.png", "hidden.png") > 0.003);
    assert!(difference(at, "normal.png", "erased.png") > 0.002);
    assert!(difference(at, "window.png", "help.png") > 0.1);
    assert!(difference(at, "window.png", "wide.png") > 0.1);
    assert!(verify(&at.join("torus.fan"), &VerifyOptions::default()).unwrap().ok);
    let kept = std::fs::read_to_string(&settings).unwrap();
    assert!(kept.contains("\"erase\"") && kept.contains("\"mirror\""), "{kept}");
}

#[test]
fn two_painters_do_not_share_an_asset() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let _other = fantex_store::AssetEditor::open(&asset, &Default::default()).unwrap();
    let steps = r#"{"wait_loaded":60},{"expect_message":"being edited by another program"},"quit""#;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
}
