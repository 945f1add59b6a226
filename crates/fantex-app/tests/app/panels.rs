//! Panels without a window: they show what is there, and clicks change what they promise.

use std::path::Path;
use std::sync::Arc;

use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{AccessKitNode, Queryable};

use fantex::glam::DVec2;
use fantex::paint::{MaskMeasure, Target, Tip};
use fantex::store::{Asset, ChannelKind};
use fantex_app::camera::{CameraMode, ViewPreset};
use fantex_app::command::{Command, keys_of};
use fantex_app::display::TONE_MAPS;
use fantex_app::document::{ChannelFact, Document, Fact, Place};
use fantex_app::figures::{DamagedPart, LevelFigures, ObjectFigures};
use fantex_app::paint::{LayerAction, PaintCommand, Painting, PenEvent, PenPhase};
use fantex_app::panels::{AtlasTexture, Textures, show};
use fantex_app::settings::{PanelSettings, Settings, Tab};
use fantex_app::theme;
use fantex_app::viewer::{FileDialog, Request, SceneInput, Viewer};

pub(crate) fn empty() -> Viewer {
    Viewer::new(Settings::default(), None, Arc::new(|| {}))
}

pub(crate) fn with_model() -> Viewer {
    let model = fantex::mesh::generate::torus(24, 12);
    let (mesh, report) = fantex::mesh::clean(model, &fantex::mesh::CleanOptions::default()).unwrap();
    let mut viewer = empty();
    let notes = vec!["12 vertices welded to an earlier vertex at the same place.".to_owned()];
    viewer.document = Some(Document::of_model(Place::parse("torus.ply"), Arc::new(mesh), &report, notes));
    viewer
}

pub(crate) fn harness(viewer: Viewer, size: [f32; 2]) -> Harness<'static, Viewer> {
    let mut is_dressed = false;
    Harness::builder().with_size(vec2(size[0], size[1])).build_ui_state(
        move |ui, viewer: &mut Viewer| {
            if !std::mem::replace(&mut is_dressed, true) {
                theme::apply(ui.ctx());
            }
            show(ui, viewer, &Textures::default());
        },
        viewer,
    )
}

#[test]
fn the_welcome_asks_for_a_file() {
    let mut viewer = empty();
    viewer.settings.remember("/data/bunny.fan");
    let mut harness = harness(viewer, [1280.0, 800.0]);
    harness.get_by_label_contains("Open a file").click();
    harness.run_steps(2);
    assert_eq!(harness.state_mut().take_requests(), [Request::Dialog(FileDialog::Open)]);
    harness.get_by_label_contains("/data/bunny.fan").click();
    harness.run_steps(2);
    assert!(harness.state().opening.is_some());
}

/// In a narrow window the line below the scene leaves out what it has no room for, and nothing lies over anything else.
#[test]
fn the_status_line_fits_into_narrow_windows() {
    for (width, has_adapter) in [(1280.0, true), (700.0, false), (480.0, false)] {
        let mut viewer = with_model();
        viewer.adapter = "some card".into();
        let harness = harness(viewer, [width, 320.0]);
        assert_eq!(harness.query_by_label("some card").is_some(), has_adapter, "{width}");
        let [name, hint] = ["torus.ply", "Drag turns"]
            .map(|text| harness.query_all_by_label_contains(text).map(|node| node.rect()))
            .map(|all| all.max_by(|a, b| a.top().total_cmp(&b.top())).unwrap());
        assert!(name.right() < hint.left() && hint.right() <= width, "{width}: {name} {hint}");
        if let Some(card) = harness.query_by_label("some card") {
            assert!(hint.right() < card.rect().left(), "{width}");
        }
    }
}

#[test]
fn camera_modes_are_buttons() {
    let mut harness = harness(with_model(), [1280.0, 800.0]);
    harness.get_by_label("Fly").click();
    harness.run_steps(2);
    assert_eq!(harness.state().settings.camera.mode, CameraMode::Fly);
}

#[test]
fn the_model_page_shows_facts_and_report() {
    let harness = harness(with_model(), [1280.0, 800.0]);
    harness.get_by_label("Triangles");
    harness.get_by_label("576");
    harness.get_by_label_contains("12 vertices welded");
}

#[test]
fn every_page_is_shown_at_every_size() {
    for size in [[1280.0, 800.0], [1920.0, 1080.0], [640.0, 400.0], [220.0, 160.0]] {
        for (tab, _) in Tab::ALL {
            for mut viewer in [empty(), with_model()] {
                viewer.settings.panels =
                    PanelSettings { tab, has_atlas: true, has_graphs: true, ..PanelSettings::default() };
                viewer.has_help = true;
                viewer
                    .notices
                    .error("Something went wrong, and this is a long sentence that says what it was.");
                let mut harness = harness(viewer, size);
                harness.run_steps(3);
            }
        }
    }
}

#[test]
fn the_light_page_turns_the_sun_off_and_on() {
    let mut viewer = with_model();
    viewer.settings.panels.tab = Tab::Light;
    let mut harness = harness(viewer, [1280.0, 800.0]);
    harness.get_by_label("Reset");
    harness.state_mut().settings.light.sun_strength = 3.0;
    harness.get_by_label("Reset").click();
    harness.run_steps(2);
    assert_eq!(harness.state().settings.light.sun_strength, 1.0);
}

/// *Reset* brings tone and exposure back, too.
#[test]
fn the_tone_curve_is_chosen_and_reset() {
    let mut viewer = with_model();
    viewer.settings.panels.tab = Tab::Light;
    let mut harness = harness(viewer, [1280.0, 1000.0]);
    let [clip, reinhard, filmic] = TONE_MAPS.map(|(tone, _)| tone);
    for (shown, name, chosen) in [("Filmic", "Reinhard", reinhard), ("Reinhard", "Clip", clip)] {
        let is_list = |node: &AccessKitNode<'_>| {
            node.role() == Role::ComboBox && node.value().as_deref() == Some(shown)
        };
        harness.get_by(is_list).click();
        harness.run_steps(3);
        harness.get_by_label(name).click();
        harness.run_steps(3);
        assert!(harness.state().settings.display.tone == chosen, "{name}");
    }
    harness.state_mut().settings.display.exposure_stops = 1.5;
    harness.run_steps(2);
    harness.get_by_label("Reset").click();
    harness.run_steps(2);
    let display = &harness.state().settings.display;
    assert!(display.tone == filmic && display.exposure_stops == 0.0);
}

#[test]
fn the_view_page_has_the_field_of_view() {
    let mut viewer = with_model();
    viewer.settings.panels.tab = Tab::View;
    let harness = harness(viewer, [1280.0, 800.0]);
    assert!(harness.query_all_by_label("Field of view").next().is_some());
    assert!(harness.query_all_by_label("Looks at").next().is_some());
}

#[test]
fn help_opens_and_closes() {
    let mut harness = harness(with_model(), [1280.0, 800.0]);
    harness.get_by_label("?").click();
    harness.run_steps(3);
    assert!(harness.state().has_help);
    harness.get_by_label_contains("four times").rect();
}

#[test]
fn errors_stay_until_they_are_dismissed() {
    let mut viewer = with_model();
    viewer.notices.error("bunny.fan is damaged.");
    let mut harness = harness(viewer, [1280.0, 800.0]);
    harness.get_by_label_contains("bunny.fan is damaged");
    harness.get_by_label("×").click();
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("bunny.fan is damaged").is_none());
}

#[test]
fn keys_in_the_scene_become_wishes() {
    let mut viewer = with_model();
    viewer.scene_pixels = [800, 600];
    let wishes = Arc::new(std::sync::Mutex::new(Vec::new()));
    let seen = wishes.clone();
    let mut harness = Harness::builder().with_size(vec2(1280.0, 800.0)).build_ui_state(
        move |ui, viewer: &mut Viewer| {
            seen.lock().unwrap().push(show(ui, viewer, &Textures::default()).input.movement);
        },
        viewer,
    );
    harness.key_down_modifiers(Modifiers::NONE, Key::W);
    harness.run_steps(2);
    assert_eq!(wishes.lock().unwrap().last().unwrap().forward, 1.0);
    harness.key_up_modifiers(Modifiers::NONE, Key::W);
    harness.run_steps(2);
    assert_eq!(wishes.lock().unwrap().last().unwrap().forward, 0.0);
}

/// A window in which keys do what they do in the program's.
fn with_keys(viewer: Viewer) -> Harness<'static, Viewer> {
    Harness::builder().with_size(vec2(1280.0, 800.0)).build_ui_state(
        |ui, viewer: &mut Viewer| {
            let ctx = ui.ctx().clone();
            viewer.keys(&ctx);
            show(ui, viewer, &Textures::default());
        },
        viewer,
    )
}

/// Only what is typed into a field is no command: a button that has the focus leaves the keys alone, and Tab does not go there.
#[test]
fn keys_are_commands_where_nothing_is_typed() {
    let mut viewer = with_model();
    viewer.settings.panels.tab = Tab::View;
    let mut harness = with_keys(viewer);
    for is_shown in [false, true] {
        harness.key_press(Key::Tab);
        harness.run_steps(2);
        assert_eq!(harness.state().settings.panels.has_inspector, is_shown);
        assert!(!harness.ctx.egui_wants_keyboard_input());
    }
    harness.get_by_label("Fly").focus();
    harness.run_steps(2);
    harness.key_press(Key::G);
    harness.run_steps(2);
    assert!(harness.ctx.egui_wants_keyboard_input() && harness.state().settings.panels.has_graphs);
    harness.get_all_by_role(Role::SpinButton).next().unwrap().focus();
    harness.run_steps(2);
    for key in [Key::G, Key::Tab] {
        harness.key_press(key);
        harness.run_steps(2);
    }
    let panels = &harness.state().settings.panels;
    assert!(panels.has_graphs && panels.has_inspector);
}

/// An asset on a page of the inspector.
pub(crate) fn with_asset(tab: Tab) -> Viewer {
    let folder = tempfile::tempdir().unwrap();
    let path = crate::painting::small_asset(folder.path());
    let mut viewer = empty();
    let asset = Arc::new(Asset::open(&path).unwrap());
    viewer.document = Some(Document::of_asset(Place::File(path), asset));
    viewer.settings.panels.tab = tab;
    viewer
}

#[test]
fn damage_is_listed() {
    let mut viewer = with_asset(Tab::Streaming);
    let figures = &mut viewer.figures;
    figures.levels = vec![
        LevelFigures { resident: 3_000_000, texels: 9_000_000 },
        LevelFigures { resident: 4, texels: 4 },
    ];
    figures.damaged = vec![DamagedPart {
        part: "group 7, level 2, page 0,0".into(),
        reason: "its checksum is wrong".into(),
    }];
    figures.damaged_count = 1;
    let mut harness = harness(viewer, [1280.0, 1000.0]);
    harness.run_steps(2);
    harness.get_by_label_contains("group 7, level 2");
    harness.get_by_label("33.3 % of 9.0 M texels");
    // It may be there again.
    harness.get_by_label("Read again").click();
    harness.run_steps(2);
    assert_eq!(harness.state().retries, 1);
}

#[test]
fn facts_stand_beside_their_names() {
    let mut viewer = with_asset(Tab::Cover);
    if let Some(document) = &mut viewer.document {
        document.cover_facts = vec![Fact { name: "Levels", value: "9".into() }];
        document.channels = vec![ChannelFact { kind: "Normal", format: "BC5".into() }];
    }
    let mut harness = harness(viewer, [1280.0, 800.0]);
    harness.run_steps(1);
    harness.get_by_label("Levels");
    harness.get_by_label("Channels");
    harness.get_by_label("BC5");
}

pub(crate) fn with_painting(folder: &Path) -> Viewer {
    let path = crate::painting::small_asset(folder);
    let painter = fantex::paint::Painter::open(&path, &fantex::paint::PaintOptions::default()).unwrap();
    let asset = painter.editor().asset().clone();
    let mut viewer = empty();
    viewer.document = Some(Document::of_asset(Place::File(path), asset));
    viewer.painting = Some(fantex_app::paint::Painting::new(painter, None, Arc::new(|| {})).unwrap());
    viewer.paints = true;
    viewer
}

/// Until the painter has done what it was asked for.
pub(crate) fn wait_painted(viewer: &mut Viewer) {
    let started = std::time::Instant::now();
    loop {
        let is_busy = viewer.painting.as_ref().unwrap().is_busy();
        viewer.poll();
        if !is_busy {
            return;
        }
        assert!(started.elapsed() < fantex_test::PATIENCE, "the painter does not end");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
}

#[test]
fn tools_and_layers_are_chosen_with_the_mouse() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), [1380.0, 860.0]);
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    harness.get_by_label("Erase tool").click();
    harness.run_steps(2);
    assert_eq!(harness.state().settings.paint.tool, fantex_app::paint::PaintTool::Erase);
    harness.get_by_label("Hard round").click();
    harness.run_steps(2);
    assert_eq!(harness.state().settings.paint.brush.hardness, 0.95);
    harness.get_by_label("Add").click();
    harness.run_steps(2);
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    harness.get_by_label("Layer 1");
    harness.get_by_label("Undo").click();
    harness.run_steps(2);
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    assert!(harness.query_by_label("Layer 1").is_none());
    harness.get_by_label("Light").click();
    harness.run_steps(2);
    harness.get_by_label("Rim").click();
    harness.run_steps(2);
    assert!(fantex_app::light::LightPreset::Rim.is_in(&harness.state().settings.light));
}

/// A click on *Original* takes all back, one on a step does it again.
#[test]
fn the_history_goes_back_to_the_original() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), [1380.0, 1500.0]);
    let click = |harness: &mut Harness<'static, Viewer>, label: &str| {
        harness.get_by_label(label).click();
        harness.run_steps(2);
        wait_painted(harness.state_mut());
        harness.run_steps(2);
    };
    let layers =
        |harness: &Harness<'static, Viewer>| harness.state().painting.as_ref().unwrap().snapshot.layers.len();
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    let [channels, history] = ["Channels", "History"].map(|label| harness.get_by_label(label).rect());
    assert!(history.left() == channels.left() && history.top() > channels.top());
    click(&mut harness, "Add");
    assert_eq!(layers(&harness), 1);
    click(&mut harness, "Original");
    assert_eq!(layers(&harness), 0);
    click(&mut harness, "1   add layer");
    assert_eq!(layers(&harness), 1);
}

/// However long it is, what is in sight is laid out, and it ends with the last step.
#[test]
fn a_long_history_costs_no_more_than_a_short_one() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = with_painting(folder.path());
    wait_painted(&mut viewer);
    let snapshot = &mut viewer.painting.as_mut().unwrap().snapshot;
    (snapshot.older, snapshot.done) = (500, vec!["paint".to_owned(); 998]);
    snapshot.undone = vec!["fill".to_owned(), "blur".to_owned()];
    let mut harness = harness(viewer, [1380.0, 1500.0]);
    harness.run_steps(4);
    let laid_out = harness.query_all_by_label_contains("   paint").count();
    assert!((2..40).contains(&laid_out), "{laid_out}");
    for last in ["1498   paint", "1499   blur", "1500   fill"] {
        harness.get_by_label(last);
    }
}

#[test]
fn textured_brushes_are_taken_by_their_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), [1380.0, 1500.0]);
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    harness.get_by_label("Chalk").click();
    harness.run_steps(2);
    assert_eq!(harness.state().settings.paint.brush.tip, Some(Tip::Chalk));
    // As sessions do.
    harness.state_mut().take_preset("Grass").unwrap();
    assert_eq!(harness.state().settings.paint.brush.tip, Some(Tip::Rake));
    let refused = harness.state_mut().take_preset("Feather").unwrap_err().to_string();
    assert!(refused.contains("Feather"), "{refused}");
    assert_eq!(harness.state().settings.paint.brush.name, "Grass", "it stays as it was");
}

/// A model for [`asking`].
pub(crate) const TRIANGLE: &str = "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n";

/// A painter that has opened a model and asks what its asset is to be like.
pub(crate) fn asking(model: &Path) -> Viewer {
    let mut viewer = empty();
    (viewer.paints, viewer.asks) = (true, true);
    viewer.open_file(model.to_owned());
    let started = std::time::Instant::now();
    while viewer.opening.is_some() {
        assert!(started.elapsed() < fantex_test::PATIENCE, "it does not open");
        std::thread::sleep(std::time::Duration::from_millis(2));
        viewer.poll();
    }
    assert!(viewer.asked.is_some());
    viewer
}

/// What is asked before a model is painted on, answered with clicks.
#[test]
fn how_a_model_becomes_an_asset_is_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("triangle.obj");
    std::fs::write(&path, TRIANGLE).unwrap();
    let mut viewer = asking(&path);
    for size in [[640.0, 400.0], [1280.0, 800.0]] {
        let mut harness = harness(std::mem::take(&mut viewer), size);
        harness.get_by_label_contains("triangle.fan");
        harness.get_by_label("Height").click();
        harness.run_steps(2);
        assert!(harness.state().asked.as_ref().is_some_and(|asked| asked.new.height != (size[0] > 700.0)));
        if size[0] > 700.0 {
            harness.get_by_label("Cancel").click();
            harness.run_steps(2);
            assert!(harness.state().asked.is_none() && harness.state().opening.is_none());
        }
        viewer = std::mem::take(harness.state_mut());
    }
    assert!(!folder.path().join("triangle.fan").exists());
}

/// While something is painted on, a digit is opacity, and no menu says that it turns the view.
#[test]
fn menus_show_the_keys_that_hold() {
    let back = Command::View(ViewPreset::Back);
    assert_eq!(keys_of(false, &back).as_deref(), Some("5"));
    assert_eq!(keys_of(true, &back), None);
    assert_eq!(keys_of(true, &Command::FrameAll).as_deref(), Some("F"));
    assert_eq!(keys_of(true, &Command::Save), None, "Ctrl + S saves what is painted");
    assert_eq!(keys_of(true, &Command::Screenshot).as_deref(), Some("Ctrl + Shift + P"));
}

/// The pointer through some places with the button held, as a mouse moves, with a frame after each; then the button is let go.
fn drag(harness: &mut Harness<'static, Viewer>, way: &[Pos2]) {
    let step = |harness: &mut Harness<'static, Viewer>, event: Event| {
        harness.event(event);
        harness.run_steps(1);
        wait_painted(harness.state_mut());
        harness.run_steps(1);
    };
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    step(harness, Event::PointerMoved(way[0]));
    step(harness, button(way[0], true));
    for pair in way.windows(2) {
        for k in 1..=8 {
            step(harness, Event::PointerMoved(pair[0].lerp(pair[1], k as f32 / 8.0)));
        }
    }
    step(harness, button(way[way.len() - 1], false));
}

/// Names of the layers with the groups around them, from the top.
fn listed(harness: &Harness<'static, Viewer>) -> Vec<String> {
    let snapshot = &harness.state().painting.as_ref().unwrap().snapshot;
    let rows = fantex_app::paint::layer_rows(&snapshot.layers, &snapshot.collapsed, None);
    rows.iter().map(|(row, layer)| format!("{}{}", "  ".repeat(row.depth), layer.name)).collect()
}

/// Into a group, to its bottom, out of it to the left; a group with all that is in it; into one that is folded. Each is one step.
#[test]
fn layers_are_dragged_with_the_mouse_into_groups_and_out_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = with_painting(folder.path());
    for _ in 0..3 {
        viewer.layer_action(&LayerAction::Add);
        wait_painted(&mut viewer);
    }
    let ids: Vec<u64> =
        viewer.painting.as_ref().unwrap().snapshot.layers.iter().map(|layer| layer.id()).collect();
    for action in [LayerAction::Group(ids[1]), LayerAction::Move(ids[2], true)] {
        viewer.layer_action(&action);
        wait_painted(&mut viewer);
    }
    let mut harness = harness(viewer, [1380.0, 1600.0]);
    harness.run_steps(2);
    assert_eq!(listed(&harness), ["Layer 3", "Group 1", "  Layer 2", "Layer 1"]);
    let steps =
        |harness: &Harness<'static, Viewer>| harness.state().painting.as_ref().unwrap().snapshot.done.len();
    let before = steps(&harness);
    let middle = |harness: &Harness<'static, Viewer>, name: &str| harness.get_by_label(name).rect().center();
    let row = middle(&harness, "Group 1").y - middle(&harness, "Layer 3").y;
    assert!(row > 20.0);

    let from = middle(&harness, "Layer 3");
    drag(&mut harness, &[from, from + vec2(0.0, row)]);
    assert_eq!(listed(&harness), ["Group 1", "  Layer 3", "  Layer 2", "Layer 1"]);
    let from = middle(&harness, "Layer 3");
    drag(&mut harness, &[from, from + vec2(0.0, row)]);
    assert_eq!(listed(&harness), ["Group 1", "  Layer 2", "  Layer 3", "Layer 1"]);
    let from = middle(&harness, "Layer 3");
    drag(&mut harness, &[from, from - vec2(40.0, 0.0)]);
    assert_eq!(listed(&harness), ["Group 1", "  Layer 2", "Layer 3", "Layer 1"]);
    let from = middle(&harness, "Layer 3");
    drag(&mut harness, &[from, from + vec2(40.0, 0.0)]);
    assert_eq!(listed(&harness), ["Group 1", "  Layer 2", "  Layer 3", "Layer 1"]);
    // All that is in it comes along.
    let from = middle(&harness, "Group 1");
    drag(&mut harness, &[from, from + vec2(0.0, 1.2 * row)]);
    assert_eq!(listed(&harness), ["Layer 1", "Group 1", "  Layer 2", "  Layer 3"]);
    assert_eq!(steps(&harness), before + 5);
    // There and back is no step.
    let from = middle(&harness, "Layer 1");
    drag(&mut harness, &[from, from + vec2(0.0, row), from]);
    assert_eq!(listed(&harness), ["Layer 1", "Group 1", "  Layer 2", "  Layer 3"]);
    assert_eq!(steps(&harness), before + 5);
    // Into a folded group, which unfolds.
    harness.get_by_label("Fold Group 1").click();
    harness.run_steps(1);
    wait_painted(harness.state_mut());
    harness.run_steps(1);
    assert_eq!(listed(&harness), ["Layer 1", "Group 1"]);
    let from = middle(&harness, "Layer 1");
    drag(&mut harness, &[from, from + vec2(0.0, row), from + vec2(40.0, row)]);
    assert_eq!(listed(&harness), ["Group 1", "  Layer 1", "  Layer 2", "  Layer 3"]);
    for _ in 0..6 {
        harness.get_by_label("Undo").click();
        harness.run_steps(1);
        wait_painted(harness.state_mut());
        harness.run_steps(1);
    }
    assert_eq!(listed(&harness), ["Layer 3", "Group 1", "  Layer 2", "Layer 1"]);
}

/// Opened again with other channels.
fn wait_opened(harness: &mut Harness<'static, Viewer>) {
    let started = std::time::Instant::now();
    while harness.state().is_opening() {
        assert!(started.elapsed() < fantex_test::PATIENCE, "it does not open");
        std::thread::sleep(std::time::Duration::from_millis(5));
        harness.state_mut().poll();
    }
    wait_painted(harness.state_mut());
    harness.run_steps(2);
}

/// What is lost is said before, and nothing is until the answer.
#[test]
fn channels_are_removed_once_the_user_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), [1380.0, 1600.0]);
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    let kinds = |harness: &Harness<'static, Viewer>| -> Vec<ChannelKind> {
        harness.state().painting.as_ref().unwrap().channels.iter().map(|channel| channel.kind).collect()
    };
    let before = kinds(&harness);
    harness.state_mut().add_channels(&[ChannelKind::Emission]);
    wait_opened(&mut harness);
    harness.state_mut().layer_action(&LayerAction::Add);
    wait_painted(harness.state_mut());
    // Else the layer's own switches are there, too.
    harness.state_mut().layer_action(&LayerAction::Select(Target::Base));
    harness.run_steps(2);
    let choose = |harness: &mut Harness<'static, Viewer>| {
        harness.get_by_label("Remove channel").click();
        harness.run_steps(2);
        // The switch of the brush is no button.
        harness.get_by_role_and_label(Role::Button, "Emission").click();
        harness.run_steps(2);
    };
    choose(&mut harness);
    assert_eq!(harness.state().removal, Some(ChannelKind::Emission));
    harness.get_by_label_contains("on the base and on the layer. This cannot be undone.");
    harness.get_by_label("Cancel").click();
    harness.run_steps(2);
    assert!(harness.state().removal.is_none() && harness.state().opening.is_none());
    choose(&mut harness);
    harness.state_mut().command(Command::Cancel);
    assert!(harness.state().removal.is_none());
    harness.run_steps(2);
    choose(&mut harness);
    harness.get_by_label("Remove the channel").click();
    harness.run_steps(2);
    wait_opened(&mut harness);
    assert_eq!(kinds(&harness), before);
    assert_eq!(harness.state().painting.as_ref().unwrap().snapshot.layers.len(), 1);
    // The last one stays.
    let (first, others) = before.split_first().unwrap();
    if !others.is_empty() {
        harness.state_mut().remove_channels(others);
        wait_opened(&mut harness);
    }
    assert_eq!(kinds(&harness), [*first]);
    harness.state_mut().ask_removal(*first);
    assert!(harness.state().removal.is_none());
    assert!(
        harness.state_mut().notices.shown().any(|notice| notice.text.contains("an asset needs a channel"))
    );
}

/// An asset of a mesh with as many triangles elsewhere: the number is no difference.
#[test]
fn what_differs_of_two_meshes_is_said() {
    let folder = tempfile::tempdir().unwrap();
    crate::painting::small_asset(folder.path());
    let mut torus = fantex::mesh::generate::torus(48, 24);
    torus.positions.iter_mut().for_each(|position| *position *= 2.0);
    let model = folder.path().join("torus.ply");
    crate::document::save_shape(&model, &torus, false);
    let harness = harness(asking(&model), [1280.0, 800.0]);
    let count = fantex_app::text::grouped(48 * 24 * 2);
    harness.get_by_label_contains(&format!(
        "torus.ply and the asset's mesh have {count} triangles, but at other places."
    ));
}

#[test]
fn objects_of_a_world_that_are_to_come_are_counted() {
    let mut viewer = with_asset(Tab::Model);
    viewer.figures.objects = Some(ObjectFigures { missing: 3, ..ObjectFigures::default() });
    let harness = harness(viewer, [1280.0, 800.0]);
    harness.get_by_label("3 objects to come");
    assert!(harness.query_by_label_contains("parcels to come").is_none());
    let mut viewer = with_asset(Tab::Model);
    viewer.figures.missing = 1;
    crate::panels::harness(viewer, [1280.0, 800.0]).get_by_label("1 parcel to come");
}

/// A window with one layer that is chosen, after a stroke.
fn with_layer(folder: &Path) -> (Harness<'static, Viewer>, u64) {
    let mut viewer = with_painting(folder);
    wait_painted(&mut viewer);
    viewer.layer_action(&LayerAction::Add);
    wait_painted(&mut viewer);
    let id = viewer.painting.as_ref().unwrap().snapshot.layers[0].id();
    (viewer.scene_pixels, viewer.pixels_per_point) = ([500, 500], 1.0);
    viewer.show(ViewPreset::Top);
    let at = |phase, x| PenEvent { phase, at: DVec2::new(x, 0.85), pressure: 1.0 };
    let pen = vec![at(PenPhase::Down, 0.5), at(PenPhase::Up, 0.55)];
    viewer.navigate(&SceneInput { pen, ..SceneInput::default() }, 0.016);
    wait_painted(&mut viewer);
    let mut harness = harness(viewer, [1380.0, 1600.0]);
    harness.run_steps(2);
    (harness, id)
}

fn painting<'a>(harness: &'a Harness<'static, Viewer>) -> &'a Painting {
    harness.state().painting.as_ref().unwrap()
}

/// From both menus that offer it.
#[test]
fn masks_of_distances_begin_where_the_pen_was() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, _) = with_layer(folder.path());
    let to = painting(&harness).last_position().to_array();
    assert_ne!(to, painting(&harness).bounds.center().to_array());
    for is_context in [true, false] {
        if is_context {
            harness.get_by_label("Layer 1").click_secondary();
            harness.run_steps(3);
            harness.get_by_label_contains("Mask from").click();
        } else {
            harness.get_by_label("From …").click();
        }
        harness.run_steps(3);
        harness.get_by_role_and_label(Role::Button, "Distance").click();
        harness.run_steps(2);
        wait_painted(harness.state_mut());
        harness.run_steps(2);
        let source = painting(&harness).snapshot.layers[0].mask_source.unwrap();
        assert_eq!(source.by, MaskMeasure::Distance { to }, "{is_context}");
        harness.state_mut().command(Command::Paint(PaintCommand::Undo));
        wait_painted(harness.state_mut());
        harness.run_steps(2);
    }
}

/// Files may say what no control would.
#[test]
fn what_is_only_shown_is_not_changed() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, id) = with_layer(folder.path());
    let by = MaskMeasure::Noise { scale: 3.0, seed: 1234 };
    harness.state_mut().layer_action(&LayerAction::MakeMask(id, Some(by.source())));
    wait_painted(harness.state_mut());
    let steps = painting(&harness).snapshot.done.len();
    for _ in 0..3 {
        harness.run_steps(2);
        wait_painted(harness.state_mut());
    }
    let snapshot = &painting(&harness).snapshot;
    assert_eq!(snapshot.layers[0].mask_source, Some(by.source()));
    assert_eq!(snapshot.done.len(), steps, "{:?}", snapshot.done);
}

#[test]
fn an_opacity_that_is_typed_is_one_step() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, _) = with_layer(folder.path());
    let steps = painting(&harness).snapshot.done.len();
    // The brush has one, too, in the panel at the left.
    let rows = harness.get_all_by_label("Opacity").map(|node| node.rect());
    let row = rows.max_by(|a, b| a.left().total_cmp(&b.left())).unwrap();
    let is_its = |at: Pos2| row.y_range().contains(at.y) && at.x > row.left();
    let field = harness.get_all_by_role(Role::SpinButton).find(|field| is_its(field.rect().center()));
    field.unwrap().focus();
    harness.run_steps(2);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    for text in ["2", "5"] {
        harness.event(Event::Text(text.into()));
        harness.run_steps(2);
        wait_painted(harness.state_mut());
        harness.run_steps(2);
    }
    harness.key_press(Key::Enter);
    harness.run_steps(4);
    wait_painted(harness.state_mut());
    let snapshot = &painting(&harness).snapshot;
    assert!((snapshot.layers[0].opacity - 0.25).abs() < 1e-6, "{}", snapshot.layers[0].opacity);
    assert_eq!(snapshot.done.len(), steps + 1, "{:?}", snapshot.done);
}

/// The height of an asset is not drawn itself.
#[test]
fn a_channel_that_is_not_in_the_atlas_is_told_and_another_one_can_be_chosen() {
    let mut viewer = with_asset(Tab::Model);
    viewer.settings.panels.has_atlas = true;
    let channel = |kind| ChannelFact { kind, format: "R8".into() };
    viewer.document.as_mut().unwrap().channels = vec![channel("Base colour"), channel("Displacement")];
    let chosen = Arc::new(std::sync::Mutex::new(None));
    let seen = chosen.clone();
    let mut harness = Harness::builder().with_size(vec2(1380.0, 800.0)).build_ui_state(
        move |ui, viewer: &mut Viewer| {
            let atlas = AtlasTexture { channel: 1, ..AtlasTexture::default() };
            let shown = show(ui, viewer, &Textures { atlas, ..Textures::default() });
            let mut chosen = seen.lock().unwrap();
            *chosen = chosen.or(shown.atlas_channel);
        },
        viewer,
    );
    harness.run_steps(2);
    harness.get_by_label_contains("This channel is not in the atlas");
    let is_list = |node: &AccessKitNode<'_>| {
        node.role() == Role::ComboBox && node.value().as_deref() == Some("Displacement")
    };
    harness.get_by(is_list).click();
    harness.run_steps(3);
    harness.get_by_label("Base colour").click();
    harness.run_steps(3);
    assert_eq!(*chosen.lock().unwrap(), Some(0));
}
