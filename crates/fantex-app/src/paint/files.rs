//! Files that are painted with: whether they have changed, and what they held when they were read.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use fantex::base::{Result, input};
use fantex::texture::{ColorSpace, Image};

/// When a file was written last, and its length; none where there is no such file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FileState(Option<(SystemTime, u64)>);

impl FileState {
    /// As the system tells it now.
    pub fn of(path: &Path) -> Self {
        let found = std::fs::metadata(path).ok();
        Self(found.and_then(|found| Some((found.modified().ok()?, found.len()))))
    }
}

/// A file and its contents.
#[derive(Clone, Debug)]
pub struct LoadedFile {
    pub path: PathBuf,
    pub bytes: Arc<[u8]>,
}

/// Reads a picture, and keeps what its file held.
pub(crate) fn load_image(path: &Path) -> Result<(LoadedFile, Image)> {
    let bytes: Arc<[u8]> = input::read(path)?.into();
    let image = Image::decode(&bytes, &path.display().to_string(), ColorSpace::Srgb)?;
    Ok((LoadedFile { path: path.to_owned(), bytes }, image))
}
