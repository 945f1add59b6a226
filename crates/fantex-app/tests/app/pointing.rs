//! What the pointer is on is told below the scene, in the viewer and in the painter.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::{Event, Modifiers, Pos2, pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use fantex::glam::DVec2;
use fantex::paint::{PaintOptions, Painter, SurfacePoint};
use fantex::store::Asset;

use fantex_app::camera::{MeshGround, ViewPreset};
use fantex_app::document::{Document, Place};
use fantex_app::paint::{PenEvent, PenPhase};
use fantex_app::viewer::Viewer;

use crate::painting::small_asset;
use crate::panels::{empty, harness, wait_painted, with_model, with_painting};

/// A place of the scene, along its sides, in the window.
fn in_window(harness: &Harness<'static, Viewer>, [x, y]: [f32; 2]) -> Pos2 {
    let viewer = harness.state();
    let [width, height] = viewer.scene_pixels.map(|n| n as f32);
    let [left, top] = viewer.scene_corner;
    pos2(left + width * x, top + height * y)
}

/// Points at a place of the scene and waits until a text with these words is there and is accepted.
fn point(
    harness: &mut Harness<'static, Viewer>,
    at: [f32; 2],
    words: &str,
    accepts: impl Fn(&str) -> bool,
) -> String {
    let started = Instant::now();
    loop {
        let place = in_window(harness, at);
        harness.event(Event::PointerMoved(place));
        harness.run_steps(2);
        let found = harness.query_by_label_contains(words).and_then(|node| node.value());
        if let Some(text) = found.filter(|text| accepts(text)) {
            return text;
        }
        assert!(started.elapsed() < fantex_test::PATIENCE, "no text with '{words}'");
        std::thread::sleep(Duration::from_millis(5));
        harness.state_mut().poll();
    }
}

/// Linear red, green and blue in a text.
fn color(text: &str) -> [f32; 3] {
    let mut words = text.split("base colour ").nth(1).unwrap().split_whitespace();
    [(); 3].map(|()| words.next().unwrap().parse().unwrap())
}

fn spot(harness: &Harness<'static, Viewer>) -> SurfacePoint {
    harness.state().readout.spot.as_ref().unwrap().point
}

/// What a painter would pick there.
fn picked(path: &Path, point: SurfacePoint) -> [f32; 3] {
    let mut painter = Painter::open(path, &PaintOptions::default()).unwrap();
    painter.pick(0, point).unwrap().truncate().to_array()
}

fn are_near(a: [f32; 3], b: [f32; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3)
}

#[test]
fn the_viewer_tells_tile_level_and_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let asset = Arc::new(Asset::open(&path).unwrap());
    let mut viewer = empty();
    viewer.ground = Some(MeshGround::new(asset.shared_mesh()));
    viewer.document = Some(Document::of_asset(Place::File(path.clone()), asset));
    let mut harness = harness(viewer, [1380.0, 860.0]);
    harness.run_steps(2);
    harness.get_by_label_contains("Point at the model");
    harness.state_mut().show(ViewPreset::Top);
    let values = point(&mut harness, [0.5, 0.85], "base colour", |_| true);
    let place = harness.get_by_label_contains("Triangle ").value().unwrap();
    assert!(["tile ", "level 0", "texel "].iter().all(|words| place.contains(words)), "{place}");
    // The picture shows texels larger than pixels: the finest level is looked at.
    let expected = picked(&path, spot(&harness));
    assert!(are_near(color(&values), expected), "{values} {expected:?}");
    // The hole of the torus.
    point(&mut harness, [0.5, 0.5], "Point at the model", |_| true);
    assert!(harness.state().readout.spot.is_none());
}

#[test]
fn a_model_with_its_own_textures_tells_its_triangle() {
    let mut viewer = with_model();
    viewer.ground = Some(MeshGround::new(viewer.document.as_ref().unwrap().shared_mesh()));
    let mut harness = harness(viewer, [1380.0, 860.0]);
    harness.run_steps(2);
    harness.state_mut().show(ViewPreset::Top);
    let text = point(&mut harness, [0.5, 0.85], "Triangle ", |_| true);
    assert!(!text.contains("tile"), "{text}");
}

/// What is painted is told as soon as the stroke has ended; the line can be switched off.
#[test]
fn the_painter_tells_what_was_painted() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = harness(with_painting(folder.path()), [1380.0, 860.0]);
    wait_painted(harness.state_mut());
    harness.run_steps(2);
    harness.state_mut().show(ViewPreset::Top);
    let at = [0.5, 0.85];
    let before = color(&point(&mut harness, at, "base colour", |_| true));
    let viewer = harness.state_mut();
    let view = viewer.viewpoint();
    let Viewer { painting, settings, notices, .. } = viewer;
    settings.paint.brush.hardness = 1.0;
    let events = [PenPhase::Down, PenPhase::Up].map(|phase| PenEvent {
        phase,
        at: DVec2::from(at.map(f64::from)),
        pressure: 1.0,
    });
    painting.as_mut().unwrap().pen(&events, &mut settings.paint, &view, Modifiers::NONE, notices);
    wait_painted(harness.state_mut());
    let after = point(&mut harness, at, "base colour", |text| !are_near(color(text), before));
    let point_there = spot(&harness);
    harness.get_by_label("View").click();
    harness.run_steps(3);
    harness.get_by_label("Tile and values under the pointer").click();
    harness.run_steps(3);
    assert!(!harness.state().settings.panels.has_readout);
    assert!(harness.query_by_label_contains("Triangle ").is_none());
    // The painter saves it, and lets go of the file.
    harness.state_mut().painting = None;
    let expected = picked(&folder.path().join("torus.fan"), point_there);
    assert!(are_near(color(&after), expected), "{after} {expected:?}");
}
