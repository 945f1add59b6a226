//! The axes in the corner of the scene.

use std::sync::{Arc, Mutex};

use eframe::egui::{Event, Modifiers, PointerButton, Pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use fantex::glam::DVec2;

use fantex_app::camera::ViewPreset;
use fantex_app::panels::{Textures, show};
use fantex_app::viewer::Viewer;

use crate::panels::{harness, with_model};

const ENDS: [(&str, ViewPreset); 6] = [
    ("(+x)", ViewPreset::Right),
    ("(-x)", ViewPreset::Left),
    ("(+y)", ViewPreset::Top),
    ("(-y)", ViewPreset::Bottom),
    ("(+z)", ViewPreset::Front),
    ("(-z)", ViewPreset::Back),
];

fn place(harness: &Harness<'static, Viewer>, end: &str) -> Pos2 {
    harness.get_by_label_contains(end).rect().center()
}

/// Each end goes to the view from there, and then lies in the middle, before the other end of its axis.
#[test]
fn ends_of_axes_are_views() {
    let mut harness = harness(with_model(), [1380.0, 860.0]);
    for (index, (name, view)) in ENDS.into_iter().enumerate() {
        // From a corner all ends lie apart.
        harness.state_mut().show(ViewPreset::ThreeQuarter);
        harness.run_steps(2);
        harness.get_by_label_contains(name).click();
        harness.run_steps(2);
        let viewer = harness.state();
        let expected = view.rig(viewer.document.as_ref().unwrap().mesh(), viewer.aspect());
        assert_eq!(viewer.rig, expected, "{name}");
        let (other, _) = ENDS[index ^ 1];
        assert!(place(&harness, name).distance(place(&harness, other)) < 1.0, "{name}");
    }
}

#[test]
fn the_axes_follow_the_camera_and_can_be_hidden() {
    let mut harness = harness(with_model(), [1380.0, 860.0]);
    harness.state_mut().show(ViewPreset::Front);
    harness.run_steps(2);
    let (right, up) = (place(&harness, "(+x)"), place(&harness, "(+y)"));
    assert!(right.x > up.x + 10.0 && up.y < right.y - 10.0, "{right} {up}");
    harness.state_mut().rig.orbit(DVec2::new(0.25, 0.0));
    harness.run_steps(2);
    assert!(place(&harness, "(+x)").distance(right) > 2.0);
    // One of the inspector's pages has the same name.
    let menu = harness.query_all_by_label("View").min_by(|a, b| a.rect().top().total_cmp(&b.rect().top()));
    menu.unwrap().click();
    harness.run_steps(3);
    harness.get_by_label("Axes in the corner").click();
    harness.run_steps(3);
    assert!(!harness.state().settings.panels.has_gizmo);
    assert!(harness.query_by_label_contains("(+x)").is_none());
}

/// A drag on it turns as one in the scene does.
#[test]
fn a_drag_on_the_axes_turns() {
    let turned = Arc::new(Mutex::new(DVec2::ZERO));
    let seen = turned.clone();
    let mut harness: Harness<'static, Viewer> =
        Harness::builder().with_size(vec2(1280.0, 800.0)).build_ui_state(
            move |ui, viewer: &mut Viewer| {
                *seen.lock().unwrap() += show(ui, viewer, &Textures::default()).input.drag;
            },
            with_model(),
        );
    harness.state_mut().show(ViewPreset::ThreeQuarter);
    harness.run_steps(2);
    let middle = place(&harness, "(+x)").lerp(place(&harness, "(-x)"), 0.5);
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    let end = middle + vec2(24.0, 0.0);
    let way = [
        Event::PointerMoved(middle),
        button(middle, true),
        Event::PointerMoved(middle + vec2(12.0, 0.0)),
        Event::PointerMoved(end),
        button(end, false),
    ];
    for event in way {
        harness.event(event);
        harness.run_steps(1);
    }
    let height = f64::from(harness.state().scene_pixels[1]);
    let by = *turned.lock().unwrap() * height;
    assert!((by.x - 24.0).abs() < 6.0 && by.y.abs() < 1.0, "{by}");
}
