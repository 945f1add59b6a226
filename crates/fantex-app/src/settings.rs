//! What the viewer remembers from one start to the next.

use std::fs::OpenOptions;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use fantex::base::{Error, ErrorKind, Result, files};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::camera::{CameraMode, FlyMotion};
use crate::display::DisplaySettings;
use crate::light::{LightSettings, Surroundings};
use crate::paint::PaintSettings;

/// How many recent files are remembered.
const MAX_RECENT: usize = 12;

/// Most bytes of a file that is read as settings.
const MAX_FILE_BYTES: u64 = 1 << 20;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    pub window: WindowSettings,
    pub camera: CameraSettings,
    pub panels: PanelSettings,
    pub light: LightSettings,
    pub display: DisplaySettings,
    pub streaming: StreamingSettings,
    pub paint: PaintSettings,
    /// Files that were opened, the last one first.
    pub recent: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct WindowSettings {
    /// Width and height in points.
    pub size: [f32; 2],
    /// Left and top in points, where the system tells.
    pub position: Option<[f32; 2]>,
    /// Whether it fills the screen.
    pub is_maximized: bool,
}

impl Default for WindowSettings {
    fn default() -> Self {
        Self { size: [1280.0, 800.0], position: None, is_maximized: false }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CameraSettings {
    pub mode: CameraMode,
    /// Vertical opening angle in degrees, 10 to 120.
    pub fov_degrees: f64,
    pub fly_speed: f64,
    pub walk_speed: f64,
    /// Height of a walker's eyes in world units; chosen by the model's size without.
    pub eye_height: Option<f64>,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self { mode: CameraMode::Orbit, fov_degrees: 35.0, fly_speed: 1.0, walk_speed: 1.0, eye_height: None }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tab {
    #[default]
    Model,
    Cover,
    Streaming,
    Light,
    View,
}

impl Tab {
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Model, "Model"),
        (Self::Cover, "Cover"),
        (Self::Streaming, "Streaming"),
        (Self::Light, "Light"),
        (Self::View, "View"),
    ];
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PanelSettings {
    pub has_inspector: bool,
    pub tab: Tab,
    pub has_atlas: bool,
    pub has_graphs: bool,
    /// The line below the scene that tells what the pointer is on.
    pub has_readout: bool,
    /// The axes of the world in a corner of the scene.
    pub has_gizmo: bool,
}

impl PanelSettings {
    /// The scene alone.
    pub const NONE: Self = Self {
        has_inspector: false,
        tab: Tab::Model,
        has_atlas: false,
        has_graphs: false,
        has_readout: false,
        has_gizmo: false,
    };
}

impl Default for PanelSettings {
    fn default() -> Self {
        Self { has_inspector: true, has_readout: true, has_gizmo: true, ..Self::NONE }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct StreamingSettings {
    /// Graphics memory for texels, mebibytes.
    pub pool_mib: u32,
    /// Memory for the geometry of a world's objects, mebibytes.
    pub geometry_mib: u32,
    /// Texels that go to the graphics memory in one frame, kibibytes.
    pub upload_kib: u32,
    /// Whether pages are loaded; off, what is there stays.
    pub is_running: bool,
}

impl Default for StreamingSettings {
    fn default() -> Self {
        Self { pool_mib: 64, geometry_mib: 384, upload_kib: 4096, is_running: true }
    }
}

impl StreamingSettings {
    pub const POOL_MIB: [u32; 2] = [1, 4096];
    pub const GEOMETRY_MIB: [u32; 2] = [16, 16384];
    pub const UPLOAD_KIB: [u32; 2] = [64, 65536];

    pub fn pool_bytes(&self) -> u64 {
        u64::from(self.pool_mib) << 20
    }

    pub fn geometry_bytes(&self) -> u64 {
        u64::from(self.geometry_mib) << 20
    }

    pub fn upload_bytes(&self) -> usize {
        (self.upload_kib as usize) << 10
    }
}

/// Reads what the program has kept. JSON has no infinite numbers, nor those that are none, and holds `null` instead: in its place comes what is
/// usual.
pub(crate) fn from_json<T: DeserializeOwned>(text: &[u8]) -> serde_json::Result<T> {
    serde_json::from_slice(text).or_else(|error| {
        let Ok(mut value) = serde_json::from_slice(text) else { return Err(error) };
        drop_nulls(&mut value);
        serde_json::from_value(value).map_err(|_| error)
    })
}

fn drop_nulls(value: &mut Value) {
    match value {
        Value::Object(keys) => {
            keys.retain(|_, value| !value.is_null());
            keys.values_mut().for_each(drop_nulls);
        }
        Value::Array(items) => items.iter_mut().for_each(drop_nulls),
        _ => {}
    }
}

/// Renames a damaged file of the program's. Returns what the user is told.
pub(crate) fn set_aside(path: &Path, what: &str, source: serde_json::Error) -> Error {
    let aside = path.with_extension("damaged.json");
    // Where it cannot be renamed it will be replaced when it is written.
    std::fs::rename(path, &aside).ok();
    let [path_text, aside] = [path, aside.as_path()].map(Path::display);
    let sentence = format!("{what} {path_text} are damaged ({source}); they were set aside as {aside}");
    Error::malformed(sentence).with_path(path).with_source(source)
}

impl Settings {
    /// Reads the settings. Without a file they are the usual ones; a damaged file is renamed, and the settings are the usual
    /// ones, too.
    pub fn load(path: &Path) -> (Self, Option<Error>) {
        let bytes = match read_limited(path, MAX_FILE_BYTES, "the settings") {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == ErrorKind::NotFound => return (Self::default(), None),
            Err(error) => return (Self::default(), Some(continued(error, "; starting with the usual ones"))),
        };
        match from_json::<Self>(&bytes) {
            Ok(settings) => (settings.sanitized(), None),
            Err(source) => (Self::default(), Some(set_aside(path, "the settings", source))),
        }
    }

    /// Writes the settings, whole or not at all. Files whose names are no text are not remembered.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut settings = self.clone();
        let paint = &mut settings.paint;
        for file in
            [&mut paint.picture, &mut paint.brush.stamp, &mut paint.texture.look, &mut paint.stencil.image]
        {
            file.take_if(|file| file.to_str().is_none());
        }
        let surroundings = &mut settings.light.surroundings;
        if matches!(surroundings, Surroundings::File(file) if file.to_str().is_none()) {
            *surroundings = Surroundings::default();
        }
        let text = serde_json::to_vec_pretty(&settings);
        write_whole(path, &text.map_err(|source| Error::writing(path, source.into()))?)
    }

    /// Puts a file at the top of the recent ones.
    pub fn remember(&mut self, place: &str) {
        self.recent.retain(|known| known != place);
        self.recent.insert(0, place.to_owned());
        self.recent.truncate(MAX_RECENT);
    }

    /// Numbers brought into their ranges, so that no file can make the viewer unusable.
    fn sanitized(mut self) -> Self {
        let within = |value: f64, [low, high]: [f64; 2], default: f64| {
            if value.is_finite() { value.clamp(low, high) } else { default }
        };
        let usable = |size: f32, default: f32| {
            if size.is_finite() && size >= 100.0 { size.min(16_384.0) } else { default }
        };
        let [width, height] = WindowSettings::default().size;
        self.window.size = [usable(self.window.size[0], width), usable(self.window.size[1], height)];
        self.window.position = self.window.position.filter(|p| p.iter().all(|n| n.abs() < 65_536.0));
        self.camera.fov_degrees = within(self.camera.fov_degrees, [10.0, 120.0], 35.0);
        self.camera.fly_speed = within(self.camera.fly_speed, FlyMotion::SPEEDS, 1.0);
        self.camera.walk_speed = within(self.camera.walk_speed, [0.1, 20.0], 1.0);
        self.camera.eye_height = self.camera.eye_height.filter(|h| h.is_finite() && *h > 0.0);
        let [least, most] = StreamingSettings::POOL_MIB;
        self.streaming.pool_mib = self.streaming.pool_mib.clamp(least, most);
        let [least, most] = StreamingSettings::GEOMETRY_MIB;
        self.streaming.geometry_mib = self.streaming.geometry_mib.clamp(least, most);
        let [least, most] = StreamingSettings::UPLOAD_KIB;
        self.streaming.upload_kib = self.streaming.upload_kib.clamp(least, most);
        self.light = self.light.sanitized();
        self.display = self.display.sanitized();
        self.recent.truncate(MAX_RECENT);
        self
    }
}

/// The label of a value, from the table of all of them.
pub fn label_of<T: PartialEq>(all: &[(T, &'static str)], value: T) -> &'static str {
    all.iter().find(|(one, _)| *one == value).map_or("", |(_, label)| label)
}

/// Reads a file of at most so many bytes; `what` names it in messages, such as `the session`.
///
/// # Errors
/// There is none (of kind [`ErrorKind::NotFound`]), it is too large, or cannot be read.
pub(crate) fn read_limited(path: &Path, max_bytes: u64, what: &str) -> Result<Vec<u8>> {
    let bytes = std::fs::metadata(path).and_then(|found| match found.len() {
        bytes if bytes > max_bytes => {
            let sentence = format!("it has {bytes} bytes, more than the {max_bytes} that it may have");
            Err(io::Error::new(io::ErrorKind::FileTooLarge, sentence))
        }
        _ => fantex::base::input::open(path).and_then(|mut file| {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes).map(|_| bytes)
        }),
    });
    bytes.map_err(|source| {
        let kind = match source.kind() {
            io::ErrorKind::NotFound => ErrorKind::NotFound,
            io::ErrorKind::FileTooLarge => ErrorKind::TooLarge,
            _ => ErrorKind::Io,
        };
        let sentence = format!("cannot read {what} {}: {source}", path.display());
        Error::new(kind, sentence).with_path(path).with_source(source)
    })
}

/// An error whose sentence goes on with what is done instead.
pub(crate) fn continued(error: Error, rest: &str) -> Error {
    let continued = Error::new(error.kind(), format!("{error}{rest}"));
    match error.path() {
        Some(path) => continued.with_path(path).with_source(error.clone()),
        None => continued.with_source(error),
    }
}

/// Writes a file beside its place and moves it there, so that at the place there is never half a file. Where a symbolic link leads, there is
/// the place; who may read and write the file stays. Folders above are made.
///
/// # Errors
/// The operating system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = |source| Error::writing(path, source);
    let folder = files::folder_of(path);
    std::fs::create_dir_all(folder).map_err(failed)?;
    if !path.exists() {
        return files::write_whole(path, true, |out| out.write_all(bytes));
    }
    // What must not be written is not replaced either.
    let there = OpenOptions::new().write(true).open(path).map_err(failed)?;
    let permissions = there.metadata().map_err(failed)?.permissions();
    drop(there);
    files::write_whole(path, true, |out| {
        out.write_all(bytes)?;
        out.get_ref().set_permissions(permissions)
    })
}

/// The user's folder.
pub(crate) fn home_folder() -> Option<PathBuf> {
    std::env::var_os("HOME").or_else(|| std::env::var_os("USERPROFILE")).map(PathBuf::from)
}

/// `name-001.ext`, `name-002.ext` ...: the first that does not exist in a folder, and is not one of `taken`.
pub fn next_free(folder: &Path, stem: &str, extension: &str, taken: &[PathBuf]) -> PathBuf {
    let name = |i: u32| folder.join(format!("{stem}-{i:03}.{extension}"));
    let is_free = |path: &PathBuf| !path.exists() && !taken.contains(path);
    (1..10_000).map(name).find(is_free).unwrap_or_else(|| name(10_000))
}
