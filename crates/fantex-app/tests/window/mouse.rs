//! Layers that the X server's own pointer drags through the list.

use std::fmt::Write as _;

use fantex::paint::{PaintOptions, Painter};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, MOTION_NOTIFY_EVENT};
use x11rb::protocol::xtest::ConnectionExt as _;

use super::display::{Display, wait_for};
use super::{check_success, save_asset};

/// Where the names of the upper two layers lie in the window, points.
const FIRST: [i16; 2] = [850, 448];
const SECOND: [i16; 2] = [850, 483];

/// From the top of the list onto an unfolded group: into it, in one step.
#[test]
fn a_layer_is_dragged_into_a_group() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let asset = save_asset(at);
    let middle = [FIRST[0] + 2, (FIRST[1] + SECOND[1]) / 2];
    let events = [
        (MOTION_NOTIFY_EVENT, FIRST),
        (BUTTON_PRESS_EVENT, FIRST),
        (MOTION_NOTIFY_EVENT, middle),
        (MOTION_NOTIFY_EVENT, SECOND),
        (BUTTON_RELEASE_EVENT, SECOND),
    ];
    let mut steps = String::from(
        r#"{"wait_loaded":120},{"wait_frames":3},{"layer":"add"},{"wait_painted":60},{"layer":{"rename":"Red"}},{"wait_painted":60},
        {"layer":"group"},{"wait_painted":60},{"layer":{"rename":"Group"}},{"wait_painted":60},{"layer":{"select":"base"}},
        {"layer":"add"},{"wait_painted":60},{"layer":{"rename":"Blue"}},{"wait_painted":60},{"wait_frames":3},
        {"window_screenshot":{"path":"seen0.png"}}"#,
    );
    // Each event has frames of its own.
    for k in 1..=events.len() {
        let then = format!(
            r#","wait_painted":60}},{{"wait_frames":3}},{{"window_screenshot":{{"path":"seen{k}.png"}}}}"#
        );
        write!(steps, r#",{{"wait_file":{{"path":"done{k}","seconds":240}}}},{{{}"#, &then[1..]).unwrap();
    }
    steps.push_str(r#",{"expect_painting":{"layers":3,"steps":7}},{"wait_saved":60},"quit""#);
    let (name, pictures) = (display.name(), at.to_owned());
    let hand = std::thread::spawn(move || {
        wait_for(&pictures.join("seen0.png"));
        let (connection, screen) = x11rb::connect(Some(&name)).unwrap();
        let root = connection.setup().roots[screen].root;
        for (k, (kind, [x, y])) in (1..).zip(events) {
            let detail = u8::from(kind != MOTION_NOTIFY_EVENT);
            connection.xtest_fake_input(kind, detail, 0, root, x, y, 0).unwrap().check().unwrap();
            std::fs::write(pictures.join(format!("done{k}")), "").unwrap();
            wait_for(&pictures.join(format!("seen{k}.png")));
        }
    });
    check_success(&display.run(at, &[&asset.to_string_lossy(), "--paint"], &steps));
    super::painting::keep_pictures(at, "mouse");
    hand.join().unwrap();
    let painter = Painter::open(&asset, &PaintOptions::default()).unwrap();
    let layers = painter.layers();
    let named = |name: &str| layers.iter().find(|layer| layer.name == name).unwrap();
    assert_eq!(layers.iter().map(|layer| layer.name.as_str()).collect::<Vec<_>>(), ["Red", "Blue", "Group"]);
    assert_eq!(named("Blue").parent, Some(named("Group").id()));
    assert_eq!(named("Red").parent, Some(named("Group").id()));
}
