//! Files that travel in the program: the looks of the gallery, and the models and images that these and the demo show.

use std::path::{Path, PathBuf};

use fantex::base::files::{TemporaryFolder, scratch_folder};
use fantex::{Error, Result};

/// The folder that holds `assets` and `gallery`.
#[derive(Debug)]
pub(crate) struct Shipped {
    folder: PathBuf,
    _temporary: Option<TemporaryFolder>,
}

impl Shipped {
    /// This folder, if it is the project's, whose files may have been changed; else a temporary one with the program's own.
    pub(crate) fn open() -> Result<Self> {
        let here = Path::new("");
        if here.join("gallery/gallery.toml").is_file() && here.join("assets").is_dir() {
            return Ok(Self { folder: here.into(), _temporary: None });
        }
        let temporary = scratch_folder()?;
        let groups = [fantex_gallery::FILES, fantex_assets::FILES, fantex_bottle::FILES];
        for (name, content) in groups.into_iter().flatten() {
            let path = temporary.path().join(name);
            let folder = path.parent().unwrap_or(&path);
            let written = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&path, content));
            written.map_err(|error| Error::writing(&path, error))?;
        }
        Ok(Self { folder: temporary.path().into(), _temporary: Some(temporary) })
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}
