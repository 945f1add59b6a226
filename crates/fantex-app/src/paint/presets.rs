//! Brushes that the user keeps, in a file of their own.

use std::io;
use std::path::{Path, PathBuf};

use fantex_paint::{Jitter, PressureResponse};
use serde::{Deserialize, Serialize};

use super::BrushSettings;
use crate::settings::{WriteError, write_whole};

/// Most bytes of a file that is read as presets.
const MAX_FILE_BYTES: u64 = 4 << 20;

/// Named brushes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Presets {
    /// In the order in which they are shown.
    pub brushes: Vec<BrushSettings>,
}

/// Presets could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum PresetsError {
    /// They could not be read.
    #[error("cannot read the brushes {}: {source}; there are the usual ones", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// They are damaged.
    #[error("the brushes {} are damaged ({source}); there are the usual ones, and the file stays until one is saved", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// They could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl Default for Presets {
    fn default() -> Self {
        let named = |name: &str| BrushSettings { name: name.into(), ..BrushSettings::default() };
        let none = PressureResponse::default();
        Self {
            brushes: vec![
                named("Soft round"),
                BrushSettings {
                    hardness: 0.95,
                    flow: 1.0,
                    spacing: 0.08,
                    pressure: PressureResponse { size: 0.5, flow: 0.0 },
                    ..named("Hard round")
                },
                BrushSettings { hardness: 0.0, flow: 0.08, spacing: 0.06, size: 140.0, ..named("Airbrush") },
                BrushSettings {
                    hardness: 0.9,
                    flow: 1.0,
                    size: 10.0,
                    smoothing: 0.5,
                    spacing: 0.1,
                    pressure: PressureResponse { size: 0.8, flow: 0.0 },
                    ..named("Ink pen")
                },
                BrushSettings {
                    hardness: 0.8,
                    size: 18.0,
                    flow: 0.8,
                    spacing: 0.9,
                    jitter: Jitter { position: 3.0, size: 0.8, flow: 0.5, angle: 0.0 },
                    pressure: none,
                    ..named("Splatter")
                },
                BrushSettings {
                    hardness: 0.5,
                    flow: 0.35,
                    spacing: 0.25,
                    jitter: Jitter { position: 0.5, size: 0.5, flow: 0.6, angle: 0.0 },
                    pressure: none,
                    ..named("Dry bristle")
                },
            ],
        }
    }
}

impl Presets {
    /// Reads presets; the usual ones where there is no file.
    ///
    /// # Errors
    ///
    /// [`PresetsError`], where there is one that cannot be read.
    pub fn load(path: &Path) -> Result<Self, PresetsError> {
        let failed = |source| PresetsError::Read { path: path.into(), source };
        match std::fs::metadata(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(failed(error)),
            Ok(found) if found.len() > MAX_FILE_BYTES => {
                return Err(failed(io::ErrorKind::FileTooLarge.into()));
            }
            Ok(_) => {}
        }
        let text = std::fs::read(path).map_err(failed)?;
        serde_json::from_slice(&text).map_err(|source| PresetsError::Damaged { path: path.into(), source })
    }

    /// Writes them, whole or not at all.
    ///
    /// # Errors
    ///
    /// [`PresetsError::Write`].
    pub fn save(&self, path: &Path) -> Result<(), PresetsError> {
        let text = serde_json::to_vec_pretty(self).unwrap_or_default();
        Ok(write_whole(path, &text)?)
    }

    /// Keeps a brush under its name; one of that name is replaced.
    pub fn keep(&mut self, brush: &BrushSettings) {
        match self.brushes.iter_mut().find(|known| known.name == brush.name) {
            Some(known) => *known = brush.clone(),
            None => self.brushes.push(brush.clone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_come_back_from_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("brushes.json");
        let mut presets = Presets::load(&path).unwrap();
        assert_eq!(presets, Presets::default());
        presets.keep(&BrushSettings { name: "Mine".into(), size: 7.0, ..BrushSettings::default() });
        presets.keep(&BrushSettings { name: "Mine".into(), size: 9.0, ..BrushSettings::default() });
        presets.save(&path).unwrap();
        let again = Presets::load(&path).unwrap();
        assert_eq!(again, presets);
        assert_eq!(
            again.brushes.iter().filter(|b| b.name == "Mine").map(|b| b.size).collect::<Vec<_>>(),
            [9.0]
        );
        std::fs::write(&path, "{").unwrap();
        assert!(Presets::load(&path).unwrap_err().to_string().contains("damaged"));
    }
}
