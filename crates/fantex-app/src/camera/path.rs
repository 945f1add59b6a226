//! Camera paths: recorded, and kept in JSON files.

use std::path::Path;

use fantex::base::{Error, Result, json_problem};
use fantex::glam::DVec3;
use fantex::scene::Camera;
use fantex::stream::{CameraKeyframe, CameraPath, MAX_PATH_SECONDS};

use crate::settings::{read_limited, write_whole};

/// Most keys of a path; at 30 per second this is an hour.
const MAX_KEYS: usize = 108_000;

/// Most bytes of a file that is read as a path.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// The camera of a keyframe.
pub fn camera_of(key: &CameraKeyframe) -> Camera {
    Camera {
        eye: DVec3::from_array(key.eye),
        target: DVec3::from_array(key.target),
        up: DVec3::from_array(key.up),
        fov_degrees: key.fov_degrees,
    }
}

/// Reads and checks a path: at least one key, times ascending from zero.
///
/// # Errors
/// The file cannot be read or is no path.
pub fn load_path(path: &Path) -> Result<CameraPath> {
    let name = path.display();
    let refused = |sentence: String| Error::malformed(sentence).with_path(path);
    let text = read_limited(path, MAX_FILE_BYTES, "the camera path")?;
    let found: CameraPath = serde_json::from_slice(&text).map_err(|source| {
        json_problem(&text, &source).context(format_args!("{name} is no camera path")).with_path(path)
    })?;
    let count = found.keyframes.len();
    if !(1..=MAX_KEYS).contains(&count) {
        return Err(refused(format!("{name} has {count} camera keys; a path has 1 to {MAX_KEYS}")));
    }
    let mut earliest = 0.0;
    for (number, key) in found.keyframes.iter().enumerate() {
        let seconds = key.seconds;
        if !(earliest..=MAX_PATH_SECONDS).contains(&seconds) {
            return Err(refused(format!(
                "{name}: key {number} is at {seconds} s; times must start at 0 or later, ascend and end within a day"
            )));
        }
        earliest = seconds;
        if let Some(defect) = camera_of(key).defect() {
            return Err(refused(format!(
                "{name}: the camera of key {number} cannot take a picture: {defect}"
            )));
        }
    }
    Ok(found)
}

/// Writes a path, whole or not at all.
///
/// # Errors
/// The file cannot be written.
pub fn save_path(found: &CameraPath, path: &Path) -> Result<()> {
    let mut text = serde_json::to_vec_pretty(found).map_err(|source| Error::writing(path, source.into()))?;
    text.push(b'\n');
    write_whole(path, &text)
}

#[derive(Clone, Debug, Default)]
pub struct PathRecorder {
    keys: Vec<CameraKeyframe>,
}

impl PathRecorder {
    /// Seconds between keys.
    const INTERVAL: f64 = 1.0 / 30.0;

    /// Takes the camera at a time since the recording began; more often than 30 times a second counts once.
    pub fn take(&mut self, seconds: f64, camera: &Camera) {
        let is_due = self.keys.last().is_none_or(|last| seconds >= last.seconds + Self::INTERVAL);
        if is_due && self.keys.len() < MAX_KEYS && camera.defect().is_none() {
            self.keys.push(keyframe(seconds, camera));
        }
    }

    /// Ends the recording with the camera where it is now.
    pub fn finish(mut self, seconds: f64, camera: &Camera) -> Option<CameraPath> {
        if self.keys.last().is_none_or(|last| seconds > last.seconds) && camera.defect().is_none() {
            self.keys.push(keyframe(seconds, camera));
        }
        (!self.keys.is_empty()).then_some(CameraPath { keyframes: self.keys })
    }
}

fn keyframe(seconds: f64, camera: &Camera) -> CameraKeyframe {
    CameraKeyframe {
        seconds: seconds.max(0.0),
        eye: camera.eye.to_array(),
        target: camera.target.to_array(),
        up: camera.up.to_array(),
        fov_degrees: camera.fov_degrees,
        is_cut: false,
    }
}
