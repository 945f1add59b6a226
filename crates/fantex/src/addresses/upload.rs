//! Finished files that are sent to object stores.

use std::path::Path;

use fantex_bake::Progress;
use fantex_base::{Error, Result, files};
use fantex_stream::{ObjectTarget, Replace, World};

use super::{is_address, is_object, watched};
use crate::StoreFolder;

/// A finished file, an asset, a plan or a part, or the index of a world with its assets, that is sent to an object store.
#[derive(Clone, Copy, Debug)]
pub struct Upload<'a> {
    /// The file.
    pub file: &'a Path,
    /// The address of the object.
    pub place: &'a Path,
    /// Whether an object that is there is replaced.
    pub force: bool,
}

/// What was sent.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Uploaded {
    /// Objects: more than one of a world.
    pub objects: u64,
    /// Their bytes.
    pub bytes: u64,
    /// What is to be known, a sentence each.
    pub notes: Vec<String>,
}

impl Upload<'_> {
    /// Refuses, before anything is sent, what could not be. Of the file it is asked whether it is one.
    ///
    /// # Errors
    /// The file is none, or lies at an address; the place is none in a store, or names no world although the file is an index, or the other way
    /// round; as [`ObjectTarget::check`].
    pub fn check(&self) -> Result<()> {
        let (file, place) = (self.file.display(), self.place.display());
        if is_address(self.file) {
            return Err(Error::invalid(format!("{file} is an address; give the path of a file to send")));
        }
        if !is_object(self.place) {
            return Err(Error::invalid(format!(
                "nothing is sent to {place}; give an s3://, gs:// or az:// address"
            )));
        }
        let found = self.file.metadata().map_err(|error| Error::reading(self.file, error))?;
        if !found.is_file() {
            return Err(Error::unsupported(format!(
                "{file} is no file; give a file, or the index of a world (.fanworld), which is sent with its assets"
            )));
        }
        match [self.file, self.place].map(World::is_named) {
            [true, true] => StoreFolder::of_index(self.place, self.force).map(drop),
            [false, false] => ObjectTarget::at(self.place)?.check(self.force),
            _ => Err(Error::invalid(format!(
                "{file} cannot be sent to {place}: of both or of none the name ends with .fanworld, as that of an index does"
            ))),
        }
    }

    /// Sends it, whole or not at all. `progress` counts bytes.
    ///
    /// # Errors
    /// As [`check`](Self::check); as [`ObjectTarget::put`]; a world has assets whose names are not those that [`split()`](crate::split()) gives them.
    /// Then nothing is there that was not there before.
    pub fn run(&self, progress: &dyn Progress) -> Result<Uploaded> {
        self.check()?;
        if World::is_named(self.file) {
            let world = World::open(self.file)?;
            let folder = StoreFolder::of_index(self.place, self.force)?;
            let sent = folder.send(files::folder_of(self.file), world, self.force, progress)?;
            return Ok(Uploaded { objects: sent.objects, bytes: sent.bytes, notes: sent.notes });
        }
        let replace = if self.force { Replace::Anything } else { Replace::Nothing };
        let bytes = self.file.metadata().map_err(|error| Error::reading(self.file, error))?.len();
        let watch = |done, total| watched(progress, done, total);
        ObjectTarget::at(self.place)?.put(self.file, &replace, &watch)?;
        Ok(Uploaded { objects: 1, bytes, notes: Vec::new() })
    }
}
