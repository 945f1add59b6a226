//! What the user can ask for, and the keys for it: one table that keys, menus and the help sheet share.

use eframe::egui::{Key, Modifiers};

use crate::camera::{CameraMode, ViewPreset};
use crate::light::LightPreset;
use crate::paint::{PaintCommand, paint_shortcuts};

/// Something the user asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Ask for a file and open it.
    OpenDialog,
    /// Open a file or address.
    Open(String),
    /// Open it again.
    Reload,
    /// Show nothing.
    Close,
    /// Stop what is under way: opening, playing, the help sheet.
    Cancel,
    /// End the program.
    Quit,
    /// Save a picture of the scene as large as it is on the screen.
    Screenshot,
    /// Save a picture of the scene, this many times as wide and high as on the screen.
    LargeScreenshot(u32),
    /// Save a picture of the whole window.
    WindowScreenshot,
    /// Show the whole model from where the camera looks.
    FrameAll,
    /// Show the whole model from a side.
    View(ViewPreset),
    /// Move the camera in another way.
    Mode(CameraMode),
    /// The next (or previous) overlay.
    StepOverlay(isize),
    /// The next (or previous) view of the shading.
    StepShading(isize),
    /// Edges on or off.
    ToggleWireframe,
    /// Shadows on or off.
    ToggleShadows,
    /// Brighter or darker by so many quarters of a stop.
    Exposure(i32),
    /// Inspector on or off.
    ToggleInspector,
    /// Live atlas on or off.
    ToggleAtlas,
    /// Graphs on or off.
    ToggleGraphs,
    /// All panels off, or those that were on.
    ToggleAllPanels,
    /// Help sheet on or off.
    ToggleHelp,
    /// Loading of pages on or off.
    ToggleStreaming,
    /// Start or end the recording of a camera path.
    ToggleRecording,
    /// Start or stop playing the camera path.
    TogglePlayback,
    /// Ask for a camera path and load it.
    LoadPath,
    /// Ask for a place and save the camera path there.
    SavePath,
    /// Ask for a picture of surroundings.
    ChooseSurroundings,
    /// Paint on what is open, or only look at it.
    TogglePainting,
    /// Something of the painter.
    Paint(PaintCommand),
    /// Another light.
    Light(LightPreset),
}

/// A key for a command.
#[derive(Clone, Debug)]
pub struct Shortcut {
    /// What it does.
    pub command: Command,
    /// What is held.
    pub modifiers: Modifiers,
    /// What is pressed.
    pub key: Key,
    /// What it does, in words.
    pub text: &'static str,
    /// Under which heading of the help sheet it stands.
    pub section: Section,
}

/// Headings of the help sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Section {
    /// Opening, saving, ending.
    File,
    /// Moving the camera.
    Camera,
    /// What is shown.
    Display,
    /// What is around it.
    Panels,
    /// Only while something is painted on.
    Painting,
}

impl Section {
    /// All headings in the order of the sheet.
    pub const ALL: [Self; 4] = [Self::File, Self::Camera, Self::Display, Self::Panels];

    /// The heading.
    pub fn label(self) -> &'static str {
        match self {
            Self::File => "File",
            Self::Camera => "Camera",
            Self::Display => "Display",
            Self::Panels => "Panels",
            Self::Painting => "Painting",
        }
    }
}

/// All keys.
pub fn shortcuts() -> Vec<Shortcut> {
    use Section::{Camera, Display, File, Panels};
    const NONE: Modifiers = Modifiers::NONE;
    const SHIFT: Modifiers = Modifiers::SHIFT;
    const CONTROL: Modifiers = Modifiers::COMMAND;
    let views = [Key::Num0, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];
    let view_texts = [
        "Three-quarter view",
        "Front view",
        "Back view",
        "Left view",
        "Right view",
        "View from above",
        "View from below",
    ];
    let row = |section, modifiers, key, command, text| Shortcut { command, modifiers, key, text, section };
    let mut rows = vec![
        row(File, CONTROL, Key::O, Command::OpenDialog, "Open a file"),
        row(File, NONE, Key::F5, Command::Reload, "Open it again"),
        row(File, CONTROL, Key::W, Command::Close, "Close the file"),
        row(File, CONTROL, Key::S, Command::Screenshot, "Save a picture"),
        row(File, CONTROL | SHIFT, Key::S, Command::LargeScreenshot(4), "Save a picture four times as large"),
        row(File, CONTROL, Key::P, Command::WindowScreenshot, "Save a picture of the window"),
        row(File, CONTROL, Key::T, Command::TogglePainting, "Paint, or only look"),
        row(File, NONE, Key::Escape, Command::Cancel, "Cancel, stop, close"),
        row(File, CONTROL, Key::Q, Command::Quit, "Quit"),
        row(Camera, NONE, Key::Num1, Command::Mode(CameraMode::Orbit), "Orbit around the model"),
        row(Camera, NONE, Key::Num2, Command::Mode(CameraMode::Fly), "Fly"),
        row(Camera, NONE, Key::Num3, Command::Mode(CameraMode::Walk), "Walk on the ground"),
        row(Camera, NONE, Key::F, Command::FrameAll, "Show the whole model"),
    ];
    rows.extend(
        views
            .into_iter()
            .zip(ViewPreset::ALL)
            .zip(view_texts)
            .map(|((key, view), text)| row(Camera, NONE, key, Command::View(view), text)),
    );
    rows.extend([
        row(Camera, NONE, Key::R, Command::ToggleRecording, "Record a camera path"),
        row(Camera, NONE, Key::P, Command::TogglePlayback, "Play the camera path"),
        row(Display, NONE, Key::O, Command::StepOverlay(1), "Next overlay"),
        row(Display, SHIFT, Key::O, Command::StepOverlay(-1), "Previous overlay"),
        row(Display, NONE, Key::V, Command::StepShading(1), "Next shading"),
        row(Display, SHIFT, Key::V, Command::StepShading(-1), "Previous shading"),
        row(Display, NONE, Key::Z, Command::ToggleWireframe, "Wireframe"),
        row(Display, NONE, Key::X, Command::ToggleShadows, "Shadows"),
        row(Display, NONE, Key::OpenBracket, Command::Exposure(-1), "Darker"),
        row(Display, NONE, Key::CloseBracket, Command::Exposure(1), "Brighter"),
        row(Panels, NONE, Key::I, Command::ToggleInspector, "Inspector"),
        row(Panels, NONE, Key::M, Command::ToggleAtlas, "Live atlas"),
        row(Panels, NONE, Key::G, Command::ToggleGraphs, "Graphs"),
        row(Panels, NONE, Key::H, Command::ToggleAllPanels, "Hide or show all panels"),
        row(Panels, NONE, Key::L, Command::ToggleStreaming, "Hold or go on loading tiles"),
        row(Panels, NONE, Key::F1, Command::ToggleHelp, "This sheet (also ?)"),
    ]);
    rows
}

/// What mouse and pen do while something is painted on: not commands, but on the help sheet.
pub const PAINT_GESTURES: [(&str, &str); 9] = [
    ("Drag", "Paint"),
    ("Drag beside the model", "Turn the view"),
    ("Right drag", "Turn the view"),
    ("Middle drag", "Shift the view"),
    ("Wheel", "Closer, farther"),
    ("Shift + click", "Straight line from the last end"),
    ("Alt + click", "Pick a colour; with Clone: from where"),
    ("Ctrl + drag", "Turn the sun"),
    ("1 ... 9 0", "Opacity; with Shift: flow"),
];

/// The same while nothing is painted on, by camera.
pub const GESTURES: [(&str, &[(&str, &str)]); 4] = [
    (
        "Orbit",
        &[
            ("Drag", "Turn"),
            ("Right drag", "Shift"),
            ("Wheel", "Closer to the point under it"),
            ("Double click", "Turn around that point"),
        ],
    ),
    (
        "Fly",
        &[
            ("W A S D", "Forwards, left, back, right"),
            ("E  Q", "Up, down"),
            ("Drag", "Look around"),
            ("Wheel", "Faster, slower"),
            ("Shift", "Much faster"),
        ],
    ),
    ("Walk", &[("W A S D", "Walk"), ("Drag", "Look around"), ("Wheel", "Faster, slower"), ("Shift", "Run")]),
    ("Light", &[("Ctrl + drag", "Turn the sun")]),
];

impl Shortcut {
    /// The keys as text, for menus and the help sheet.
    pub fn keys(&self) -> String {
        let mut text = String::new();
        if self.modifiers.command {
            text.push_str(if cfg!(target_os = "macos") { "Cmd + " } else { "Ctrl + " });
        }
        if self.modifiers.shift {
            text.push_str("Shift + ");
        }
        text.push_str(match self.key {
            Key::OpenBracket => "[",
            Key::CloseBracket => "]",
            Key::Escape => "Esc",
            key => key.name(),
        });
        text
    }
}

/// The command of a key, if it has one. Exactly the held modifiers count.
pub fn command_of(modifiers: Modifiers, key: Key) -> Option<Command> {
    // The question mark lies elsewhere on every keyboard.
    if key == Key::Questionmark {
        return Some(Command::ToggleHelp);
    }
    let is_same = |s: &Shortcut| {
        s.key == key && s.modifiers.command == modifiers.command && s.modifiers.shift == modifiers.shift
    };
    (!modifiers.alt).then(|| shortcuts().into_iter().find(is_same)).flatten().map(|s| s.command)
}

/// The same while something is painted on (or not): the painter's keys come first, and those that fly the camera are not
/// needed.
pub fn command_while(is_painting: bool, modifiers: Modifiers, key: Key) -> Option<Command> {
    let is_same = |s: &Shortcut| {
        s.key == key && s.modifiers.command == modifiers.command && s.modifiers.shift == modifiers.shift
    };
    let own = if is_painting && !modifiers.alt { paint_shortcuts().into_iter().find(is_same) } else { None };
    own.map(|s| s.command).or_else(|| command_of(modifiers, key))
}

/// The keys of a command as text.
pub fn keys_of(command: &Command) -> Option<String> {
    let all = shortcuts().into_iter().chain(paint_shortcuts());
    all.into_iter().find(|s| s.command == *command).map(|s| s.keys())
}

/// Reads `Ctrl+Shift+S`, `F1`, `?` and the like.
pub fn parse_keys(text: &str) -> Option<(Modifiers, Key)> {
    let mut modifiers = Modifiers::NONE;
    let mut parts: Vec<&str> = text.split('+').map(str::trim).collect();
    let key = parts.pop()?;
    for part in parts {
        modifiers |= match part.to_ascii_lowercase().as_str() {
            "ctrl" | "cmd" => Modifiers::COMMAND | Modifiers::CTRL,
            "shift" => Modifiers::SHIFT,
            "alt" => Modifiers::ALT,
            _ => return None,
        };
    }
    Some((modifiers, Key::from_name(key)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_has_two_meanings() {
        let all = shortcuts();
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                assert!(!(a.key == b.key && a.modifiers == b.modifiers), "{} and {}", a.text, b.text);
                assert_ne!(a.command, b.command, "one key per command");
            }
        }
    }

    #[test]
    fn movement_keys_are_no_commands() {
        for key in [Key::W, Key::A, Key::S, Key::D, Key::Q, Key::E] {
            assert_eq!(command_of(Modifiers::NONE, key), None, "{key:?} moves the camera");
        }
    }

    #[test]
    fn keys_are_found_as_they_are_written() {
        for shortcut in shortcuts() {
            let (modifiers, key) = parse_keys(&shortcut.keys().replace(' ', "")).unwrap();
            assert_eq!(command_of(modifiers, key), Some(shortcut.command));
        }
        assert_eq!(parse_keys("Ctrl+Nonsense"), None);
        assert_eq!(parse_keys("Hyper+A"), None);
        assert_eq!(command_of(Modifiers::NONE, Key::Questionmark), Some(Command::ToggleHelp));
        assert_eq!(command_of(Modifiers::ALT, Key::O), None);
    }
}
