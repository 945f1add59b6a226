//! COLMAP's binary files, little-endian.
//!
//! ```text
//! cameras.bin   u64 count, then for each: u32 id, i32 model, u64 width, u64 height, f64 parameters
//! images.bin    u64 count, then for each: u32 id, f64 quaternion (w x y z), f64 translation, u32 camera, name and a zero byte,
//!               u64 points, then for each: f64 x, f64 y, u64 point
//! ```

use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

use super::model::{CameraModel, pose_of_quaternion};
use super::{
    Cameras, EntryProblem, LONGEST_NAME, Listed, MOST_ENTRIES, ReadCamerasError, checked_name, open_within,
};

const MOST_BYTES: u64 = 64 << 30;
/// Bytes of a point in `images.bin`.
const POINT_BYTES: u64 = 24;

pub(super) fn read_cameras(path: &Path) -> Result<Cameras, ReadCamerasError> {
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

pub(super) fn read_images(path: &Path, cameras: &Cameras) -> Result<Vec<Listed>, ReadCamerasError> {
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
        Ok(Self { path, reader: BufReader::with_capacity(1 << 16, open_within(path, MOST_BYTES)?), byte: 0 })
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
