//! Pictures of what is shown: their names, until they are in their files.

use std::path::{Path, PathBuf};

use crate::settings::next_free;
use crate::viewer::{PictureSize, Request, Viewer};

impl Viewer {
    pub(super) fn request_picture(&mut self, times: u32) {
        if self.document.is_some() || self.live.is_some() {
            let path = self.next_picture(&self.stem());
            self.request(Request::Picture { path, size: PictureSize::Times(times) });
        }
    }

    /// A picture is in its file, or will not be.
    pub fn forget_picture(&mut self, path: &Path) {
        self.named_pictures.retain(|named| named != path);
    }

    /// Pictures that were asked for will not be taken.
    pub fn forget_pictures(&mut self) {
        self.named_pictures.clear();
    }

    /// A name for a picture. It may be long until there is a file of it.
    pub(super) fn next_picture(&mut self, stem: &str) -> PathBuf {
        let path = next_free(&self.picture_folder, stem, "png", &self.named_pictures);
        self.named_pictures.push(path.clone());
        path
    }
}
