//! Every character that is shown is in the fonts.

use std::collections::BTreeSet;
use std::path::Path;

use eframe::egui::FontId;
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use fantex::store::ChannelKind;

use fantex_app::command::Command;
use fantex_app::paint::{LayerAction, PaintTool, SymmetryKind};
use fantex_app::settings::{PanelSettings, Tab};
use fantex_app::viewer::Viewer;

use crate::panels::{TRIANGLE, asking, empty, harness, wait_painted, with_asset, with_model, with_painting};

const SIZE: [f32; 2] = [1380.0, 1600.0];

/// Characters of a text that are in no font.
fn missing(harness: &Harness<'static, Viewer>, text: &str) -> Vec<char> {
    let font = FontId::proportional(13.0);
    harness
        .ctx
        .fonts_mut(|fonts| text.chars().filter(|&c| !c.is_control() && !fonts.has_glyph(&font, c)).collect())
}

/// Looks at all that is on the page.
#[track_caller]
fn check(harness: &mut Harness<'static, Viewer>) {
    harness.run_steps(3);
    let mut texts = BTreeSet::new();
    for node in harness.root().children_recursive() {
        let node = node.accesskit_node();
        texts.extend(node.label());
        texts.extend(node.value());
        texts.extend(node.data().placeholder().map(str::to_owned));
    }
    assert!(texts.len() > 5, "{texts:?}");
    for text in &texts {
        let missing = missing(harness, text);
        assert!(missing.is_empty(), "{missing:?} of '{text}'");
    }
}

/// A menu of the bar; pages of the inspector may have the same name.
fn open_menu(harness: &mut Harness<'static, Viewer>, name: &str) {
    let top = harness.query_all_by_label(name).min_by(|a, b| a.rect().top().total_cmp(&b.rect().top()));
    top.unwrap().click();
    harness.run_steps(3);
}

#[test]
fn pages_of_the_viewer_lack_no_glyph() {
    for (tab, _) in Tab::ALL {
        for mut viewer in [empty(), with_model(), with_asset(tab)] {
            viewer.settings.panels =
                PanelSettings { tab, has_atlas: true, has_graphs: true, ..PanelSettings::default() };
            viewer.notices.error("The disk is full.");
            let mut harness = harness(viewer, SIZE);
            check(&mut harness);
            for menu in ["File", "View"] {
                open_menu(&mut harness, menu);
                check(&mut harness);
                open_menu(&mut harness, menu);
            }
            harness.state_mut().has_help = true;
            check(&mut harness);
        }
    }
}

#[test]
fn questions_and_looks_lack_no_glyph() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("triangle.obj");
    std::fs::write(&path, TRIANGLE).unwrap();
    check(&mut harness(asking(&path), SIZE));
    let mut viewer = with_asset(Tab::Model);
    viewer.command(Command::Export);
    assert!(viewer.exporting.is_some());
    check(&mut harness(viewer, SIZE));
    let mut viewer = empty();
    viewer.live = Some(crate::live::open(folder.path()).0);
    check(&mut harness(viewer, SIZE));
}

#[test]
fn pages_of_the_painter_lack_no_glyph() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), SIZE);
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    let viewer = harness.state_mut();
    viewer.layer_action(&LayerAction::Add);
    wait_painted(viewer);
    let layer = viewer.painting.as_ref().unwrap().snapshot.layers[0].id();
    viewer.layer_action(&LayerAction::AddMask(layer, true));
    wait_painted(viewer);
    let paint = &mut viewer.settings.paint;
    paint.brush.only_seen = true;
    paint.stencil.is_on = true;
    // What was switched on moves the section before it is clicked.
    harness.run_steps(3);
    harness.get_by_label("Stroke").click();
    harness.run_steps(30);
    assert!(harness.query_all_by_label("Pressure: size").next().is_some());
    for (tool, _) in PaintTool::ALL {
        harness.state_mut().settings.paint.tool = tool;
        check(&mut harness);
    }
    for (kind, _) in SymmetryKind::ALL {
        harness.state_mut().settings.paint.symmetry.kind = kind;
        check(&mut harness);
    }
    harness.state_mut().has_help = true;
    check(&mut harness);
    harness.state_mut().has_help = false;
    harness.state_mut().removal = Some(ChannelKind::BaseColor);
    check(&mut harness);
}

/// Crates whose sentences the window does not show.
const OTHERS: [&str; 6] =
    ["fantex-cli", "fantex-web", "fantex-three", "fantex-python", "fantex-test", "fantex-bench"];

fn sources(folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(std::fs::read_to_string(&path).unwrap());
        }
    }
}

/// Labels and messages wherever they are: what stands in the sources and is no comment.
#[test]
fn messages_lack_no_glyph() {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut texts = Vec::new();
    sources(&own.join("src"), &mut texts);
    for entry in std::fs::read_dir(own.parent().unwrap()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with("fantex") && !OTHERS.contains(&name.as_str()) && path.join("src").is_dir() {
            sources(&path.join("src"), &mut texts);
        }
    }
    let lines =
        texts.iter().flat_map(|text| text.lines()).filter(|line| !line.trim_start().starts_with("//"));
    let shown: BTreeSet<char> = lines.flat_map(str::chars).filter(|c| !c.is_ascii()).collect();
    assert!(shown.contains(&'…'), "{shown:?}");
    let harness = harness(empty(), [400.0, 300.0]);
    let all: String = shown.into_iter().collect();
    assert_eq!(missing(&harness, &all), Vec::<char>::new());
}
