//! Painting in the window: strokes are seen at once, undone, saved and there again.

use fantex::store::{VerifyOptions, verify};

use super::display::{Display, QUICK_SETTINGS};
use super::{check_success, difference, save_asset, save_asset_of, save_model};

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

/// It is opened again with the channel, which is painted; the camera stays, and so do layers and history.
#[test]
fn a_channel_is_added_and_painted() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"layer":"add"},
        {"stroke":{"points":[[0.5,0.75],[0.6,0.78]]}},{"wait_painted":60},{"wait_sharp":120},{"screenshot":{"path":"before.png"}},
        {"add_channels":["emission"]},{"wait_loaded":120},{"wait_frames":3},{"wait_sharp":120},{"screenshot":{"path":"added.png"}},
        {"expect_painting":{"layers":1,"steps":2}},{"channels":{"color":false,"emission":true}},
        {"stroke":{"points":[[0.6,0.78]]}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"glow.png"}},
        {"key":"Ctrl+Z"},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"undone.png"}},{"wait_saved":30},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "before.png", "added.png") < 0.001);
    assert!(difference(at, "added.png", "glow.png") > 0.001);
    assert!(difference(at, "added.png", "undone.png") < 0.001);
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
}

/// It is taken out again with its paint; the other channels, the layer and its other steps stay.
#[test]
fn a_channel_is_removed_and_height_is_seen_alone() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"layer":"add"},
        {"stroke":{"points":[[0.5,0.75],[0.6,0.78]]}},{"wait_painted":60},
        {"add_channels":["normal","displacement"]},{"wait_loaded":120},{"wait_frames":3},{"wait_sharp":120},{"screenshot":{"path":"flat.png"}},
        {"channels":{"color":false,"height":true}},{"material":{"height":1.0}},{"brush":{"size":90,"hardness":0.2,"flow":1.0}},
        {"stroke":{"points":[[0.4,0.75],[0.5,0.78]]}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"raised.png"}},
        {"see_height":true},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},{"screenshot":{"path":"height.png"}},
        {"window_screenshot":{"path":"window.png"}},
        {"material":{"height":0.0}},{"stroke":{"points":[[0.6,0.25]]}},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},
        {"screenshot":{"path":"carved.png"}},{"key":"Ctrl+Z"},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},
        {"screenshot":{"path":"back.png"}},
        {"see_height":false},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},{"screenshot":{"path":"again.png"}},
        {"remove_channels":["displacement"]},{"wait_loaded":120},{"wait_frames":3},{"wait_sharp":120},{"screenshot":{"path":"removed.png"}},
        {"expect_painting":{"layers":1,"steps":0}},{"wait_saved":30},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "flat.png", "raised.png") > 0.001);
    assert_eq!(difference(at, "height.png", "back.png"), 0.0);
    assert_eq!(difference(at, "raised.png", "again.png"), 0.0);
    // Grey everywhere; white where it was raised, black where it was carved.
    let count = |name: &str, is_counted: fn(u8) -> bool| {
        let (_, _, samples) = super::picture(&at.join(name));
        samples.chunks(3).filter(|p| p[0] == p[1] && p[1] == p[2] && is_counted(p[0])).count()
    };
    assert!(count("height.png", |grey| grey > 240) > count("raised.png", |grey| grey > 240) + 200);
    assert!(count("carved.png", |grey| grey < 10) > count("height.png", |grey| grey < 10) + 200);
    assert!(difference(at, "flat.png", "removed.png") < 0.001, "the relief of the layer is gone");
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
    keep_pictures(at, "height");
}

/// Holes are painted, seen once the materials show them, and closed again.
#[test]
fn opacity_is_painted_and_shown() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"screenshot":{"path":"whole.png"}},
        {"key":"Shift+E"},{"opacity_to":0.0},{"brush":{"size":90,"hardness":0.6,"flow":1.0}},
        {"stroke":{"points":[[0.4,0.75],[0.6,0.78]]}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"opaque.png"}},
        {"show_alpha":"cut_out"},{"wait_loaded":120},{"wait_frames":3},{"wait_sharp":120},{"screenshot":{"path":"hole.png"}},
        {"window_screenshot":{"path":"window.png"}},{"expect_painting":{"steps":2}},
        {"show_alpha":"blended"},{"wait_loaded":120},{"wait_frames":3},{"wait_sharp":120},{"screenshot":{"path":"blended.png"}},
        {"opacity_to":1.0},{"stroke":{"points":[[0.3,0.75],[0.7,0.78]]}},{"stroke":{"points":[[0.3,0.72],[0.7,0.81]]}},
        {"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"closed.png"}},{"wait_saved":30},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "whole.png", "opaque.png") < 0.001, "the materials ignore it");
    assert!(difference(at, "whole.png", "hole.png") > 0.01);
    assert!(difference(at, "whole.png", "blended.png") > 0.01);
    assert!(difference(at, "hole.png", "blended.png") > 0.0);
    assert!(difference(at, "whole.png", "closed.png") < 0.2 * difference(at, "whole.png", "blended.png"));
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
    keep_pictures(at, "opacity");
}

#[test]
fn models_become_assets_with_layers_and_panels() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let model = save_model(folder.path());
    let settings = folder.path().join("settings.json");
    std::fs::write(&settings, QUICK_SETTINGS).unwrap();
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

/// Masks made from the shape, seen alone; the list of layers with its pictures, and a layer dragged through it.
#[test]
fn masks_are_made_and_seen_alone_and_layers_are_dragged() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"three_quarter"},{"wait_sharp":120},
        {"color":"#20c040"},{"layer":"add_fill_everywhere"},{"wait_painted":60},{"layer":{"rename":"Moss"}},{"wait_painted":60},
        {"layer":{"make_mask":{"by":{"slope":{"axis":1}},"from":0.5,"to":0.3}}},{"wait_painted":60},
        {"wait_sharp":60},{"screenshot":{"path":"moss.png"}},
        {"layer":{"see_mask":true}},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},{"screenshot":{"path":"alone.png"}},
        {"layer":"invert_mask"},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},{"screenshot":{"path":"inverted.png"}},
        {"layer":"invert_mask"},{"wait_painted":60},
        {"layer":{"see_mask":false}},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},{"screenshot":{"path":"again.png"}},
        {"color":"#d03020"},{"layer":"add"},{"wait_painted":60},{"brush":{"size":80,"hardness":0.9,"flow":1.0}},
        {"stroke":{"points":[[0.4,0.6],[0.6,0.6]]}},{"wait_painted":60},
        {"layer":"duplicate"},{"wait_painted":60},{"wait_frames":12},{"wait_sharp":60},
        {"window_screenshot":{"path":"window.png"}},
        {"layer":"merge_down"},{"wait_painted":60},{"expect_painting":{"layers":2}},{"wait_saved":30},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "moss.png", "alone.png") > 0.02);
    assert!(difference(at, "alone.png", "inverted.png") > 0.05);
    assert_eq!(difference(at, "moss.png", "again.png"), 0.0);
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
    keep_pictures(at, "layers");
}

/// A group is folded, moved, faded and dissolved; what it shows follows.
#[test]
fn layers_lie_in_groups() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"screenshot":{"path":"base.png"}},
        {"color":"#d03020"},{"brush":{"size":80,"hardness":0.9,"flow":1.0}},
        {"layer":"add"},{"wait_painted":60},{"layer":{"rename":"Red"}},{"stroke":{"points":[[0.4,0.75],[0.6,0.78]]}},{"wait_painted":60},
        {"layer":"group"},{"wait_painted":60},{"layer":{"rename":"Paint"}},{"wait_painted":60},
        {"color":"#2040d0"},{"layer":"add"},{"wait_painted":60},{"layer":{"rename":"Blue"}},
        {"stroke":{"points":[[0.4,0.25],[0.6,0.22]]}},{"wait_painted":60},
        {"layer":"group"},{"wait_painted":60},{"layer":{"rename":"Inner"}},{"layer":{"group_kind":"isolated"}},
        {"layer":{"blend":"multiply"}},{"layer":{"opacity":0.8}},{"layer":{"add_mask":true}},{"wait_painted":60},
        {"wait_frames":12},{"wait_sharp":60},{"screenshot":{"path":"both.png"}},{"window_screenshot":{"path":"window.png"}},
        {"layer":{"select":"Paint"}},{"layer":{"collapse":true}},{"wait_painted":60},{"wait_frames":12},
        {"window_screenshot":{"path":"folded.png"}},
        {"layer":{"show":false}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"hidden.png"}},
        {"layer":{"show":true}},{"layer":"ungroup"},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"ungrouped.png"}},
        {"expect_painting":{"layers":3}},{"wait_saved":30},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "base.png", "both.png") > 0.01);
    assert_eq!(difference(at, "base.png", "hidden.png"), 0.0);
    assert_eq!(difference(at, "both.png", "ungrouped.png"), 0.0);
    assert!(difference(at, "window.png", "folded.png") > 0.002);
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
    keep_pictures(at, "groups");
}

/// A text is seen before it is applied, moved by its handles, taken away and applied.
#[test]
fn a_text_is_placed_by_handles() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"screenshot":{"path":"base.png"}},
        {"color":"#ff2000"},{"text":"fan"},{"paint_tool":"sticker"},{"brush":{"size":90}},
        {"stroke":{"points":[[0.5,0.78]]}},{"wait_painted":60},{"wait_frames":3},{"wait_sharp":60},{"screenshot":{"path":"placed.png"}},
        {"window_screenshot":{"path":"window.png"}},{"expect_painting":{"steps":0}},
        {"stroke":{"points":[[0.5,0.78],[0.4,0.76]]}},{"wait_painted":60},{"wait_frames":3},{"wait_painted":60},{"wait_sharp":60},
        {"screenshot":{"path":"moved.png"}},
        {"key":"Escape"},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"gone.png"}},{"expect_painting":{"steps":0}},
        {"stroke":{"points":[[0.5,0.78]]}},{"wait_painted":60},{"key":"Enter"},{"wait_painted":60},{"wait_sharp":60},
        {"screenshot":{"path":"applied.png"}},{"expect_painting":{"steps":1}},{"wait_saved":30},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "base.png", "placed.png") > 0.003);
    assert!(difference(at, "placed.png", "moved.png") > 0.003);
    assert_eq!(difference(at, "base.png", "gone.png"), 0.0);
    assert!(difference(at, "placed.png", "applied.png") < 0.001, "it was seen as it is");
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
    keep_pictures(at, "placing");
}

/// Leaves pictures for the eye where `FANTEX_PICTURES` names a folder.
pub(super) fn keep_pictures(from: &std::path::Path, name: &str) {
    let Some(to) = std::env::var_os("FANTEX_PICTURES") else { return };
    let to = std::path::Path::new(&to).join(name);
    std::fs::create_dir_all(&to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|end| end == "png") {
            std::fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
        }
    }
}

#[test]
fn two_painters_do_not_share_an_asset() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let _other = fantex::store::AssetEditor::open(&asset, &Default::default()).unwrap();
    let steps = r#"{"wait_loaded":60},"quit""#;
    let output = display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("being edited by another program") && told.lines().count() == 1, "{told}");
    // In a window that shows it, it is a message.
    let steps = r#"{"wait_loaded":60},{"wait_frames":3},{"key":"Ctrl+T"},{"wait_loaded":60},
        {"expect_message":"being edited by another program"},"quit""#;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy()], steps));
}

/// White rings on black, and a look with a texture.
fn save_pictures(folder: &std::path::Path) {
    let texel = |i: usize| {
        let (x, y) = ((i % 128) as f32 - 63.5, (i / 128) as f32 - 63.5);
        let is_ring = ((x.hypot(y) / 10.0) as u32).is_multiple_of(2) && x.hypot(y) < 60.0;
        let light = if is_ring { 1.0 } else { 0.0 };
        [light, light, light, 1.0]
    };
    let texels: Vec<[f32; 4]> = (0..128 * 128).map(texel).collect();
    fantex::texture::Image::from_linear_rgb(128, 128, &texels).save(folder.join("rings.png")).unwrap();
    std::fs::write(
        folder.join("a.toml"),
        "[textures.squares]\nkind = \"checker\"\nplace = { scale = 0.3 }\n",
    )
    .unwrap();
}

#[test]
fn pictures_over_the_view_and_textures_are_painted_with() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    save_pictures(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"screenshot":{"path":"before.png"}},
        {"color":"#ff2000"},{"brush":{"size":90,"hardness":1.0,"flow":1.0,"smoothing":0.0}},
        {"stencil":{"is_on":true,"image":"rings.png","opacity":0.4}},"fit_stencil",
        {"stroke":{"points":[[0.3,0.75],[0.7,0.75]]}},{"wait_painted":60},
        {"hover":[0.5,0.6]},{"wait_sharp":60},{"screenshot":{"path":"through.png"}},{"window_screenshot":{"path":"overlay.png"}},
        {"adjust_stencil":true},{"stroke":{"points":[[0.5,0.5],[0.6,0.4]]}},{"hover":[0.5,0.9]},{"wait_frames":3},
        {"window_screenshot":{"path":"moved.png"}},{"wait_painted":60},{"expect_painting":{"steps":1}},
        {"adjust_stencil":false},"project",{"wait_painted":120},{"wait_sharp":60},{"screenshot":{"path":"projected.png"}},
        {"expect_painting":{"steps":2}},{"stencil":{}},
        {"texture":{"source":"solid","solid":"marble","scale":0.5}},
        {"stroke":{"points":[[0.3,0.25],[0.7,0.25]]}},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"marble.png"}},
        {"texture":{"source":"look","look":"a.toml"}},{"layer":"add_fill_everywhere"},{"wait_painted":120},{"wait_sharp":60},
        {"screenshot":{"path":"squares.png"}},{"wait_frames":3},{"window_screenshot":{"path":"look.png"}},
        {"texture":{"source":"solid","solid":"wood"}},{"layer":"refill"},{"wait_painted":120},{"wait_sharp":60},
        {"screenshot":{"path":"wood.png"}},{"expect_painting":{"layers":1,"steps":5}},
        {"key":"Ctrl+Z"},{"key":"Ctrl+Z"},{"wait_painted":120},{"wait_sharp":60},{"screenshot":{"path":"undone.png"}},
        {"expect_painting":{"layers":0,"steps":3}},{"wait_saved":30},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    for (before, after, least) in [
        ("before.png", "through.png", 0.003),
        ("overlay.png", "moved.png", 0.01),
        ("through.png", "projected.png", 0.01),
        ("projected.png", "marble.png", 0.01),
        ("marble.png", "squares.png", 0.1),
        ("squares.png", "wood.png", 0.1),
    ] {
        assert!(difference(at, before, after) > least, "{before} {after}");
    }
    assert_eq!(difference(at, "marble.png", "undone.png"), 0.0);
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
}

/// A fill of all the texels and a projection, each stopped in the middle; a click beside the model.
#[test]
fn what_takes_long_is_stopped_by_a_key() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset_of(folder.path(), 6_000_000);
    save_pictures(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"screenshot":{"path":"before.png"}},
        {"window_screenshot":{"path":"hint.png"}},{"stroke":{"points":[[0.02,0.02]]}},{"wait_frames":3},
        {"window_screenshot":{"path":"missed.png"}},
        {"color":"#ff2000"},{"paint_tool":"fill"},{"fill":"whole"},{"stroke":{"points":[[0.5,0.75]]}},{"wait_working":60},{"key":"Escape"},
        {"wait_painted":120},{"expect_painting":{"steps":0}},
        {"stencil":{"is_on":true,"image":"rings.png"}},"fit_stencil","project",{"wait_working":60},{"key":"Escape"},
        {"wait_painted":120},{"expect_painting":{"steps":0}},
        {"stencil":{}},{"hover":[0.02,0.02]},{"wait_sharp":120},{"screenshot":{"path":"stopped.png"}},
        {"paint_tool":"fill"},{"stroke":{"points":[[0.5,0.75]]}},{"wait_painted":240},{"expect_painting":{"steps":1}},
        {"hover":[0.02,0.02]},{"wait_sharp":120},{"screenshot":{"path":"filled.png"}},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "hint.png", "missed.png") > 0.0005, "the status line tells");
    assert_eq!(difference(at, "before.png", "stopped.png"), 0.0);
    assert!(difference(at, "before.png", "filled.png") > 0.1);
    assert!(verify(&asset, &VerifyOptions::default()).unwrap().ok);
}

#[test]
fn the_step_after_a_stroke_waits_for_the_hand_and_the_model_is_framed_between_the_panels() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    // Each stroke has its own colour, though nothing waits between them.
    let steps = r##"{"wait_loaded":120},{"wait_sharp":120},{"screenshot":{"path":"opened.png"}},
        {"key":"F"},{"wait_sharp":60},{"screenshot":{"path":"framed.png"}},
        {"view":"top"},{"brush":{"size":50,"hardness":1.0,"flow":1.0,"smoothing":0.0}},
        {"color":"#ff0000"},{"stroke":{"points":[[0.4,0.72],[0.5,0.74]],"frames":9}},
        {"color":"#00ff00"},{"stroke":{"points":[[0.6,0.72],[0.7,0.68]],"frames":9}},
        {"color":"#0000ff"},{"stroke":{"points":[[0.4,0.28],[0.6,0.28]],"frames":9}},
        {"wait_painted":60},{"shading":"base_color"},{"hover":[0.5,0.5]},{"wait_sharp":60},{"screenshot":{"path":"colors.png"}},
        {"expect_painting":{"steps":3}},"quit""##;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "opened.png", "framed.png") < 0.001, "framed at once as later");
    let (_, _, samples) = super::picture(&at.join("colors.png"));
    for wanted in [[255, 0, 0], [0, 255, 0], [0, 0, 255]] {
        let is_wanted = |p: &&[u8]| p.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) < 40);
        let count = samples.chunks(3).filter(is_wanted).count();
        assert!(count > 500, "{wanted:?}: {count}");
    }
}

/// The questions before a model is painted on, in pictures and in files.
#[test]
fn models_ask_and_their_paint_moves_to_another_mesh() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    save_model(at);
    let other = fantex::mesh::generate::torus(40, 20);
    let geometry = fantex::mesh::WriteGeometry {
        positions: &other.positions,
        triangles: &other.triangles,
        colors: None,
    };
    fantex::mesh::write_model(&at.join("other.ply"), &geometry, false).unwrap();
    let steps = r##"{"asks":true},{"open":"torus.ply"},{"wait_loaded":120},{"wait_frames":3},{"window_screenshot":{"path":"new.png"}},
        {"answer":{"new":{"texels":300000,"normal":true}}},{"wait_loaded":240},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},
        {"color":"#ff2000"},{"brush":{"size":120,"hardness":1.0,"flow":1.0,"only_seen":true}},
        {"stroke":{"points":[[0.5,0.75],[0.6,0.78]]}},{"wait_painted":60},{"wait_saved":30},{"wait_sharp":60},{"screenshot":{"path":"painted.png"}},
        {"window_screenshot":{"path":"brush.png"}},
        {"export":{"path":"out.glb","preset":"unreal","side":256}},{"wait_exported":240},{"save_copy":"copy.fan"},{"wait_exported":60},
        {"copy":{"from":"other.ply","to":"torus.ply"}},{"open":"torus.ply"},{"wait_loaded":120},{"wait_frames":3},{"window_screenshot":{"path":"foreign.png"}},
        {"answer":{"replay":{"texels":300000}}},{"wait_loaded":240},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},
        {"hover":[0.02,0.02]},{"wait_frames":3},{"screenshot":{"path":"moved.png"}},{"expect_painting":{"steps":1}},"quit""##;
    check_success(&display.run(at, &["--paint"], steps));
    assert!(difference(at, "new.png", "foreign.png") > 0.01);
    assert!(
        difference(at, "painted.png", "moved.png") < 0.05,
        "{}",
        difference(at, "painted.png", "moved.png")
    );
    let reds = |name: &str| {
        let (_, _, samples) = super::picture(&at.join(name));
        samples.chunks(3).filter(|p| p[0] > 120 && p[1] < 90 && p[2] < 90).count() as f64
    };
    let [painted, moved] = ["painted.png", "moved.png"].map(reds);
    assert!(painted > 2000.0 && (moved / painted - 1.0).abs() < 0.1, "{painted} {moved}");
    assert!(at.join("torus-old-001.fan").is_file() && at.join("out_ORM.png").is_file());
    assert!(verify(&at.join("copy.fan"), &VerifyOptions::default()).unwrap().ok);
    assert!(verify(&at.join("torus.fan"), &VerifyOptions::default()).unwrap().ok);
}

/// By the system, or by Ctrl-C in the terminal.
#[cfg(target_os = "linux")]
#[test]
fn what_is_painted_is_saved_where_the_program_is_asked_to_end() {
    use std::process::{Command, Stdio};
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r#"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_frames":3},
        {"stroke":{"points":[[0.5,0.75],[0.6,0.78]]}},{"wait_painted":60},{"screenshot":{"path":"painted.png"}},
        {"wait_file":{"path":"never","seconds":240}}"#;
    let mut command = display.command(folder.path(), &[&asset.to_string_lossy(), "--paint"], steps);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    super::display::wait_for(&folder.path().join("painted.png"));
    let asked = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    assert!(asked.success());
    check_success(&child.wait_with_output().unwrap());
    let painter = fantex::paint::Painter::open(&asset, &fantex::paint::PaintOptions::default()).unwrap();
    assert_eq!(painter.history().done().len(), 1);
}
