//! COLMAP's text files.
//!
//! ```text
//! cameras.txt   CAMERA_ID MODEL WIDTH HEIGHT PARAMS...
//! images.txt    IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME
//!               X Y POINT3D_ID ...                             (a line of its own, which may be empty)
//! ```

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::str::{FromStr, SplitAsciiWhitespace};

use super::model::{CameraModel, pose_of_quaternion};
use super::{Cameras, EntryProblem, Listed, MOST_ENTRIES, ReadCamerasError, checked_name, open_within};

/// Text files of COLMAP hold every point that every photograph sees.
const MOST_BYTES: u64 = 64 << 30;
/// Bytes of one line: two million points.
const LONGEST_LINE: u64 = 64 << 20;
/// Parameters of a camera that are looked at.
const MOST_PARAMETERS: usize = 32;

pub(super) fn read_cameras(path: &Path) -> Result<Cameras, ReadCamerasError> {
    let mut lines = Lines::open(path)?;
    let mut cameras = Cameras::new();
    while lines.next_entry()? {
        let entry = camera(lines.text()).and_then(|(number, camera)| match cameras.insert(number, camera) {
            Some(_) => Err(EntryProblem::Duplicate { camera: number }),
            None if cameras.len() > MOST_ENTRIES => {
                Err(EntryProblem::TooMany { what: "cameras", limit: MOST_ENTRIES })
            }
            None => Ok(()),
        });
        entry.map_err(|problem| lines.error(problem))?;
    }
    Ok(cameras)
}

pub(super) fn read_images(path: &Path, cameras: &Cameras) -> Result<Vec<Listed>, ReadCamerasError> {
    let mut lines = Lines::open(path)?;
    let mut images = Vec::new();
    while lines.next_entry()? {
        let entry = image(lines.text()).and_then(|listed| {
            if !cameras.contains_key(&listed.camera) {
                return Err(EntryProblem::UnknownCamera { name: listed.name, camera: listed.camera });
            }
            if images.len() == MOST_ENTRIES {
                return Err(EntryProblem::TooMany { what: "photographs", limit: MOST_ENTRIES });
            }
            images.push(listed);
            Ok(())
        });
        entry.map_err(|problem| lines.error(problem))?;
        // The points that the photograph sees.
        lines.next_line()?;
    }
    Ok(images)
}

fn camera(text: &str) -> Result<(u32, crate::PhotoCamera), EntryProblem> {
    let mut words = text.split_ascii_whitespace();
    let number = parsed(&mut words, "the number of a camera")?;
    let model = CameraModel::by_name(words.next().unwrap_or_default())?;
    let size = [parsed(&mut words, "the width in pixels")?, parsed(&mut words, "the height in pixels")?];
    let mut parameters = Vec::new();
    for word in words.take(MOST_PARAMETERS) {
        parameters.push(number_of(word, "a parameter of the camera")?);
    }
    Ok((number, model.camera(size, &parameters)?))
}

fn image(text: &str) -> Result<Listed, EntryProblem> {
    let mut rest = text;
    let mut words = text.split_ascii_whitespace();
    let _number: u32 = parsed(&mut words, "the number of a photograph")?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = parsed(&mut words, "QW QX QY QZ TX TY TZ, seven numbers")?;
    }
    let camera = parsed(&mut words, "the number of a camera")?;
    // Names may hold spaces.
    for _ in 0..9 {
        rest = rest
            .trim_ascii_start()
            .split_once(|c: char| c.is_ascii_whitespace())
            .map_or("", |(_, rest)| rest);
    }
    let [w, x, y, z, translation @ ..] = numbers;
    Ok(Listed {
        name: checked_name(rest.trim())?,
        camera,
        camera_from_world: pose_of_quaternion([w, x, y, z], translation)?,
    })
}

fn parsed<T: FromStr>(
    words: &mut SplitAsciiWhitespace<'_>,
    expected: &'static str,
) -> Result<T, EntryProblem> {
    number_of(words.next().unwrap_or_default(), expected)
}

fn number_of<T: FromStr>(word: &str, expected: &'static str) -> Result<T, EntryProblem> {
    word.parse().map_err(|_| EntryProblem::Syntax { expected, found: word.chars().take(40).collect() })
}

/// Lines of a file, one at a time.
struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    text: String,
    number: usize,
}

impl<'a> Lines<'a> {
    fn open(path: &'a Path) -> Result<Self, ReadCamerasError> {
        let reader = BufReader::with_capacity(1 << 16, open_within(path, MOST_BYTES)?);
        Ok(Self { path, reader, text: String::new(), number: 0 })
    }

    fn text(&self) -> &str {
        &self.text
    }

    /// The next line that is neither empty nor a comment.
    fn next_entry(&mut self) -> Result<bool, ReadCamerasError> {
        while self.next_line()? {
            let text = self.text.trim();
            if !text.is_empty() && !text.starts_with('#') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The next line; false at the end of the file.
    fn next_line(&mut self) -> Result<bool, ReadCamerasError> {
        let mut bytes = std::mem::take(&mut self.text).into_bytes();
        bytes.clear();
        let read = self.reader.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes);
        let read = read.map_err(|source| ReadCamerasError::Read { path: self.path.into(), source })?;
        self.number += 1;
        if read as u64 == LONGEST_LINE {
            return Err(
                self.error(EntryProblem::TooMany { what: "bytes in a line", limit: LONGEST_LINE as usize })
            );
        }
        self.text = String::from_utf8(bytes).map_err(|_| {
            self.error(EntryProblem::Syntax { expected: "text in UTF-8", found: "other bytes".to_owned() })
        })?;
        Ok(read > 0)
    }

    fn error(&self, problem: EntryProblem) -> ReadCamerasError {
        ReadCamerasError::Text { path: self.path.into(), line: self.number, problem }
    }
}
