//! The X server's raw events reach the painter's pen.

use std::time::Duration;

use fantex_app::pen::PenReadings;
use fantex_app::pen::x11::listen;
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, MOTION_NOTIFY_EVENT};
use x11rb::protocol::xtest::ConnectionExt as _;

use crate::display::Display;

#[test]
fn moves_and_touches_of_the_pointer_are_heard() {
    let Some(display) = Display::start() else { return };
    let readings = PenReadings::default();
    listen(Some(&display.name()), readings.clone()).unwrap();
    let (connection, screen) = x11rb::connect(Some(&display.name())).unwrap();
    let root = connection.setup().roots[screen].root;
    let fake = |kind: u8, detail: u8, x: i16| {
        connection.xtest_fake_input(kind, detail, 0, root, x, 50, 0).unwrap().check().unwrap();
    };
    (0..5).for_each(|i| fake(MOTION_NOTIFY_EVENT, 0, 10 * (i + 1)));
    fake(BUTTON_PRESS_EVENT, 1, 0);
    fake(BUTTON_RELEASE_EVENT, 1, 0);
    fake(MOTION_NOTIFY_EVENT, 0, 90);
    // Five moves, a press and a move; letting go is none of them.
    while readings.waiting() < 7 {
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(readings.take(7), [None; 7], "a mouse has no pressure");
}

#[test]
fn a_display_that_is_not_there_is_an_error() {
    assert!(listen(Some(":4999"), PenReadings::default()).is_err());
}
