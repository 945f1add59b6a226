//! Recorded camera paths: keys with times, played back smoothly, kept in a JSON file.

use std::path::Path;

use fantex::base::{Error, ErrorKind, Result};
use fantex::glam::DVec3;
use fantex::scene::Camera;
use serde::{Deserialize, Serialize};

use crate::settings::write_whole;

/// Most keys of a path; at 30 per second this is an hour.
const MAX_KEYS: usize = 108_000;

/// Most bytes of a file that is read as a path.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// Where the camera is at one time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraKey {
    /// From the start of the path.
    pub seconds: f64,
    /// The pinhole, world space.
    pub eye: [f64; 3],
    /// A point in the middle of the picture, world space.
    pub target: [f64; 3],
    /// Upwards in the picture.
    pub up: [f64; 3],
    /// Vertical opening angle in degrees.
    pub fov_degrees: f64,
}

impl CameraKey {
    /// A camera at a time.
    pub fn new(seconds: f64, camera: &Camera) -> Self {
        Self {
            seconds,
            eye: camera.eye.to_array(),
            target: camera.target.to_array(),
            up: camera.up.to_array(),
            fov_degrees: camera.fov_degrees,
        }
    }

    /// Its camera.
    pub fn camera(&self) -> Camera {
        Camera {
            eye: DVec3::from_array(self.eye),
            target: DVec3::from_array(self.target),
            up: DVec3::from_array(self.up),
            fov_degrees: self.fov_degrees,
        }
    }
}

/// A camera's way: at least one key, times ascending from zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// The keys.
    pub keys: Vec<CameraKey>,
}

impl CameraPath {
    /// Reads and checks a path.
    ///
    /// # Errors
    ///
    /// The file cannot be read or is no path.
    pub fn load(path: &Path) -> Result<Self> {
        let name = path.display();
        let failed = |source: std::io::Error| {
            let sentence = format!("cannot read the camera path {name}: {source}");
            Error::new(ErrorKind::Io, sentence).with_path(path).with_source(source)
        };
        let bytes = std::fs::metadata(path).map_err(failed)?.len();
        if bytes > MAX_FILE_BYTES {
            let sentence = format!(
                "{name} has {bytes} bytes, more than the {MAX_FILE_BYTES} that a camera path may have"
            );
            return Err(Error::too_large(sentence).with_path(path));
        }
        let text = std::fs::read(path).map_err(failed)?;
        let found: Self = serde_json::from_slice(&text).map_err(|source| {
            Error::malformed(format!("{name} is no camera path: {source}"))
                .with_path(path)
                .with_source(source)
        })?;
        found.check(path)?;
        Ok(found)
    }

    /// Writes the path, whole or not at all.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut text =
            serde_json::to_vec_pretty(self).map_err(|source| Error::writing(path, source.into()))?;
        text.push(b'\n');
        write_whole(path, &text)
    }

    fn check(&self, path: &Path) -> Result<()> {
        let (count, name) = (self.keys.len(), path.display());
        let refused = |sentence: String| Err(Error::malformed(sentence).with_path(path));
        if !(1..=MAX_KEYS).contains(&count) {
            return refused(format!("{name} has {count} camera keys; a path has 1 to {MAX_KEYS}"));
        }
        let mut earliest = 0.0;
        for (key, found) in self.keys.iter().enumerate() {
            let seconds = found.seconds;
            if !(seconds >= earliest && seconds.is_finite()) {
                return refused(format!(
                    "{name}: key {key} is at {seconds} s; times must start at 0 or later and ascend"
                ));
            }
            earliest = seconds;
            if let Some(defect) = found.camera().defect() {
                return refused(format!("{name}: the camera of key {key} cannot take a picture: {defect}"));
            }
        }
        Ok(())
    }

    /// Seconds from the start to the last key.
    pub fn seconds(&self) -> f64 {
        self.keys.last().map_or(0.0, |key| key.seconds)
    }

    /// The camera at a time; before and after the path that of its ends. Between keys eye, target, up and opening angle
    /// change linearly: recorded keys lie a thirtieth of a second apart.
    pub fn camera_at(&self, seconds: f64) -> Option<Camera> {
        let next = self.keys.partition_point(|key| key.seconds <= seconds);
        let after = self.keys.get(next);
        let Some(before) = next.checked_sub(1).map(|i| &self.keys[i]) else {
            return after.map(CameraKey::camera);
        };
        let Some(after) = after else { return Some(before.camera()) };
        let t = (seconds - before.seconds) / (after.seconds - before.seconds);
        let [a, b] = [before.camera(), after.camera()];
        let between = Camera {
            eye: a.eye.lerp(b.eye, t),
            target: a.target.lerp(b.target, t),
            up: a.up.lerp(b.up, t),
            fov_degrees: a.fov_degrees + (b.fov_degrees - a.fov_degrees) * t,
        };
        // Halfway between opposite views there may be no camera.
        Some(if between.defect().is_none() { between } else { a })
    }
}

/// A recording under way.
#[derive(Clone, Debug, Default)]
pub struct PathRecorder {
    keys: Vec<CameraKey>,
}

impl PathRecorder {
    /// Seconds between keys.
    const INTERVAL: f64 = 1.0 / 30.0;

    /// Takes the camera at a time since the recording began; more often than 30 times a second counts once.
    pub fn take(&mut self, seconds: f64, camera: &Camera) {
        let is_due = self.keys.last().is_none_or(|last| seconds >= last.seconds + Self::INTERVAL);
        if is_due && self.keys.len() < MAX_KEYS && camera.defect().is_none() {
            self.keys.push(CameraKey::new(seconds.max(0.0), camera));
        }
    }

    /// Seconds that have been recorded.
    pub fn seconds(&self) -> f64 {
        self.keys.last().map_or(0.0, |key| key.seconds)
    }

    /// Ends the recording with the camera where it is now.
    pub fn finish(mut self, seconds: f64, camera: &Camera) -> Option<CameraPath> {
        if self.keys.last().is_none_or(|last| seconds > last.seconds) && camera.defect().is_none() {
            self.keys.push(CameraKey::new(seconds.max(0.0), camera));
        }
        (!self.keys.is_empty()).then_some(CameraPath { keys: self.keys })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(x: f64) -> Camera {
        Camera { eye: DVec3::new(x, 1.0, 5.0), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 40.0 }
    }

    fn recorded() -> CameraPath {
        let mut recorder = PathRecorder::default();
        for frame in 0..=120 {
            let seconds = f64::from(frame) / 60.0;
            recorder.take(seconds, &camera(seconds));
        }
        recorder.finish(2.0, &camera(2.0)).unwrap()
    }

    #[test]
    fn recordings_play_back_as_they_were() {
        let path = recorded();
        assert!((40..80).contains(&path.keys.len()), "{}", path.keys.len());
        assert_eq!(path.seconds(), 2.0);
        for seconds in [0.0, 0.31, 1.0, 1.999] {
            assert!((path.camera_at(seconds).unwrap().eye.x - seconds).abs() < 1e-9);
        }
        assert_eq!(path.camera_at(-1.0).unwrap().eye.x, 0.0);
        assert_eq!(path.camera_at(99.0).unwrap().eye.x, 2.0);
    }

    #[test]
    fn files_keep_paths() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("way.json");
        recorded().save(&file).unwrap();
        assert_eq!(CameraPath::load(&file).unwrap(), recorded());
    }

    #[test]
    fn what_is_no_path_is_refused_in_a_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("way.json");
        let message = |text: &str| {
            std::fs::write(&file, text).unwrap();
            CameraPath::load(&file).unwrap_err().to_string()
        };
        assert!(message("{").contains("no camera path"));
        assert!(message("{\"keys\":[]}").contains("0 camera keys"));
        let key = |seconds: f64, eye: f64| {
            format!(
                "{{\"seconds\":{seconds},\"eye\":[{eye},0,0],\"target\":[0,0,0],\"up\":[0,1,0],\"fov_degrees\":40}}"
            )
        };
        assert!(message(&format!("{{\"keys\":[{},{}]}}", key(1.0, 1.0), key(0.5, 1.0))).contains("key 1"));
        assert!(message(&format!("{{\"keys\":[{}]}}", key(0.0, 0.0))).contains("same point"));
        assert!(
            CameraPath::load(&folder.path().join("none")).unwrap_err().to_string().contains("cannot read")
        );
    }
}
