//! COLMAP's text files.
//!
//! ```text
//! cameras.txt   CAMERA_ID MODEL WIDTH HEIGHT PARAMS...
//! images.txt    IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME
//!               X Y POINT3D_ID ...                             (a line of its own, which may be empty)
//! ```

use std::fs::File;
use std::io;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;
use std::str::{FromStr, SplitAsciiWhitespace};

use super::{
    CameraModel, Cameras, EntryProblem, LONGEST_NAME, Listed, MOST_ENTRIES, ReadCamerasError, checked_name,
    open_within, pose_of_quaternion,
};

/// Text files of COLMAP hold every point that every photograph sees.
const MAX_BYTES: u64 = 64 << 30;
/// Bytes of one line: two million points.
const LONGEST_LINE: u64 = 64 << 20;
/// Parameters of a camera that are looked at.
const MOST_PARAMETERS: usize = 32;

pub(super) fn read_text_cameras(path: &Path) -> Result<Cameras, ReadCamerasError> {
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

pub(super) fn read_text_images(path: &Path, cameras: &Cameras) -> Result<Vec<Listed>, ReadCamerasError> {
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
        let reader = BufReader::with_capacity(1 << 16, open_within(path, MAX_BYTES)?);
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

// ---- COLMAP's binary files, little-endian.
//
// ```text
// cameras.bin   u64 count, then for each: u32 id, i32 model, u64 width, u64 height, f64 parameters
// images.bin    u64 count, then for each: u32 id, f64 quaternion (w x y z), f64 translation, u32 camera, name and a zero byte,
//               u64 points, then for each: f64 x, f64 y, u64 point
// ```

/// Bytes of a point in `images.bin`.
const POINT_BYTES: u64 = 24;

pub(super) fn read_binary_cameras(path: &Path) -> Result<Cameras, ReadCamerasError> {
    let mut file = Numbers::open(path)?;
    let count = file.count("cameras")?;
    let mut cameras = Cameras::new();
    for _ in 0..count {
        let start = file.byte;
        let number = u32::from_le_bytes(file.bytes("a camera")?);
        let model = CameraModel::by_number(i32::from_le_bytes(file.bytes("a camera")?));
        let model = model.map_err(|problem| file.error_at(start, problem))?;
        let size = [u64::from_le_bytes(file.bytes("a camera")?), u64::from_le_bytes(file.bytes("a camera")?)];
        let mut parameters = Vec::with_capacity(model.parameters);
        for _ in 0..model.parameters {
            parameters.push(f64::from_le_bytes(file.bytes("a camera")?));
        }
        let camera = model.camera(size, &parameters).map_err(|problem| file.error_at(start, problem))?;
        if cameras.insert(number, camera).is_some() {
            return Err(file.error_at(start, EntryProblem::Duplicate { camera: number }));
        }
    }
    Ok(cameras)
}

pub(super) fn read_binary_images(path: &Path, cameras: &Cameras) -> Result<Vec<Listed>, ReadCamerasError> {
    let mut file = Numbers::open(path)?;
    let count = file.count("photographs")?;
    let mut images = Vec::new();
    for _ in 0..count {
        let start = file.byte;
        let _number: [u8; 4] = file.bytes("a photograph")?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = f64::from_le_bytes(file.bytes("a photograph")?);
        }
        let camera = u32::from_le_bytes(file.bytes("a photograph")?);
        let name = file.name()?;
        let [w, x, y, z, translation @ ..] = numbers;
        let pose = pose_of_quaternion([w, x, y, z], translation);
        let camera_from_world = pose.map_err(|problem| file.error_at(start, problem))?;
        if !cameras.contains_key(&camera) {
            return Err(file.error_at(start, EntryProblem::UnknownCamera { name, camera }));
        }
        let points = u64::from_le_bytes(file.bytes("a photograph")?);
        file.skip(points.saturating_mul(POINT_BYTES), "the points of a photograph")?;
        images.push(Listed { name, camera, camera_from_world });
    }
    Ok(images)
}

/// A file of numbers, and how far it has been read.
struct Numbers<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    byte: u64,
}

impl<'a> Numbers<'a> {
    fn open(path: &'a Path) -> Result<Self, ReadCamerasError> {
        Ok(Self { path, reader: BufReader::with_capacity(1 << 16, open_within(path, MAX_BYTES)?), byte: 0 })
    }

    fn bytes<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], ReadCamerasError> {
        let mut bytes = [0; N];
        match self.reader.read_exact(&mut bytes) {
            Ok(()) => {
                self.byte += N as u64;
                Ok(bytes)
            }
            Err(source) => Err(self.failed(source, what)),
        }
    }

    /// The number of entries, each of which takes memory.
    fn count(&mut self, what: &'static str) -> Result<u64, ReadCamerasError> {
        let count = u64::from_le_bytes(self.bytes(what)?);
        match count > MOST_ENTRIES as u64 {
            true => Err(self.error_at(0, EntryProblem::TooMany { what, limit: MOST_ENTRIES })),
            false => Ok(count),
        }
    }

    fn name(&mut self) -> Result<String, ReadCamerasError> {
        let (start, mut bytes) = (self.byte, Vec::new());
        let limit = LONGEST_NAME as u64 + 1;
        let read = self.reader.by_ref().take(limit).read_until(0, &mut bytes);
        let read = read.map_err(|source| self.failed(source, "a name"))?;
        self.byte += read as u64;
        if bytes.pop() != Some(0) {
            let problem = match read as u64 == limit {
                true => EntryProblem::Name("longer than 4096 bytes"),
                false => EntryProblem::Truncated { what: "a name" },
            };
            return Err(self.error_at(start, problem));
        }
        let name = String::from_utf8(bytes).map_err(|_| EntryProblem::Name("not UTF-8"));
        name.and_then(|name| checked_name(&name)).map_err(|problem| self.error_at(start, problem))
    }

    fn skip(&mut self, bytes: u64, what: &'static str) -> Result<(), ReadCamerasError> {
        let skipped = io::copy(&mut self.reader.by_ref().take(bytes), &mut io::sink());
        let skipped = skipped.map_err(|source| self.failed(source, what))?;
        match skipped == bytes {
            true => self.byte += bytes,
            false => return Err(self.error_at(self.byte, EntryProblem::Truncated { what })),
        }
        Ok(())
    }

    fn failed(&self, source: io::Error, what: &'static str) -> ReadCamerasError {
        match source.kind() {
            ErrorKind::UnexpectedEof => self.error_at(self.byte, EntryProblem::Truncated { what }),
            _ => ReadCamerasError::Read { path: self.path.into(), source },
        }
    }

    fn error_at(&self, byte: u64, problem: impl Into<EntryProblem>) -> ReadCamerasError {
        ReadCamerasError::Binary { path: self.path.into(), byte, problem: problem.into() }
    }
}
