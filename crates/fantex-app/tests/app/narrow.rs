//! In small windows all that can be clicked lies in the window, and nothing in the bar lies over anything else.

use eframe::egui::accessibility::is_input;
use eframe::egui::{Rect, Role, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};

use fantex_app::command::{GESTURES, PAINT_GESTURES, shortcuts};
use fantex_app::paint::{PaintTool, paint_shortcuts};
use fantex_app::settings::{PanelSettings, Tab};
use fantex_app::viewer::Viewer;

use crate::panels::{empty, harness, wait_painted, with_model, with_painting};

/// Points from the top that the bar takes.
const BAR: f32 = 33.0;

/// What can be clicked or typed into: what it is, and where.
fn inputs(harness: &Harness<'static, Viewer>) -> Vec<(String, Rect)> {
    let nodes = harness.root().children_recursive().filter(|node| {
        let node = node.accesskit_node();
        // Edges of panels reach beyond these.
        is_input(node.role()) && node.role() != Role::Splitter && !node.is_hidden()
    });
    nodes
        .map(|node| {
            let own = node.accesskit_node();
            (format!("{:?} {:?}", own.role(), own.label().unwrap_or_default()), node.rect())
        })
        .collect()
}

#[track_caller]
fn check(harness: &Harness<'static, Viewer>, [width, height]: [f32; 2]) {
    let all = inputs(harness);
    assert!(all.len() > 5, "{all:?}");
    for (name, rect) in &all {
        assert!(rect.left() >= -0.5 && rect.right() <= width + 0.5, "{name} at {rect} of {width}");
        let is_fixed = rect.center().y < BAR || name.contains("View from") || name.contains(" tool\"");
        assert!(!is_fixed || rect.bottom() <= height, "{name} at {rect} of {height}");
    }
    let mut bar: Vec<_> = all.iter().filter(|(_, rect)| rect.center().y < BAR).collect();
    bar.sort_by(|(_, a), (_, b)| a.left().total_cmp(&b.left()));
    for pair in bar.windows(2) {
        let [(a, left), (b, right)] = [pair[0], pair[1]];
        assert!(left.right() <= right.left() + 0.5, "{a} {left} lies over {b} {right} at {width}");
    }
}

const SIZES: [[f32; 2]; 3] = [[800.0, 600.0], [640.0, 480.0], [480.0, 320.0]];

#[test]
fn the_viewer_fits_into_small_windows() {
    for size in SIZES {
        for (tab, _) in Tab::ALL {
            for mut viewer in [empty(), with_model()] {
                viewer.settings.panels = PanelSettings { tab, ..PanelSettings::default() };
                let mut harness = harness(viewer, size);
                harness.run_steps(3);
                check(&harness, size);
            }
        }
    }
}

#[test]
fn the_painter_fits_into_a_small_window() {
    let size = SIZES[0];
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), size);
    wait_painted(harness.state_mut());
    harness.run_steps(3);
    check(&harness, size);
}

/// What has no room in the bar is in a menu of it.
#[test]
fn the_bar_hides_nothing_for_good() {
    let mut harness = harness(with_model(), SIZES[0]);
    harness.run_steps(2);
    assert!(harness.query_by_label("Wireframe").is_none());
    harness.get_by_label("More").click();
    harness.run_steps(3);
    harness.get_by_label("Wireframe").click();
    harness.run_steps(3);
    assert!(harness.state().settings.display.has_wireframe);
    // With room there is no such menu.
    harness.set_size(vec2(1380.0, 860.0));
    harness.run_steps(3);
    assert!(harness.query_by_label("More").is_none());
    harness.get_by_label("Wireframe");
}

/// All keys are on the sheet, beside each other or one below the other, as wide as the window at most.
#[test]
fn the_sheet_of_keys_fits_into_small_windows() {
    let folder = tempfile::tempdir().unwrap();
    for is_painting in [false, true] {
        let viewer = if is_painting { with_painting(folder.path()) } else { with_model() };
        let mut harness = harness(viewer, SIZES[0]);
        harness.state_mut().has_help = true;
        for size in SIZES {
            harness.set_size(size.into());
            harness.run_steps(4);
            let mut texts: Vec<&str> = Vec::new();
            match is_painting {
                true => {
                    texts.extend(PAINT_GESTURES.iter().map(|(_, text)| *text));
                    // Digits have one line in common.
                    texts.extend(paint_shortcuts().into_iter().map(|s| s.text).filter(|t| *t != "Flow"));
                }
                false => {
                    texts.extend(GESTURES.iter().flat_map(|(_, rows)| rows.iter().map(|(_, text)| *text)));
                    texts.extend(shortcuts().into_iter().map(|s| s.text));
                }
            }
            for text in texts {
                let rects: Vec<Rect> = harness.query_all_by_label(text).map(|node| node.rect()).collect();
                assert!(!rects.is_empty(), "{text} at {size:?}");
                let is_inside = |rect: &Rect| rect.left() >= 0.0 && rect.right() <= size[0];
                assert!(rects.iter().all(is_inside), "{text} {rects:?} at {size:?}");
            }
        }
    }
}

/// The scene keeps its share of the width; where there is no room for two panels beside it they take turns.
#[test]
fn the_scene_keeps_its_share_of_small_windows() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), SIZES[0]);
    wait_painted(harness.state_mut());
    for size in [SIZES[0], SIZES[1], [1000.0, 700.0], SIZES[2]] {
        harness.set_size(size.into());
        harness.run_steps(3);
        let width = harness.state().scene_pixels[0] as f32 / harness.ctx.pixels_per_point();
        assert!(width >= 0.4 * size[0] - 1.0, "{width} at {size:?}");
    }
    harness.set_size(SIZES[0].into());
    harness.run_steps(3);
    assert!(harness.query_by_label("Channels").is_none());
    harness.get_by_label("Layers").click();
    harness.run_steps(3);
    harness.get_by_label("Channels");
    harness.get_by_label("Brush").click();
    harness.run_steps(3);
    harness.get_by_label("Brushes");
    // Fills and texts have no brush.
    harness.state_mut().settings.paint.tool = PaintTool::Fill;
    harness.run_steps(2);
    assert!(harness.query_by_label("Brushes").is_none());
    let mut viewer = with_model();
    viewer.settings.panels = PanelSettings { has_atlas: true, ..PanelSettings::default() };
    let mut harness = crate::panels::harness(viewer, SIZES[0]);
    for size in SIZES {
        harness.set_size(size.into());
        harness.run_steps(3);
        let width = harness.state().scene_pixels[0] as f32 / harness.ctx.pixels_per_point();
        assert!(width >= 0.4 * size[0] - 1.0, "{width} at {size:?}");
    }
}

/// Messages do not lie over panels and bars.
#[test]
fn messages_stay_within_a_small_scene() {
    let folder = tempfile::tempdir().unwrap();
    let mut viewer = with_painting(folder.path());
    let error = |k: u32| format!("{k} {}", "Something could not be read. ".repeat(6));
    viewer.notices.error(error(0));
    let mut harness = harness(viewer, [640.0, 400.0]);
    harness.run_steps(3);
    let alone = harness.get_by_label_contains("0 Something").rect();
    (1..4).for_each(|k| harness.state_mut().notices.error(error(k)));
    harness.run_steps(3);
    let viewer = harness.state();
    let [left, top] = viewer.scene_corner;
    let [width, height] = viewer.scene_pixels.map(|n| n as f32 / harness.ctx.pixels_per_point());
    let newest = harness.get_by_label_contains("3 Something").rect();
    assert!(newest.left() >= left && newest.right() <= left + width, "{newest}");
    assert!(newest.bottom() <= top + height, "{newest}");
    assert!((newest.height() - alone.height()).abs() < 1.0, "{newest} {alone}");
    let second = harness.get_by_label_contains("2 Something").rect();
    assert!(second.top() > top && second.bottom() < newest.top(), "{second} {newest}");
}
