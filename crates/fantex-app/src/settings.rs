//! What the viewer remembers from one start to the next.

use std::io;
use std::path::{Path, PathBuf};

use fantex::base::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::camera::{CameraMode, FlyMotion};
use crate::display::DisplaySettings;
use crate::light::LightSettings;
use crate::paint::PaintSettings;

/// How many recent files are remembered.
const MAX_RECENT: usize = 12;

/// Most bytes of a file that is read as settings.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Everything that is remembered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// The window.
    pub window: WindowSettings,
    /// How the camera moves.
    pub camera: CameraSettings,
    /// Which panels are shown.
    pub panels: PanelSettings,
    /// The light.
    pub light: LightSettings,
    /// How the scene is shown.
    pub display: DisplaySettings,
    /// Memory and speed of streaming.
    pub streaming: StreamingSettings,
    /// Tools, brush and colours.
    pub paint: PaintSettings,
    /// Files that were opened, the last one first.
    pub recent: Vec<String>,
}

/// The window's place.
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

/// How the camera moves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CameraSettings {
    /// Orbit, fly or walk.
    pub mode: CameraMode,
    /// Vertical opening angle in degrees, 10 to 120.
    pub fov_degrees: f64,
    /// Factor of the speed of flight.
    pub fly_speed: f64,
    /// Factor of the speed of walking.
    pub walk_speed: f64,
    /// Height of a walker's eyes in world units; chosen by the model's size without.
    pub eye_height: Option<f64>,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self { mode: CameraMode::Orbit, fov_degrees: 35.0, fly_speed: 1.0, walk_speed: 1.0, eye_height: None }
    }
}

/// A page of the inspector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tab {
    /// What the model is.
    #[default]
    Model,
    /// How it is covered by tiles.
    Cover,
    /// What is resident.
    Streaming,
    /// Sun and surroundings.
    Light,
    /// Camera and picture.
    View,
}

impl Tab {
    /// All pages from left to right.
    pub const ALL: [Self; 5] = [Self::Model, Self::Cover, Self::Streaming, Self::Light, Self::View];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Model => "Model",
            Self::Cover => "Cover",
            Self::Streaming => "Streaming",
            Self::Light => "Light",
            Self::View => "View",
        }
    }
}

/// Which panels are shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PanelSettings {
    /// The inspector at the right.
    pub has_inspector: bool,
    /// Its page.
    pub tab: Tab,
    /// The live atlas beside the scene.
    pub has_atlas: bool,
    /// The graphs below the scene.
    pub has_graphs: bool,
}

impl Default for PanelSettings {
    fn default() -> Self {
        Self { has_inspector: true, tab: Tab::Model, has_atlas: false, has_graphs: false }
    }
}

/// Memory and speed of streaming.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct StreamingSettings {
    /// Graphics memory for texels, mebibytes.
    pub pool_mib: u32,
    /// Texels that go to the graphics memory in one frame, kibibytes.
    pub upload_kib: u32,
    /// Whether pages are loaded; off, what is there stays.
    pub is_running: bool,
}

impl Default for StreamingSettings {
    fn default() -> Self {
        Self { pool_mib: 64, upload_kib: 4096, is_running: true }
    }
}

impl StreamingSettings {
    /// Least and most memory, mebibytes.
    pub const POOL_MIB: [u32; 2] = [1, 4096];
    /// Least and most texels of a frame, kibibytes.
    pub const UPLOAD_KIB: [u32; 2] = [64, 65536];

    /// Graphics memory for texels in bytes.
    pub fn pool_bytes(&self) -> u64 {
        u64::from(self.pool_mib) << 20
    }

    /// Texels of a frame in bytes.
    pub fn upload_bytes(&self) -> usize {
        (self.upload_kib as usize) << 10
    }
}

impl Settings {
    /// Reads the settings. Without a file they are the usual ones; a damaged file is renamed, and the settings are the usual
    /// ones, too.
    pub fn load(path: &Path) -> (Self, Option<Error>) {
        match read_limited(path) {
            Ok(bytes) => match serde_json::from_slice::<Self>(&bytes) {
                Ok(settings) => (settings.sanitized(), None),
                Err(source) => {
                    let aside = path.with_extension("damaged.json");
                    // Where it cannot be renamed it will be replaced when the program ends.
                    std::fs::rename(path, &aside).ok();
                    let sentence = format!(
                        "the settings {} are damaged ({source}); they were set aside as {}",
                        path.display(),
                        aside.display()
                    );
                    (Self::default(), Some(Error::malformed(sentence).with_path(path).with_source(source)))
                }
            },
            Err(error) if error.kind() == io::ErrorKind::NotFound => (Self::default(), None),
            Err(source) => {
                let sentence = format!(
                    "cannot read the settings {}: {source}; starting with the usual ones",
                    path.display()
                );
                (
                    Self::default(),
                    Some(Error::new(ErrorKind::Io, sentence).with_path(path).with_source(source)),
                )
            }
        }
    }

    /// Writes the settings, whole or not at all.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_vec_pretty(self).map_err(|source| Error::writing(path, source.into()))?;
        write_whole(path, &text)
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
        let [least, most] = StreamingSettings::UPLOAD_KIB;
        self.streaming.upload_kib = self.streaming.upload_kib.clamp(least, most);
        self.light = self.light.sanitized();
        self.display = self.display.sanitized();
        self.recent.truncate(MAX_RECENT);
        self
    }
}

fn read_limited(path: &Path) -> io::Result<Vec<u8>> {
    if std::fs::metadata(path)?.len() > MAX_FILE_BYTES {
        return Err(io::ErrorKind::FileTooLarge.into());
    }
    std::fs::read(path)
}

/// Writes a file beside its place and moves it there, so that at the place there is never half a file. Folders above are made.
///
/// # Errors
///
/// The operating system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = |source| Error::writing(path, source);
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let mut name = path.file_name().ok_or_else(|| failed(io::ErrorKind::InvalidFilename.into()))?.to_owned();
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path));
    written.map_err(|source| {
        // The reason why writing failed matters, not whether a rest could be removed.
        std::fs::remove_file(&part).ok();
        failed(source)
    })
}

/// `name-001.ext`, `name-002.ext` ...: the first that does not exist in a folder.
pub fn next_free(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    let name = |i: u32| folder.join(format!("{stem}-{i:03}.{extension}"));
    (1..10_000).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(10_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings.json");
        std::fs::write(&path, text).unwrap();
        (folder, path)
    }

    #[test]
    fn settings_come_back() {
        let (_folder, path) = file("{}");
        let mut settings = Settings::default();
        settings.camera.mode = CameraMode::Walk;
        settings.panels.tab = Tab::Light;
        settings.remember("a.glb");
        settings.save(&path).unwrap();
        let (again, problem) = Settings::load(&path);
        assert_eq!(again, settings);
        assert!(problem.is_none());
    }

    #[test]
    fn a_first_start_has_no_file_and_no_problem() {
        let folder = tempfile::tempdir().unwrap();
        let (settings, problem) = Settings::load(&folder.path().join("none.json"));
        assert_eq!(settings, Settings::default());
        assert!(problem.is_none());
    }

    #[test]
    fn damaged_settings_are_set_aside_and_reported() {
        for text in ["{\"camera\":", "[1]", "\0\0\0", "{\"camera\":{\"mode\":\"swim\"}}"] {
            let (_folder, path) = file(text);
            let (settings, problem) = Settings::load(&path);
            assert_eq!(settings, Settings::default());
            let problem = problem.unwrap().to_string();
            let aside = path.with_extension("damaged.json");
            assert!(problem.contains(&aside.display().to_string()), "{text}: {problem}");
            assert_eq!(std::fs::read_to_string(aside).unwrap(), text);
            assert!(!path.exists());
        }
    }

    #[test]
    fn nonsense_numbers_are_brought_into_range() {
        let (_folder, path) = file(
            r#"{"window":{"size":[0,1e30]},"camera":{"fov_degrees":-4},"streaming":{"pool_mib":0},"display":{"anisotropy":5}}"#,
        );
        let (settings, problem) = Settings::load(&path);
        assert!(problem.is_none());
        assert_eq!(settings.window.size, [1280.0, 16_384.0]);
        assert_eq!(settings.camera.fov_degrees, 10.0);
        assert_eq!(settings.streaming.pool_mib, 1);
        assert_eq!(settings.display.anisotropy, 8);
    }

    #[test]
    fn the_last_file_is_the_first_of_the_recent_ones() {
        let mut settings = Settings::default();
        (0..20).for_each(|i| settings.remember(&format!("{i}.glb")));
        settings.remember("15.glb");
        assert_eq!(settings.recent[..3], ["15.glb", "19.glb", "18.glb"]);
        assert_eq!(settings.recent.len(), MAX_RECENT);
    }

    #[test]
    fn folders_are_made_and_files_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/c.txt");
        write_whole(&path, b"first").unwrap();
        write_whole(&path, b"second").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no rest is left");
    }

    #[test]
    fn failures_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("file"), b"").unwrap();
        let error = write_whole(&folder.path().join("file/below"), b"").unwrap_err();
        assert!(error.to_string().contains("below"));
    }

    #[test]
    fn names_count_up() {
        let folder = tempfile::tempdir().unwrap();
        let first = next_free(folder.path(), "bunny", "png");
        assert!(first.ends_with("bunny-001.png"));
        std::fs::write(first, b"").unwrap();
        assert!(next_free(folder.path(), "bunny", "png").ends_with("bunny-002.png"));
    }
}
