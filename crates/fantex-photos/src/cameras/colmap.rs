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

use fantex_base::{Error, Place, Result};

use super::{
    CameraModel, Cameras, Listed, MAX_ENTRIES, MAX_NAME_BYTES, bad_name, checked_name, open_within,
    pose_of_quaternion, syntax, too_many, truncated, two_cameras, unknown_camera,
};

/// Text files of COLMAP hold every point that every photograph sees.
const MAX_BYTES: u64 = 64 << 30;
/// Bytes of one line: two million points.
const MAX_LINE_BYTES: u64 = 64 << 20;
const MAX_PARAMETERS: usize = 32;

pub(super) fn read_text_cameras(path: &Path) -> Result<Cameras> {
    let mut lines = Lines::open(path)?;
    let mut cameras = Cameras::new();
    while lines.next_entry()? {
        let entry = camera(&lines.text).and_then(|(number, camera)| match cameras.insert(number, camera) {
            Some(_) => Err(two_cameras(number)),
            None if cameras.len() > MAX_ENTRIES => Err(too_many("cameras", MAX_ENTRIES)),
            None => Ok(()),
        });
        entry.map_err(|problem| lines.error(problem))?;
    }
    Ok(cameras)
}

pub(super) fn read_text_images(path: &Path, cameras: &Cameras) -> Result<Vec<Listed>> {
    let mut lines = Lines::open(path)?;
    let mut images = Vec::new();
    while lines.next_entry()? {
        let entry = image(&lines.text).and_then(|listed| {
            if !cameras.contains_key(&listed.camera) {
                return Err(unknown_camera(&listed.name, listed.camera));
            }
            if images.len() == MAX_ENTRIES {
                return Err(too_many("photographs", MAX_ENTRIES));
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

fn camera(text: &str) -> Result<(u32, crate::PhotoCamera)> {
    let mut words = text.split_ascii_whitespace();
    let number = parsed(&mut words, "the number of a camera")?;
    let model = CameraModel::by_name(words.next().unwrap_or_default())?;
    let size = [parsed(&mut words, "the width in pixels")?, parsed(&mut words, "the height in pixels")?];
    let mut parameters = Vec::new();
    for word in words.take(MAX_PARAMETERS) {
        parameters.push(number_of(word, "a parameter of the camera")?);
    }
    Ok((number, model.camera(size, &parameters)?))
}

fn image(text: &str) -> Result<Listed> {
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

fn parsed<T: FromStr>(words: &mut SplitAsciiWhitespace<'_>, expected: &'static str) -> Result<T> {
    number_of(words.next().unwrap_or_default(), expected)
}

fn number_of<T: FromStr>(word: &str, expected: &'static str) -> Result<T> {
    word.parse().map_err(|_| syntax(expected, word))
}

struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    text: String,
    number: usize,
}

impl<'a> Lines<'a> {
    fn open(path: &'a Path) -> Result<Self> {
        let reader = BufReader::with_capacity(1 << 16, open_within(path, MAX_BYTES)?);
        Ok(Self { path, reader, text: String::new(), number: 0 })
    }

    /// The next line that is neither empty nor a comment.
    fn next_entry(&mut self) -> Result<bool> {
        while self.next_line()? {
            let text = self.text.trim();
            if !text.is_empty() && !text.starts_with('#') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The next line; false at the end of the file.
    fn next_line(&mut self) -> Result<bool> {
        let mut bytes = std::mem::take(&mut self.text).into_bytes();
        bytes.clear();
        let read = self.reader.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut bytes);
        let read = read.map_err(|source| Error::reading(self.path, source))?;
        self.number += 1;
        if read as u64 == MAX_LINE_BYTES {
            return Err(self.error(too_many("bytes in a line", MAX_LINE_BYTES as usize)));
        }
        self.text =
            String::from_utf8(bytes).map_err(|_| self.error(syntax("text in UTF-8", "other bytes")))?;
        Ok(read > 0)
    }

    fn error(&self, problem: Error) -> Error {
        problem.at(Place::Line(self.number as u64)).in_file(self.path)
    }
}

// ---- COLMAP's binary files, little-endian.
//
// ```text
// cameras.bin   u64 count, then for each: u32 id, i32 model, u64 width, u64 height, f64 parameters
// images.bin    u64 count, then for each: u32 id, f64 quaternion (w x y z), f64 translation, u32 camera, name and a zero byte,
//               u64 points, then for each: f64 x, f64 y, u64 point
// ```

const POINT_BYTES: u64 = 24;

pub(super) fn read_binary_cameras(path: &Path) -> Result<Cameras> {
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
            return Err(file.error_at(start, two_cameras(number)));
        }
    }
    file.end("camera")?;
    Ok(cameras)
}

pub(super) fn read_binary_images(path: &Path, cameras: &Cameras) -> Result<Vec<Listed>> {
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
            return Err(file.error_at(start, unknown_camera(&name, camera)));
        }
        let points = u64::from_le_bytes(file.bytes("a photograph")?);
        file.skip(points.saturating_mul(POINT_BYTES), "the points of a photograph")?;
        images.push(Listed { name, camera, camera_from_world });
    }
    file.end("photograph")?;
    Ok(images)
}

/// A file of numbers, and how far it has been read.
struct Numbers<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    byte: u64,
}

impl<'a> Numbers<'a> {
    fn open(path: &'a Path) -> Result<Self> {
        Ok(Self { path, reader: BufReader::with_capacity(1 << 16, open_within(path, MAX_BYTES)?), byte: 0 })
    }

    fn bytes<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N]> {
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
    fn count(&mut self, what: &'static str) -> Result<u64> {
        let count = u64::from_le_bytes(self.bytes(what)?);
        match count > MAX_ENTRIES as u64 {
            true => Err(self.error_at(0, too_many(what, MAX_ENTRIES))),
            false => Ok(count),
        }
    }

    fn name(&mut self) -> Result<String> {
        let (start, mut bytes) = (self.byte, Vec::new());
        let limit = MAX_NAME_BYTES as u64 + 1;
        let read = self.reader.by_ref().take(limit).read_until(0, &mut bytes);
        let read = read.map_err(|source| self.failed(source, "a name"))?;
        self.byte += read as u64;
        if bytes.pop() != Some(0) {
            let problem = match read as u64 == limit {
                true => bad_name("longer than 4096 bytes"),
                false => truncated("a name"),
            };
            return Err(self.error_at(start, problem));
        }
        let name = String::from_utf8(bytes).map_err(|_| bad_name("not UTF-8"));
        name.and_then(|name| checked_name(&name)).map_err(|problem| self.error_at(start, problem))
    }

    fn skip(&mut self, bytes: u64, what: &'static str) -> Result<()> {
        let skipped = io::copy(&mut self.reader.by_ref().take(bytes), &mut io::sink());
        let skipped = skipped.map_err(|source| self.failed(source, what))?;
        match skipped == bytes {
            true => self.byte += bytes,
            false => return Err(self.error_at(self.byte, truncated(what))),
        }
        Ok(())
    }

    /// Refuses what comes after the entries that the file counts.
    fn end(&mut self, what: &str) -> Result<()> {
        let rest = self.reader.fill_buf().map_err(|source| Error::reading(self.path, source))?;
        match rest.is_empty() {
            true => Ok(()),
            false => Err(self.error_at(
                self.byte,
                Error::malformed(format!("the file goes on after the last {what} that it counts")),
            )),
        }
    }

    fn failed(&self, source: io::Error, what: &'static str) -> Error {
        match source.kind() {
            ErrorKind::UnexpectedEof => self.error_at(self.byte, truncated(what)),
            _ => Error::reading(self.path, source),
        }
    }

    fn error_at(&self, byte: u64, problem: Error) -> Error {
        problem.at(Place::Byte(byte)).in_file(self.path)
    }
}
