//! What the user can ask for, and the keys for it: one table that keys, menus and the help sheet share.

use eframe::egui::{Key, Modifiers};

use crate::camera::{CameraMode, ViewPreset};
use crate::light::LightPreset;
use crate::paint::{PaintCommand, paint_shortcuts};

#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    OpenDialog,
    /// Open a file or address.
    Open(String),
    Reload,
    Close,
    /// Stop what is under way: opening, playing, the help sheet.
    Cancel,
    Quit,
    /// Ask how the asset is exported.
    Export,
    /// Write the asset to another file, and go on with this one.
    SaveCopy,
    /// Write what was changed of a look into its file; of anything else, a picture.
    Save,
    Screenshot,
    /// Save a picture of the scene, this many times as wide and high as on the screen.
    LargeScreenshot(u32),
    WindowScreenshot,
    /// Show the whole model from where the camera looks.
    FrameAll,
    View(ViewPreset),
    Mode(CameraMode),
    StepOverlay(isize),
    StepShading(isize),
    ToggleWireframe,
    ToggleShadows,
    /// Keep the picture of the scene beside it, or let it go.
    Compare,
    /// Brighter or darker by so many quarters of a stop.
    Exposure(i32),
    ToggleInspector,
    ToggleAtlas,
    ToggleGraphs,
    /// Show the axes of the world in a corner of the scene, or no longer.
    ToggleGizmo,
    /// Tell what the pointer is on, or no longer.
    ToggleReadout,
    ToggleAllPanels,
    ToggleHelp,
    ToggleStreaming,
    ToggleRecording,
    TogglePlayback,
    LoadPath,
    SavePath,
    ChooseSurroundings,
    TogglePainting,
    Paint(PaintCommand),
    Light(LightPreset),
}

#[derive(Clone, Debug)]
pub struct Shortcut {
    pub command: Command,
    pub modifiers: Modifiers,
    pub key: Key,
    pub text: &'static str,
    pub section: Section,
}

/// Headings of the help sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Section {
    File,
    Camera,
    Display,
    Panels,
    Painting,
}

impl Section {
    /// With their texts.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::File, "File"),
        (Self::Camera, "Camera"),
        (Self::Display, "Display"),
        (Self::Panels, "Panels"),
        (Self::Painting, "Painting"),
    ];
}

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
        row(File, CONTROL, Key::E, Command::Export, "Export for another program"),
        row(File, CONTROL | SHIFT, Key::C, Command::SaveCopy, "Save a copy"),
        row(File, CONTROL, Key::S, Command::Save, "Save the look, else a picture"),
        row(File, CONTROL | SHIFT, Key::P, Command::Screenshot, "Save a picture"),
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
            .map(|((key, (view, _)), text)| row(Camera, NONE, key, Command::View(view), text)),
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
        row(Display, NONE, Key::Y, Command::Compare, "Keep this picture beside what comes (A/B)"),
        row(Display, NONE, Key::OpenBracket, Command::Exposure(-1), "Darker"),
        row(Display, NONE, Key::CloseBracket, Command::Exposure(1), "Brighter"),
        row(Panels, NONE, Key::I, Command::ToggleInspector, "Inspector"),
        row(Panels, NONE, Key::M, Command::ToggleAtlas, "Live atlas"),
        row(Panels, NONE, Key::G, Command::ToggleGraphs, "Graphs"),
        row(Panels, NONE, Key::H, Command::ToggleAllPanels, "Hide or show all panels (also Tab)"),
        row(Panels, NONE, Key::L, Command::ToggleStreaming, "Hold or go on loading tiles"),
        row(Panels, NONE, Key::F1, Command::ToggleHelp, "This sheet (also ?)"),
    ]);
    rows
}

/// What mouse and pen do while something is painted on: not commands, but on the help sheet.
pub const PAINT_GESTURES: [(&str, &str); 12] = [
    ("Drag", "Paint"),
    ("Drag beside the model", "Turn the view"),
    ("Right drag", "Turn the view"),
    ("Middle drag", "Shift the view"),
    ("Wheel", "Closer, farther"),
    ("Ctrl + wheel", "Size of the brush"),
    ("F + drag", "Size (sideways) and hardness (up, down)"),
    ("Ctrl + right drag", "The same"),
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

/// The command of a key, if it has one. Exactly the held modifiers count. While something is painted on the painter's keys come first.
pub fn command_of(is_painting: bool, modifiers: Modifiers, key: Key) -> Option<Command> {
    let is_same = |s: &Shortcut| {
        s.key == key && s.modifiers.command == modifiers.command && s.modifiers.shift == modifiers.shift
    };
    let also = match key {
        // It lies elsewhere on every keyboard.
        Key::Questionmark => Some(Command::ToggleHelp),
        // The painter's hides its own.
        Key::Tab if !is_painting && modifiers.is_none() => Some(Command::ToggleAllPanels),
        _ => None,
    };
    let own = if is_painting { paint_shortcuts() } else { Vec::new() };
    let mut found = own.into_iter().chain(shortcuts()).filter(|_| !modifiers.alt);
    also.or_else(|| found.find(is_same).map(|s| s.command))
}

/// The keys of a command, as far as they hold: while something is painted on the painter has some of them.
pub fn keys_of(is_painting: bool, command: &Command) -> Option<String> {
    let all = shortcuts().into_iter().chain(paint_shortcuts());
    let is_painters = matches!(command, Command::Paint(_));
    let holds = |s: &Shortcut| {
        s.command == *command
            && (is_painters || command_of(is_painting, s.modifiers, s.key).as_ref() == Some(command))
    };
    all.into_iter().find(holds).map(|s| s.keys())
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
