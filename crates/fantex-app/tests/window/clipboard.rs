//! A picture of another program's clipboard, pasted with real keys.

use std::path::Path;
use std::time::Duration;

use fantex::texture::{Image, Samples};
use x11rb::COPY_DEPTH_FROM_PARENT;
use x11rb::connection::Connection;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    Atom, AtomEnum, ConnectionExt as _, CreateWindowAux, EventMask, InputFocus, KEY_PRESS_EVENT,
    KEY_RELEASE_EVENT, PropMode, SELECTION_NOTIFY_EVENT, SelectionNotifyEvent, SelectionRequestEvent, Window,
    WindowClass,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

use super::display::{Display, wait_for};
use super::{check_success, difference, save_asset};

/// X11's numbers of keys.
const CONTROL: u32 = 0xffe3;
const V: u32 = 0x76;

/// Columns of the window that sessions open.
const WINDOW_WIDTH: u16 = 1000;

/// Has the clipboard, with a PNG in it, as long as the display lives; returns once it has.
fn offer(display: &Display, png: Vec<u8>) {
    let (connection, screen) = x11rb::connect(Some(&display.name())).unwrap();
    let atom = |name: &str| connection.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom;
    let [clipboard, targets, picture] = ["CLIPBOARD", "TARGETS", "image/png"].map(atom);
    let window = connection.generate_id().unwrap();
    let root = connection.setup().roots[screen].root;
    let class = WindowClass::INPUT_OUTPUT;
    let aux = CreateWindowAux::new();
    connection.create_window(COPY_DEPTH_FROM_PARENT, window, root, 0, 0, 1, 1, 0, class, 0, &aux).unwrap();
    connection.set_selection_owner(window, clipboard, x11rb::CURRENT_TIME).unwrap().check().unwrap();
    assert_eq!(connection.get_selection_owner(clipboard).unwrap().reply().unwrap().owner, window);
    std::thread::spawn(move || {
        while let Ok(event) = connection.wait_for_event() {
            if let Event::SelectionRequest(request) = event {
                answer(&connection, &request, [targets, picture], &png);
            }
        }
    });
}

fn answer(
    connection: &RustConnection,
    request: &SelectionRequestEvent,
    [targets, picture]: [Atom; 2],
    png: &[u8],
) {
    let &SelectionRequestEvent { requestor, property, target, .. } = request;
    let given = if target == targets {
        let kinds = [targets, picture];
        connection.change_property32(PropMode::REPLACE, requestor, property, AtomEnum::ATOM, &kinds).unwrap();
        property
    } else if target == picture {
        connection.change_property8(PropMode::REPLACE, requestor, property, picture, png).unwrap();
        property
    } else {
        x11rb::NONE
    };
    let told = SelectionNotifyEvent {
        response_type: SELECTION_NOTIFY_EVENT,
        sequence: 0,
        time: request.time,
        requestor,
        selection: request.selection,
        target,
        property: given,
    };
    connection.send_event(false, requestor, EventMask::NO_EVENT, told).unwrap();
    connection.flush().unwrap();
}

/// Presses `Ctrl` + `V` in the window of the program, once a file is there; then makes another one.
fn paste_between(display: &str, ready: &Path, pressed: &Path) {
    wait_for(ready);
    let (connection, screen) = x11rb::connect(Some(display)).unwrap();
    let root = connection.setup().roots[screen].root;
    let is_ours = |window: &Window| {
        let geometry = connection.get_geometry(*window).unwrap().reply();
        geometry.is_ok_and(|geometry| geometry.width == WINDOW_WIDTH)
    };
    let windows = connection.query_tree(root).unwrap().reply().unwrap().children;
    let window = windows.into_iter().find(is_ours).unwrap();
    // There is no window manager that would do this.
    connection.set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME).unwrap().check().unwrap();
    let setup = connection.setup();
    let (first, count) = (setup.min_keycode, setup.max_keycode - setup.min_keycode + 1);
    let mapping = connection.get_keyboard_mapping(first, count).unwrap().reply().unwrap();
    let per_key = usize::from(mapping.keysyms_per_keycode);
    let code = |symbol: u32| {
        let at = mapping.keysyms.chunks(per_key).position(|symbols| symbols[0] == symbol).unwrap();
        first + at as u8
    };
    for (kind, symbol) in [
        (KEY_PRESS_EVENT, CONTROL),
        (KEY_PRESS_EVENT, V),
        (KEY_RELEASE_EVENT, V),
        (KEY_RELEASE_EVENT, CONTROL),
    ] {
        std::thread::sleep(Duration::from_millis(50));
        connection.xtest_fake_input(kind, code(symbol), 0, root, 0, 0, 0).unwrap().check().unwrap();
    }
    std::fs::write(pressed, "").unwrap();
}

#[test]
fn a_picture_of_another_program_is_pasted() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let asset = save_asset(at);
    // A red square with a half transparent corner.
    let mut texels = [[1.0, 0.0, 0.0, 1.0]; 64];
    texels[0][3] = 0.5;
    Image::from_linear_rgba(8, 8, &texels).save(at.join("red.png")).unwrap();
    offer(&display, std::fs::read(at.join("red.png")).unwrap());
    let (name, [ready, pressed]) = (display.name(), ["ready.png", "pressed"].map(|name| at.join(name)));
    let keys = std::thread::spawn(move || paste_between(&name, &ready, &pressed));
    let steps = r#"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"window_screenshot":{"path":"ready.png"}},
        {"wait_file":{"path":"pressed","seconds":240}},{"wait_frames":12},{"window_screenshot":{"path":"pasted.png"}},"quit""#;
    let (asset, settings) = (asset.to_string_lossy(), at.join("kept/settings.json"));
    std::fs::create_dir(at.join("kept")).unwrap();
    let arguments = [&*asset, "--paint", "--settings", &*settings.to_string_lossy()];
    check_success(&display.run(at, &arguments, steps));
    super::painting::keep_pictures(at, "clipboard");
    keys.join().unwrap();
    let kept: Vec<_> = std::fs::read_dir(at.join("kept/pasted")).unwrap().collect();
    assert_eq!(kept.len(), 1);
    let paths = [at.join("red.png"), kept[0].as_ref().unwrap().path()];
    let [copied, pasted] = paths.map(|path| Image::load(path).unwrap());
    assert_eq!((pasted.width, pasted.height, pasted.channels), (8, 8, 4));
    let (Samples::U8(copied), Samples::U8(pasted)) = (copied.samples, pasted.samples) else {
        panic!("not bytes")
    };
    // On the way colours are multiplied by alpha.
    assert!(copied.iter().zip(&pasted).all(|(a, b)| a.abs_diff(*b) < 3), "{pasted:?}");
    assert!(difference(at, "ready.png", "pasted.png") > 0.02, "it lies over the view");
}
