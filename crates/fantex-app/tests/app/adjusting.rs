//! Size and hardness of the brush by drags and wheel, as hand and keys ask for them.

use eframe::egui::{Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2};
use eframe::egui::{TouchDeviceId, TouchId, TouchPhase, Vec2, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use fantex::glam::DVec3;
use fantex_app::camera::ViewPreset;
use fantex_app::command::{Command, PAINT_GESTURES, keys_of};
use fantex_app::panels::{Textures, show};
use fantex_app::theme;
use fantex_app::viewer::{KeyPhase, Viewer};

use crate::panels::{wait_painted, with_model, with_painting};

const CONTROL: Modifiers = Modifiers { ctrl: true, command: true, ..Modifiers::NONE };

/// A window in which keys and hand do what they do in the program's.
fn studio(folder: &std::path::Path) -> Harness<'static, Viewer> {
    let mut is_dressed = false;
    let mut harness: Harness<'static, Viewer> =
        Harness::builder().with_size(vec2(1380.0, 860.0)).build_ui_state(
            move |ui, viewer: &mut Viewer| {
                if !std::mem::replace(&mut is_dressed, true) {
                    theme::apply(ui.ctx());
                }
                let ctx = ui.ctx().clone();
                viewer.keys(&ctx);
                let shown = show(ui, viewer, &Textures::default());
                viewer.navigate(&shown.input, 0.016);
            },
            with_painting(folder),
        );
    wait_painted(harness.state_mut());
    harness.state_mut().show(ViewPreset::Front);
    let brush = &mut harness.state_mut().settings.paint.brush;
    (brush.size, brush.hardness) = (40.0, 0.5);
    harness.run_steps(2);
    harness
}

/// The middle of the scene.
fn middle(harness: &Harness<'static, Viewer>) -> Pos2 {
    let viewer = harness.state();
    let [x, y] = viewer.scene_corner;
    let [width, height] = viewer.scene_pixels.map(|n| n as f32);
    pos2(x + 0.5 * width, y + 0.5 * height)
}

/// A drag from the middle of the scene, with a frame for each event.
fn drag(harness: &mut Harness<'static, Viewer>, button: PointerButton, modifiers: Modifiers, by: Vec2) {
    let from = middle(harness);
    let pressed = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers };
    let mut events = vec![Event::PointerMoved(from), pressed(from, true)];
    events.extend((1..=4u8).map(|k| Event::PointerMoved(from + by * (0.25 * f32::from(k)))));
    events.push(pressed(from + by, false));
    for event in events {
        harness.event(event);
        harness.run_steps(1);
    }
}

/// Steps of the size and tenths of the hardness since [`studio`].
fn changes(harness: &Harness<'static, Viewer>) -> [f32; 2] {
    let brush = &harness.state().settings.paint.brush;
    [(brush.size / 40.0).ln() / 1.12f32.ln(), 10.0 * (brush.hardness - 0.5)]
}

/// As [`changes`], for a drag: 40 steps and 20 tenths over the height of the scene.
fn expected(harness: &Harness<'static, Viewer>, by: Vec2) -> [f32; 2] {
    let height = harness.state().scene_pixels[1] as f32;
    [40.0 * by.x / height, -20.0 * by.y / height]
}

fn assert_near(found: [f32; 2], expected: [f32; 2]) {
    let is_near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.02 + 0.02 * b.abs());
    assert!(is_near, "{found:?}, not {expected:?}");
}

fn is_untouched(harness: &mut Harness<'static, Viewer>) -> bool {
    wait_painted(harness.state_mut());
    harness.state().painting.as_ref().unwrap().snapshot.done.is_empty()
}

#[test]
fn a_drag_with_f_held_changes_size_and_hardness() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    let rig = harness.state().rig;
    harness.key_down(Key::F);
    harness.run_steps(1);
    let by = vec2(60.0, -80.0);
    drag(&mut harness, PointerButton::Primary, Modifiers::NONE, by);
    assert_near(changes(&harness), expected(&harness, by));
    // Back again, and only the size.
    drag(&mut harness, PointerButton::Primary, Modifiers::NONE, vec2(-60.0, 80.0));
    assert_near(changes(&harness), [0.0; 2]);
    drag(&mut harness, PointerButton::Primary, Modifiers::NONE, vec2(-40.0, 0.0));
    assert_near(changes(&harness), expected(&harness, vec2(-40.0, 0.0)));
    harness.key_up(Key::F);
    harness.run_steps(2);
    assert_eq!(harness.state().rig, rig, "the drag has used the key up");
    assert!(is_untouched(&mut harness), "nothing is painted");
    // Without the key the same drag paints.
    let before = changes(&harness);
    harness.state_mut().show(ViewPreset::Top);
    let from = middle(&harness) + vec2(0.0, 0.35 * harness.state().scene_pixels[1] as f32);
    for event in [
        Event::PointerMoved(from),
        Event::PointerButton {
            pos: from,
            button: PointerButton::Primary,
            pressed: true,
            modifiers: Modifiers::NONE,
        },
        Event::PointerMoved(from + vec2(30.0, 0.0)),
        Event::PointerButton {
            pos: from + vec2(30.0, 0.0),
            button: PointerButton::Primary,
            pressed: false,
            modifiers: Modifiers::NONE,
        },
    ] {
        harness.event(event);
        harness.run_steps(1);
    }
    assert!(!is_untouched(&mut harness));
    assert_eq!(changes(&harness), before);
}

/// While the brush is dragged its outline stays where the drag began.
#[test]
fn the_outline_stays_where_the_drag_began() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    harness.key_down(Key::F);
    let from = middle(&harness);
    let modifiers = Modifiers::NONE;
    let pressed =
        |pos, pressed| Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers };
    for event in
        [Event::PointerMoved(from), pressed(from, true), Event::PointerMoved(from + vec2(50.0, 30.0))]
    {
        harness.event(event);
        harness.run_steps(1);
    }
    let origin = harness.state().brush_origin().unwrap();
    assert!((origin.x - 0.5).abs() < 0.01 && (origin.y - 0.5).abs() < 0.01, "{origin}");
    // The key may be let go before the button.
    harness.key_up(Key::F);
    harness.event(Event::PointerMoved(from + vec2(100.0, 30.0)));
    harness.run_steps(1);
    assert_near(changes(&harness), expected(&harness, vec2(100.0, 30.0)));
    harness.event(pressed(from + vec2(100.0, 30.0), false));
    harness.run_steps(1);
    assert_eq!(harness.state().brush_origin(), None);
    assert!(is_untouched(&mut harness));
}

#[test]
fn a_tap_of_f_shows_all() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    harness.state_mut().rig.eye += DVec3::new(0.2, 0.3, 0.5);
    harness.run_steps(1);
    let before = harness.state().rig;
    harness.key_down(Key::F);
    harness.run_steps(2);
    assert_eq!(harness.state().rig, before, "it may become a drag");
    harness.key_up(Key::F);
    harness.run_steps(2);
    let viewer = harness.state();
    let mut all = before;
    all.frame_all(viewer.document.as_ref().unwrap().mesh(), viewer.aspect());
    assert!((viewer.rig.eye - all.eye).length() < 1e-9, "{:?}", viewer.rig);
    assert_ne!(viewer.rig, before);
    assert_eq!(changes(&harness), [0.0; 2]);
}

/// Where nothing is painted on there is nothing to wait for, and while something is typed the key is a letter.
#[test]
fn f_shows_all_at_once_where_nothing_is_painted_on() {
    let mut viewer = with_model();
    viewer.scene_pixels = [800, 600];
    viewer.show(ViewPreset::Front);
    viewer.rig.eye += DVec3::new(0.2, 0.3, 0.5);
    let before = viewer.rig;
    viewer.key(Key::F, Modifiers::NONE, KeyPhase::Pressed, true);
    viewer.key(Key::F, Modifiers::NONE, KeyPhase::Released, true);
    viewer.key(Key::F, Modifiers::NONE, KeyPhase::Repeated, false);
    viewer.key(Key::F, Modifiers::NONE, KeyPhase::Released, false);
    assert_eq!(viewer.rig, before);
    viewer.key(Key::F, Modifiers::NONE, KeyPhase::Pressed, false);
    assert_ne!(viewer.rig, before);
}

#[test]
fn a_right_drag_with_control_changes_size_and_hardness() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    let rig = harness.state().rig;
    harness.event(Event::ModifiersChanged(CONTROL));
    harness.run_steps(1);
    let by = vec2(80.0, 60.0);
    drag(&mut harness, PointerButton::Secondary, CONTROL, by);
    assert_near(changes(&harness), expected(&harness, by));
    assert_eq!(harness.state().rig, rig);
    harness.event(Event::ModifiersChanged(Modifiers::NONE));
    harness.run_steps(1);
    let before = changes(&harness);
    drag(&mut harness, PointerButton::Secondary, Modifiers::NONE, by);
    assert_ne!(harness.state().rig, rig, "without Control it turns");
    assert_eq!(changes(&harness), before);
    assert!(is_untouched(&mut harness));
}

#[test]
fn the_wheel_with_control_changes_the_size() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    let rig = harness.state().rig;
    let scroll = |harness: &mut Harness<'static, Viewer>, notches: f32, modifiers: Modifiers| {
        harness.event(Event::PointerMoved(middle(harness)));
        harness.event(Event::ModifiersChanged(modifiers));
        harness.event(Event::MouseWheel {
            unit: MouseWheelUnit::Point,
            delta: vec2(0.0, 50.0 * notches),
            phase: TouchPhase::Move,
            source: MouseWheelSource::Unknown,
            modifiers,
        });
        // It is spread over frames.
        harness.run_steps(20);
    };
    scroll(&mut harness, 3.0, CONTROL);
    assert_near(changes(&harness), [3.0, 0.0]);
    scroll(&mut harness, -5.0, CONTROL);
    assert_near(changes(&harness), [-2.0, 0.0]);
    assert_eq!(harness.state().rig, rig);
    let before = changes(&harness);
    scroll(&mut harness, 2.0, Modifiers::NONE);
    assert_ne!(harness.state().rig, rig, "without Control it comes closer");
    assert_eq!(changes(&harness), before);
}

/// What the hand can do is on the sheet of keys, and the menu still names the key of *Show all*.
#[test]
fn the_keys_are_listed() {
    for keys in ["F + drag", "Ctrl + right drag", "Ctrl + wheel"] {
        assert!(PAINT_GESTURES.iter().any(|(listed, _)| *listed == keys), "{keys}");
    }
    assert_eq!(keys_of(true, &Command::FrameAll).as_deref(), Some("F"));
}

/// The system takes a touch for itself, as for a gesture of its own: no button is let go then.
#[test]
fn a_touch_that_is_taken_back_lifts_the_pen() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    let at = middle(&harness);
    let touch = |id: u64, phase| Event::Touch {
        device_id: TouchDeviceId(0),
        id: TouchId(id),
        phase,
        pos: at,
        force: Some(0.5),
    };
    let button = PointerButton::Primary;
    let pressed = Event::PointerButton { pos: at, button, pressed: true, modifiers: Modifiers::NONE };
    let is_down = |harness: &mut Harness<'static, Viewer>, events: Vec<Event>| {
        // As the window has them: in one frame.
        harness.input_mut().events.extend(events);
        harness.run_steps(1);
        harness.state().painting.as_ref().unwrap().has_hand_down()
    };
    harness.event(Event::PointerMoved(at));
    harness.run_steps(1);
    assert!(is_down(&mut harness, vec![touch(1, TouchPhase::Start), Event::PointerMoved(at), pressed]));
    assert!(is_down(&mut harness, vec![touch(2, TouchPhase::Cancel)]), "another finger");
    assert!(is_down(&mut harness, vec![Event::PointerGone]), "a mouse that leaves the window");
    assert!(!is_down(&mut harness, vec![touch(1, TouchPhase::Cancel), Event::PointerGone]));
}

/// Where the pen goes down counts, however far it is when the frame ends.
#[test]
fn strokes_begin_where_the_pen_goes_down() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    harness.state_mut().show(ViewPreset::Top);
    harness.state_mut().notices.error("The disk is full.");
    harness.run_steps(2);
    let viewer = harness.state();
    let [[x, y], [width, height]] = [viewer.scene_corner, viewer.scene_pixels.map(|n| n as f32)];
    let model = pos2(x + 0.5 * width, y + 0.82 * height);
    let outside = pos2(0.5 * x, model.y);
    let card = harness.get_by_label("The disk is full.").rect().center();
    for (from, to, strokes) in [(card, model, 0), (model, outside, 1)] {
        let pressed = |pos, pressed| Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        let events =
            [Event::PointerMoved(from), pressed(from, true), Event::PointerMoved(to), pressed(to, false)];
        // All in one frame.
        harness.input_mut().events.extend(events);
        harness.run_steps(1);
        wait_painted(harness.state_mut());
        assert_eq!(harness.state().painting.as_ref().unwrap().snapshot.done.len(), strokes);
    }
}
