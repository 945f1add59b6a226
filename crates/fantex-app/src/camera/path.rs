//! Recorded camera paths: keys with times, played back smoothly, kept in a JSON file.

use std::path::Path;

use fantex::base::{Error, Result};
use fantex::glam::DVec3;
use fantex::scene::Camera;
use serde::{Deserialize, Serialize};

use crate::settings::{read_limited, write_whole};

/// Most keys of a path; at 30 per second this is an hour.
const MAX_KEYS: usize = 108_000;

/// Most bytes of a file that is read as a path.
const MAX_FILE_BYTES: u64 = 64 << 20;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraKey {
    /// From the start of the path.
    pub seconds: f64,
    /// The pinhole, world space.
    pub eye: [f64; 3],
    /// A point in the middle of the picture, world space.
    pub target: [f64; 3],
    pub up: [f64; 3],
    /// Vertical opening angle in degrees.
    pub fov_degrees: f64,
}

impl CameraKey {
    pub fn new(seconds: f64, camera: &Camera) -> Self {
        Self {
            seconds,
            eye: camera.eye.to_array(),
            target: camera.target.to_array(),
            up: camera.up.to_array(),
            fov_degrees: camera.fov_degrees,
        }
    }

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
        let text = read_limited(path, MAX_FILE_BYTES, "the camera path")?;
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
