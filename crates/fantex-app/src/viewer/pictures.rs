//! Names that the program finds itself: of pictures, until they are in their files, and of what is saved where no file can be chosen.

use std::path::{Path, PathBuf};

use fantex::base::files::{folder_of, temporary_file};

use crate::document::Place;
use crate::settings::{home_folder, next_free};
use crate::viewer::{FileDialog, PictureSize, Request, Viewer};

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

    /// Goes on where this system shows no file dialogs: what was to be saved gets a name beside what is open.
    pub fn go_on_without(&mut self, dialog: FileDialog) {
        let named = |path: &Path, what: &str, extension: &str| {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            next_free(&self.writable_folder(path), &format!("{stem}-{what}"), extension, &[])
        };
        let path = match &dialog {
            FileDialog::SaveCopy(asset) => named(asset, "copy", "fan"),
            FileDialog::Export(asset, settings) => named(asset, "export", settings.preset.extension()),
            FileDialog::SavePath => match self.document.as_ref().map(|document| &document.place) {
                Some(Place::File(path)) => named(path, "path", "json"),
                _ => named(&self.picture_folder.join(self.stem()), "path", "json"),
            },
            _ => {
                return self.notices.warning(
                    "This system shows no file dialog: drop the file onto the window, or name it on the command line.",
                );
            }
        };
        self.notices.warning(format!("This system shows no file dialog: {} is written.", path.display()));
        self.take_file(dialog, path);
    }

    /// The folder of a file, or where nothing can be written there the user's, or that of pictures.
    fn writable_folder(&self, path: &Path) -> PathBuf {
        let folders = [Some(folder_of(path).to_owned()), home_folder(), Some(self.picture_folder.clone())];
        let is_writable = |folder: &PathBuf| temporary_file(&folder.join("fantex"), "").is_ok();
        let found = folders.into_iter().flatten().find(is_writable);
        found.unwrap_or_else(|| folder_of(path).to_owned())
    }
}
